"""Guards numbers against a baseline."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from typing import Any

from . import _native
from ._arrays import invalid
from ._warnings import of_run, skipped, unscored
from .errors import DriftedError
from .stores import Store, folder_of, open_store

Path = str | PathLike[str]


class Drift:
    """A comparison of a store with a baseline. ``str`` of it says what moved, and by how much."""

    def __init__(self, report: str, text: str, drifted: bool, lost: Sequence[str] = ()) -> None:
        #: Everything, as ``atsplat drift --json`` prints it.
        self.report: dict[str, Any] = json.loads(report)
        #: Whether a number moved beyond its limit, or trials, data or protocols changed.
        self.drifted = drifted
        #: Targets with a score in the baseline that failed now, or have samples that are not finite, each with the reason.
        self.lost = list(lost)
        self._text = text

    @property
    def verdict(self) -> str:
        """``same``, ``within``, ``nothing`` (there was nothing to compare) or ``drifted``."""
        return str(self.report["verdict"])

    @property
    def comparisons(self) -> list[dict[str, Any]]:
        """For each preset, method and metric: the verdict, both means, and the largest change of a target."""
        return list(self.report["comparisons"])

    def raise_if_drifted(self) -> None:
        """Raises :class:`~atsplat.DriftedError` if a number moved, or if there was nothing to compare."""
        if self.verdict not in ("same", "within"):
            raise DriftedError(self)

    def __str__(self) -> str:
        return self._text

    def __repr__(self) -> str:
        return f"Drift({self.verdict!r})"


def drift(store: Path | Store, baseline: Path, *, probe: bool = False) -> Drift:
    """Compares results with a baseline.

    Args:
        store: results.
        baseline: the file that :func:`accept_baseline` or ``atsplat drift accept`` wrote.
        probe: run the pipeline's stages on this machine, to find which one moved a number, if the baseline has a probe.
    """
    return Drift(*_native.compare_with_baseline(folder_of(store), fspath(baseline), probe))


def accept_baseline(
    store: Path | Store,
    baseline: Path,
    *,
    why: str,
    repeats: Sequence[Path | Store] = (),
    limits: Mapping[str, float] | None = None,
) -> None:
    """Makes results the baseline; ``why`` is kept in its history. As with ``atsplat drift accept``, the probe of the old baseline,
    or the smallest one if it has none, is run on this machine and stored next to the file.

    Args:
        store: results of a finished run.
        baseline: the file to create or replace.
        why: why these numbers are correct.
        repeats: results of repetitions of the run. Numbers of methods that are not deterministic may later change as much as these
            differ.
        limits: how far the mean of a metric, such as ``psnr`` or ``PSNR``, may change in such methods, in its unit, instead of what
            ``repeats`` show. Limits of both kinds stay in later baselines until ``limits`` or ``repeats`` are given again.

    Raises:
        InvalidError: if no result has scores, if the run is unfinished, or if ``repeats`` are not of the same run.

    Warnings say what the old baseline guards and the new one does not, which targets of the baseline have no score, which scores the
    repetitions lack, and what the run skipped or did not find.
    """
    folder = folder_of(store)
    if isinstance(repeats, (str, PathLike, Store)):
        raise invalid("repeats", "expected a sequence of stores, found a single one")
    stated = list((limits or {}).items())
    lost = _native.accept_baseline(folder, fspath(baseline), why, [folder_of(repeat) for repeat in repeats], stated)
    of = open_store(folder)
    for text in [*lost, *unscored(of), *skipped(of), *of_run(of)]:
        warnings.warn(f"{fspath(baseline)}: {text}", stacklevel=2)
