"""Protocols and their trials: what a method may see of a scene, and the views that it has to render."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np

from . import _native
from ._arguments import at_most, folder_of_weights, path_of, whole
from ._arrays import images as stored_images
from ._arrays import invalid
from .cameras import Cameras
from .gaussians import Gaussians

Path = str | PathLike[str]


def protocols() -> list[str]:
    """Names of the built-in protocols."""
    return _native.protocol_names()


def protocol(name: str | Path) -> Protocol:
    """A built-in protocol by name, or the one in a TOML file (a path that ends in ``.toml``)."""
    return Protocol(path_of(name, "protocol"))


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

    def __reduce__(self) -> tuple[Any, ...]:
        return Protocol, (self._source,)

    def __repr__(self) -> str:
        return f"Protocol({self.name!r}): {self.title}"

    @property
    def toml(self) -> str:
        """The whole protocol as TOML."""
        return self._native.toml

    @property
    def metrics(self) -> list[str]:
        """Its PSNR, SSIM and LPIPS, by id (:func:`atsplat.metrics`)."""
        return self._native.metrics

    @property
    def settings(self) -> list[str]:
        """Methods that published another pose normalisation, other near and far planes or another renderer under this protocol."""
        return self._native.settings

    def open(
        self,
        data: Path | Data,
        *,
        index: Path | None = None,
        sampler: Path | None = None,
        any_size: bool = False,
        frames: Path | None = None,
        images: int | None = None,
        prefer_undistorted: bool = False,
    ) -> Data:
        """Opens a dataset; its format is detected.

        Args:
            data: RE10K trajectories, ``.torch`` chunks, a ``transforms.json``, a COLMAP model, or a folder of them.
            index: the evaluation index (JSON), or a folder in which the published one is found by its hash, at any depth; by
                default the first of ``PROTOCOL.json``, ``evaluation_index_DATASET.json`` (such as
                ``evaluation_index_re10k.json``) and ``evaluation_index.json`` next to the data.
            sampler: a sampling rule, by name or as a ``.toml``: instead of an index, for data without a published one.
            any_size: accept images of any size, which changes the protocol's hash.
            frames: folder of the frames of trajectories or a COLMAP model, if they are not next to the poses.
            images: which copy of a capture's images: 1 for ``images``, 2, 4 or 8 for ``images_2`` …
            prefer_undistorted: use DL3DV's undistorted ``gaussian_splat/`` in scenes that have it; an error if none does.

        Raises:
            InvalidError: also for an argument that data of the detected format does not read.
        """
        if isinstance(data, Data):
            if data.protocol.hash != self.hash:
                raise invalid("data", f"expected data opened for {self.name}, found {data.protocol.name}'s")
            if any((index, sampler, any_size, frames, images, prefer_undistorted)):
                raise invalid("data", "is already open: its index, sampler and images cannot be changed")
            return data
        given = {"index": index, "sampler": sampler, "frames": frames}
        paths = {name: None if value is None else path_of(value, name) for name, value in given.items()}
        factor = None if images is None else whole(images, "images")
        flags = {"any_size": any_size, "prefer_undistorted": prefer_undistorted}
        for name, flag in flags.items():
            if not isinstance(flag, bool):
                raise invalid(name, f"expected True or False, found {flag!r}")
        path = path_of(data, "data")
        opened = self._native.open(path, paths["index"], paths["sampler"], any_size, paths["frames"], factor, prefer_undistorted)
        return Data(self, opened, (path, {**paths, **flags, "images": factor}))

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

        Problems with the data and the index, such as scenes that the data lack, are a warning at once, and entries without a trial
        are one at the end.

        Args:
            limit: at most this many scenes, spread evenly over the index.
            setting: whose published pose normalisation, near and far planes, and renderer of Gaussians (see :attr:`settings`).
            metrics: in addition to the protocol's own, by id (:func:`atsplat.metrics`) in upper or lower case, for
                :meth:`Trial.score`.
            weights: folder of LPIPS weights, searched before torch's cache.
            options: as for :meth:`open`.
        """
        return Trials(self.open(data, **options), limit, setting, tuple(metrics), weights)


class Data:
    """A dataset opened for a protocol, with its index."""

    def __init__(self, of: Protocol, native: Any, source: tuple[str, dict[str, Any]]) -> None:
        #: The protocol that it was opened for.
        self.protocol = of
        self._native = native
        #: Path and options, to open it again in another process.
        self._source = source
        #: Counts of problems with the data and the index, by kind: unreadable and ignored scenes, scenes of the index that the data
        #: lack, repeated targets, frames that are not sampled.
        self.warnings: dict[str, int] = {kind: count for kind, count, _ in native.warnings}
        #: The first of each kind.
        self.examples: dict[str, str] = {kind: example for kind, _, example in native.warnings}

    def __reduce__(self) -> tuple[Any, ...]:
        return _opened, (self.protocol, *self._source)

    @property
    def entries(self) -> list[tuple[str, int]]:
        """Scenes of the index that are in the data, each with its number of entries."""
        return list(self._native.entries())

    @property
    def missing(self) -> list[Skipped]:
        """Entries of the index whose scenes are not in the data."""
        return [
            Skipped(scene, entry, "missing-scene", "the scene is not in the data")
            for scene, count in self._native.missing()
            for entry in range(count)
        ]


def _opened(of: Protocol, path: str, options: dict[str, Any]) -> Data:
    return of.open(path, **options)


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
        self._trials = data._native.trials(setting, at_most(limit), None, True)
        self._suite = suite(metrics, weights, data)
        self._warned = False
        if data.warnings:
            found = "; ".join(f"{count} × {kind}: {data.examples[kind]}" for kind, count in data.warnings.items())
            warnings.warn(f"{data.protocol.name}: {found}", stacklevel=3)
        #: Entries of the index that gave no trial so far, with the reason; those of scenes that the data lack are in ``data.missing``.
        self.skipped: list[Skipped] = []

    def __len__(self) -> int:
        """Trials that are left, and entries that may turn out to have none."""
        return int(self._trials.left())

    def __iter__(self) -> Iterator[Trial]:
        return self

    def __next__(self) -> Trial:
        while (outcome := self._trials.next()) is not None:
            trial, skipped = outcome
            if trial is not None:
                return Trial(trial, self._suite)
            self.skipped.append(Skipped(*skipped))
        if self.skipped and not self._warned:
            self._warned = True
            count, first = len(self.skipped), self.skipped[0]
            text = f"{count} entries of the index gave no trial, first {first.scene}, entry {first.entry}: {first.detail} ({first.reason})"
            warnings.warn(f"{self.data.protocol.name}: {text}", stacklevel=2)
        raise StopIteration


def check_setting(of: Protocol, setting: str) -> None:
    """A typo must not silently select the protocol's own setting."""
    known = ["ATSplat", *of.settings]
    if not isinstance(setting, str):
        raise invalid("setting", f"expected a name, found {setting!r}")
    if setting.lower() not in [name.lower() for name in known]:
        raise invalid("setting", f"expected one of {', '.join(dict.fromkeys(known))}, found {setting!r}")


def suite(metrics: Sequence[str], weights: Path | None, data: Data | None = None) -> Any:
    """The metrics of a protocol and more of them, with loaded weights."""
    return _native.Suite(ids_of(metrics), folder_of_weights(weights), None if data is None else data._native)


def ids_of(metrics: Sequence[str]) -> list[str]:
    """Ids of metrics; one that is given alone is not a sequence of letters."""
    return [metrics] if isinstance(metrics, str) else list(metrics)


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
        images: np.ndarray = self._images()
        return images


@dataclass(frozen=True)
class Scores:
    """Scores of one trial."""

    #: For each target: its ``frame``, ``status``, why it failed as ``detail``, and a number for each metric id (None if it was not
    #: computed, with the reason in ``not_computed``; a PSNR of identical images is infinite).
    targets: list[dict[str, Any]]
    #: Metrics by id, over the targets that have a finite number. As in tables, targets whose render is identical to the truth are in no
    #: mean, of whichever metric. A metric without a mean is an error that says why.
    mean: Mapping[str, float] = field(default_factory=dict)
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
                :class:`~atsplat.Gaussians` in the trial's world, which are rendered as the protocol says for the setting.

        Returns:
            Scores, whose ``status`` and ``detail`` say whether output of the wrong size or range made it fail.
        """
        if isinstance(output, Gaussians):
            rows = self._native.score_gaussians(output._native, self._suite)
        else:
            rows = self._native.score_images(*stored_images(output), self._suite)
        trial, targets = json.loads(rows)
        return scores(trial, targets, self._suite.ids)


class Means(dict[str, float]):
    """Means by metric; asking for one that no target has is an error with the reason."""

    def __init__(self, means: dict[str, float], reasons: dict[str, str], why: str) -> None:
        super().__init__(means)
        self._reasons, self._why = reasons, why

    def __missing__(self, key: str) -> float:
        raise invalid(key, f"expected a mean of the trial's targets, found none: {self._reasons.get(key, self._why)}")

    def __reduce__(self) -> tuple[Any, ...]:
        return Means, (dict(self), self._reasons, self._why)


def scores(trial: dict[str, Any], targets: list[dict[str, Any]], metrics: Sequence[str] = ()) -> Scores:
    """Scores from the rows of a trial."""
    rows = [with_metrics(row, metrics) for row in targets]
    ids = dict.fromkeys(key for row in targets for key in (*row["scores"], *row["not_computed"]))
    compared = [row for row in rows if row["status"] == "scored"]
    # A PSNR of 8-bit images may be infinite although the render differs.
    values = {key: [row[key] for row in compared if row.get(key) is not None and np.isfinite(row[key])] for key in ids}
    mean = {key: float(np.mean(numbers)) for key, numbers in values.items() if numbers}
    identical = sum(row["status"] == "identical" for row in rows)
    details = (row["detail"] for row in rows if row.get("detail"))
    why = trial["detail"] or next(details, "every target is identical to the truth" if identical else "no target has this metric")
    reasons = {key: text for row in targets for key, text in row["not_computed"].items()}
    return Scores(rows, Means(mean, reasons, why), trial["status"], trial["detail"], identical)


def with_metrics(row: dict[str, Any], metrics: Sequence[str] = ()) -> dict[str, Any]:
    """A target's row with a key for each metric; rows that failed have no numbers."""
    scored, missing = row["scores"], row["not_computed"]
    other = {key: value for key, value in row.items() if key not in ("scores", "not_computed")}
    other |= {key: None for key in metrics if key not in other}
    absent = {key: float("inf") if why == "identical" else None for key, why in missing.items()}
    return {**other, **absent, **scored, "not_computed": missing}
