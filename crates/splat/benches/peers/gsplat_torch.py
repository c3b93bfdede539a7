"""gsplat's pure-PyTorch path and atsplat on the same scene, alternately, in one run.

    pip install --no-deps gsplat==1.5.3 jaxtyping wadler_lindig rich ninja; pip install torch numpy
    python gsplat_torch.py path/to/atsplat [COUNT WIDTH HEIGHT [ROUNDS]]

gsplat projects and evaluates harmonics in PyTorch (`gsplat/cuda/_torch_impl.py`), but lists the pairs of Gaussians
and pixels in CUDA (`rasterize_to_indices_in_range`), sorts tiles in a Python loop over Gaussians, and composites with
nerfacc's CUDA scans. Here the first part is gsplat's own code; the rest is the minimum that PyTorch needs for the
same image, vectorised, and so faster than gsplat itself would be on a CPU.
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from gsplat.cuda._torch_impl import _fully_fused_projection, _quat_scale_to_covar_preci, _spherical_harmonics

from scene import FOCAL, scene, write


def composite(means, conics, opacities, colours, depths, radii, width, height):
    order = torch.argsort(depths, stable=True)
    means, conics, opacities, colours, radii = (v[order] for v in (means, conics, opacities, colours, radii))
    low = torch.clamp(torch.floor(means - radii).long(), min=0)
    high = torch.minimum(torch.ceil(means + radii).long(), torch.tensor([width, height]))
    extent = torch.clamp(high - low, min=0) * (radii > 0)
    counts = extent.prod(1)
    gaussian = torch.repeat_interleave(torch.arange(len(means)), counts)
    within = torch.arange(len(gaussian)) - torch.repeat_interleave(torch.cumsum(counts, 0) - counts, counts)
    x = low[gaussian, 0] + within % extent[gaussian, 0]
    y = low[gaussian, 1] + within // extent[gaussian, 0]
    dx, dy = x + 0.5 - means[gaussian, 0], y + 0.5 - means[gaussian, 1]
    a, b, c = conics[gaussian].unbind(1)
    alpha = torch.clamp_max(opacities[gaussian] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy), 0.999)
    hit = alpha >= 1 / 255
    gaussian, alpha, pixel = gaussian[hit], alpha[hit], (y * width + x)[hit]
    pixel, by_pixel = torch.sort(pixel, stable=True)
    gaussian, alpha = gaussian[by_pixel], alpha[by_pixel].double()
    logs = torch.cumsum(torch.log1p(-alpha), 0)
    first = torch.searchsorted(pixel, torch.arange(width * height))
    base = torch.cat([torch.zeros(1, dtype=torch.double), logs])[first]
    before = logs - torch.log1p(-alpha) - base[pixel]
    after = before + torch.log1p(-alpha)
    # A pixel is finished before the Gaussian that takes its transmittance to 1e-4.
    weight = (alpha * torch.exp(before) * (after > np.log(1e-4))).float()
    image = torch.zeros(width * height, 3)
    image.index_add_(0, pixel, weight[:, None] * colours[gaussian])
    return image.reshape(height, width, 3)


@torch.no_grad()
def render(tensors, width, height):
    means, quaternions, log_scales, logits, harmonics = tensors
    focal = FOCAL * width
    k = torch.tensor([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])[None]
    covariances, _ = _quat_scale_to_covar_preci(quaternions, log_scales.exp(), True, False)
    radii, means2d, depths, conics, _ = _fully_fused_projection(
        means, covariances, torch.eye(4)[None], k, width, height
    )
    colours = torch.clamp_min(_spherical_harmonics(0, means, harmonics[:, None]) + 0.5, 0)
    return composite(
        means2d[0], conics[0], torch.sigmoid(logits), colours, depths[0], radii[0].float(), width, height
    )


def ours(atsplat, folder):
    words = [atsplat, "--threads", "2", "render", folder / "scene.ply", "--cameras", folder / "transforms.json"]
    words += ["--out", folder / "out", "--formats", "exr", "--effects", "all", "--timings", "--json"]
    report = json.loads(subprocess.run(words, check=True, capture_output=True).stdout)
    return next(row["median-ms"] for row in report["timings"]["rows"] if row["stage"] == "render")


def main():
    atsplat = Path(sys.argv[1]).resolve()
    count, width, height = map(int, sys.argv[2:5]) if len(sys.argv) > 4 else (131_072, 256, 256)
    rounds = int(sys.argv[5]) if len(sys.argv) > 5 else 5
    torch.set_num_threads(2)
    tensors = [torch.from_numpy(values) for values in scene(count, width, height)]
    theirs, atsplat_ms = [], []
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), count, width, height)
        render(tensors, width, height)
        for _ in range(rounds):
            start = time.perf_counter()
            image = render(tensors, width, height)
            theirs.append(1e3 * (time.perf_counter() - start))
            atsplat_ms.append(ours(atsplat, Path(folder)))
    theirs, atsplat_ms = statistics.median(theirs), statistics.median(atsplat_ms)
    print(f"{count} Gaussians to {width}x{height}, medians of {rounds} turns, two threads")
    print(f"gsplat's functions in PyTorch: {theirs:.0f} ms, mean of the image {image.mean():.4f}")
    print(f"atsplat: {atsplat_ms:.1f} ms, {theirs / atsplat_ms:.0f} times as fast")


if __name__ == "__main__":
    main()
