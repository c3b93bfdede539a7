"""Renders Gaussians on the processor, with the same code as the evaluation."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from . import _native
from ._arguments import colour, whole
from ._arrays import invalid
from .cameras import Cameras
from .gaussians import Gaussians


@dataclass(frozen=True, eq=False)
class Rendering:
    """Images of N views."""

    #: N × H × W × 3, float32: colour over the background, not clamped.
    images: np.ndarray
    #: N × H × W, float32 in [0, 1].
    alpha: np.ndarray
    #: N × H × W, float32, if requested: expected depth along the optical axis in scene units, 0 where alpha is 0.
    depth: np.ndarray | None = None


def render(
    gaussians: Gaussians,
    cameras: Cameras,
    height: int | None = None,
    width: int | None = None,
    *,
    background: Sequence[float] = (0.0, 0.0, 0.0),
    constants: str = "exact",
    antialiased: bool = False,
    depth: bool = False,
) -> Rendering:
    """Renders Gaussians from cameras; Ctrl-C stops it. Those with NaN, and others that cannot be rendered, are left out with a warning.

    Args:
        gaussians: in the world of the cameras.
        cameras: poses, intrinsics and lenses.
        height: in pixels; by default that of the cameras.
        width: in pixels; by default that of the cameras.
        background: RGB in [0, 1] behind all Gaussians.
        constants: thresholds and rules of a rasterizer: ``exact``, ``gsplat-1.5``, ``gsplat-1.6``, ``inria``,
            ``pixelsplat-family`` or ``mip-splatting`` (with ``antialiased``).
        antialiased: gsplat's ``antialiased`` mode, Mip-Splatting's 2D filter.
        depth: render depth too.
    """
    for field, given, kind in (("gaussians", gaussians, Gaussians), ("cameras", cameras, Cameras)):
        if not isinstance(given, kind):
            raise invalid(field, f"expected {kind.__name__}, found {type(given).__name__}")
    sized = replace(
        cameras,
        height=cameras.height if height is None else whole(height, "height"),
        width=cameras.width if width is None else whole(width, "width"),
    )
    rgb = colour(background)
    rendered, left_out, ignored = _native.render(gaussians._native, sized._numbers(), rgb, constants, antialiased, depth)
    if left_out:
        text = f"{left_out} of {len(gaussians)} Gaussians are invalid (NaN, infinite, or without a rotation), and not rendered"
        warnings.warn(text, stacklevel=2)
    if ignored is not None:
        warnings.warn(ignored, stacklevel=2)
    images, alpha, *rest = rendered
    if not rest:
        return Rendering(images, alpha)
    composited = rest[0]
    expected = np.divide(composited, alpha, out=np.zeros_like(composited), where=alpha > 0)
    return Rendering(images, alpha, expected)
