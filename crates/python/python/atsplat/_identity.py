"""What a method is: hashes of its code and of the values that the code uses.

A store keeps them, so that results of one method are never taken for those of another with its name. They are equal in every process:
nothing depends on addresses, or on the order of sets and dicts.

A part is the source of a function or class, the file of a module that a function imports, or the value of a variable. Followed are
variables in closures and globals, defaults, what a method is bound to, the arguments of ``functools.partial``, and what configurations are
made of: items, attributes, members of enumerations, attributes of classes. Code of installed packages counts by name. Not followed are
files, random generators, and objects of other libraries, which count by their type's name; :func:`examined` lists their types. Variables
that one of the functions assigns are the method's state, not what it is.
"""

from __future__ import annotations

import functools
import os
import sys
from abc import ABCMeta
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Set
from enum import Enum
from pathlib import PurePath
from types import BuiltinFunctionType, FunctionType, MethodType, MethodWrapperType, ModuleType
from typing import Any

from . import _code, _contents
from ._code import FOREIGN, root
from ._contents import digest, plain

#: Parts that are listed in a record; further ones share a hash.
LISTED = 48


def identity(method: Callable[..., Any]) -> dict[str, str]:
    """Hashes of the parts of a method, by what they are."""
    return examined(method)[0]


def examined(method: Callable[..., Any]) -> tuple[dict[str, str], list[str]]:
    """The identity of a method, and the types of objects of which it has no more than the type's name."""
    walk = _Walk(method)
    if walk.assigned:
        walk = _Walk(method, walk.assigned)
    unseen = sorted(walk.unseen)
    if len(walk.parts) <= LISTED:
        return walk.parts, unseen
    names = list(walk.parts)
    kept = {name: walk.parts[name] for name in names[: LISTED - 1]}
    others = (f"{name} {walk.parts[name]}".encode() for name in sorted(names[LISTED - 1 :]))
    return {**kept, f"{len(names) - LISTED + 1} others": digest(b"others", *others).hex()[:16]}, unseen


def modules(method: Callable[..., Any]) -> list[Any]:
    """The ``torch.nn.Module`` that a method is, contains or uses; without those inside of others."""
    return _Walk(method).modules


class _Walk:
    """Goes through everything that a method uses."""

    def __init__(self, method: Callable[..., Any], state: Set[tuple[int, str]] = frozenset()) -> None:
        #: Variables that functions assign, by the address of their cell or globals; ``state`` has those that are left out.
        self.assigned: set[tuple[int, str]] = set()
        self._state = state
        self.parts: dict[str, str] = {}
        self.modules: list[Any] = []
        #: Types of objects that are known by them alone; not those of a library's function, which are its internals.
        self.unseen: set[str] = set()
        self._is_in_library = False
        #: Digests by address, with the objects, which keep their addresses that way.
        self._known: dict[int, tuple[Any, bytes]] = {}
        self._imported: set[str] = set()
        of = method if isinstance(method, (FunctionType, type)) else type(getattr(method, "func", getattr(method, "__self__", method)))
        self._package = root(of.__module__ or "")
        hashed = self._value(method)
        if not isinstance(method, FunctionType):
            self._add("method", hashed)

    def _add(self, name: str, hashed: bytes) -> None:
        key, number = name, 1
        while key in self.parts:
            number += 1
            key = f"{name} #{number}"
        self.parts[key] = hashed.hex()[:16]

    def _value(self, value: Any) -> bytes:
        constant = plain(value)
        if constant is not None:
            return constant
        known = self._known.get(id(value))
        if known is not None:
            return known[1]
        # What refers to itself.
        self._known[id(value)] = value, b"itself"
        hashed = self._compound(value)
        self._known[id(value)] = value, hashed
        return hashed

    def _compound(self, value: Any) -> bytes:
        torch = sys.modules.get("torch")
        if torch is not None and hasattr(torch, "nn") and isinstance(value, torch.nn.Module):
            return self._module(value)
        content = self._content(value)
        if content is not None:
            return self._with_class(value, content)
        if isinstance(value, (functools.partial, functools.partialmethod)):
            return digest(b"partial", *(self._value(part) for part in (value.func, value.args, value.keywords)))
        if isinstance(value, MethodType):
            return digest(b"method", self._value(value.__self__), self._value(value.__func__))
        if isinstance(value, FunctionType):
            return self._inside(not self._is_user_code(value), lambda: self._function(value))
        if isinstance(value, type):
            return self._class(value)
        if isinstance(value, ModuleType):
            # One that is not a variable of a function, which would say what it uses of it.
            self._follow([value.__name__])
            return _named_module(value)
        if isinstance(value, (BuiltinFunctionType, MethodWrapperType)):
            is_bound = isinstance(value.__self__, (Mapping, list, tuple, Set, str, bytes))
            return digest(b"function", _name(value).encode(), *([self._value(value.__self__)] if is_bound else []))
        return self._object(value)

    def _inside(self, is_library: bool, of: Callable[[], bytes]) -> bytes:
        before, self._is_in_library = self._is_in_library, is_library
        try:
            return of()
        finally:
            self._is_in_library = before

    def _content(self, value: Any) -> bytes | None:
        """The hash of items, numbers and the like, of whatever class; None for other objects."""
        array = _contents.array_of(value)
        if array is not None:
            objects = _contents.objects_in(value)
            return array if objects is None else digest(b"objects", array, *map(self._value, objects))
        for of in _contents.NUMBERS_AND_TEXTS:
            if isinstance(value, of) and not isinstance(value, Enum):
                return digest(b"constant", of.__name__.encode(), of.__repr__(value).encode())
        if isinstance(value, (list, tuple)):
            return digest(b"list" if isinstance(value, list) else b"tuple", *map(self._value, _iterated(value)))
        if isinstance(value, dict):
            items = self._named(b"dict", dict.items(value))
            factory = value.default_factory if isinstance(value, defaultdict) else None
            return items if factory is None or isinstance(factory, type) else digest(b"defaultdict", items, self._value(factory))
        if isinstance(value, (set, frozenset)):
            return digest(b"set", *sorted(map(self._value, _iterated(value))))
        if isinstance(value, _contents.NAMESPACES) and not self._is_user_code(type(value)):
            return self._named(b"namespace", vars(value).items())
        standard = _contents.standard(value)
        if standard is not None:
            return digest(b"standard", _base(type(value)).encode(), self._value(standard))
        of = type(value)
        if not isinstance(value, Mapping) or self._is_user_code(of) or root(of.__module__) in _contents.VOLATILE_MAPPINGS:
            return None
        try:
            read = list(value.items())
        except Exception:
            # A file that is closed, or values that are missing.
            return None
        return self._named(b"dict", read)

    def _with_class(self, value: Any, content: bytes) -> bytes:
        """With what a subclass adds."""
        of = type(value)
        if self._is_user_code(of):
            return digest(b"subclass", content, self._value(of), self._attributes(value, is_module=False))
        adds = isinstance(value, dict) and root(of.__module__) not in FOREIGN and getattr(value, "__dict__", None)
        return digest(b"subclass", content, self._attributes(value, is_module=False)) if adds else content

    def _named(self, kind: bytes, items: Iterable[tuple[Any, Any]]) -> bytes:
        ordered = sorted(((self._value(key), value) for key, value in items), key=lambda item: item[0])
        return digest(kind, *(part for key, value in ordered for part in (key, self._value(value))))

    def _function(self, function: FunctionType) -> bytes:
        """Its source is a part, and so is each of its variables; to others it is a name."""
        name, code = _short(function), function.__code__
        cells = dict(zip(code.co_freevars, function.__closure__ or ()))
        scope = id(function.__globals__)
        for key, is_global in _code.assigned(code):
            if is_global or key in cells:
                self.assigned.add((scope if is_global else id(cells[key]), key))
        cells = {key: cell for key, cell in cells.items() if key != "__class__" and (id(cell), key) not in self._state}
        used = {key: cell.cell_contents for key, cell in cells.items() if _is_filled(cell)}
        defaults = self._value(function.__defaults__), self._value(function.__kwdefaults__)
        if not self._is_user_code(function):
            # A decorator of another library, for example: what it wraps is in its closure.
            closure = (self._value(value) for _, value in sorted(used.items(), key=_first))
            return digest(b"function", _name(function).encode(), *defaults, *closure)
        for key in _code.loaded(code):
            if key in function.__globals__ and not key.startswith("__") and (scope, key) not in self._state:
                used[key] = function.__globals__[key]
        names = {name for one in _code.codes(code) for name in one.co_names if not name.startswith("__")}
        used |= self._used_of_modules(used, names)
        self._follow(_code.imported(code, _code.package_of(function)))
        others = [b for key, value in sorted(used.items(), key=_first) for b in self._variable(f"{name}, {key}", value)]
        self._add(name, digest(b"function", _code.source(code), *defaults, *others))
        return digest(b"function", name.encode())

    def _used_of_modules(self, used: dict[str, Any], names: set[str]) -> dict[str, Any]:
        """What a function that uses these variables and names may use of the user's modules, and of modules in them."""
        found: dict[str, Any] = {}
        waiting = [(key, value) for key, value in sorted(used.items(), key=_first) if isinstance(value, ModuleType)]
        direct, seen = len(waiting), set()
        for at, (key, module) in enumerate(waiting):
            if self._is_user_code(module) and (at < direct or id(module) not in seen and not _code.is_installed(_place(module))):
                seen.add(id(module))
                members = {f"{key}.{name}": vars(module)[name] for name in sorted(names & vars(module).keys())}
                found |= members
                waiting += [(name, value) for name, value in members.items() if isinstance(value, ModuleType)]
        return found

    def _follow(self, names: Iterable[str]) -> None:
        """Adds the files of modules that are not installed, and of those that they import. Nothing is imported: that may run anything."""
        waiting = sorted(names, reverse=True)
        while waiting:
            name = waiting.pop()
            if name in self._imported or root(name) in FOREIGN:
                continue
            self._imported.add(name)
            file, folders = _code.located(name) or (None, None)
            if file is None or _code.is_installed(os.path.realpath(file)):
                continue
            try:
                content, code = _code.content_of(file)
            except OSError:
                self.unseen.add(f"the module {name}")
                continue
            self._add(f"module {name}", content)
            if code is not None:
                package = name if folders is not None else name.rpartition(".")[0]
                waiting += sorted(_code.imported(code, package), reverse=True)

    def _variable(self, name: str, value: Any) -> list[bytes]:
        """Adds the part of a variable; what is known by its name has none, and belongs to the source."""
        if isinstance(value, ModuleType):
            return [_named_module(value)]
        hashed = self._value(value)
        if isinstance(value, (FunctionType, type, BuiltinFunctionType)):
            return [hashed]
        self._add(name, hashed)
        return []

    def _class(self, of: type) -> bytes:
        if not self._is_user_code(of):
            return digest(b"class", _name(of).encode())
        bases = [self._value(base) for base in of.__bases__ if base is not object]
        if self._is_user_code(type(of)):
            bases.append(self._value(type(of)))
        is_installed = _code.is_installed(_place(of))
        members = [(key, _function_of(member, is_installed)) for key, member in sorted(vars(of).items())]
        methods = [member for _, member in members if isinstance(member, FunctionType)]
        values = [(key, member) for key, member in members if not key.startswith("__") and plain(member) is not None]
        # A library's classes, also of the method's package, lead to all of it.
        values += [] if is_installed else self._other_members(of, members)
        self._add(_short(of), digest(b"class", *bases, self._named(b"members", values)))
        for method in methods:
            self._value(method)
        return digest(b"class", _short(of).encode())

    def _other_members(self, of: type, members: list[tuple[str, Any]]) -> list[tuple[str, Any]]:
        """Members of a class that are neither constants nor methods under the names of their functions."""
        if issubclass(of, Enum):
            return [(f"{of.__name__}.{key}", member.value) for key, member in of.__members__.items() if plain(member) is None]
        # What another metaclass leaves in a class is made from the rest.
        is_usual = type(of) in (type, ABCMeta) or self._is_user_code(type(of))
        found = []
        for key, member in members:
            if isinstance(member, FunctionType):
                # Annotations have a function of another name since Python 3.14.
                if key != member.__name__ and not key.startswith("__annot"):
                    found.append((key, member))
            elif is_usual and not key.startswith("__") and key != "_abc_impl" and plain(member) is None:
                is_descriptor = hasattr(type(member), "__get__") and not isinstance(member, (functools.partialmethod, functools.partial))
                if not is_descriptor or callable(member):
                    found.append((key, member))
        return found

    def _module(self, module: Any) -> bytes:
        """Parameters and buffers, and of each module inside its class and its plain attributes."""
        from .torch import state_hash

        if all(module is not part for known in self.modules for part in known.modules()):
            self.modules.append(module)
        parts = [state_hash(module).encode()]
        for key, part in module.named_modules():
            self._known[id(part)] = part, digest(b"module", key.encode())
            parts += [key.encode(), self._value(type(part)), self._attributes(part, is_module=True)]
        return digest(b"module", *parts)

    def _object(self, value: Any) -> bytes:
        of = type(value)
        if isinstance(value, PurePath):
            return digest(b"path", os.fspath(value).encode())
        if isinstance(value, Enum):
            # Combined flags may have no name.
            return digest(b"enum", _name(of).encode(), str(value.name).encode(), self._value(value.value), self._value(of))
        if of.__module__ == "atsplat.gaussians":
            return digest(b"gaussians", *(self._value(part) for part in value.__reduce__()[1]))
        if self._is_user_code(of) or hasattr(of, "__dataclass_fields__"):
            return self._inside(False, lambda: digest(b"object", self._value(of), self._attributes(value, is_module=False)))
        wrapped = _attribute(value, "__wrapped__")
        if isinstance(wrapped, (FunctionType, MethodType, functools.partial)) or wrapped is not None and self._is_user_code(type(wrapped)):
            return self._value(wrapped)
        if not self._is_in_library and not _contents.is_harmless(value):
            self.unseen.add(_name(of))
        # A ufunc has a name that its type does not say.
        return digest(b"object", _name(of).encode(), str(_attribute(value, "__name__") or "").encode())

    def _attributes(self, value: Any, *, is_module: bool) -> bytes:
        attributes: dict[str, Any] = dict(_attribute(value, "__dict__") or {})
        for of in type(value).__mro__:
            listed = of.__dict__.get("__slots__", ())
            for key in (listed,) if isinstance(listed, str) else listed:
                if hasattr(value, key):
                    attributes[key] = getattr(value, key)
        if is_module:
            # Those of PyTorch and Lightning, which change while a module trains.
            is_lightning = "LightningModule" in {of.__name__ for of in type(value).__mro__}
            is_user_code = self._is_user_code(type(value)) and not is_lightning
            base = vars(sys.modules["torch"].nn.Module())
            # A convolution's stride is a tuple.
            kinds = (tuple,) if is_lightning else (tuple, list)
            attributes = {
                key: item for key, item in attributes.items()
                if key not in base and (is_user_code or not key.startswith("_") and _contents.is_flat(item, kinds))
            }
        return self._named(b"attributes", attributes.items())

    def _is_user_code(self, value: Any) -> bool:
        """Whether this is the user's code: of the method's package, or not installed."""
        module = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
        # A function that was compiled from a text may have none.
        module = "" if module is None and isinstance(value, FunctionType) else module
        if not isinstance(module, str) or root(module) in FOREIGN:
            return False
        return not _code.is_installed(_place(value)) or root(module) == self._package


def _place(value: Any) -> str:
    """The file of a module, a class or a function's code."""
    module = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None) or ""
    file = value.__code__.co_filename if isinstance(value, FunctionType) else getattr(sys.modules.get(module), "__file__", None)
    return os.path.realpath(file) if file else ""


def _is_filled(cell: Any) -> bool:
    try:
        cell.cell_contents
    except ValueError:
        return False
    return True


def _function_of(member: Any, is_installed: bool) -> Any:
    """The function of a method of whichever kind."""
    if isinstance(member, (staticmethod, classmethod)):
        member = member.__func__
    if isinstance(member, property):
        return member.fget
    if is_installed:
        return member
    if isinstance(member, functools.cached_property):
        return member.func
    wrapped = None if isinstance(member, (FunctionType, type)) else _attribute(member, "__wrapped__")
    return wrapped if isinstance(wrapped, FunctionType) and type(member).__module__ == "functools" else member


def _iterated(value: Any) -> Iterable[Any]:
    """The items that are stored, whatever a subclass makes of them."""
    base = next(of for of in (list, tuple, set, frozenset) if isinstance(value, of))
    return base.__iter__(value)


def _attribute(value: Any, name: str) -> Any:
    """An attribute, None if there is none: a class may make anything of names that it does not know."""
    try:
        return getattr(value, name, None)
    except Exception:
        return None


def _first(item: tuple[str, Any]) -> str:
    return item[0]


def _named_module(module: ModuleType) -> bytes:
    return digest(b"module", module.__name__.encode())


def _base(of: type) -> str:
    """The name of a class of the standard library, or of the one that a class is made from."""
    return next((_name(one) for one in of.__mro__ if root(one.__module__) in FOREIGN or root(one.__module__) == "numpy"), _name(of))


def _short(value: Any) -> str:
    """Its name in the module, or in the function that it was made in."""
    return str(value.__qualname__).rsplit("<locals>.", 1)[-1]


def _name(value: Any) -> str:
    return f"{getattr(value, '__module__', None)}.{getattr(value, '__qualname__', type(value).__qualname__)}"
