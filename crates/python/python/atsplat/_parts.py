"""The parts of which an identity consists, and the files among them."""

from __future__ import annotations

import os
from collections.abc import Iterable
from types import FunctionType, ModuleType
from typing import Any

from . import _code, _files
from ._files import FOREIGN, root


class Parts:
    """What was found of a method, by what it is."""

    def __init__(self) -> None:
        self.parts: dict[str, str] = {}
        #: Versions of installed packages that the method reaches, beside its parts.
        self.packages: dict[str, str] = {}
        #: Types of objects that are known by them alone, and files that are no help.
        self.unseen: set[str] = set()
        #: The package that the method is in, whose code counts wherever it is installed.
        self._package = ""
        self._imported: set[str] = set()

    def listed(self) -> list[bytes]:
        """The parts as bytes, in the order of their names."""
        return [f"{name} {part}".encode() for name, part in sorted({**self.parts, **self.packages}.items())]

    def _key(self, name: str) -> str:
        """A name for a part, before its hash is known. It stands for the part wherever that is met again: names themselves are shared
        by lambdas, and by functions that another makes."""
        key, number = name, 1
        while key in self.parts:
            number += 1
            key = f"{name} #{number}"
        self.parts[key] = ""
        return key

    def _put(self, key: str, hashed: bytes) -> None:
        self.parts[key] = hashed.hex()[:16]

    def _is_user_code(self, value: Any) -> bool:
        """Whether this module, class or function is the user's code: of the method's package, or not installed."""
        if isinstance(value, ModuleType):
            module: Any = value.__name__
        elif isinstance(value, FunctionType):
            # Not of what a decorator says that it wraps. A function that was compiled from a text may have none.
            module = value.__globals__.get("__name__") or ""
        else:
            module = getattr(value, "__module__", None)
        if not isinstance(module, str) or root(module) in FOREIGN:
            return False
        if not _files.is_installed(_files.place(value)):
            return True
        package = root(module)
        if f"package {package}" not in self.packages:
            self.packages[f"package {package}"] = _files.version_of(package)
        return package == self._package

    def _follow(self, names: Iterable[str]) -> None:
        """Adds the files of modules that are not installed, and of those that they import. Nothing is imported: that may run anything."""
        waiting = sorted(names, reverse=True)
        while waiting:
            name = waiting.pop()
            if name in self._imported or root(name) in FOREIGN:
                continue
            file, folders = _files.located(name) or (None, None)
            code = None if file is None else self._read(name, file)
            if code is not None:
                package = name if folders is not None else name.rpartition(".")[0]
                waiting += sorted(_code.imported(code, package), reverse=True)

    def _read(self, name: str, file: str) -> Any:
        """Adds the file of a module, unless it is installed; gives its code if it is Python's."""
        self._imported.add(name)
        if _files.is_installed(os.path.realpath(file)):
            return None
        try:
            content, code = _files.content_of(file)
        except OSError:
            self.unseen.add(f"the module {name}")
            return None
        if code is not None and _files.is_changed(name, file, code):
            self.unseen.add(f"the module {name}, whose file has changed since it was imported")
            content = _files.unknown_content()
        self._put(self._key(f"module {name}"), content)
        return code

    def _follow_binary(self, value: Any) -> bool:
        """Whether this is a compiled extension that is not Python's own, or of one: its file says what it does."""
        found = _files.binary_of(value)
        if found is None:
            return False
        name, file = found
        if name not in self._imported:
            self._read(name, file)
        return True
