"""What classes and objects have: members, attributes, names."""

from __future__ import annotations

import functools
from abc import ABCMeta
from collections.abc import Callable, Iterable
from enum import Enum
from types import FunctionType, MethodType
from typing import Any

from ._contents import attribute, plain
from ._files import FOREIGN, root

#: Modules of PyTorch that pass calls on to another, by the attribute that has it.
_WRAPPERS = {"OptimizedModule": "_orig_mod", "DataParallel": "module", "DistributedDataParallel": "module"}


def inner(value: Any) -> Any:
    """The module in one of PyTorch's that passes calls on (compiled, parallel); None for other objects."""
    of = type(value)
    key = _WRAPPERS.get(of.__name__) if root(of.__module__) == "torch" else None
    return None if key is None else attribute(value, key)


def called(method: Callable[..., Any]) -> Any:
    """What a call comes down to: without ``functools.partial`` and :func:`inner`, and of a bound method its object."""
    while True:
        found = inner(method)
        if isinstance(method, functools.partial):
            found = method.func
        elif isinstance(method, MethodType):
            found = method.__self__
        if found is None:
            return method
        method = found


def members(of: type, is_installed: bool) -> list[tuple[str, Any]]:
    """The members of a class by name, with the functions that they are made of in their place."""
    return [(key, part) for key, member in sorted(vars(of).items()) for part in _functions_of(member, is_installed)]


def _functions_of(member: Any, is_installed: bool) -> list[Any]:
    if isinstance(member, (staticmethod, classmethod)):
        return [member.__func__]
    if isinstance(member, property):
        return [one for one in (member.fget, member.fset, member.fdel) if one is not None]
    if is_installed:
        return [member]
    if isinstance(member, functools.cached_property):
        return [member.func]
    if isinstance(member, functools.singledispatchmethod):
        return list(member.dispatcher.registry.values())
    wrapped = None if isinstance(member, (FunctionType, type)) else attribute(member, "__wrapped__")
    return [wrapped if isinstance(wrapped, FunctionType) and type(member).__module__ == "functools" else member]


def other_members(
    of: type, found: list[tuple[str, Any]], is_user_code: Callable[[Any], bool]
) -> list[tuple[str, Any]]:
    """Those of a class's members that are neither constants nor methods under the names of their functions."""
    if issubclass(of, Enum):
        return [(f"{of.__name__}.{key}", member.value) for key, member in of.__members__.items() if plain(member) is None]
    # What another metaclass leaves in a class is made from the rest.
    is_usual = type(of) in (type, ABCMeta) or is_user_code(type(of))
    others = []
    for key, member in found:
        if isinstance(member, FunctionType):
            # Annotations have a function of another name since Python 3.14.
            if key != member.__name__ and not key.startswith("__annot"):
                others.append((key, member))
        elif is_usual and not key.startswith("__") and key != "_abc_impl" and plain(member) is None:
            is_descriptor = hasattr(type(member), "__get__") and not isinstance(member, (functools.partialmethod, functools.partial))
            if not is_descriptor or callable(member) or is_user_code(type(member)):
                others.append((key, member))
    return others


def attributes(value: Any) -> dict[str, Any]:
    """The attributes of an object, also in slots."""
    found: dict[str, Any] = dict(attribute(value, "__dict__") or {})
    for of in type(value).__mro__:
        listed = of.__dict__.get("__slots__", ())
        for key in (listed,) if isinstance(listed, str) else listed:
            is_private = key.startswith("__") and not key.endswith("__")
            name = f"_{of.__name__.lstrip('_')}{key}" if is_private else key
            if hasattr(value, name):
                found[name] = getattr(value, name)
    return found


def iterated(value: Any) -> Iterable[Any]:
    """The items that are stored, whatever a subclass makes of them."""
    base = next(of for of in (list, tuple, set, frozenset) if isinstance(value, of))
    return base.__iter__(value)


def base_name(of: type) -> str:
    """The name of a class of the standard library, or of the one that a class is made from."""
    return next((name_of(one) for one in of.__mro__ if root(one.__module__) in FOREIGN or root(one.__module__) == "numpy"), name_of(of))


def short_name(value: Any) -> str:
    """Its name in the module, or in the function that it was made in."""
    return str(value.__qualname__).rsplit("<locals>.", 1)[-1]


def name_of(value: Any) -> str:
    return f"{getattr(value, '__module__', None)}.{getattr(value, '__qualname__', type(value).__qualname__)}"
