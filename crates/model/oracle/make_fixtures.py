"""Writes `../tests/fixtures/network/*.safetensors`: what the PyTorch reference makes of tiny scenes in every variant.

    python make_fixtures.py [VARIANT...]

A file holds cameras, Gaussians, selections and the stages between; its metadata hold the configuration (TOML),
the seeds that weights and image come from, and the names and shapes of all parameters that the reference asked for.
"""

import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import save_file

import hashed
import reference

HERE = Path(__file__).parent
OUT = HERE / "../tests/fixtures/network"
CALL_SEED = 11

NO_CONTEXT = ('kind = "point-net", neighbours = 4', 'kind = "none"')
DINO = ('kind = "patch"\nlayers = 1', 'kind = "dino-v2"\nsize = "tiny"\nregisters = false')
# name, replacements in tiny.toml, views, height, width
VARIANTS = [
    ("base", [], 2, 32, 48),
    ("one_view", [], 1, 48, 32),
    ("three_views", [], 3, 32, 32),
    ("dino", [DINO], 2, 32, 48),
    ("dino_registers", [DINO, ("registers = false", "registers = true")], 2, 32, 48),
    ("high_resolution", [DINO, ("image-downscale = 1", "image-downscale = 2"), ("ratio = 0.5", "ratio = 0.8")], 2, 64, 96),
    ("fine_half_size", [("[fine]\npatch-size = 8\nimage-downscale = 1", "[fine]\npatch-size = 4\nimage-downscale = 2")], 2, 32, 48),
    ("nearest", [('"bilinear"', '"nearest"')], 2, 32, 48),
    ("biases", [("linear-bias = false", "linear-bias = true"), ("norm-bias = false", "norm-bias = true"),
                ('kind = "rms", eps = 1e-5', 'kind = "none"')], 2, 32, 48),
    ("ray_depth", [('kind = "patch-depth"', 'kind = "ray-depth"'), NO_CONTEXT, ("token = 4", "token = 8")], 2, 32, 48),
    ("learnable", [('kind = "patch-depth"', 'kind = "learnable-tokens", tokens = 10'), NO_CONTEXT], 2, 32, 48),
    ("direct", [('kind = "patch-depth"', 'kind = "direct-xyz"'), NO_CONTEXT], 2, 32, 48),
    ("no_context", [NO_CONTEXT], 2, 32, 48),
    ("random", [('kind = "uncertainty"', 'kind = "random", seed = 5')], 2, 32, 48),
    ("farthest_point", [('kind = "uncertainty"', 'kind = "farthest-point"')], 2, 32, 48),
    ("straight_through", [('kind = "uncertainty"', 'kind = "straight-through"')], 2, 32, 48),
    ("no_expansion", [("expansion = { ratio = 0.5 }\n", ""), ("expansion = { ratio = 0.5 }\n", ""),
                      ("expansion = { ratio = 0.25 }\n", "")], 2, 32, 48),
    ("first_block_only", [("layers = 2\nexpansion = { ratio = 0.5 }", "layers = 2\nexpand = false\nexpansion = { ratio = 0.5 }"),
                          ("expansion = { ratio = 0.25 }", "expand = false\nexpansion = { ratio = 0.25 }")], 2, 32, 48),
    ("thresholds", [("ratio = 0.5", "threshold = 0.5"), ("ratio = 0.5", "threshold = 0.7"), ("ratio = 0.25", "threshold = 0.65")], 2, 32, 48),
    ("rounded_down", [('"ceil"', '"floor"'), ("ratio = 0.5", "ratio = 0.3")], 2, 32, 48),
    ("three_children", [("children = 2", "children = 3"), ("token = 4", "token = 3"), ("sh-degree = 0", "sh-degree = 2")], 2, 32, 48),
    ("depth_sigmoid", [('"log-sigmoid", near = 0.1, far = 500.0, shift = 0.0', '"sigmoid", near = 0.0, far = 500.0, shift = -3.0')], 2, 32, 48),
    ("depth_inverse", [('"log-sigmoid"', '"inverse-sigmoid"')], 2, 32, 48),
    ("depth_exp", [('"log-sigmoid", near = 0.1, far = 500.0, shift = 0.0', '"exp", shift = 0.5')], 2, 32, 48),
    ("activations", [('kind = "linear", gain = 1.0', 'kind = "inverse-log", gain = 0.5'), ('"normalize"', '"normalize-from-identity"'),
                     ('"exp-clamped", shift = -6.9, max = -1.2', '"softplus", shift = -1.0, gain = 0.01')], 2, 32, 48),
    ("patch_frame", [("token = 4", "token = 8"), ("sh-degree = 0", 'sh-degree = 0\nframe = "patch"')], 2, 32, 48),
]
# Stages that only this variant keeps, for finding where two networks part.
STAGES = {"base", "dino", "high_resolution"}


def scene(seed, views, height, width):
    """Cameras on an arc that look ahead, with different lenses."""
    poses, intrinsics = [], []
    for view in range(views):
        angle = 0.15 * view - 0.1
        c, s = np.cos(angle), np.sin(angle)
        poses.append([[c, 0, s, 0.4 * view - 0.3], [0, 1, 0, 0.05 * view], [-s, 0, c, -0.1 * view], [0, 0, 0, 1]])
        intrinsics.append([0.9 + 0.05 * view, 1.1 * width / height, 0.5 + 0.01 * view, 0.48])
    images = torch.from_numpy(hashed.image(seed, views, height, width)).double()
    return reference.Scene(images, torch.tensor(poses).double(), torch.tensor(intrinsics).double())


def main():
    """All variants, or those that are named."""
    OUT.mkdir(parents=True, exist_ok=True)
    base = (HERE / "tiny.toml").read_text()
    for number, (name, replacements, views, height, width) in enumerate(VARIANTS):
        if sys.argv[1:] and name not in sys.argv[1:]:
            continue
        text = base.replace("views = 2", f"views = {views}").replace("[32, 48]", f"[{height}, {width}]")
        for old, new in replacements:
            assert old in text, (name, old)
            text = text.replace(old, new, 1)
        config = tomllib.loads(text)
        for seed in range(100 * number, 100 * number + 50):
            given = scene(seed, views, height, width)
            parameters = reference.Parameters(seed)
            try:
                made, seen = reference.reconstruct(config, parameters, given, CALL_SEED)
            except AssertionError as error:
                print(name, seed, error)
                continue
            break
        else:
            raise SystemExit(f"{name}: no seed without near ties")
        small = {"depths", "anchors", "neighbours"}
        kept = {key: value for key, value in seen.items()
                if name in STAGES or key in small or key.split("_")[0] in ("selected", "parents", "scores")}
        tensors = {"poses": given.poses, "intrinsics": given.intrinsics, **made, **kept}
        arrays = {}
        for key, value in tensors.items():
            kind = np.float64 if key in ("poses", "intrinsics") else np.int32 if value.dtype == torch.int64 else np.float32
            array = value.numpy().astype(kind)
            assert np.isfinite(array).all(), (name, key)
            arrays[key] = np.ascontiguousarray(array)
        metadata = {
            "configuration": text,
            "seed": str(seed),
            "call_seed": str(CALL_SEED),
            "image": json.dumps([views, height, width]),
            "parameters": json.dumps(parameters.shapes),
        }
        save_file(arrays, OUT / f"{name}.safetensors", metadata)
        counts = [int(len(value)) for key, value in seen.items() if key.startswith("selected")]
        print(f"{name}: seed {seed}, {len(made['means'])} Gaussians, selected {counts}")


if __name__ == "__main__":
    main()
