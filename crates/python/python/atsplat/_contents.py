"""Values as bytes: constants, arrays, and objects of the standard library that are nothing but their content."""

from __future__ import annotations

import array as arrays
import datetime
import decimal
import fractions
import functools
import hashlib
import operator
import os
import re
import struct
import sys
import types
import uuid
from argparse import Namespace
from collections import deque
from enum import Enum
from typing import Any

import numpy as np

_CONSTANTS = (bool, int, float, complex, str, bytes, range, slice)
#: Bases of classes whose instances are constants with more to them.
NUMBERS_AND_TEXTS = (int, float, complex, str, bytes)
NAMESPACES = (Namespace, types.SimpleNamespace)
#: What pickle would store of these is their content, and the same in every process.
_REDUCED = (
    operator.itemgetter, operator.attrgetter, operator.methodcaller, arrays.array, uuid.UUID,
    datetime.date, datetime.time, datetime.timedelta, datetime.tzinfo,
)
#: Arrays of these libraries are in memory, and can be read as NumPy's.
_ARRAY_LIBRARIES = ("jax", "jaxlib", "tensorflow")
#: Objects of these modules have no influence on an output that their type's name does not tell: logs, locks, pools, type hints.
_HARMLESS = (
    "logging", "loguru", "tqdm", "threading", "_thread", "queue", "_queue", "concurrent", "multiprocessing", "asyncio", "contextvars",
    "typing", "typing_extensions", "abc", "_abc", "weakref", "_weakref", "_weakrefset",
)
_HARMLESS_OF_TORCH = ("torch.optim.", "torch.amp.", "torch.cuda.", "torch.utils.hooks.")
#: Their items are another program's matter, or change by themselves.
VOLATILE_MAPPINGS = ("os", "weakref", "_weakref")


def digest(kind: bytes, *parts: bytes) -> bytes:
    whole = hashlib.sha256(kind)
    for part in parts:
        whole.update(struct.pack("<q", len(part)))
        whole.update(part)
    return whole.digest()


def plain(value: Any) -> bytes | None:
    """The hash of a constant; None if it is none."""
    if value is None or value is Ellipsis or isinstance(value, _CONSTANTS) and _is_what_it_prints(value):
        return digest(b"constant", type(value).__name__.encode(), repr(value).encode())
    if isinstance(value, np.generic) and not value.dtype.hasobject:
        return digest(b"number", value.dtype.str.encode(), value.tobytes())
    if isinstance(value, np.dtype) or type(value).__module__ == "torch" and type(value).__name__ in ("dtype", "device", "layout"):
        return digest(b"constant", str(value).encode())
    return None


def _is_what_it_prints(value: Any) -> bool:
    """Whether a constant's text says all about it; of subclasses, that of those without attributes and another text."""
    of = type(value)
    if of in _CONSTANTS:
        return True
    prints = next(one.__module__ for one in of.__mro__ if "__repr__" in vars(one))
    return prints in ("builtins", "enum", "numpy") and (isinstance(value, Enum) or not getattr(value, "__dict__", None))


def is_flat(value: Any) -> bool:
    """Whether this is a constant, or made of constants alone."""
    if plain(value) is not None:
        return True
    if type(value) is dict:
        return all(is_flat(part) for item in value.items() for part in item)
    return type(value) in (tuple, list, set, frozenset) and all(map(is_flat, value))


def is_array(value: Any) -> bool:
    """Whether this is an array or a tensor."""
    tensor = getattr(sys.modules.get("torch"), "Tensor", None)
    if isinstance(value, np.ndarray) or tensor is not None and isinstance(value, tensor):
        return True
    return type(value).__module__.split(".")[0] in _ARRAY_LIBRARIES and all(hasattr(value, key) for key in ("__array__", "dtype", "shape"))


def array(value: Any) -> bytes:
    """The hash of an array or tensor; those of objects also have :func:`objects_in`."""
    if isinstance(value, np.ndarray):
        content = value.tobytes() if not value.dtype.hasobject else repr(value.shape).encode()
        return digest(b"array", str(value.dtype).encode(), repr(value.shape).encode(), content)
    if type(value).__module__.split(".")[0] in _ARRAY_LIBRARIES:
        return array(np.asarray(value))
    from ._modules import tensor

    return tensor(value)


def objects_in(value: Any) -> list[Any] | None:
    """The items of an array of objects."""
    return value.ravel().tolist() if isinstance(value, np.ndarray) and value.dtype.hasobject else None


def standard(value: Any) -> Any:
    """What defines an object of the standard library, as other values; None if it is not one of those known here."""
    if isinstance(value, deque):
        return value.maxlen, list(value)
    if isinstance(value, bytearray):
        return bytes(value)
    if isinstance(value, memoryview):
        return value.format, value.shape, value.tobytes()
    if isinstance(value, decimal.Decimal):
        return tuple(value.as_tuple())
    if isinstance(value, fractions.Fraction):
        return value.numerator, value.denominator
    if isinstance(value, re.Pattern):
        return value.pattern, value.flags
    if isinstance(value, np.vectorize):
        return value.pyfunc, value.otypes, value.excluded, value.signature
    if isinstance(value, _REDUCED):
        # The first part may be a method that makes it, or contain keywords.
        first, *others = tuple(value.__reduce_ex__(4))[:3]
        return (first, *others) if isinstance(first, functools.partial) else tuple(others)
    return None


def is_harmless(value: Any) -> bool:
    """Whether its type's name, or its own name, says all that matters."""
    of = type(value)
    if callable(value) and isinstance(getattr(value, "__name__", None), str) or hasattr(of, "__get__"):
        return True
    if of is object or value is NotImplemented or isinstance(value, os._Environ) or of.__module__ == "types":
        return True
    if any(value is stream for stream in (sys.stdin, sys.stdout, sys.stderr)):
        return True
    return of.__module__.split(".")[0] in _HARMLESS or f"{of.__module__}.".startswith(_HARMLESS_OF_TORCH)


def attribute(value: Any, name: str) -> Any:
    """An attribute, None if there is none: a class may make anything of names that it does not know."""
    try:
        return getattr(value, name, None)
    except Exception:
        return None
