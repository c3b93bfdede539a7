"""pixelSplat, MVSplat, DepthSplat and NoPoSplat as methods (docs/methods.md): the encoder of their own repository makes Gaussians,
which atsplat renders. Crops, poses, near and far are the trial's: those that the protocol lists for the method.

Usage: pixelsplat_family.py METHOD --repository DIR (--checkpoint FILE | --random-weights SEED)
"""

import argparse
import dataclasses
import functools
import hashlib
import inspect
import json
import os
import subprocess
import sys
import time
import types

answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)  # What libraries print goes to standard error.

import numpy as np
import torch

NAMES = {"pixelsplat": "pixelSplat", "mvsplat": "MVSplat", "depthsplat": "DepthSplat", "noposplat": "NoPoSplat"}
RASTERIZER = "diff_gaussian_rasterization"


def answer(**message):
    print(json.dumps(message), file=answers, flush=True)


def arguments():
    parser = argparse.ArgumentParser()
    parser.add_argument("method", choices=sorted(NAMES))
    parser.add_argument("--repository", required=True)
    parser.add_argument("--experiment", default="re10k", help="of the repository's config/experiment")
    parser.add_argument("--override", action="append", default=[], help="further settings as Hydra takes them")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    weights = parser.add_mutually_exclusive_group(required=True)
    weights.add_argument("--checkpoint")
    weights.add_argument("--random-weights", type=int, metavar="SEED")
    return parser.parse_args()


def encoder_of(args):
    """The repository's encoder, with its experiment's configuration, and the number of context views that it needs."""
    if args.method in ("mvsplat", "depthsplat"):  # As in their src/main.py.
        torch.set_float32_matmul_precision("high")
    sys.path.insert(0, os.path.abspath(args.repository))
    try:
        __import__(RASTERIZER)
    except ImportError:  # The encoder needs none, but its repository imports it.
        nothing = lambda *args, **kwargs: None
        sys.modules[RASTERIZER] = types.SimpleNamespace(GaussianRasterizationSettings=nothing, GaussianRasterizer=nothing)
    from dacite import from_dict
    from hydra import compose, initialize_config_dir
    from omegaconf import OmegaConf

    with initialize_config_dir(os.path.abspath(os.path.join(args.repository, "config")), version_base=None):
        config = compose("main", overrides=[f"+experiment={args.experiment}", "mode=test", *args.override])
    from src.global_cfg import set_cfg

    set_cfg(config)
    # A checkpoint holds the backbone's weights too.
    torch.hub.load = functools.partial(torch.hub.load, pretrained=False)
    from src.model.encoder import EncoderCfg, get_encoder

    holder = dataclasses.make_dataclass("Holder", [("encoder", EncoderCfg)])
    settings = OmegaConf.to_container(config.model.encoder)
    encoder, _ = get_encoder(from_dict(holder, {"encoder": settings}).encoder)
    if args.checkpoint:
        state = torch.load(args.checkpoint, map_location="cpu", weights_only=False)
        state = state.get("state_dict", state)
        own = {key.removeprefix("encoder."): value for key, value in state.items() if key.startswith("encoder.")}
        encoder.load_state_dict(own, strict=True)
    return encoder.to(args.device).eval(), views_for(args.method, config)


def views_for(method, config):
    """The number of context views that the encoder was built for; none if it takes any."""
    if method == "depthsplat" or config.model.encoder.name == "noposplat_multi":
        return None
    return 2 if method == "noposplat" else config.dataset.view_sampler.num_context_views


def views_of(trial, device):
    """The context as the repositories batch it: images in [0, 1], camera to world, intrinsics divided by width and height."""
    views = trial["context"]
    images = np.stack([np.load(view["image"]) for view in views]).transpose(0, 3, 1, 2)
    intrinsics = np.array([view["intrinsics"] for view in views], dtype=float)
    intrinsics[:, 0] /= np.array([view["width"] for view in views])[:, None]
    intrinsics[:, 1] /= np.array([view["height"] for view in views])[:, None]
    batch = {
        "image": images / 255,
        "extrinsics": [view["world_from_camera"] for view in views],
        "intrinsics": intrinsics,
        "near": [trial["near"]] * len(views),
        "far": [trial["far"]] * len(views),
    }
    batch = {name: torch.tensor(np.array(value), dtype=torch.float32, device=device)[None] for name, value in batch.items()}
    return {**batch, "index": torch.arange(len(views), device=device)[None]}


def now(device):
    """Seconds, once the device has done what it was given: CUDA computes while Python goes on."""
    if torch.device(device).type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()


@torch.no_grad()
def gaussians_of(encoder, trial, device):
    """The Gaussians, and the seconds of the encoder alone: without reading, cropping and uploading images."""
    context = views_of(trial, device)
    batch = encoder.get_data_shim()({"context": context, "target": context, "scene": [trial["scene"]]})
    torch.manual_seed(0)  # pixelSplat samples depths.
    options = {"deterministic": False} if "deterministic" in inspect.signature(encoder.forward).parameters else {}
    begin = now(device)
    made = encoder(batch["context"], 0, **options)
    seconds = now(device) - begin
    return made["gaussians"] if isinstance(made, dict) else made, seconds


def basis(directions):
    """3DGS's real spherical harmonics to degree 3 (its forward.cu, computeColorFromSH): N×16."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    bands = [0.28209479177387814 + 0 * x, -0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    bands += [1.0925484305920792 * x * y, -1.0925484305920792 * y * z, 0.31539156525252005 * (2 * zz - xx - yy)]
    bands += [-1.0925484305920792 * x * z, 0.5462742152960396 * (xx - yy), -0.5900435899266435 * y * (3 * xx - yy)]
    bands += [2.890611442640554 * x * y * z, -0.4570457994644658 * y * (4 * zz - xx - yy)]
    bands += [0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy), -0.4570457994644658 * x * (4 * zz - xx - yy)]
    bands += [1.445305721320277 * z * (xx - yy), -0.5900435899266435 * x * (xx - 3 * yy)]
    return np.stack(bands, axis=1)


def standard_from_e3nn():
    """Coefficients for directions (x, y, z) from those for (z, x, y), which the rasterizer of pixelSplat, MVSplat and DepthSplat
    takes: 16×16."""
    directions = np.random.default_rng(0).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.linalg.lstsq(basis(directions), basis(directions[:, [2, 0, 1]]), rcond=None)[0]


def write_ply(path, gaussians, has_standard_axes):
    """3DGS's layout. The encoders give covariances, and harmonics to degree 4, of which rasterizers use degree 3."""
    covariances = gaussians.covariances[0].double().cpu()
    squares, axes = torch.linalg.eigh(covariances)
    axes[:, :, 0] *= torch.linalg.det(axes)[:, None]
    harmonics = gaussians.harmonics[0].cpu().numpy()[..., :16]
    if not has_standard_axes:
        count = harmonics.shape[-1]
        harmonics = harmonics @ standard_from_e3nn()[:count, :count].T
    rest = harmonics[..., 1:].reshape(len(harmonics), -1)
    opacities = gaussians.opacities[0].double().cpu().clamp(1e-7, 1 - 1e-7)
    columns = {"xyz": gaussians.means[0].cpu().numpy(), "f_dc_": harmonics[..., 0], "f_rest_": rest}
    columns["opacity"] = torch.logit(opacities)[:, None].numpy()
    columns["scale_"] = 0.5 * squares.clamp_min(1e-20).log().numpy()
    columns["rot_"] = quaternions(axes.numpy())
    names = []
    for name, column in columns.items():
        names += list(name) if name == "xyz" else [name] if name == "opacity" else [f"{name}{at}" for at in range(column.shape[1])]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(harmonics)}"]
    header += [f"property float {name}" for name in names] + ["end_header", ""]
    with open(path, "wb") as file:
        file.write("\n".join(header).encode())
        np.concatenate(list(columns.values()), axis=1).astype("<f4").tofile(file)


def quaternions(matrices):
    """w, x, y, z of rotations: the eigenvector of the largest eigenvalue of a symmetric matrix (Bar-Itzhack 2000)."""
    (a, b, c), (d, e, f), (g, h, i) = matrices.transpose(1, 2, 0)
    rows = [[a - e - i, b + d, c + g, h - f], [b + d, e - a - i, f + h, c - g]]
    rows += [[c + g, f + h, i - a - e, d - b], [h - f, c - g, d - b, a + e + i]]
    _, vectors = np.linalg.eigh(np.array(rows).transpose(2, 0, 1))
    return vectors[:, [3, 0, 1, 2], 3]


def is_relative(trial):
    """Whether the world is the first camera, in whose frame NoPoSplat makes its Gaussians."""
    return np.allclose(trial["context"][0]["world_from_camera"], np.eye(4), atol=1e-4)


def main():
    args = arguments()
    torch.manual_seed(args.random_weights or 0)
    encoder, views = encoder_of(args)
    commit = subprocess.run(["git", "-C", args.repository, "rev-parse", "HEAD"], capture_output=True, text=True).stdout.strip()
    weights = hashlib.sha256(open(args.checkpoint, "rb").read()).hexdigest() if args.checkpoint else None
    version = f"{commit or 'unknown commit'}, {args.experiment}, seed {args.random_weights}"
    hello = {"name": args.method, "version": version, "gives": "gaussians", "setting": NAMES[args.method]}
    answer(atsplat=1, **hello, weights_sha256=weights, untrained=weights is None)
    for line in sys.stdin:
        trial = json.loads(line)
        number = trial["trial"]
        if args.method == "noposplat" and not is_relative(trial):
            answer(trial=number, not_applicable="NoPoSplat needs poses relative to the first context view")
            continue
        if any("lens" in view for view in trial["context"]):
            remedy = "`atsplat data undistort`, of a build with `--features opencv`, makes them"
            answer(trial=number, not_applicable=f"the encoder takes pinholes; {remedy}")
            continue
        if views not in (None, len(trial["context"])):
            found = f"the encoder is for {views} context views, found {len(trial['context'])}"
            answer(trial=number, not_applicable=f"{found}: give the number with --override dataset.view_sampler.num_context_views=N")
            continue
        try:
            gaussians, seconds = gaussians_of(encoder, trial, args.device)
            write_ply(os.path.join(trial["folder"], "gaussians.ply"), gaussians, args.method == "noposplat")
        except Exception as error:
            if "CUDA error" in str(error):  # Nothing works in this process any more: another one takes over.
                raise
            answer(trial=number, error=f"{type(error).__name__}: {error}")
            continue
        answer(trial=number, gaussians="gaussians.ply", seconds={"encode": seconds})


main()
