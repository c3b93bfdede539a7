"""Code as bytes: what functions are, what they read and assign, and the modules that they import."""

from __future__ import annotations

import dis
import functools
import inspect
import linecache
import textwrap
import warnings
from collections.abc import Iterator, Set
from types import CodeType, FunctionType
from typing import Any

from ._contents import digest


def source(code: CodeType) -> bytes:
    """Its text, if that is what runs: a file may have been edited since it was imported. Otherwise the instructions; also of a lambda,
    whose lines contain more than it."""
    instructions = compiled(code)
    if code.co_name != "<lambda>":
        try:
            linecache.checkcache(code.co_filename)
            text = "".join(linecache.getlines(code.co_filename))
            if (code.co_name, code.co_firstlineno, instructions) in _functions(text, code.co_filename):
                return textwrap.dedent(inspect.getsource(code)).encode()
        except (OSError, TypeError, SyntaxError, ValueError, IndexError):
            pass
    return instructions


@functools.lru_cache(maxsize=32)
def _functions(text: str, file: str) -> frozenset[tuple[str, int, bytes]]:
    return frozenset((one.co_name, one.co_firstlineno, compiled(one)) for one in codes(parsed(text, file)))


def parsed(text: str, file: str) -> CodeType:
    with warnings.catch_warnings():
        # Its import has given them.
        warnings.simplefilter("ignore")
        return compile(text, file, "exec", dont_inherit=True)


def compiled(code: CodeType) -> bytes:
    """The hash of a function's instructions and constants, and of functions inside of it, wherever they are written."""
    counts = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    handlers = getattr(code, "co_exceptiontable", b"")
    return digest(b"code", code.co_code, handlers, repr((counts, names)).encode(), *map(_constant, code.co_consts))


def _constant(value: Any) -> bytes:
    if isinstance(value, CodeType):
        return compiled(value)
    if isinstance(value, frozenset):
        return digest(b"set", *sorted(map(_constant, value)))
    return digest(b"tuple", *map(_constant, value)) if isinstance(value, tuple) else repr(value).encode()


def codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code, and that of functions inside of it."""
    yield code
    for one in _inside(code):
        yield from codes(one)


def _inside(code: CodeType) -> list[CodeType]:
    return [one for one in code.co_consts if isinstance(one, CodeType)]


def loaded(code: CodeType) -> set[str]:
    """Globals that a function reads."""
    found = (one for part in codes(code) for one in dis.get_instructions(part))
    return {one.argval for one in found if one.opname in ("LOAD_GLOBAL", "LOAD_NAME")}


def assigned(code: CodeType, free: Set[str] | None = None) -> set[tuple[str, bool]]:
    """Variables that a function assigns, and whether they are globals; others are of its closure.

    A scope inside may have a variable of its own by the name of one in the closure (``free``): it is then no free one there, or also a
    cell, as that of a comprehension is since Python 3.12.
    """
    free = (set(code.co_freevars) if free is None else free & set(code.co_freevars)) - set(code.co_cellvars)
    found: set[tuple[str, bool]] = set()
    for one in dis.get_instructions(code):
        if one.opname in ("STORE_GLOBAL", "DELETE_GLOBAL"):
            found.add((one.argval, True))
        elif one.opname in ("STORE_DEREF", "DELETE_DEREF") and one.argval in free:
            found.add((one.argval, False))
    return found.union(*(assigned(part, free) for part in _inside(code)))


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
