"""Files of modules: where they are, what is in them, and whether they still are what was imported. Nothing is imported to find out."""

from __future__ import annotations

import functools
import importlib.metadata
import importlib.util
import marshal
import os
import sys
from importlib.machinery import EXTENSION_SUFFIXES, SourceFileLoader
from types import CodeType, FunctionType, ModuleType
from typing import Any

from . import _code
from ._contents import attribute, digest

#: Top-level modules that count by name, wherever they are.
FOREIGN = sys.stdlib_module_names - {"__main__"} | {"builtins", "atsplat"}
#: Equal only within this process.
_PROCESS = os.urandom(16)


def located(name: str) -> tuple[str | None, Any] | None:
    """The file of a module, and the folders of its submodules if it is a package; None if there is none."""
    module = sys.modules.get(name)
    if module is not None:
        return getattr(module, "__file__", None), getattr(module, "__path__", None)
    parent, folders = name.rpartition(".")[0], None
    if parent:
        found = located(parent)
        if found is None or found[1] is None:
            return None
        folders = found[1]
    for finder in sys.meta_path:
        try:
            spec = finder.find_spec(name, folders)
        except Exception:
            # A finder of another library that only knows what was imported.
            continue
        if spec is not None:
            return spec.origin if spec.has_location else None, spec.submodule_search_locations
    return None


def content_of(file: str) -> tuple[bytes, CodeType | None]:
    """The hash of a module's file, and its code if it is Python's."""
    with open(file, "rb") as opened:
        content = opened.read()
    if not file.endswith((".py", ".pyw")):
        return digest(b"module", content), None
    try:
        text = importlib.util.decode_source(content)
        return digest(b"module", text.encode()), _code.parsed(text, file)
    except (SyntaxError, ValueError):
        return digest(b"module", content), None


def is_changed(name: str, file: str, code: CodeType) -> bool:
    """Whether a module was imported before its file became this code, as far as its functions and its compiled form tell."""
    module = sys.modules.get(name)
    spec = getattr(module, "__spec__", None)
    # Hooks of other libraries import other code than the file's.
    if module is None or type(getattr(spec, "loader", None)) is not SourceFileLoader:
        return False
    members = list(vars(module).values())
    members += [member for of in members if isinstance(of, type) and of.__module__ == name for member in vars(of).values()]
    imported = [one.__code__ for one in members if isinstance(one, FunctionType) and one.__code__.co_filename == code.co_filename]
    there = {_code.compiled(one) for one in _code.codes(code)}
    if any(_code.compiled(one) not in there for one in imported):
        return True
    kept = _kept(getattr(spec, "cached", None))
    return kept is not None and _code.compiled(kept) != _code.compiled(code)


def _kept(file: str | None) -> CodeType | None:
    """The compiled form of a module, which an import writes where it may: elsewhere it can be an old one."""
    if file is None or sys.dont_write_bytecode or not os.access(os.path.dirname(file), os.W_OK):
        return None
    try:
        with open(file, "rb") as opened:
            content = opened.read()
        code = marshal.loads(content[16:]) if content.startswith(importlib.util.MAGIC_NUMBER) else None
    except (OSError, ValueError, EOFError, TypeError):
        return None
    return code if isinstance(code, CodeType) else None


def unknown_content() -> bytes:
    """The hash of a file that is not what was imported: of this process alone."""
    return digest(b"changed", _PROCESS)


def binary_of(value: Any) -> tuple[str, str] | None:
    """The name and file of the compiled extension that this is, or is of; None if that is none, or Python's own."""
    module = value if isinstance(value, ModuleType) else attribute(value, "__self__")
    if not isinstance(module, ModuleType):
        name = attribute(value, "__module__")
        module = sys.modules.get(name) if isinstance(name, str) else None
    file = getattr(module, "__file__", None)
    if module is None or not isinstance(file, str) or not file.endswith(tuple(EXTENSION_SUFFIXES)):
        return None
    return None if root(module.__name__) in FOREIGN else (module.__name__, file)


def place(value: Any) -> str:
    """The file of a module, of a class or of a function's code; empty if there is none."""
    if isinstance(value, FunctionType):
        return _real(value.__code__.co_filename)
    module = value if isinstance(value, ModuleType) else sys.modules.get(getattr(value, "__module__", None) or "")
    return _real(getattr(module, "__file__", None) or "")


@functools.lru_cache(maxsize=4096)
def _real(file: str) -> str:
    return os.path.realpath(file) if file else ""


def is_installed(file: str) -> bool:
    return "site-packages" in file or "dist-packages" in file


def version_of(package: str) -> str:
    """The version of an installed package, rather the one that was imported than the one that replaced it since."""
    stated = attribute(sys.modules.get(package), "__version__")
    if isinstance(stated, str):
        return stated
    names = sorted(set(_distributions().get(package, ())))
    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in names) or "unknown"


@functools.lru_cache(maxsize=1)
def _distributions() -> Any:
    return importlib.metadata.packages_distributions()


def root(module: str) -> str:
    return module.split(".")[0]
