"""Times gsplat on a CUDA card and this crate's `gpu` benchmark on the same scenes and card, alternately.

    pip install gsplat==1.5.3                             # compiles its kernels at the first import
    cargo bench -p atsplat-splat --bench gpu --no-run     # prints the executable
    python gsplat_cuda.py <executable> [turns]

`read` copies the image to the host, as "forward on the device" does here; `kept` leaves it on the card. `derivative`
renders and goes back to means, rotations, scales, opacities and colours, as "backward on the device" does.
"""

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from gsplat import rasterization

CASES = {"131072": (256, 256), "311040": (960, 512)}
FOCAL = 0.9
ROUNDS = 50
C0 = 0.28209479177387814


def read(path):
    """Means, quaternions (w, x, y, z), scales, opacities and colours of a binary PLY of floats."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    lines = data[:end].decode().splitlines()
    count = next(int(line.split()[-1]) for line in lines if line.startswith("element vertex"))
    names = [line.split()[-1] for line in lines if line.startswith("property float")]
    rows = np.frombuffer(data[end:], "<f4").reshape(count, len(names))
    at = lambda *columns: torch.from_numpy(rows[:, [names.index(name) for name in columns]].copy()).cuda()
    quaternions = at("rot_0", "rot_1", "rot_2", "rot_3")
    colours = (C0 * at("f_dc_0", "f_dc_1", "f_dc_2") + 0.5).clamp_min(0.0)
    return [
        at("x", "y", "z"),
        quaternions / quaternions.norm(dim=1, keepdim=True),
        at("scale_0", "scale_1", "scale_2").exp(),
        at("opacity")[:, 0].sigmoid(),
        colours,
    ]


def timed(work):
    for _ in range(5):
        work()
    secs = []
    for _ in range(ROUNDS):
        torch.cuda.synchronize()
        start = time.perf_counter()
        work()
        torch.cuda.synchronize()
        secs.append(1e3 * (time.perf_counter() - start))
    return f"least {min(secs):.2f} ms, median {statistics.median(secs):.2f} ms"


def works(path, size):
    width, height = size
    inputs = read(path)
    views = torch.eye(4, device="cuda")[None]
    focal = FOCAL * width
    intrinsics = torch.tensor([[[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]], device="cuda")
    seed = torch.tensor([1.0, 0.5, -0.5], device="cuda").expand(1, height, width, 3).contiguous()

    def image(packed, values=inputs):
        return rasterization(*values, views, intrinsics, width, height, near_plane=0.01, packed=packed)[0]

    def derivative(packed):
        leaves = [value.detach().requires_grad_(True) for value in inputs]
        image(packed, leaves).backward(seed)

    print(f"gsplat {path.stem} mean colour: " + " ".join(f"{x:.4f}" for x in image(True)[0].mean((0, 1)).tolist()))
    for packed in (True, False):
        name = "packed" if packed else "dense"
        with torch.no_grad():
            yield f"{name} forward, kept", lambda packed=packed: image(packed)
            yield f"{name} forward, read", lambda packed=packed: image(packed).cpu()
        yield f"{name} derivative", lambda packed=packed: derivative(packed)


def main():
    executable = sys.argv[1]
    turns = int(sys.argv[2]) if len(sys.argv) > 2 else 3
    print(torch.cuda.get_device_name(), torch.__version__)
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([executable, "--export", folder], check=True)
        for _ in range(turns):
            for name, size in CASES.items():
                for what, work in works(Path(folder) / f"{name}.ply", size):
                    print(f"gsplat {name} {what}: {timed(work)}", flush=True)
            subprocess.run([executable, "--rounds", str(ROUNDS)], check=True)


main()
