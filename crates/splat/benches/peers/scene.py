"""The benchmark scene of ../render.rs as files: a PLY and one camera at the origin (nerfstudio's transforms.json)."""

import json
import sys
from pathlib import Path

import numpy as np

FOCAL = 0.9


def scene(count, width, height, seed=1):
    """Means, quaternions (w, x, y, z), log scales, opacity logits and degree-0 SH coefficients."""
    random = np.random.default_rng(seed)
    u, v = random.random(count) * width, random.random(count) * height
    depth = 3 + np.sin(u * 0.02) + np.cos(v * 0.03) + 0.1 * random.random(count)
    focal = FOCAL * width
    means = np.stack([(u - width / 2) / focal * depth, (v - height / 2) / focal * depth, depth], 1)
    quaternions = np.concatenate([np.ones((count, 1)), random.random((count, 3))], 1)
    log_scales = np.repeat(np.log(0.6 * depth / focal)[:, None], 3, 1)
    logits = 4 * random.random(count) - 1
    harmonics = random.random((count, 3)) - 0.5
    return [values.astype(np.float32) for values in (means, quaternions, log_scales, logits, harmonics)]


def write(folder, count, width, height, views=9):
    """Writes the scene, and a trajectory of `views` identical views of it."""
    means, quaternions, log_scales, logits, harmonics = scene(count, width, height)
    names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()
    rows = np.concatenate([means, harmonics, logits[:, None], log_scales, quaternions], 1).astype("<f4")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [f"property float {name}" for name in names] + ["end_header\n"]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.ply").write_bytes("\n".join(header).encode() + rows.tobytes())
    # OpenGL's axes: the camera looks along its own -z.
    pose = np.diag([1.0, -1.0, -1.0, 1.0]).tolist()
    focal = FOCAL * width
    frames = [{"file_path": f"images/frame_{n:05}.png", "transform_matrix": pose} for n in range(1, views + 1)]
    camera = dict(w=width, h=height, fl_x=focal, fl_y=focal, cx=width / 2, cy=height / 2, camera_model="OPENCV")
    (folder / "transforms.json").write_text(json.dumps(camera | {"frames": frames}))


if __name__ == "__main__":
    write(Path(sys.argv[1]), *map(int, sys.argv[2:5]))
