"""What a method is: hashes of its code and of the values that the code uses.

A store keeps them, so that results of one method are never taken for those of another with its name. They are equal in every process:
nothing depends on addresses, or on the order of sets and dicts.

A part is the source of a function or class, the file of a module that a function imports, the value of a variable, the value of an
attribute of the object that is called (``method.weights``), or the version of an installed package. Followed are variables in closures
and globals, defaults, what a method is bound to, the arguments of ``functools.partial``, and what configurations are made of: items,
attributes, members of enumerations, attributes of classes. Code of installed packages counts by name. Not followed are files, random
generators, and objects of other libraries, which count by their type's name; :func:`examined` lists their types. Variables that one of
the functions assigns are the method's state, not what it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import FunctionType
from typing import Any

from ._arrays import invalid
from ._contents import digest
from ._walk import Walk

#: Increase it whenever a method's hashes change although the method does not: then stores say why they differ.
RULES = 3
#: Those of methods without attributes, whose hashes have not changed since.
RULES_WITHOUT_ATTRIBUTES = 2
#: Parts that are listed in a record; further ones share a hash.
LISTED = 48


def identity(method: Callable[..., Any]) -> dict[str, str]:
    """Hashes of the parts of a method, by what they are."""
    return examined(method)[0]


def examined(method: Callable[..., Any]) -> tuple[dict[str, str], list[str]]:
    """The identity of a method, and the types of objects of which it has no more than the type's name."""
    walk = Walk().method(method)
    if walk.assigned:
        walk = Walk(walk.assigned, walk.arrays).method(method)
    parts, unseen = {**walk.parts, **dict(sorted(walk.packages.items()))}, sorted(walk.unseen)
    if len(parts) <= LISTED:
        return parts, unseen
    names = list(parts)
    kept = {name: parts[name] for name in names[: LISTED - 1]}
    others = (f"{name} {parts[name]}".encode() for name in sorted(names[LISTED - 1 :]))
    return {**kept, f"{len(names) - LISTED + 1} others": digest(b"others", *others).hex()[:16]}, unseen


def rules(parts: Iterable[str]) -> int:
    """The rules by which parts with these names were hashed. Where the attributes of the object that is called are no parts, they are
    those of before, so that older stores are resumed."""
    has_attributes = any(name.startswith("method.") or name.endswith(" others") for name in parts)
    return RULES if has_attributes else RULES_WITHOUT_ATTRIBUTES


def modules(method: Callable[..., Any]) -> list[Any]:
    """The ``torch.nn.Module`` that a method is, contains or uses; without those inside of others.

    Raises:
        InvalidError: if what the method uses cannot be gone through.
    """
    try:
        return _Finder().method(method).modules
    except Exception as error:
        raise invalid("method", f"its modules cannot be found ({type(error).__name__}: {error}): give module=…") from error


def state_hash(module: Any) -> str:
    """The hash of a module's state."""
    walk = Walk()
    return digest(b"state", walk.state(module), *walk.listed()).hex()


class _Finder(Walk):
    """Finds modules alone: neither arrays nor files are read."""

    def _array(self, value: Any) -> bytes:
        return b"array"

    def state(self, module: Any) -> bytes:
        return b"state"

    def _source(self, function: FunctionType) -> bytes:
        return b"source"

    def _follow(self, names: Iterable[str]) -> None:
        return

    def _read(self, name: str, file: str) -> Any:
        return None
