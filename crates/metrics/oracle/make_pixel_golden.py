"""PSNR, L1 and SSIM of small images by skimage, torchmetrics, pytorch-msssim and Inria's formula.

pip install numpy pillow scikit-image torch torchmetrics pytorch-msssim; python make_pixel_golden.py > ../tests/fixtures/pixel_golden.json

Images are those of crates/pixels, cut to the size that is written down; renders are made by `seeded.render`, which the
tests have too. Everything is computed in f64 from f32 samples.
"""

import json

import numpy as np
import pytorch_msssim
import skimage.metrics
import torch
import torch.nn.functional as F
import torchmetrics.functional.image as tm
from PIL import Image
from seeded import IMAGES, render

CASES = [
    ("size_17x15.jpg", None),
    ("lossless.webp", None),
    ("baseline_444_q98.jpg", None),
    ("baseline_420_q20.jpg", (0, 0, 23, 11)),
    ("baseline_444_q75.jpg", (3, 5, 11, 30)),
]


def gaussian():
    """In f64, where the programs' own are f32 and do not add up to 1."""
    taps = torch.tensor([np.exp(-((i - 5) ** 2) / (2 * 1.5**2)) for i in range(11)], dtype=torch.float64)
    return taps / taps.sum()


def inria(x, y):
    taps = gaussian()
    window = (taps[:, None] @ taps[None, :]).expand(3, 1, 11, 11).contiguous()
    blur = lambda t: F.conv2d(t, window, padding=5, groups=3)
    mx, my = blur(x), blur(y)
    vx, vy, c = blur(x * x) - mx * mx, blur(y * y) - my * my, blur(x * y) - mx * my
    return (((2 * mx * my + 1e-4) * (2 * c + 9e-4)) / ((mx**2 + my**2 + 1e-4) * (vx + vy + 9e-4))).mean().item()


def scores(x, y):
    skimage_ssim = lambda **more: float(skimage.metrics.structural_similarity(x, y, channel_axis=2, data_range=1.0, **more))
    tx, ty = (torch.from_numpy(v.transpose(2, 0, 1)[None].copy()) for v in (x, y))
    return {
        "psnr": float(skimage.metrics.peak_signal_noise_ratio(y, x, data_range=1.0)),
        "psnr_torchmetrics": tm.peak_signal_noise_ratio(tx, ty, data_range=1.0).item(),
        "l1": float(np.abs(x - y).mean()),
        "ssim_skimage_gaussian": skimage_ssim(win_size=11, gaussian_weights=True),
        "ssim_skimage_uniform": skimage_ssim(),
        "ssim_inria": inria(tx, ty),
        "ssim_torchmetrics": tm.structural_similarity_index_measure(tx, ty, data_range=1.0).item(),
        "ssim_pytorch_msssim": pytorch_msssim.ssim(tx, ty, data_range=1.0, win=gaussian().expand(3, 1, 1, 11)).item(),
    }


golden = []
for name, box in CASES:
    image = Image.open(IMAGES / name).convert("RGB")
    image = np.asarray(image.crop((box[0], box[1], box[0] + box[2], box[1] + box[3])) if box else image)
    truth = image.astype(np.float32) / np.float32(255)
    made = render(image, seed=len(golden))
    eight = lambda v, add: np.floor(np.clip(v, 0, 1) * np.float32(255) + np.float32(add)) / np.float32(255)
    values = {
        "as-rendered": (made, truth),
        "clipped": (np.clip(made, 0, 1), truth),
        "truncated": (eight(made, 0), eight(truth, 0)),
        "rounded": (eight(made, 0.5), eight(truth, 0.5)),
    }
    wide = {key: scores(x.astype(np.float64), y.astype(np.float64)) for key, (x, y) in values.items()}
    f32 = skimage.metrics.structural_similarity(made, truth, channel_axis=2, data_range=1.0, win_size=11, gaussian_weights=True)
    golden.append({"image": name, "box": box, "size": image.shape[1::-1], "values": wide, "ssim_skimage_f32": float(f32)})
print(json.dumps(golden, indent=1))
