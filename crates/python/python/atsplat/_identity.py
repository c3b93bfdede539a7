"""What a method is: hashes of its code and of the values that the code uses.

A store keeps them, so that results of one method are never taken for those of another with its name. They are equal in every process:
nothing depends on addresses, or on the order of sets and dicts.

A part is the source of a function or class, or the value of a variable. Followed are variables in closures and globals, defaults, what a
method is bound to, and the arguments of ``functools.partial``; code of installed packages counts by name. Not followed are files, random
generators, and objects of other libraries. Variables that one of the functions assigns are the method's state, not what it is.
"""

from __future__ import annotations

import dis
import functools
import hashlib
import inspect
import os
import struct
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from enum import Enum
from pathlib import PurePath
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

#: Parts that are listed in a record; further ones share a hash.
LISTED = 48

#: Top-level modules that count by name wherever they lie.
_FOREIGN = sys.stdlib_module_names - {"__main__"} | {"builtins", "atsplat"}


def identity(method: Callable[..., Any]) -> dict[str, str]:
    """Hashes of the parts of a method, by what they are."""
    walk = _Walk(method)
    if walk.assigned:
        walk = _Walk(method, walk.assigned)
    if len(walk.parts) <= LISTED:
        return walk.parts
    names = list(walk.parts)
    kept = {name: walk.parts[name] for name in names[: LISTED - 1]}
    others = (f"{name} {walk.parts[name]}".encode() for name in sorted(names[LISTED - 1 :]))
    return {**kept, f"{len(names) - LISTED + 1} others": _digest(b"others", *others).hex()[:16]}


def modules(method: Callable[..., Any]) -> list[Any]:
    """The ``torch.nn.Module`` that a method is, holds or uses; without those inside of others."""
    return _Walk(method).modules


class _Walk:
    """Goes through everything that a method uses."""

    def __init__(self, method: Callable[..., Any], state: Set[tuple[int, str]] = frozenset()) -> None:
        #: Variables that functions assign, by the address of their cell or globals; ``state`` has those that are left out.
        self.assigned: set[tuple[int, str]] = set()
        self._state = state
        self.parts: dict[str, str] = {}
        self.modules: list[Any] = []
        #: Digests by address, with the objects, which keep their addresses that way.
        self._known: dict[int, tuple[Any, bytes]] = {}
        of = method if isinstance(method, (FunctionType, type)) else type(getattr(method, "func", getattr(method, "__self__", method)))
        self._package = _root(of.__module__ or "")
        digest = self._value(method)
        if not isinstance(method, FunctionType):
            self._add("method", digest)

    def _add(self, name: str, digest: bytes) -> None:
        key, number = name, 1
        while key in self.parts:
            number += 1
            key = f"{name} #{number}"
        self.parts[key] = digest.hex()[:16]

    def _value(self, value: Any) -> bytes:
        plain = _plain(value)
        if plain is not None:
            return plain
        known = self._known.get(id(value))
        if known is not None:
            return known[1]
        # What refers to itself.
        self._known[id(value)] = value, b"itself"
        digest = self._compound(value)
        self._known[id(value)] = value, digest
        return digest

    def _compound(self, value: Any) -> bytes:
        torch = sys.modules.get("torch")
        if torch is not None and hasattr(torch, "nn") and isinstance(value, torch.nn.Module):
            return self._module(value)
        array = _array(value, torch)
        if array is not None:
            return array
        if isinstance(value, (list, tuple)):
            return _digest(b"list" if isinstance(value, list) else b"tuple", *(self._value(item) for item in value))
        if isinstance(value, Mapping) and type(value).__module__ in ("builtins", "collections", "types"):
            return self._named(b"dict", value.items())
        if isinstance(value, (set, frozenset)):
            return _digest(b"set", *sorted(self._value(item) for item in value))
        if isinstance(value, functools.partial):
            return _digest(b"partial", *(self._value(part) for part in (value.func, value.args, value.keywords)))
        if isinstance(value, MethodType):
            return _digest(b"method", self._value(value.__self__), self._value(value.__func__))
        if isinstance(value, FunctionType):
            return self._function(value)
        if isinstance(value, type):
            return self._class(value)
        if isinstance(value, ModuleType):
            return _digest(b"module", value.__name__.encode())
        if isinstance(value, BuiltinFunctionType):
            return _digest(b"function", _name(value).encode())
        if isinstance(getattr(value, "__wrapped__", None), FunctionType):
            return self._value(value.__wrapped__)
        return self._object(value)

    def _named(self, kind: bytes, items: Iterable[tuple[Any, Any]]) -> bytes:
        ordered = sorted(((self._value(key), value) for key, value in items), key=lambda item: item[0])
        return _digest(kind, *(part for key, value in ordered for part in (key, self._value(value))))

    def _function(self, function: FunctionType) -> bytes:
        """Its source is a part, and so is each of its variables; to others it is a name."""
        name, code = _short(function), function.__code__
        cells = dict(zip(code.co_freevars, function.__closure__ or ()))
        scope = id(function.__globals__)
        for key, is_global in _assigned(code):
            if is_global or key in cells:
                self.assigned.add((scope if is_global else id(cells[key]), key))
        cells = {key: cell for key, cell in cells.items() if key != "__class__" and (id(cell), key) not in self._state}
        used = {key: cell.cell_contents for key, cell in cells.items() if _is_filled(cell)}
        defaults = self._value(function.__defaults__), self._value(function.__kwdefaults__)
        if not self._is_own(function):
            # A decorator of another library, for example: what it wraps is in its closure.
            own = (self._value(value) for _, value in sorted(used.items(), key=_first))
            return _digest(b"function", _name(function).encode(), *defaults, *own)
        for key in _loaded(code):
            if key in function.__globals__ and not key.startswith("__") and (scope, key) not in self._state:
                used[key] = function.__globals__[key]
        names = {name for one in _codes(code) for name in one.co_names if not name.startswith("__")}
        for key, value in list(used.items()):
            if isinstance(value, ModuleType) and self._is_own(value):
                used |= {f"{key}.{own}": vars(value)[own] for own in names & vars(value).keys()}
        others = [b for key, value in sorted(used.items(), key=_first) for b in self._variable(f"{name}, {key}", value)]
        self._add(name, _digest(b"function", _source(code), *defaults, *others))
        return _digest(b"function", name.encode())

    def _variable(self, name: str, value: Any) -> list[bytes]:
        """Adds the part of a variable; what is known by its name has none, and belongs to the source."""
        digest = self._value(value)
        if isinstance(value, (FunctionType, type, ModuleType, BuiltinFunctionType)):
            return [digest]
        self._add(name, digest)
        return []

    def _class(self, of: type) -> bytes:
        if not self._is_own(of):
            return _digest(b"class", _name(of).encode())
        bases = [self._value(base) for base in of.__bases__ if base is not object]
        members = [(key, _function_of(member)) for key, member in sorted(vars(of).items())]
        own = [(key, member) for key, member in members if isinstance(member, FunctionType)]
        values = [(key, member) for key, member in members if not key.startswith("__") and _plain(member) is not None]
        self._add(_short(of), _digest(b"class", *bases, self._named(b"members", values)))
        for _, member in own:
            self._value(member)
        return _digest(b"class", _short(of).encode())

    def _module(self, module: Any) -> bytes:
        """Parameters and buffers, and of each module inside its class and its plain attributes."""
        from .torch import state_hash

        if all(module is not part for own in self.modules for part in own.modules()):
            self.modules.append(module)
        parts = [state_hash(module).encode()]
        for key, part in module.named_modules():
            self._known[id(part)] = part, _digest(b"module", key.encode())
            parts += [key.encode(), self._value(type(part)), self._attributes(part, is_module=True)]
        return _digest(b"module", *parts)

    def _object(self, value: Any) -> bytes:
        of = type(value)
        if isinstance(value, PurePath):
            return _digest(b"path", os.fspath(value).encode())
        if isinstance(value, Enum):
            return _digest(b"enum", _name(of).encode(), value.name.encode())
        if of.__module__ == "atsplat.gaussians":
            return _digest(b"gaussians", *(self._value(part) for part in value.__reduce__()[1]))
        if self._is_own(of) or hasattr(of, "__dataclass_fields__"):
            return _digest(b"object", self._value(of), self._attributes(value, is_module=False))
        # A ufunc has a name of its own.
        return _digest(b"object", _name(of).encode(), str(getattr(value, "__name__", "")).encode())

    def _attributes(self, value: Any, *, is_module: bool) -> bytes:
        attributes: dict[str, Any] = dict(getattr(value, "__dict__", {}))
        for of in type(value).__mro__:
            listed = of.__dict__.get("__slots__", ())
            for key in (listed,) if isinstance(listed, str) else listed:
                if hasattr(value, key):
                    attributes[key] = getattr(value, key)
        if is_module:
            # Those of PyTorch and Lightning, which change while a module trains.
            is_own = self._is_own(type(value)) and "LightningModule" not in {of.__name__ for of in type(value).__mro__}
            base = vars(sys.modules["torch"].nn.Module())
            attributes = {
                key: own for key, own in attributes.items()
                if key not in base and (is_own or not key.startswith("_")) and (is_own or _plain(own) is not None)
            }
        return self._named(b"attributes", attributes.items())

    def _is_own(self, value: Any) -> bool:
        """Whether this is the user's code: of the method's package, or not installed."""
        module = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
        # A function that was compiled from a text may have none.
        module = "" if module is None and isinstance(value, FunctionType) else module
        if not isinstance(module, str) or _root(module) in _FOREIGN:
            return False
        file = value.__code__.co_filename if isinstance(value, FunctionType) else getattr(sys.modules.get(module), "__file__", None)
        place = os.path.realpath(file) if file else ""
        is_installed = "site-packages" in place or "dist-packages" in place
        return not is_installed or _root(module) == self._package


def _digest(kind: bytes, *parts: bytes) -> bytes:
    whole = hashlib.sha256(kind)
    for part in parts:
        whole.update(struct.pack("<q", len(part)))
        whole.update(part)
    return whole.digest()


def _plain(value: Any) -> bytes | None:
    """The hash of a constant; None if it is none."""
    if value is None or value is Ellipsis or isinstance(value, (bool, int, float, complex, str, bytes, range, slice)):
        return _digest(b"constant", type(value).__name__.encode(), repr(value).encode())
    if isinstance(value, np.generic) and not value.dtype.hasobject:
        return _digest(b"number", value.dtype.str.encode(), value.tobytes())
    if isinstance(value, np.dtype) or type(value).__module__ == "torch" and type(value).__name__ in ("dtype", "device", "layout"):
        return _digest(b"constant", str(value).encode())
    return None


def _array(value: Any, torch: Any) -> bytes | None:
    if isinstance(value, np.ndarray):
        content = value.tobytes() if not value.dtype.hasobject else repr(value.shape).encode()
        return _digest(b"array", str(value.dtype).encode(), repr(value.shape).encode(), content)
    if hasattr(torch, "Tensor") and isinstance(value, torch.Tensor):
        from .torch import tensor_bytes

        return _digest(b"tensor", *tensor_bytes(value))
    return None


def _source(code: CodeType) -> bytes:
    """Its text. Of a lambda, whose lines hold more than itself, and of what an interpreter was given, the instructions."""
    try:
        if code.co_name != "<lambda>":
            return textwrap.dedent(inspect.getsource(code)).encode()
    except (OSError, TypeError, SyntaxError, IndexError):
        pass
    return _digest(b"code", code.co_code, repr((code.co_names, code.co_freevars)).encode(), *map(_constant, code.co_consts))


def _constant(value: Any) -> bytes:
    if isinstance(value, CodeType):
        return _source(value)
    if isinstance(value, frozenset):
        return _digest(b"set", *sorted(map(_constant, value)))
    return _digest(b"tuple", *map(_constant, value)) if isinstance(value, tuple) else repr(value).encode()


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code, and that of functions inside of it."""
    yield code
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield from _codes(one)


def _loaded(code: CodeType) -> set[str]:
    """Globals that a function reads."""
    found = (one for part in _codes(code) for one in dis.get_instructions(part))
    return {one.argval for one in found if one.opname in ("LOAD_GLOBAL", "LOAD_NAME")}


def _assigned(code: CodeType) -> set[tuple[str, bool]]:
    """Variables that a function assigns, and whether they are globals; others may be of its closure."""
    found = (one for part in _codes(code) for one in dis.get_instructions(part))
    kinds = {"STORE_GLOBAL": True, "DELETE_GLOBAL": True, "STORE_DEREF": False, "DELETE_DEREF": False}
    return {(one.argval, kinds[one.opname]) for one in found if one.opname in kinds}


def _is_filled(cell: Any) -> bool:
    try:
        cell.cell_contents
    except ValueError:
        return False
    return True


def _function_of(member: Any) -> Any:
    if isinstance(member, (staticmethod, classmethod)):
        member = member.__func__
    return member.fget if isinstance(member, property) else member


def _first(item: tuple[str, Any]) -> str:
    return item[0]


def _short(value: Any) -> str:
    """Its name in the module, or in the function that it was made in."""
    return str(value.__qualname__).rsplit("<locals>.", 1)[-1]


def _name(value: Any) -> str:
    return f"{getattr(value, '__module__', None)}.{getattr(value, '__qualname__', type(value).__qualname__)}"


def _root(module: str) -> str:
    return module.split(".")[0]
