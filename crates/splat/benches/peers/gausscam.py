"""Times gausscam (PyPI) and this crate's `gpu` benchmark on the same scenes and adapter, alternately.

    cargo bench -p atsplat-splat --bench gpu --no-run     # prints the executable
    python -m venv /tmp/venv && /tmp/venv/bin/pip install "gausscam[webgpu,io]"
    /tmp/venv/bin/python gausscam.py <executable> [adapter] [turns]

Both render 8 frames after a warm-up and report the minimum and the median. gausscam keeps its Gaussians on the device
and returns 8-bit RGB and depth in millimetres; the comparable figure here is "on the device", which returns f32 RGB
and alpha.
"""

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# This file has the package's name, and its folder would otherwise come first.
sys.path.pop(0)

import numpy as np  # noqa: E402
from gausscam.backends.webgpu import Pipeline, pick_variant  # noqa: E402
from gausscam.core.assets import GaussianCloud  # noqa: E402
from wgpu.backends.wgpu_native import GPUDevice  # noqa: E402

# gausscam binds 35 storage buffers at once, more than llvmpipe's 32. The omitted ones belong to kernels that neither a
# cloud without a robot nor this sort runs: links of the robot, and the other sort's counters.
UNUSED_BINDINGS = {6, 7, 34, 35}
UNUSED_KERNELS = {"update_links", "self_cull"}


def leave_out_what_is_unused(device_class):
    """Wraps the three calls that name bindings and kernels; everything that runs is gausscam's own."""

    def without(method):
        original = getattr(device_class, method)

        def wrapped(self, *, entries, **rest):
            return original(self, entries=[entry for entry in entries if entry["binding"] not in UNUSED_BINDINGS], **rest)

        setattr(device_class, method, wrapped)

    without("create_bind_group_layout")
    without("create_bind_group")
    original = device_class.create_compute_pipeline

    def create_compute_pipeline(self, *, compute, **rest):
        return None if compute["entry_point"] in UNUSED_KERNELS else original(self, compute=compute, **rest)

    device_class.create_compute_pipeline = create_compute_pipeline


leave_out_what_is_unused(GPUDevice)

CASES = {"131072": (256, 256), "311040": (960, 512)}
ROUNDS = 8


def peer(folder, name, adapter):
    """A function that renders one frame, as numpy arrays."""
    width, height = CASES[name]
    cloud = GaussianCloud.from_ply(folder / f"{name}.ply")
    # Right, up and backwards of a camera that looks along +z with y down.
    axes = np.diag([1.0, -1.0, -1.0]).astype(np.float32)
    scene = dict(
        xyz=np.ascontiguousarray(cloud.xyz, np.float32),
        rot=cloud.rot / np.linalg.norm(cloud.rot, axis=1, keepdims=True),
        scale=np.exp(cloud.scale).astype(np.float32),
        opacity=(1.0 / (1.0 + np.exp(-cloud.opacity))).astype(np.float32),
        sh=cloud.sh[:, :3],
        slots=np.zeros(0, np.int32),
        W=np.int32(width),
        H=np.int32(height),
        fovy=np.float32(np.degrees(2.0 * np.arctan(height / (2.0 * 0.9 * width)))),
        cam_pos=np.zeros((1, 3), np.float32),
        cam_xmat=axes[None],
    )
    pipeline = Pipeline(scene, adapter, variant=pick_variant(adapter))
    return lambda: pipeline.unpack(*pipeline.render_frame())


def timed(render):
    secs = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        render()
        secs.append(1e3 * (time.perf_counter() - start))
    return f"least {min(secs):.1f} ms, median {statistics.median(secs):.1f} ms"


def main():
    executable = sys.argv[1]
    adapter = sys.argv[2] if len(sys.argv) > 2 else "llvmpipe"
    turns = int(sys.argv[3]) if len(sys.argv) > 3 else 3
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        subprocess.run([executable, "--export", str(folder)], check=True)
        peers = {name: peer(folder, name, adapter) for name in CASES}
        # Both show the same scene only if these agree; ours follow below.
        for name, render in peers.items():
            rgb, _ = render()
            red, green, blue = rgb.reshape(-1, 3).mean(axis=0) / 255.0
            print(f"gausscam {name} mean colour: {red:.4f} {green:.4f} {blue:.4f}")
        for _ in range(turns):
            for name, render in peers.items():
                print(f"gausscam {name}: {timed(render)}", flush=True)
            ours = [executable, "--adapter", adapter, "--rounds", str(ROUNDS), "--only", "forward on the device"]
            subprocess.run(ours, check=True)


main()
