"""Exceptions. Messages say where, what was expected and what was found."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .drift import Drift


class AtsplatError(Exception):
    """The base of all errors of this package."""

    #: The file or folder that the error is about, if any.
    file: str | None = None
    #: The setting, array, or line or field of the file that is wrong, if known.
    field: str | None = None


class InvalidError(AtsplatError, ValueError):
    """A wrong argument, or a file whose content is wrong."""


class FileError(AtsplatError, OSError):
    """A file or folder that cannot be read or written; ``errno`` is the system's number."""


class DriftedError(AtsplatError):
    """Numbers moved against a baseline. ``drift`` is the comparison."""

    def __init__(self, drift: Drift) -> None:
        super().__init__(str(drift))
        self.drift = drift


class NotApplicable(AtsplatError):
    """Raised by a method that does not support a kind of trial: its row says so, and does not count as failed."""
