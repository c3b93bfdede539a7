"""Arrays of any library as NumPy's, and their bytes for the native part."""

from __future__ import annotations

from typing import Any

import numpy as np

from .errors import InvalidError

Stored = tuple[list[int], str, bytes]


def as_array(value: Any) -> np.ndarray:
    """A NumPy array without a copy where the memory allows it. PyTorch tensors may have gradients and lie on any device."""
    if isinstance(value, np.ndarray):
        return value
    if hasattr(value, "detach"):
        value = value.detach().cpu()
        if "bfloat16" in str(value.dtype):
            value = value.float()
        return np.asarray(value)
    if isinstance(value, (list, tuple)):
        return np.stack([as_array(item) for item in value]) if value else np.empty(0)
    if hasattr(value, "__array__"):
        return np.asarray(value)
    if hasattr(value, "__dlpack__"):
        on_cpu = not hasattr(value, "__dlpack_device__") or value.__dlpack_device__()[0] == 1
        return np.from_dlpack(value) if on_cpu else np.from_dlpack(value, device="cpu")
    return np.asarray(value)


def floats(value: Any, field: str, shape: tuple[int | None, ...]) -> np.ndarray:
    """A contiguous array of float32; ``None`` in ``shape`` stands for any length."""
    array = as_array(value)
    if array.dtype.kind not in "fiu":
        raise invalid(field, f"expected numbers, found {array.dtype}")
    fits = array.ndim == len(shape) and all(want in (None, have) for want, have in zip(shape, array.shape))
    if not fits:
        expected = " × ".join("N" if want is None else str(want) for want in shape)
        raise invalid(field, f"expected {expected}, found {describe(array)}")
    return np.ascontiguousarray(array, dtype=np.float32)


def images(value: Any, field: str = "images") -> Stored:
    """Shape, type (``f4`` or ``u1``) and bytes of N × H × W × 3 images, float or uint8."""
    array = as_array(value)
    if array.ndim != 4 or array.shape[-1] != 3:
        hint = "; permute channels to the end" if array.ndim == 4 and array.shape[1] == 3 else ""
        raise invalid(field, f"expected count × height × width × 3, found {describe(array)}{hint}")
    if array.dtype == np.uint8:
        return list(array.shape), "u1", array.tobytes()
    if array.dtype.kind != "f":
        raise invalid(field, f"expected floats in [0, 1] or uint8, found {array.dtype}")
    return list(array.shape), "f4", array.astype(np.float32, copy=False).tobytes()


def describe(array: np.ndarray) -> str:
    return " × ".join(map(str, array.shape)) or "a single number"


def invalid(field: str, problem: str) -> InvalidError:
    error = InvalidError(f"{field}: {problem}")
    error.field = field
    return error
