"""The native part; the package's own modules document what it does."""

from collections.abc import Callable
from typing import Any

__version__: str

_Camera = tuple[list[float], list[float], str, list[float], int, int]

def protocol_names() -> list[str]: ...
def metric_definitions() -> list[tuple[str, str, int, str]]: ...

class Protocol:
    name: str
    title: str
    hash: str
    toml: str
    metrics: list[str]
    settings: list[str]
    def __init__(self, name_or_path: str) -> None: ...
    def open(
        self,
        data: str,
        index: str | None,
        sampler: str | None,
        any_size: bool,
        frames: str | None,
        images: int | None,
        prefer_undistorted: bool,
    ) -> Data: ...

class Data:
    name: str
    warnings: list[tuple[str, int, str]]
    def entries(self) -> list[tuple[str, int]]: ...
    def missing(self) -> list[tuple[str, int]]: ...
    def trials(self, setting: str, limit: int | None, only: tuple[str, int] | None, ahead: bool) -> Trials: ...

class Trials:
    def next(self) -> tuple[Trial | None, tuple[str, int, str, str] | None] | None: ...
    def left(self) -> int: ...

class Input:
    scene: str
    entry: int
    hash: str
    overlap: float | None
    near_far: tuple[float, float]
    def context_images(self) -> Any: ...
    def context_cameras(self) -> tuple[list[_Camera], list[int]]: ...
    def target_cameras(self) -> tuple[list[_Camera], list[int]]: ...

class Trial:
    def input(self) -> Input: ...
    def target_images(self) -> Any: ...
    def score_images(self, shape: list[int], kind: str, bytes: bytes, suite: Suite) -> str: ...
    def score_gaussians(self, gaussians: Gaussians, suite: Suite) -> str: ...

class Suite:
    ids: list[str]
    def __init__(self, ids: list[str], weights: str | None, data: Data | None) -> None: ...
    def score(self, shape: list[int], renders: tuple[str, bytes], truths: tuple[str, bytes]) -> list[list[float]]: ...

class Gaussians:
    sh_degree: int
    means: Any
    quaternions: Any
    log_scales: Any
    opacity_logits: Any
    sh: Any
    scalars: Any | None
    filter_3d: Any | None
    @staticmethod
    def from_bytes(
        arrays: list[bytes], coefficients: int, scalars: bytes | None, filter_3d: bytes | None
    ) -> Gaussians: ...
    @staticmethod
    def read(path: str, opacities_as_stored: bool) -> tuple[Gaussians, list[str]]: ...
    def write(self, path: str, antialiased: bool) -> list[str]: ...
    def __len__(self) -> int: ...

def render(
    gaussians: Gaussians,
    cameras: list[_Camera],
    background: list[float],
    constants: str,
    antialiased: bool,
    depth: bool,
) -> tuple[list[Any], int, str | None]: ...
def evaluate(
    method: Any, record: str, data: list[Data], settings: dict[str, Any], progress: Callable[[], None] | None
) -> str | None: ...
def read_store(folder: str) -> tuple[str, str, str, str, str]: ...
def merge_stores(stores: list[str], out: str, partial: bool) -> None: ...
def tables(stores: list[str], force: bool) -> list[tuple[str, str, list[str]]]: ...
def write_report(stores: list[str], out: str, title: str, force: bool) -> list[Any]: ...
def compare_with_baseline(store: str, baseline: str, probe: bool) -> tuple[str, str, bool, list[str]]: ...
def accept_baseline(
    store: str, baseline: str, why: str, repeats: list[str], limits: list[tuple[str, float]]
) -> list[str]: ...
