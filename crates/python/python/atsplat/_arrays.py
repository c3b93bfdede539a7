"""Arrays of any library as NumPy's, and their bytes for the native part."""

from __future__ import annotations

from typing import Any

import numpy as np

from .errors import InvalidError

Stored = tuple[list[int], str, bytes]


def as_array(value: Any, field: str = "array") -> np.ndarray:
    """A NumPy array without a copy where the memory allows it. PyTorch tensors may have gradients and be on any device."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise invalid(field, "expected an array without masked values, found a masked array: .filled() gives them values")
    if isinstance(value, np.ndarray):
        return value
    if hasattr(value, "detach"):
        value = value.detach().cpu()
        if "bfloat16" in str(value.dtype):
            value = value.float()
        return np.asarray(value)
    if isinstance(value, (list, tuple)):
        return _stacked([as_array(item, field) for item in value], field) if value else np.empty(0)
    if hasattr(value, "__array__"):
        return np.asarray(value)
    if hasattr(value, "__dlpack__"):
        on_cpu = not hasattr(value, "__dlpack_device__") or value.__dlpack_device__()[0] == 1
        return np.from_dlpack(value) if on_cpu else np.from_dlpack(value, device="cpu")
    array = np.asarray(value)
    if array.dtype.kind in "OSU":
        raise invalid(field, f"expected an array of numbers, found {type(value).__name__}")
    return array


def _stacked(arrays: list[np.ndarray], field: str) -> np.ndarray:
    shapes = {array.shape: None for array in arrays}
    if len(shapes) > 1:
        first, second = (describe(np.broadcast_to(0, shape)) for shape in list(shapes)[:2])
        raise invalid(field, f"expected arrays of the same shape, found {first} and {second}")
    kinds = {array.dtype: None for array in arrays}
    if len(kinds) > 1 and np.dtype(np.uint8) in kinds:
        # NumPy would take 255 for a float.
        raise invalid(field, f"expected arrays of one type, found {' and '.join(map(str, kinds))}")
    return np.stack(arrays)


def floats(value: Any, field: str, shape: tuple[int | None, ...]) -> np.ndarray:
    """A contiguous array of float32; ``None`` in ``shape`` stands for any length."""
    array = as_array(value, field)
    if array.dtype.kind not in "fiu":
        raise invalid(field, f"expected numbers, found {array.dtype}")
    fits = array.ndim == len(shape) and all(want in (None, have) for want, have in zip(shape, array.shape))
    if not fits:
        expected = " × ".join("N" if want is None else str(want) for want in shape)
        raise invalid(field, f"expected {expected}, found {describe(array)}")
    return np.ascontiguousarray(array, dtype=np.float32)


def images(value: Any, field: str = "images") -> Stored:
    """Shape, type (``f4`` or ``u1``) and bytes of N × H × W × 3 images, float or uint8."""
    if type(value).__name__ == "Rendering" and hasattr(value, "images"):
        raise invalid(field, "expected an array, found a Rendering: return its .images")
    array = as_array(value, field)
    if array.ndim != 4 or array.shape[-1] != 3:
        hint = "; permute channels to the end" if array.ndim == 4 and array.shape[1] == 3 else ""
        raise invalid(field, f"expected count × height × width × 3, found {describe(array)}{hint}")
    if array.dtype == np.uint8:
        # Black is an image.
        if array.size and array.max() == 1:
            problem = "found only 0 and 1, as floats that were cast: multiply them by 255 before"
            raise invalid(field, f"expected uint8 from 0 to 255, {problem}, or give floats in [0, 1]")
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
