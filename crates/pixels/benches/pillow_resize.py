"""Times Pillow and atsplat-pixels in turns, on one thread, and checks that they agree.

    cargo build --release -p atsplat-pixels --example time_resize
    python crates/pixels/benches/pillow_resize.py target/release/examples/time_resize

Each round times one call of either; the table has the median and the least of the rounds, and how often
Pillow took longer. Alternating calls share whatever else the machine does.
"""

import statistics
import subprocess
import sys
import time

import numpy as np
import PIL
from PIL import Image

SIZES = [(640, 360, 455, 256), (480, 270, 398, 224), (960, 540, 796, 448), (1920, 1080, 960, 540)]
ROUNDS = 41


def main():
    ours = subprocess.Popen([sys.argv[1]], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    print(f"Pillow {PIL.__version__}, {ROUNDS} rounds, milliseconds")
    print("| size | filter | Pillow median (least) | ours median (least) | ratio of medians | rounds won |")
    print("|---|---|---|---|---|---|")
    for width, height, to_width, to_height in SIZES:
        index = np.arange(width * height * 3, dtype=np.uint32)
        samples = ((index * np.uint32(2654435761)) >> np.uint32(24)).astype(np.uint8)
        image = Image.fromarray(samples.reshape(height, width, 3))
        for name in ("lanczos", "bilinear", "box"):
            pillow, rust = [], []
            for _ in range(ROUNDS):
                ours.stdin.write(f"{width} {height} {to_width} {to_height} {name}\n")
                ours.stdin.flush()
                seconds, checksum = ours.stdout.readline().split()
                rust.append(float(seconds) * 1e3)
                start = time.perf_counter()
                resized = image.resize((to_width, to_height), Image.Resampling[name.upper()])
                pillow.append((time.perf_counter() - start) * 1e3)
            expected = 0
            for value in resized.tobytes():
                expected = (expected * 31 + value) & 0xFFFFFFFF
            assert int(checksum) == expected, f"{width}x{height} {name}: not the same bits"
            won = sum(p > r for p, r in zip(pillow, rust))
            middle = statistics.median(pillow), statistics.median(rust)
            print(
                f"| {width}×{height} → {to_width}×{to_height} | {name} | {middle[0]:.2f} ({min(pillow):.2f}) "
                f"| {middle[1]:.2f} ({min(rust):.2f}) | {middle[0] / middle[1]:.1f} | {won}/{ROUNDS} |"
            )
    ours.stdin.close()
    ours.wait()


if __name__ == "__main__":
    main()
