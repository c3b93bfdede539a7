"""Tables of stores, as ``atsplat report`` makes them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from os import PathLike, fspath
from typing import Any

from . import _native
from ._arrays import invalid
from .stores import Store, folder_of

Path = str | PathLike[str]


def report(*stores: Path | Store, force: bool = False) -> Report:
    """Tables of one or several stores.

    Args:
        stores: folders, or opened ones; they are read again.
        force: put results of different protocols into one table, which is then marked.
    """
    if not stores:
        raise invalid("stores", "expected at least one store")
    if any(isinstance(store, (list, tuple)) for store in stores):
        raise invalid("stores", "expected stores one by one, as in report(a, b), found a list: report(*list)")
    return Report([folder_of(store) for store in stores], force)


class Report:
    """The tables of stores: those that papers published, with the measured rows next to them, then one for each protocol."""

    def __init__(self, stores: Sequence[str], force: bool) -> None:
        self._stores, self._force = list(stores), force
        self._tables = [Table(*texts) for texts in _native.tables(self._stores, force)]

    def __iter__(self) -> Iterator[Table]:
        return iter(self._tables)

    def __len__(self) -> int:
        return len(self._tables)

    @property
    def names(self) -> list[str]:
        """Names of the tables."""
        return [table.name for table in self._tables]

    def table(self, name: str) -> Table:
        """A table by name: that of a paper (``re10k``, ``dl3dv`` …), or a protocol's (``re10k-2v-256``)."""
        for table in self._tables:
            if name in (table.name, table.name.removeprefix("protocol-")):
                return table
        raise invalid("table", f"expected one of {', '.join(self.names) or 'no table: the stores have no results'}, found {name!r}")

    def write(self, out: Path, *, title: str = "Measured results next to the paper's") -> list[str]:
        """Writes tables, plots and one HTML page into a folder; returns the paths of all files."""
        return [fspath(path) for path in _native.write_report(self._stores, fspath(out), title, self._force)]

    def __str__(self) -> str:
        return "\n\n".join(map(str, self._tables))

    def _repr_html_(self) -> str:
        return "".join(table._repr_html_() for table in self._tables)


class Table:
    """A table; in a notebook, it shows itself."""

    def __init__(self, name: str, title: str, texts: Sequence[str]) -> None:
        #: Name in files.
        self.name = name
        #: Short title.
        self.title = title
        self._json, self._text, self._markdown, self._latex, self._csv, self._html = texts

    def __repr__(self) -> str:
        return f"Table({self.name!r})"

    def __str__(self) -> str:
        return self._text

    def _repr_html_(self) -> str:
        return self._html

    def to_markdown(self) -> str:
        """In GitHub's Markdown."""
        return self._markdown

    def to_latex(self) -> str:
        """A ``table`` environment for ``booktabs``."""
        return self._latex

    def to_csv(self) -> str:
        """One line for each row, with numbers in full precision, their intervals and numbers of scenes."""
        return self._csv

    def to_dict(self) -> dict[str, Any]:
        """Everything, as ``atsplat report --json`` prints it."""
        whole: dict[str, Any] = json.loads(self._json)
        return whole

    @property
    def rows(self) -> list[dict[str, Any]]:
        """One dict for each row: its labels by their headings, ``from`` (published or measured), ``measured on``, ``remarks`` (such as
        ``leaked targets excluded``), ``method``, ``store``, and a number, text or None for each column. Columns of groups with a
        heading are named ``GROUP COLUMN``."""
        table = self.to_dict()["table"]
        columns = [
            [f"{group['title']} {column['title']}".strip() for column in group["columns"]] for group in table["groups"]
        ]
        rows = []
        for row in table["rows"]:
            named = dict(zip(table["labels"], row["labels"]))
            measured_on = row["measured-on"] and row["measured-on"]["text"]
            named.update({"from": row["origin"], "measured on": measured_on, "remarks": row["remarks"]})
            named.update({"method": row["method"], "store": row["store"]})
            for names, cells in zip(columns, row["cells"]):
                named.update({name: _value(cell["value"]) for name, cell in zip(names, cells)})
            rows.append(named)
        return rows


def _value(value: Any) -> float | str | None:
    return next(iter(value.values())) if isinstance(value, dict) else None
