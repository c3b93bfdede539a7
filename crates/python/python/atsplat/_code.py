"""Code as bytes: the source of functions, what they read and assign, and the modules that they import."""

from __future__ import annotations

import dis
import importlib.util
import inspect
import sys
import textwrap
from collections.abc import Iterator
from types import CodeType, FunctionType
from typing import Any

from ._contents import digest

#: Top-level modules that count by name, wherever they are.
FOREIGN = sys.stdlib_module_names - {"__main__"} | {"builtins", "atsplat"}


def source(code: CodeType) -> bytes:
    """Its text. Of a lambda, whose lines contain more than it, and of what an interpreter was given, the instructions."""
    try:
        if code.co_name != "<lambda>":
            return textwrap.dedent(inspect.getsource(code)).encode()
    except (OSError, TypeError, SyntaxError, IndexError):
        pass
    return digest(b"code", code.co_code, repr((code.co_names, code.co_freevars)).encode(), *map(_constant, code.co_consts))


def _constant(value: Any) -> bytes:
    if isinstance(value, CodeType):
        return source(value)
    if isinstance(value, frozenset):
        return digest(b"set", *sorted(map(_constant, value)))
    return digest(b"tuple", *map(_constant, value)) if isinstance(value, tuple) else repr(value).encode()


def codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code, and that of functions inside of it."""
    yield code
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield from codes(one)


def loaded(code: CodeType) -> set[str]:
    """Globals that a function reads."""
    found = (one for part in codes(code) for one in dis.get_instructions(part))
    return {one.argval for one in found if one.opname in ("LOAD_GLOBAL", "LOAD_NAME")}


def assigned(code: CodeType) -> set[tuple[str, bool]]:
    """Variables that a function assigns, and whether they are globals; others may be of its closure."""
    found = (one for part in codes(code) for one in dis.get_instructions(part))
    kinds = {"STORE_GLOBAL": True, "DELETE_GLOBAL": True, "STORE_DEREF": False, "DELETE_DEREF": False}
    return {(one.argval, kinds[one.opname]) for one in found if one.opname in kinds}


def imported(code: CodeType, package: str) -> set[str]:
    """Modules that a code in this package imports, with their packages. Some names may be of other things in modules."""
    found: set[str] = set()
    for part in codes(code):
        constants: list[Any] = []
        for one in dis.get_instructions(part):
            if one.opname in ("LOAD_CONST", "LOAD_SMALL_INT"):
                constants.append(one.argval)
            elif one.opname == "IMPORT_NAME":
                level, names = constants[-2:]
                above = package.split(".")[: len(package.split(".")) - level + 1] if level else []
                base = ".".join(filter(None, [*above, one.argval]))
                found |= {base, *(f"{base}.{name}" for name in names or () if name != "*")}
    parents = {name[:at] for name in found for at, letter in enumerate(name) if letter == "."}
    return {name for name in found | parents if name}


def package_of(function: FunctionType) -> str:
    """The package that a function's relative imports start from."""
    scope = function.__globals__
    name = scope.get("__name__") or ""
    return str(scope.get("__package__") or (name if "__path__" in scope else name.rpartition(".")[0]))


def located(name: str) -> tuple[str | None, Any] | None:
    """The file of a module, and the folders of its submodules if it is a package; None if there is none. Nothing is imported."""
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
        return digest(b"module", text.encode()), compile(text, file, "exec", dont_inherit=True)
    except (SyntaxError, ValueError):
        return digest(b"module", content), None


def is_installed(file: str) -> bool:
    return "site-packages" in file or "dist-packages" in file


def root(module: str) -> str:
    return module.split(".")[0]
