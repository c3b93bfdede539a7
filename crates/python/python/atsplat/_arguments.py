"""Checks of plain arguments, so that errors name them."""

from __future__ import annotations

import operator
import unicodedata
from os import PathLike, fspath, path
from typing import Any

from ._arrays import invalid


#: Most characters of a title in tables and plots.
LONGEST_TITLE = 80


def whole(value: Any, field: str, least: int = 1, most: int = 2**32 - 1) -> int:
    """An integer of any library from ``least`` to ``most``."""
    if not isinstance(value, bool):
        try:
            number = operator.index(value)
        except TypeError:
            pass
        else:
            if number > most:
                raise invalid(field, f"expected an integer of at most {most}, found {value!r}")
            if number >= least:
                return number
    raise invalid(field, f"expected an integer from {least}, found {value!r}")


def at_most(value: Any, field: str = "limit") -> int | None:
    """A number of scenes, or None for all of them."""
    return None if value is None else whole(value, field, most=2**64 - 1)


def shard_of(value: Any) -> tuple[int, int] | None:
    """Number and count of shards."""
    if value is None:
        return None
    if not isinstance(value, (tuple, list)) or len(value) != 2:
        raise invalid("shard", f"expected a pair such as (1, 8), the number of the shard and how many there are, found {value!r}")
    number, count = whole(value[0], "shard"), whole(value[1], "shard")
    if number > count:
        raise invalid("shard", f"expected a number from 1 to {count}, found {number}")
    return number, count


def path_of(value: Any, field: str) -> str:
    """A path as text."""
    if isinstance(value, (str, PathLike)):
        text = fspath(value)
        if isinstance(text, str):
            return text
    raise invalid(field, f"expected a path, found {type(value).__name__}")


def folder_of_weights(value: Any) -> str | None:
    """A folder that exists."""
    if value is None:
        return None
    folder = path_of(value, "weights")
    if not path.isdir(folder):
        raise invalid("weights", f"expected an existing folder, found {folder!r}")
    return folder


def title_of(value: Any) -> str | None:
    """A title in tables and plots, without the spaces around it."""
    if value is None:
        return None
    line = value.strip() if isinstance(value, str) else ""
    if not 0 < len(line) <= LONGEST_TITLE or any(unicodedata.category(character) == "Cc" for character in line):
        raise invalid("title", f"expected a title in one line of at most {LONGEST_TITLE} characters, found {value!r}")
    return line


def colour(value: Any, field: str = "background") -> list[float]:
    """RGB as three numbers in [0, 1]."""
    try:
        channels = [float(channel) for channel in value]
    except (TypeError, ValueError):
        channels = []
    if len(channels) != 3:
        raise invalid(field, f"expected three numbers, red, green and blue, found {value!r}")
    if not all(0 <= channel <= 1 for channel in channels):
        hint = ": divide by 255" if all(0 <= channel <= 255 for channel in channels) else ""
        raise invalid(field, f"expected red, green and blue in [0, 1], found {value!r}{hint}")
    return channels
