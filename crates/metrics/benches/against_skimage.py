"""SSIM and PSNR against scikit-image on the same images, in turns in one run, both on one thread.

cargo build --release -p atsplat-metrics --example time_metrics
python against_skimage.py PATH_TO/time_metrics [WIDTH HEIGHT]
"""

import os
import subprocess
import sys
import tempfile
import time

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
import numpy as np
from skimage.data import astronaut
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

binary = sys.argv[1]
width, height = (int(word) for word in sys.argv[2:4]) if len(sys.argv) > 3 else (256, 256)
truth = np.resize(astronaut(), (max(height, 512), max(width, 512), 3))[:height, :width].astype(np.float32) / 255
noise = np.random.default_rng(0).normal(0, 0.03, truth.shape)
render = (truth + noise).astype(np.float32)
common = dict(channel_axis=2, data_range=1.0)
calls = {
    "psnr": lambda: peak_signal_noise_ratio(truth, np.clip(render, 0, 1), data_range=1.0),
    "ssim": lambda: structural_similarity(render, truth, win_size=11, gaussian_weights=True, **common),
    "ssim-uniform-7x7": lambda: structural_similarity(render, truth, **common),
}
with tempfile.TemporaryDirectory() as folder:
    paths = [os.path.join(folder, name) for name in ("render", "truth")]
    for path, image in zip(paths, (render, truth)):
        image.astype("<f4").tofile(path)
    ours, theirs = {}, {}
    for _ in range(5):
        lines = subprocess.run([binary, str(width), str(height), *paths, "20"], capture_output=True, text=True, check=True)
        for name, least, median, value in (line.split() for line in lines.stdout.splitlines()):
            ours.setdefault(name, []).append((float(least), float(median), float(value)))
        for name, call in calls.items():
            for _ in range(4):
                start = time.perf_counter()
                value = call()
                theirs.setdefault(name, []).append((1e3 * (time.perf_counter() - start), float(value)))
print(f"{width}x{height} RGB, one thread, minimum of all repetitions, milliseconds")
for name in calls:
    least = min(o[0] for o in ours[name])
    other = min(t[0] for t in theirs[name])
    middle = sorted(t[0] for t in theirs[name])[len(theirs[name]) // 2] / sorted(o[1] for o in ours[name])[2]
    print(f"{name:18} ours {least:7.3f}  skimage {other:8.3f}  {other / least:6.1f}x (medians {middle:.1f}x)  difference {ours[name][0][2] - theirs[name][0][1]:.1e}")
