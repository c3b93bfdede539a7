"""PSNR, SSIM and LPIPS of images under named conventions."""

from __future__ import annotations

from functools import lru_cache
from os import PathLike
from typing import Any

import numpy as np

from . import _native
from ._arguments import folder_of_weights
from ._arrays import as_array, describe, images, invalid

#: The convention of pixelSplat, MVSplat, DepthSplat, NoPoSplat, iLRM and TokenGS.
PIXELSPLAT = "pixelsplat"


def metrics() -> list[dict[str, Any]]:
    """Every metric: ``id``, ``unit``, ``better`` (higher or lower) and what its ``convention`` is."""
    named = _native.metric_definitions()
    return [
        {"id": key, "unit": unit, "better": "higher" if sign > 0 else "lower", "convention": convention}
        for key, unit, sign, convention in named
    ]


def psnr(a: Any, b: Any, convention: str = PIXELSPLAT) -> Any:
    """PSNR in dB; infinite for identical images.

    Args:
        a: the render, H × W × 3 or N × H × W × 3, float in [0, 1] or uint8.
        b: the ground truth, of the same shape.
        convention: ``pixelsplat`` (clipped to [0, 1]), or the end of an id of :func:`metrics`: ``unclipped``,
            ``8bit-truncated``, ``8bit-rounded``; in upper or lower case.

    Returns:
        A float, or an array of N of them. Type checkers cannot tell which: to them it is ``Any``.

    Raises:
        InvalidError: also for floats that are meant in another range, such as 0 to 255.
    """
    return _score("psnr", a, b, convention, None)


def ssim(a: Any, b: Any, convention: str = PIXELSPLAT) -> Any:
    """SSIM, at most 1.

    Arguments and errors as for :func:`psnr`; conventions: ``pixelsplat`` (skimage, Gaussian), ``clipped``, ``8bit-truncated``,
    ``8bit-rounded``, ``inria``, ``inria-8bit-rounded``, ``valid``, ``torchmetrics``, ``uniform-7x7``.
    """
    return _score("ssim", a, b, convention, None)


def lpips(a: Any, b: Any, convention: str = PIXELSPLAT, *, weights: str | PathLike[str] | None = None) -> Any:
    """LPIPS, at least 0.

    Arguments and errors as for :func:`psnr`; conventions: ``pixelsplat`` (VGG16, v0.1), ``clipped``, ``8bit-truncated``,
    ``inria-8bit-rounded``, ``alex``.

    Args:
        weights: folder with torchvision's ``vgg16-397923af.pth`` (or ``alexnet-owt-7be5be79.pth``), searched before torch's cache.
    """
    return _score("lpips", a, b, convention, weights)


def _score(metric: str, a: Any, b: Any, convention: str, weights: str | PathLike[str] | None) -> float | np.ndarray:
    known = [named["id"] for named in metrics() if named["id"].split("-")[0] == metric]
    name = str(convention).lower()
    key = metric if name == PIXELSPLAT else f"{metric}-{name}"
    if key not in known:
        others = [name.removeprefix(f"{metric}-") for name in known if name != metric]
        raise invalid("convention", f"expected one of {', '.join([PIXELSPLAT, *others])}, found {convention!r}")
    render, truth = as_array(a, "render"), as_array(b, "truth")
    if render.shape != truth.shape:
        raise invalid("truth", f"expected {describe(render)} like the render, found {describe(truth)}")
    single = render.ndim == 3
    if render.ndim > 0 and len(render) == 0:
        raise invalid("render", "expected at least one image, found none")
    shape, kind, samples = images(render[None] if single else render, "render")
    _, truth_kind, truth_samples = images(truth[None] if single else truth, "truth")
    folder = folder_of_weights(weights)
    scored = _suite(key, folder).score(shape, (kind, samples), (truth_kind, truth_samples))
    numbers = np.array([scores[0] for scores in scored])
    return float(numbers[0]) if single else numbers


@lru_cache(maxsize=8)
def _suite(key: str, weights: str | None) -> Any:
    return _native.Suite([key], weights, None)
