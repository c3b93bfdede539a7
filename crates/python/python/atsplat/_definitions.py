"""Functions and classes: the user's have parts of their own, and are known by their names to others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Set
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any

from . import _code, _files, _members
from ._contents import digest, plain
from ._members import name_of, short_name
from ._parts import Parts


#: What is known by its name: as a variable, it has no part of its own.
BY_NAME = (ModuleType, FunctionType, type, BuiltinFunctionType)


class Definitions(Parts):
    """Hashes functions and classes, of whose values a subclass knows more."""

    def __init__(self, state: Set[tuple[int, str]]) -> None:
        super().__init__()
        #: Variables that functions assign, by the address of their cell or globals; ``state`` has those that are left out.
        self.assigned: set[tuple[int, str]] = set()
        self._state = state
        #: Hashes of values by address, with the values, which keep their addresses that way.
        self._known: dict[int, tuple[Any, bytes]] = {}
        #: What is in a library's function is its internals.
        self._is_in_library = False

    def value(self, value: Any) -> bytes:
        """The hash of a value."""
        raise NotImplementedError

    def _named(self, kind: bytes, items: Iterable[tuple[Any, Any]]) -> bytes:
        raise NotImplementedError

    def _know(self, value: Any, hashed: bytes) -> bytes:
        self._known[id(value)] = value, hashed
        return hashed

    def _inside(self, is_library: bool, of: Callable[[], bytes]) -> bytes:
        before, self._is_in_library = self._is_in_library, is_library
        try:
            return of()
        finally:
            self._is_in_library = before

    def _function(self, function: FunctionType) -> bytes:
        is_user_code = self._is_user_code(function)
        return self._inside(not is_user_code, lambda: (self._of_user if is_user_code else self._of_library)(function))

    def _closure(self, function: FunctionType) -> dict[str, Any]:
        """What is in a function's closure, apart from the method's state."""
        code, scope = function.__code__, id(function.__globals__)
        cells = dict(zip(code.co_freevars, function.__closure__ or ()))
        for key, is_global in _code.assigned(code):
            if is_global or key in cells:
                self.assigned.add((scope if is_global else id(cells[key]), key))
        cells = {key: cell for key, cell in cells.items() if key != "__class__" and (id(cell), key) not in self._state}
        return {key: cell.cell_contents for key, cell in sorted(cells.items()) if _is_filled(cell)}

    def _of_library(self, function: FunctionType) -> bytes:
        """A decorator, for example: what it wraps is in its closure."""
        used = self._closure(function).values()
        parts = function.__defaults__, function.__kwdefaults__, *used
        return digest(b"function", name_of(function).encode(), *map(self.value, parts))

    def _of_user(self, function: FunctionType) -> bytes:
        """The source is a part, and so is each variable; to others the function is a name."""
        key = self._key(short_name(function))
        hashed = self._know(function, digest(b"function", key.encode()))
        code, used = function.__code__, self._closure(function)
        for name in _code.loaded(code):
            if name in function.__globals__ and not name.startswith("__") and (id(function.__globals__), name) not in self._state:
                used[name] = function.__globals__[name]
        names = {name for one in _code.codes(code) for name in one.co_names if not name.startswith("__")}
        used |= self._used_of_modules(used, names)
        self._follow(_code.imported(code, _code.package_of(function)))
        own = {name: value for name, value in vars(function).items() if not name.startswith("__")}
        parts = [self.value(function.__defaults__), self.value(function.__kwdefaults__), self._named(b"attributes", own.items())]
        parts += [part for name, value in sorted(used.items(), key=_first) for part in self._variable(f"{key}, {name}", value)]
        self._put(key, digest(b"function", self._source(function), *parts))
        return hashed

    def _source(self, function: FunctionType) -> bytes:
        return _code.source(function.__code__)

    def _used_of_modules(self, used: dict[str, Any], names: set[str]) -> dict[str, Any]:
        """What a function that uses these variables and names may use of the user's modules, and of modules in them."""
        found: dict[str, Any] = {}
        waiting = [(key, value) for key, value in sorted(used.items(), key=_first) if isinstance(value, ModuleType)]
        direct, seen = len(waiting), set()
        for at, (key, module) in enumerate(waiting):
            is_user_code = self._is_user_code(module)
            if is_user_code and (at < direct or id(module) not in seen and not _files.is_installed(_files.place(module))):
                seen.add(id(module))
                members = {f"{key}.{name}": vars(module)[name] for name in sorted(names & vars(module).keys())}
                found |= members
                waiting += [(name, value) for name, value in members.items() if isinstance(value, ModuleType)]
        return found

    def _variable(self, name: str, value: Any) -> list[bytes]:
        """Adds the part of a variable; what is known by its name has none, and belongs to the source."""
        if isinstance(value, ModuleType):
            self._follow_binary(value)
            return [named_module(value)]
        if isinstance(value, (FunctionType, type, BuiltinFunctionType)):
            return [self.value(value)]
        # Before the parts that its value has, so that a list which is cut begins with the method's own.
        key = self._key(name)
        self._put(key, self.value(value))
        return []

    def _class(self, of: type) -> bytes:
        if not self._is_user_code(of):
            return digest(b"class", name_of(of).encode())
        key = self._key(short_name(of))
        hashed = self._know(of, digest(b"class", key.encode()))
        self._follow_binary(of)
        bases = [self.value(base) for base in of.__bases__ if base is not object]
        if self._is_user_code(type(of)):
            bases.append(self.value(type(of)))
        is_installed = _files.is_installed(_files.place(of))
        members = _members.members(of, is_installed)
        values = [(name, member) for name, member in members if not name.startswith("__") and plain(member) is not None]
        # A library's classes, also of the method's package, lead to all of it.
        values += [] if is_installed else _members.other_members(of, members, self._is_user_code)
        self._put(key, digest(b"class", *bases, self._named(b"members", values)))
        for _, member in members:
            if isinstance(member, FunctionType):
                self.value(member)
        return hashed


def _is_filled(cell: Any) -> bool:
    try:
        cell.cell_contents
    except ValueError:
        return False
    return True


def _first(item: tuple[str, Any]) -> str:
    return item[0]


def named_module(module: ModuleType) -> bytes:
    """What a module is to a function that has it as a variable."""
    return digest(b"module", module.__name__.encode())
