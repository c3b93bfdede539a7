"""What a store says that its user should know: one line for each kind, with a count and the first example."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .stores import Store


def of_method(store: Store, method: str) -> list[str]:
    """Everything about the trials of a method, and about its data."""
    return [*skipped(store, method), *of_run(store), *notes(store, method), *failed(store, method)]


def skipped(store: Store, method: str | None = None) -> list[str]:
    """Entries of the index without a trial."""
    concerned = (row for row in store.skipped if method is None or not row.get("methods") or method in row["methods"])
    return _counted(
        ((row["preset"], f"index entries skipped, {row['reason']}"), f"scene {row['scene']}: {row['detail']}") for row in concerned
    )


def of_run(store: Store) -> list[str]:
    """Problems of data and index."""
    return [f"{row['preset']}: {row['count']} × {row['kind']}: {row['example']}" for row in store.warnings]


def notes(store: Store, method: str) -> list[str]:
    """What was noted about trials that have results."""
    rows = (row for row in store.trials() if row["method"] == method)
    return _counted(
        ((row["preset"], f"{note.split(': ')[0]}, in trials of {method}"), f"{row['scene']}: {note}")
        for row in rows
        for note in row["notes"]
    )


def failed(store: Store, method: str) -> list[str]:
    """Trials and targets without a score."""
    return _counted(
        ((row["preset"], f"{'targets' if 'target' in row else 'trials'} of {method} {row['status']}"), f"{row['scene']}: {row['detail']}")
        for row in store.failures()
        if row["method"] == method
    )


def unscored(store: Store) -> list[str]:
    """Targets without a score, except for trials that a method does not support."""
    names = ("preset", "method", "scene", "entry")
    unsupported = {tuple(row[name] for name in names) for row in store.trials() if row["status"] == "not-applicable"}
    rows = (row for row in store.rows() if row["status"] in ("failed", "non-finite"))
    supported = (row for row in rows if tuple(row[name] for name in names) not in unsupported)
    return _counted(
        ((row["preset"], f"targets of {row['method']} without a score, {row['status']}"), f"{row['scene']}: {row['detail']}")
        for row in supported
    )


def _counted(found: Iterable[tuple[tuple[str, str], str]]) -> list[str]:
    kinds: dict[tuple[str, str], list[Any]] = {}
    for kind, example in found:
        kinds.setdefault(kind, [0, example])[0] += 1
    return [f"{preset}: {count} × {what}: {example}" for (preset, what), (count, example) in kinds.items()]
