"""3D Gaussians from and to arrays and files."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from os import PathLike, fspath
from typing import Any

import numpy as np

from . import _native
from ._arrays import as_array, floats, invalid

#: The spherical harmonic of degree 0: ``colour = C0 * coefficient + 0.5``.
C0 = 0.28209479177387814

#: Colours beyond it are far outside [0, 1]. As of the samples of images, one in so many may be.
RANGE = (-0.5, 2.0)
FAR_ONE_IN = 100


class Gaussians:
    """N Gaussians, parameterised as 3DGS and its PLY files do.

    Args:
        means: N × 3, centres in scene units.
        quaternions: N × 4, rotations ``world_from_gaussian`` as ``w, x, y, z``; of any norm but zero.
        scales: N × 3, standard deviations along the Gaussian's axes in scene units; or
        log_scales: N × 3, their natural logarithms.
        opacities: N, in [0, 1]; or
        opacity_logits: N, before the sigmoid.
        colours: N × 3, RGB in [0, 1] or uint8, the same from everywhere; or
        sh: N × (degree + 1)² × 3, coefficients of spherical harmonics up to degree 4, in the order ``l² + l + m``.
        scalars: N, a value that is composited like a colour, such as ATSplat's uncertainty; optional.
        filter_3d: N, Mip-Splatting's 3D smoothing filter, as standard deviations in scene units; optional.

    Arrays are copied as float32: later changes of them change nothing here.

    Raises:
        InvalidError: naming the array, if its shape is another, scales or the filter are negative, opacities are not in [0, 1], or
            colours are far from it.
    """

    def __init__(
        self,
        means: Any,
        quaternions: Any,
        *,
        scales: Any = None,
        log_scales: Any = None,
        opacities: Any = None,
        opacity_logits: Any = None,
        colours: Any = None,
        sh: Any = None,
        scalars: Any = None,
        filter_3d: Any = None,
    ) -> None:
        centres = floats(means, "means", (None, 3))
        count = len(centres)
        parts = [
            centres,
            floats(quaternions, "quaternions", (count, 4)),
            _one_of("log_scales", log_scales, "scales", scales, _logarithms, (count, 3), (count, 3)),
            _one_of("opacity_logits", opacity_logits, "opacities", opacities, _logits, (count,), (count,)),
            _one_of("sh", sh, "colours", colours, _coefficients, (count, None, 3), (count, 3)),
        ]
        coefficients = parts[-1].shape[1]
        optional = [
            None if values is None else floats(values, field, (count,)).tobytes()
            for field, values in (("scalars", scalars), ("filter_3d", _filter(filter_3d, count)))
        ]
        self._native = _native.Gaussians.from_bytes([part.tobytes() for part in parts], coefficients, *optional)

    @classmethod
    def _of(cls, native: Any) -> Gaussians:
        gaussians = cls.__new__(cls)
        gaussians._native = native
        return gaussians

    @classmethod
    def read(cls, path: str | PathLike[str], *, opacities_as_stored: bool = False) -> Gaussians:
        """Reads PLY, compressed PLY, SPZ or ``.splat``; problems, and fields of the file that are not read, are warnings.

        ``opacities_as_stored`` reads opacities, not logits, from PLY files, as the exporters of pixelSplat and NoPoSplat write
        them; other formats store opacities anyway and are rejected. The files of pixelSplat's and DepthSplat's exporters are for
        viewers: rotated, recentred and scaled, and without view-dependent harmonics.
        They fit no trial's cameras; run the method by the adapter ``eval/methods/pixelsplat_family.py`` instead.
        """
        native, notes = _native.Gaussians.read(fspath(path), opacities_as_stored)
        for note in notes:
            warnings.warn(f"{fspath(path)}: {note}", stacklevel=2)
        return cls._of(native)

    def write(self, path: str | PathLike[str], *, antialiased: bool = False) -> None:
        """Writes ``.ply`` (lossless, but infinite opacity logits become ±20) or ``.spz`` (quantised; values beyond its ranges are
        clamped, with a warning).

        ``antialiased`` records in SPZ that they were trained, and should be rendered, with ``antialiased=True``.
        """
        for note in self._native.write(fspath(path), antialiased):
            warnings.warn(f"{fspath(path)}: {note}", stacklevel=2)

    def __len__(self) -> int:
        return len(self._native)

    def __repr__(self) -> str:
        return f"Gaussians({len(self)}, SH degree {self.sh_degree})"

    def __reduce__(self) -> tuple[Any, ...]:
        required = (self.means, self.quaternions, self.log_scales, self.opacity_logits, self.sh)
        return _rebuilt, (*required, self.scalars, self.filter_3d)

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0 to 4."""
        return self._native.sh_degree

    @property
    def means(self) -> np.ndarray:
        """N × 3, float32: centres."""
        return _array(self._native.means)

    @property
    def quaternions(self) -> np.ndarray:
        """N × 4, float32: rotations as ``w, x, y, z``, as they were given."""
        return _array(self._native.quaternions)

    @property
    def log_scales(self) -> np.ndarray:
        """N × 3, float32: natural logarithms of the standard deviations."""
        return _array(self._native.log_scales)

    @property
    def opacity_logits(self) -> np.ndarray:
        """N, float32: opacities before the sigmoid."""
        return _array(self._native.opacity_logits)

    @property
    def sh(self) -> np.ndarray:
        """N × (degree + 1)² × 3, float32: coefficients of spherical harmonics."""
        return _array(self._native.sh)

    @property
    def scalars(self) -> np.ndarray | None:
        """N, float32: a value that is composited like a colour, such as ATSplat's uncertainty."""
        return self._native.scalars

    @property
    def filter_3d(self) -> np.ndarray | None:
        """N, float32: Mip-Splatting's 3D smoothing filter, as standard deviations in scene units."""
        return self._native.filter_3d


# Pickles of earlier versions have the first five arrays.
def _rebuilt(
    means: Any, quaternions: Any, log_scales: Any, opacity_logits: Any, sh: Any, scalars: Any = None, filter_3d: Any = None
) -> Gaussians:
    return Gaussians(
        means,
        quaternions,
        log_scales=log_scales,
        opacity_logits=opacity_logits,
        sh=sh,
        scalars=scalars,
        filter_3d=filter_3d,
    )


def _one_of(
    stored: str,
    stored_value: Any,
    plain: str,
    plain_value: Any,
    convert: Callable[[np.ndarray], np.ndarray],
    stored_shape: tuple[int | None, ...],
    plain_shape: tuple[int | None, ...],
) -> np.ndarray:
    if (stored_value is None) == (plain_value is None):
        raise invalid(stored, f"expected one of {stored} and {plain}")
    if stored_value is not None:
        return floats(stored_value, stored, stored_shape)
    if plain == "colours":
        given = as_array(plain_value, plain)
        plain_value = given / 255.0 if given.dtype == np.uint8 else given
    with np.errstate(divide="ignore"):
        converted = convert(floats(plain_value, plain, plain_shape).astype(np.float64))
    return np.ascontiguousarray(converted, dtype=np.float32)


def _array(value: Any) -> np.ndarray:
    array: np.ndarray = value
    return array


def _logarithms(scales: np.ndarray) -> np.ndarray:
    wrong = ~(scales >= 0)
    if wrong.any():
        found = _first(scales, wrong)
        raise invalid("scales", f"expected standard deviations from 0, found {found}; log_scales takes their logarithms")
    return _array(np.log(scales))


def _filter(values: Any, count: int) -> np.ndarray | None:
    if values is None:
        return None
    checked = floats(values, "filter_3d", (count,))
    wrong = ~(checked >= 0)
    if wrong.any():
        raise invalid("filter_3d", f"expected standard deviations from 0, found {_first(checked, wrong)}")
    return checked


def _first(values: np.ndarray, wrong: np.ndarray) -> str:
    at = tuple(np.argwhere(wrong)[0])
    return f"{values[at]:g} of Gaussian {at[0]}"


def _coefficients(colours: np.ndarray) -> np.ndarray:
    least, most = RANGE
    far = ~((colours >= least) & (colours <= most)) & ~np.isnan(colours)
    if far.sum() * FAR_ONE_IN > colours.size:
        problem = f"expected RGB in [0, 1], found {np.nanmin(colours):g} to {np.nanmax(colours):g}"
        raise invalid("colours", f"{problem}; divide those up to 255 by 255. sh takes coefficients")
    return _array(((colours - 0.5) / C0)[:, None])


def _logits(opacities: np.ndarray) -> np.ndarray:
    wrong = ~((opacities >= 0) & (opacities <= 1))
    if wrong.any():
        found = _first(opacities, wrong)
        raise invalid("opacities", f"expected numbers in [0, 1], found {found}; opacity_logits takes numbers before the sigmoid")
    return _array(np.log(opacities / (1.0 - opacities)))
