"""Goes through everything that a method uses."""

from __future__ import annotations

import copy
import functools
import os
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Set
from enum import Enum
from pathlib import PurePath
from types import BuiltinFunctionType, FunctionType, MethodType, MethodWrapperType, ModuleType
from typing import Any

import numpy as np

from . import _contents, _files, _members, _modules
from ._contents import attribute, digest, plain
from ._definitions import BY_NAME, Definitions, named_module
from ._files import FOREIGN, root
from ._members import name_of

#: Of a library's module, those with an array in them change while it runs: caches, sums of metrics.
_CONTAINERS = (list, tuple, dict, set, frozenset, np.ndarray)


class Walk(Definitions):
    """Hashes values, and finds modules."""

    def __init__(self, state: Set[tuple[int, str]] = frozenset(), arrays: dict[int, tuple[Any, bytes]] | None = None) -> None:
        super().__init__(state)
        self.modules: list[Any] = []
        #: Hashes of arrays by address, with the arrays, which keep their addresses that way; for another walk of the same method.
        self.arrays: dict[int, tuple[Any, bytes]] = {} if arrays is None else arrays
        self._numbered = 0
        #: The object whose attributes are parts of their own.
        self._called: Any = None

    def method(self, method: Callable[..., Any]) -> Walk:
        """Goes through a method."""
        called = self._called = _members.called(method)
        of = called if isinstance(called, (FunctionType, type)) else type(called)
        package = root(of.__module__ or "")
        self._package = "" if package == "torch" else package
        hashed = self.value(method)
        if not isinstance(method, FunctionType) or not self._is_user_code(method):
            self._put(self._key("method"), hashed)
        return self

    def value(self, value: Any) -> bytes:
        """The hash of a value."""
        constant = plain(value)
        if constant is not None:
            return constant
        known = self._known.get(id(value))
        if known is not None:
            return known[1]
        # What refers to itself.
        self._know(value, b"itself")
        return self._know(value, self._compound(value))

    def _compound(self, value: Any) -> bytes:
        torch = sys.modules.get("torch")
        if torch is not None and hasattr(torch, "nn") and isinstance(value, torch.nn.Module):
            return self._module(value)
        content = self._content(value)
        if content is not None:
            return self._with_class(value, content)
        if isinstance(value, (functools.partial, functools.partialmethod)):
            return digest(b"partial", *(self.value(part) for part in (value.func, value.args, value.keywords)))
        if isinstance(value, MethodType):
            return digest(b"method", self.value(value.__self__), self.value(value.__func__))
        if isinstance(value, FunctionType):
            return self._function(value)
        if isinstance(value, type):
            return self._class(value)
        if isinstance(value, ModuleType):
            # One that is not a variable of a function, which would say what it uses of it.
            if not self._follow_binary(value):
                self._follow([value.__name__])
            return named_module(value)
        if isinstance(value, (BuiltinFunctionType, MethodWrapperType)):
            self._follow_binary(value)
            is_bound = isinstance(value.__self__, (Mapping, list, tuple, Set, str, bytes))
            return digest(b"function", name_of(value).encode(), *([self.value(value.__self__)] if is_bound else []))
        return self._object(value)

    def _unseen(self, of: type) -> None:
        if not self._is_in_library:
            self.unseen.add(name_of(of))

    def _array(self, value: Any) -> bytes:
        known = self.arrays.get(id(value))
        if known is None:
            known = self.arrays[id(value)] = value, _contents.array(value)
        return known[1]

    def _content(self, value: Any) -> bytes | None:
        """The hash of items, numbers and the like, of whatever class; None for other objects."""
        if _contents.is_array(value):
            hashed, objects = self._array(value), _contents.objects_in(value)
            return hashed if objects is None else digest(b"objects", hashed, *map(self.value, objects))
        for of in _contents.NUMBERS_AND_TEXTS:
            if isinstance(value, of) and not isinstance(value, Enum):
                return digest(b"constant", of.__name__.encode(), of.__repr__(value).encode())
        if isinstance(value, (list, tuple)):
            return digest(b"list" if isinstance(value, list) else b"tuple", *map(self.value, _members.iterated(value)))
        if isinstance(value, dict):
            items = self._named(b"dict", dict.items(value))
            factory = value.default_factory if isinstance(value, defaultdict) else None
            return items if factory is None or isinstance(factory, type) else digest(b"defaultdict", items, self.value(factory))
        if isinstance(value, (set, frozenset)):
            return digest(b"set", *sorted(map(self.value, sorted(_members.iterated(value), key=self._apart))))
        if isinstance(value, _contents.NAMESPACES) and not self._is_user_code(type(value)):
            return self._named(b"namespace", vars(value).items())
        standard = _contents.standard(value)
        if standard is not None:
            return digest(b"standard", _members.base_name(type(value)).encode(), self.value(standard))
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
            return digest(b"subclass", content, self.value(of), self._attributes(value))
        adds = isinstance(value, dict) and root(of.__module__) not in FOREIGN and getattr(value, "__dict__", None)
        return digest(b"subclass", content, self._attributes(value)) if adds else content

    def _attributes(self, value: Any) -> bytes:
        return self._held(value, _members.attributes(value))

    def _held(self, value: Any, attributes: Mapping[str, Any]) -> bytes:
        """The attributes of an object. Those of the method are parts, so that an error names the one that differs."""
        if value is not self._called or all(isinstance(held, BY_NAME) for held in attributes.values()):
            return self._named(b"attributes", attributes.items())
        parts = []
        for name in sorted(attributes):
            parts += [name.encode(), *self._variable(f"method.{name}", attributes[name])]
        return digest(b"attributes", *parts)

    def _named(self, kind: bytes, items: Iterable[tuple[Any, Any]]) -> bytes:
        ordered = sorted(items, key=lambda item: self._apart(item[0]))
        return digest(kind, *(self.value(part) for item in ordered for part in item))

    def _apart(self, value: Any) -> bytes:
        """The hash of a value with its parts, as if nothing came after it: an order for what has none, because parts are numbered in the
        order in which they are met."""
        if _contents.is_flat(value):
            return self.value(value)
        walk = copy.copy(self)
        walk.parts, walk.packages = dict(self.parts), dict(self.packages)
        walk._known, walk._imported = dict(self._known), set(self._imported)
        walk.modules, walk.unseen, walk.assigned = [], set(), set()
        return digest(b"apart", walk.value(value), *walk.listed())

    def _module(self, module: Any) -> bytes:
        """Its state, and of each module inside its class, its attributes and hooks."""
        if all(module is not part for known in self.modules for part in known.modules()):
            self.modules.append(module)
        self._numbered += 1
        inside = list(module.named_modules())
        for key, part in inside:
            self._know(part, digest(b"module", str(self._numbered).encode(), key.encode()))
        parts = [self.state(module)]
        for key, part in inside:
            parts += [key.encode(), self.value(type(part)), self._settings(part), *map(self.value, _modules.hooks(part))]
        return digest(b"module", *parts)

    def state(self, module: Any) -> bytes:
        """The hash of the parameters and buffers of a module, and of what else its state has."""
        return digest(b"state", *(part for name, value in _modules.state(module) for part in (name.encode(), self.value(value))))

    def _settings(self, module: Any) -> bytes:
        """The attributes of a module, apart from those of modules inside."""
        of = type(module)
        held = _modules.attributes(module)
        if self._is_user_code(of):
            return self._held(module, held)
        if _modules.is_generated(of):
            self._unseen(of)
        if _modules.is_generated(of) or _members.inner(module) is not None:
            return b""
        read = {}
        for key, value in held.items():
            is_container = isinstance(value, _CONTAINERS) or isinstance(value, sys.modules["torch"].Tensor)
            if key.startswith("_"):
                continue
            if is_container and not _contents.is_flat(value):
                self._unseen(of)
            else:
                read[key] = value
        return self._named(b"attributes", read.items())

    def _object(self, value: Any) -> bytes:
        of = type(value)
        if isinstance(value, PurePath):
            return digest(b"path", os.fspath(value).encode())
        if isinstance(value, Enum):
            # Combined flags may have no name.
            return digest(b"enum", name_of(of).encode(), str(value.name).encode(), self.value(value.value), self.value(of))
        if of.__module__ == "atsplat.gaussians":
            return digest(b"gaussians", *(self.value(part) for part in value.__reduce__()[1]))
        self._follow_binary(value)
        if self._is_user_code(of) or hasattr(of, "__dataclass_fields__"):
            if any(_files.binary_of(one) for one in of.__mro__):
                # What is in it is no attribute.
                self._unseen(of)
            return self._inside(False, lambda: digest(b"object", self.value(of), self._attributes(value)))
        wrapped = attribute(value, "__wrapped__")
        if isinstance(wrapped, (FunctionType, MethodType, functools.partial)) or wrapped is not None and self._is_user_code(type(wrapped)):
            return self.value(wrapped)
        if not _contents.is_harmless(value):
            self._unseen(of)
        # A ufunc has a name that its type does not say.
        return digest(b"object", name_of(of).encode(), str(attribute(value, "__name__") or "").encode())
