"""Results stores, as ``atsplat run`` and :func:`atsplat.evaluate` write them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from os import PathLike, fspath
from typing import Any

import numpy as np

from . import _native
from .metrics import metrics
from .protocols import with_metrics

Path = str | PathLike


class Store:
    """The rows of a store as they were when it was opened."""

    def __init__(self, path: str) -> None:
        #: Its folder.
        self.path = path
        provenance, trials, targets, self._summary = _native.read_store(path)
        #: What was run, how and where: protocols, methods, metrics, machine.
        self.provenance: dict[str, Any] = json.loads(provenance)
        self._trials: list[dict[str, Any]] = json.loads(trials)
        self._targets: list[dict[str, Any]] = json.loads(targets)

    def __repr__(self) -> str:
        return f"Store({self.path!r}, {len(self._trials)} trials, {len(self._targets)} targets)"

    def __str__(self) -> str:
        return self._summary

    def __len__(self) -> int:
        return len(self._targets)

    def _repr_html_(self) -> str:
        from .reports import report

        return report(self)._repr_html_()

    def trials(self) -> list[dict[str, Any]]:
        """One row for each trial and method: hashes, status, why it failed, Gaussians, overlap."""
        return [dict(row) for row in self._trials]

    def rows(self) -> list[dict[str, Any]]:
        """One row for each target: ``preset``, ``method``, ``scene``, ``entry``, ``target``, ``frame``, ``status``, ``detail`` …
        and a key for each metric id, None if it was not computed (why is in ``not_computed``), infinite for the PSNR of identical
        images."""
        return [with_metrics(row) for row in self._targets]

    def columns(self) -> dict[str, np.ndarray]:
        """The rows by column: floats, with NaN where there is no number, integers, booleans, or objects."""
        rows = self.rows()
        names = dict.fromkeys(name for row in rows for name in row if name != "not_computed")
        scored = {metric["id"] for metric in metrics()}
        return {name: _column([row.get(name) for row in rows], name in scored) for name in names}

    def failures(self) -> list[dict[str, Any]]:
        """Trials that failed or have failed targets, and targets with samples that are not finite, each with its ``detail``. Trials that
        are not for a method are no failures."""
        trials = [dict(row) for row in self._trials if row["status"] not in ("done", "not-applicable")]
        return trials + [row for row in self.rows() if row["status"] == "non-finite"]


def open_store(path: Path) -> Store:
    """Reads a store, complete or not."""
    return Store(fspath(path))


def merge(stores: Sequence[Path | Store], out: Path, *, partial: bool = False) -> Store:
    """Merges shards of one run into a new store; without ``partial``, all of them must be there."""
    _native.merge_stores([folder_of(store) for store in stores], fspath(out), partial)
    return open_store(out)


def folder_of(store: Path | Store) -> str:
    return store.path if isinstance(store, Store) else fspath(store)


def _column(values: list[Any], is_score: bool) -> np.ndarray:
    if is_score:
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
    present = [value for value in values if value is not None]
    kinds = {type(value) for value in present}
    if kinds and kinds <= {int, float}:
        whole = kinds == {int} and len(present) == len(values)
        return np.array([np.nan if value is None else value for value in values], dtype=np.int64 if whole else np.float64)
    # NumPy's booleans have no value for a missing one.
    return np.array(values, dtype=bool) if kinds == {bool} and len(present) == len(values) else _objects(values)


def _objects(values: list[Any]) -> np.ndarray:
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array
