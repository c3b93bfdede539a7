"""Results stores, as ``atsplat run`` and :func:`atsplat.evaluate` write them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from os import PathLike, fspath
from typing import Any

import numpy as np

from . import _native
from ._arguments import path_of
from .metrics import metrics
from .protocols import with_metrics

Path = str | PathLike[str]


class Store:
    """The rows of a store as they were when it was opened."""

    def __init__(self, path: str) -> None:
        #: Its folder.
        self.path = path
        provenance, trials, targets, gaps, self._summary = _native.read_store(path)
        #: What was run, how and where: protocols, methods, metrics, machine.
        self.provenance: dict[str, Any] = json.loads(provenance)
        #: Entries of the index without a trial: ``preset``, ``scene``, ``entry``, ``reason``, ``detail``, and the ``methods`` that it
        #: is about, if not all.
        self.skipped: list[dict[str, Any]] = self.provenance["skipped"]
        #: What was wrong with data and index, such as scenes that are missing: ``preset``, ``kind``, ``count``, ``example``.
        self.warnings: list[dict[str, Any]] = self.provenance["warnings"]
        #: Everything for which ``evaluate(…, strict=True)`` and ``--strict`` fail: scenes that are missing, skipped entries, failures,
        #: an interrupted run. One for each kind: ``preset``, ``method`` (None: all), ``count``, and ``text`` with the first case. That the
        #: store is a part of a run is one too (``missing_shards``), for which ``evaluate`` does not fail.
        self.gaps: list[dict[str, Any]] = json.loads(gaps)
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
        return [_copy(row) for row in self._trials]

    def rows(self) -> list[dict[str, Any]]:
        """One row for each target: ``preset``, ``method``, ``scene``, ``entry``, ``target``, ``frame``, ``status``, ``detail`` …
        and a key for each metric id, None if it was not computed (why is in ``not_computed``), infinite for the PSNR of identical
        images."""
        ids = [metric["id"] for metric in self.provenance["metrics"]]
        return [with_metrics(_copy(row), ids) for row in self._targets]

    def columns(self) -> dict[str, np.ndarray]:
        """The rows by column: floats, with NaN where there is no number, integers, booleans, or objects."""
        rows = self.rows()
        names = dict.fromkeys(name for row in rows for name in row if name != "not_computed")
        scored = {metric["id"] for metric in metrics()}
        return {name: _column([row.get(name) for row in rows], name in scored) for name in names}

    def failures(self) -> list[dict[str, Any]]:
        """Trials that failed or have failed targets, and targets with samples that are not finite, each with its ``detail``. Trials that a
        method does not support are not failures."""
        trials = [row for row in self.trials() if row["status"] not in ("done", "not-applicable")]
        return trials + [row for row in self.rows() if row["status"] == "non-finite"]


def open_store(path: Path) -> Store:
    """Reads a store, complete or not."""
    return Store(path_of(path, "path"))


def merge(stores: Sequence[Path | Store], out: Path, *, partial: bool = False) -> Store:
    """Merges shards of one run into a new store; without ``partial``, all of them must be there. A store of exactly these results
    stays as it is."""
    _native.merge_stores([folder_of(store) for store in stores], fspath(out), partial)
    return open_store(out)


def folder_of(store: Path | Store) -> str:
    return store.path if isinstance(store, Store) else path_of(store, "store")


def _copy(row: dict[str, Any]) -> dict[str, Any]:
    """A row that may be changed: values are plain, or lists and dicts of such."""
    return {name: value.copy() if isinstance(value, (list, dict)) else value for name, value in row.items()}


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
