"""Protocols and their trials: what a method may see of a scene, and the views that it has to render."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike, fspath
from typing import Any

import numpy as np

from . import _native
from ._arrays import images as stored_images
from ._arrays import invalid
from .cameras import Cameras
from .gaussians import Gaussians

Path = str | PathLike


def protocols() -> list[str]:
    """Names of the built-in protocols."""
    return _native.protocol_names()


def protocol(name: str | Path) -> Protocol:
    """A built-in protocol by name, or the one in a TOML file (a path that ends in ``.toml``)."""
    return Protocol(fspath(name))


class Protocol:
    """Everything that defines a benchmark number except the method and the data."""

    def __init__(self, name: str) -> None:
        self._native = _native.Protocol(name)
        self._source = name
        #: Its name in results.
        self.name: str = self._native.name
        #: One line about it.
        self.title: str = self._native.title
        #: SHA-256 of everything in it that can change a number.
        self.hash: str = self._native.hash

    def __reduce__(self) -> tuple:
        return Protocol, (self._source,)

    def __repr__(self) -> str:
        return f"Protocol({self.name!r}): {self.title}"

    @property
    def toml(self) -> str:
        """The whole protocol as TOML."""
        return self._native.toml

    @property
    def settings(self) -> list[str]:
        """Methods that published another pose normalisation, or other near and far planes, under this protocol."""
        return self._native.settings

    def open(
        self,
        data: Path | Data,
        *,
        index: Path | None = None,
        sampler: str | None = None,
        any_size: bool = False,
        frames: Path | None = None,
        images: int | None = None,
    ) -> Data:
        """Opens a dataset; its format is detected.

        Args:
            data: RE10K trajectories, ``.torch`` chunks, a ``transforms.json``, a COLMAP model, or a folder of them.
            index: the evaluation index (JSON), or a folder in which the published one is found by its hash; by default
                ``PROTOCOL.json`` or ``evaluation_index.json`` next to the data.
            sampler: instead of an index, for data without a published one: a rule that chooses frames, by name or as a ``.toml``.
            any_size: accept images of any size, which changes the protocol's hash.
            frames: folder of the frames of trajectories or a COLMAP model, if they are not next to the poses.
            images: which copy of a capture's images: 1 for ``images``, 2, 4 or 8 for ``images_2`` …

        Raises:
            InvalidError: also for an argument that data of the detected format does not read.
        """
        if isinstance(data, Data):
            if data.protocol.hash != self.hash:
                raise invalid("data", f"expected data opened for {self.name}, found {data.protocol.name}'s")
            if any((index, sampler, any_size, frames, images)):
                raise invalid("data", "is open already: its index, sampler and images were chosen then")
            return data
        path = None if index is None else fspath(index)
        root = None if frames is None else fspath(frames)
        return Data(self, self._native.open(fspath(data), path, sampler, any_size, root, images))

    def trials(
        self,
        data: Path | Data,
        *,
        limit: int | None = None,
        setting: str = "ATSplat",
        metrics: Sequence[str] = (),
        weights: Path | None = None,
        **options: Any,
    ) -> Trials:
        """Goes through the trials, in the index's order; scenes are read and decoded ahead.

        Args:
            limit: at most this many scenes, spread evenly over the index.
            setting: whose published pose normalisation, near and far planes (see :attr:`settings`).
            metrics: in addition to the protocol's own, by id (:func:`atsplat.metrics`), for :meth:`Trial.score`.
            weights: folder of LPIPS weights, searched before torch's cache.
            options: as for :meth:`open`.
        """
        return Trials(self.open(data, **options), limit, setting, tuple(metrics), weights)


class Data:
    """A dataset opened for a protocol, with its index."""

    def __init__(self, of: Protocol, native: Any) -> None:
        self.protocol = of
        self._native = native
        #: Counts of problems that were found while it was opened, by kind.
        self.warnings: dict[str, int] = dict(native.warnings)

    @property
    def entries(self) -> list[tuple[str, int]]:
        """Scenes of the index that are in the data, each with its number of entries."""
        return self._native.entries()


@dataclass(frozen=True)
class Skipped:
    """An entry of the index without a trial."""

    scene: str
    entry: int
    reason: str
    detail: str


class Trials:
    """An iterator over trials."""

    def __init__(self, data: Data, limit: int | None, setting: str, metrics: tuple[str, ...], weights: Path | None) -> None:
        check_setting(data.protocol, setting)
        self.data = data
        self._trials = data._native.trials(setting, limit, None, True)
        self._suite = suite(metrics, weights, data)
        #: Entries of the index that gave no trial so far, with the reason.
        self.skipped: list[Skipped] = []

    def __len__(self) -> int:
        """Trials that are left, and entries that may turn out to have none."""
        return self._trials.left()

    def __iter__(self) -> Iterator[Trial]:
        return self

    def __next__(self) -> Trial:
        while (outcome := self._trials.next()) is not None:
            trial, skipped = outcome
            if trial is not None:
                return Trial(trial, self._suite)
            self.skipped.append(Skipped(*skipped))
        raise StopIteration


def check_setting(of: Protocol, setting: str) -> None:
    """A typing error must not choose the protocol's own setting in silence."""
    known = ["ATSplat", *of.settings]
    if setting.lower() not in [name.lower() for name in known]:
        raise invalid("setting", f"expected one of {', '.join(dict.fromkeys(known))}, found {setting!r}")


def suite(metrics: Sequence[str], weights: Path | None, data: Data | None = None) -> Any:
    """The metrics of a protocol and more of them, with loaded weights."""
    folder = None if weights is None else fspath(weights)
    return _native.Suite(list(metrics), folder, None if data is None else data._native)


class Views:
    """Cameras of a trial's views, and their images where a method may see them."""

    def __init__(self, cameras: Cameras, images: Any = None) -> None:
        #: The cameras, in the trial's normalised world.
        self.cameras = cameras
        self._images = images

    def __len__(self) -> int:
        return len(self.cameras)

    @cached_property
    def images(self) -> np.ndarray:
        """V × H × W × 3, float32 in [0, 1], after the protocol's crop and resizing."""
        if self._images is None:
            raise AttributeError("a method may not see the images of targets")
        return self._images()


@dataclass(frozen=True)
class Scores:
    """Scores of one trial."""

    #: For each target: its ``frame``, ``status``, why it failed as ``detail``, and a number for each metric id (None if it was not
    #: computed, with the reason in ``not_computed``; a PSNR of identical images is infinite).
    targets: list[dict[str, Any]]
    #: Metrics by id, over the targets that have a finite number. As in tables, targets whose render is identical to the truth are in no
    #: mean, of whichever metric.
    mean: dict[str, float] = field(default_factory=dict)
    #: ``done``, ``partial``, ``failed`` or ``not-applicable``.
    status: str = "done"
    #: Why it failed.
    detail: str | None = None
    #: Number of targets whose render is identical to the truth.
    identical: int = 0


class Trial:
    """A trial: context views with images, target views without."""

    def __init__(self, native: Any, metrics: Any) -> None:
        self._native = native
        self._suite = metrics
        self._input = native.input()
        #: Key of the scene.
        self.scene: str = self._input.scene
        #: Position of the index entry among the scene's.
        self.entry: int = self._input.entry
        #: Near and far plane, in units of the trial's world.
        self.near_far: tuple[float, float] = self._input.near_far
        #: Overlap of the context views, if the index has it.
        self.overlap: float | None = self._input.overlap
        #: SHA-256 of what defines the trial.
        self.hash: str = self._input.hash
        #: What a method may see: images and cameras.
        self.context = Views(Cameras._of(*self._input.context_cameras()), self._input.context_images)
        #: What it has to render: cameras.
        self.target = Views(Cameras._of(*self._input.target_cameras()))

    def __repr__(self) -> str:
        return f"Trial({self.scene!r}, {len(self.context)} context views, {len(self.target)} targets)"

    def score(self, output: Any) -> Scores:
        """Scores a method's output as :func:`atsplat.evaluate` does.

        Args:
            output: images (targets × H × W × 3, float in [0, 1] or uint8) in the order of the targets, or
                :class:`~atsplat.Gaussians` in the trial's world, which are rendered as the protocol says.
        """
        if isinstance(output, Gaussians):
            rows = self._native.score_gaussians(output._native, self._suite)
        else:
            rows = self._native.score_images(*stored_images(output), self._suite)
        return scores(*json.loads(rows))


def scores(trial: dict[str, Any], targets: list[dict[str, Any]]) -> Scores:
    """Scores from the rows of a trial."""
    rows = [with_metrics(row) for row in targets]
    ids = dict.fromkeys(key for row in targets for key in (*row["scores"], *row["not_computed"]))
    compared = [row for row in rows if row["status"] == "scored"]
    # A PSNR of 8-bit images may be infinite although the render differs.
    values = {key: [row[key] for row in compared if row.get(key) is not None and np.isfinite(row[key])] for key in ids}
    mean = {key: float(np.mean(own)) for key, own in values.items() if own}
    identical = sum(row["status"] == "identical" for row in rows)
    return Scores(rows, mean, trial["status"], trial["detail"], identical)


def with_metrics(row: dict[str, Any]) -> dict[str, Any]:
    """A target's row with a key for each metric."""
    scored, missing = row["scores"], row["not_computed"]
    other = {key: value for key, value in row.items() if key not in ("scores", "not_computed")}
    absent = {key: float("inf") if why == "identical" else None for key, why in missing.items()}
    return {**other, **absent, **scored, "not_computed": missing}
