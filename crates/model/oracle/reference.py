"""A second ATSplat, in PyTorch, written from the paper for the Rust one to be compared with.

A function for each part, in the paper's order; everything in float64; one scene at a time. Configurations are
those of `src/config`, read by `tomllib`. Parameters are asked for by name and shape and made by `hashed.py`.
Shapes in comments: V views, H x W pixels, c coarse and f fine patches of a view, N tokens, D channels.
"""

import math

import numpy as np
import torch
import torch.nn.functional as F

import dinov2
import hashed

torch.set_grad_enabled(False)


class Parameters:
    """Parameters by name; remembers which were asked for."""

    def __init__(self, seed, prefix="", shapes=None):
        self.seed, self.prefix = seed, prefix
        self.shapes = {} if shapes is None else shapes

    def below(self, name):
        return Parameters(self.seed, f"{self.prefix}{name}.", self.shapes)

    def __call__(self, name, *shape):
        name = self.prefix + name
        assert self.shapes.setdefault(name, shape) == shape, name
        return torch.from_numpy(hashed.weight(self.seed, name, shape)).double()


class Scene:
    """Images [V, H, W, 3] in 0..1, poses world from camera [V, 4, 4], normalised intrinsics fx fy cx cy [V, 4]."""

    def __init__(self, images, poses, intrinsics):
        self.images, self.poses, self.intrinsics = images, poses, intrinsics

    def smaller(self, factor):
        return Scene(resized(self.images, self.images.shape[1] // factor, self.images.shape[2] // factor),
                     self.poses, self.intrinsics)

    def rays(self, rows, columns):
        """Origins and unit directions [V, R, C, 3] through points given in pixels: rows [R], columns [C]."""
        _, height, width, _ = self.images.shape
        fx, fy, cx, cy = (self.intrinsics[:, k, None, None] for k in range(4))
        x = (columns[None, None, :] / width - cx) / fx
        y = (rows[None, :, None] / height - cy) / fy
        x, y = torch.broadcast_tensors(x, y)
        in_camera = torch.stack([x, y, torch.ones_like(x)], -1)
        directions = torch.einsum("vij,vrcj->vrci", self.poses[:, :3, :3], in_camera)
        directions = directions / directions.norm(dim=-1, keepdim=True)
        return self.poses[:, None, None, :3, 3].expand_as(directions), directions

    def plucker(self):
        """o x d and d at every pixel's centre: [V, H, W, 6]."""
        _, height, width, _ = self.images.shape
        origins, directions = self.rays(torch.arange(height).double() + 0.5, torch.arange(width).double() + 0.5)
        return torch.cat([torch.linalg.cross(origins, directions), directions], -1)


def resized(images, height, width):
    moved = images.permute(0, 3, 1, 2)
    moved = F.interpolate(moved, (height, width), mode="bilinear", antialias=True, align_corners=False)
    return moved.permute(0, 2, 3, 1)


def patches(maps, size):
    """[V, H, W, C] to [V, patches, size * size * C]; within a patch: row, column, channel."""
    views, height, width, channels = maps.shape
    maps = maps.reshape(views, height // size, size, width // size, size, channels)
    return maps.permute(0, 1, 3, 2, 4, 5).reshape(views, -1, size * size * channels)


class Layers:
    """What transformer layers are made of, under one configuration."""

    def __init__(self, config):
        self.config = config["transformer"]
        self.dim, self.head_dim = self.config["dim"], self.config["head-dim"]

    def linear(self, p, name, x, outputs):
        bias = p(f"{name}.bias", outputs) if self.config["linear-bias"] else None
        return F.linear(x, p(f"{name}.weight", outputs, x.shape[-1]), bias)

    def norm(self, p, name, x):
        bias = p(f"{name}.bias", self.dim) if self.config["norm-bias"] else None
        return F.layer_norm(x, (self.dim,), p(f"{name}.weight", self.dim), bias, self.config["norm-eps"])

    def mlp(self, p, x, hidden, outputs):
        return self.linear(p, "fc2", F.gelu(self.linear(p, "fc1", x, hidden)), outputs)

    def head(self, p, x, outputs):
        """Layer norm and a 2-layer MLP."""
        return self.mlp(p.below("mlp"), self.norm(p, "norm", x), self.dim, outputs)

    def heads(self, x):
        """[..., n, D] to [..., heads, n, head_dim]."""
        return x.unflatten(-1, (-1, self.head_dim)).transpose(-2, -3)

    def attend(self, p, queries, keys, values):
        queries, keys, values = map(self.heads, (queries, keys, values))
        norm = self.config["query-key-norm"]
        if norm["kind"] == "rms":
            def rms(x, name):
                return x / (x.square().mean(-1, keepdim=True) + norm["eps"]).sqrt() * p(f"{name}.weight", self.head_dim)
            queries, keys = rms(queries, "q_norm"), rms(keys, "k_norm")
        weights = (queries @ keys.transpose(-1, -2) / math.sqrt(self.head_dim)).softmax(-1)
        return self.linear(p, "proj", (weights @ values).transpose(-2, -3).flatten(-2), self.dim)

    def block(self, p, x):
        """Self-attention, then feed-forward."""
        a = p.below("attn")
        qkv = self.linear(a, "qkv", self.norm(p, "norm1", x), 3 * self.dim)
        x = x + self.attend(a, *qkv.split(self.dim, -1))
        return x + self.mlp(p.below("mlp"), self.norm(p, "norm2", x), self.config["mlp-ratio"] * self.dim, self.dim)

    def decoder_layer(self, p, x, context):
        """Cross-attention, then a block."""
        c = p.below("cross")
        queries = self.linear(c, "q", self.norm(p, "cross_norm", x), self.dim)
        keys_values = self.linear(c, "kv", self.norm(p, "context_norm", context), 2 * self.dim)
        x = x + self.attend(c, queries, *keys_values.split(self.dim, -1))
        return self.block(p.below("block"), x)


def backbone(config, layers, p, scene):
    """[V, c, D']."""
    settings, size = config["backbone"], config["coarse"]["patch-size"]
    if settings["kind"] == "dino-v2":
        _, height, width, _ = scene.images.shape
        images = resized(scene.images, 14 * (height // size), 14 * (width // size))
        return dinov2.patch_tokens(p, images, settings["size"], settings["registers"])
    maps = torch.cat([2 * scene.images - 1, scene.plucker()], -1)
    x = layers.linear(p, "embed", patches(maps, size), layers.dim)
    for layer in range(settings["layers"]):
        x = layers.block(p.below(f"layers.{layer}"), x)
    return x


def coarse_branch(config, layers, p, scene, seen):
    """[V, c, D]: features across views."""
    settings = config["coarse"]
    features = backbone(config, layers, p.below("backbone"), scene)
    seen["backbone"] = features
    p = p.below("coarse")
    raw = layers.linear(p, "patch", patches(2 * scene.images - 1, settings["patch-size"]), layers.dim)
    x = layers.linear(p, "fuse", torch.cat([features, raw], -1), layers.dim)
    x = x + layers.linear(p, "plucker", patches(scene.plucker(), settings["patch-size"]), layers.dim)
    seen["coarse_tokens"] = x
    views = x.shape[0]
    x = x.flatten(0, 1)
    for layer in range(settings["layers"]):
        x = layers.block(p.below(f"layers.{layer}"), x)
    x = x.unflatten(0, (views, -1))
    seen["coarse"] = x
    return x


def fine_branch(config, layers, p, scene, coarse, grid, seen):
    """[V * f, D]: what anchors look at."""
    settings, p = config["fine"], p.below("fine")
    size = settings["patch-size"]
    x = layers.linear(p, "patch", patches(2 * scene.images - 1, size), layers.dim)
    x = x + layers.linear(p, "plucker", patches(scene.plucker(), size), layers.dim)
    for layer in range(settings["layers"]):
        x = layers.block(p.below(f"layers.{layer}"), x)
    seen["fine_own"] = x
    fine_grid = (scene.images.shape[1] // size, scene.images.shape[2] // size)
    maps = coarse.unflatten(1, grid).permute(0, 3, 1, 2)
    if settings["upsampling"] == "bilinear":
        maps = F.interpolate(maps, fine_grid, mode="bilinear", align_corners=False)
    else:
        maps = F.interpolate(maps, fine_grid, mode="nearest")
    x = x + maps.permute(0, 2, 3, 1).flatten(1, 2)
    seen["fine"] = x
    return x.flatten(0, 1)


def depth_of(settings, x):
    kind = settings["kind"]
    x = x + settings["shift"]
    if kind == "exp":
        return x.exp()
    near, far = settings["near"], settings["far"]
    if kind == "log-sigmoid":
        return near * (far / near) ** x.sigmoid()
    if kind == "sigmoid":
        return near + (far - near) * x.sigmoid()
    assert kind == "inverse-sigmoid"
    return 1 / (1 / far + (1 / near - 1 / far) * x.sigmoid())


def centres(count, size):
    """Where the patches' centres are, in pixels."""
    return (torch.arange(count).double() + 0.5) * size


def squared_distances(points):
    """(dx^2 + dy^2) + dz^2 in float64 of float32 coordinates."""
    points = points.float().double()
    d = points[:, None] - points[None]
    return (d[..., 0].square() + d[..., 1].square()) + d[..., 2].square()


def pointnet(config, layers, p, tokens, anchors, seen):
    neighbours = min(config["anchors"]["context"]["neighbours"], len(tokens))
    distances = squared_distances(anchors)
    nearest = distances.argsort(dim=1, stable=True)
    ordered = distances.gather(1, nearest)
    if neighbours < len(tokens):
        gap = (ordered[:, neighbours] / ordered[:, neighbours - 1]).min().item()
        assert gap > 1 + 1e-4, f"neighbours of equal distance: {gap}"
    nearest = nearest[:, :neighbours]
    seen["neighbours"] = nearest
    normed = layers.norm(p, "norm", tokens)
    offsets = anchors[nearest] - anchors[:, None]
    pairs = torch.cat([normed[nearest], offsets], -1)
    largest = layers.linear(p, "fc1", pairs, layers.dim).amax(1)
    return tokens + layers.linear(p, "fc2", F.gelu(largest), layers.dim)


def initial_tokens(config, layers, p, scene, coarse, grid, seen):
    """Tokens [N, D], anchors [N, 3] or None; and, each or None, what is handed on with a token: rays of its Gaussians
    ([N, K, 3], [N, K, 3]), or in the patch's frame its camera's rotation and its footprint ([N, 3, 3], [N])."""
    settings, p = config["anchors"], p.below("anchors")
    kind, size = settings["design"]["kind"], config["coarse"]["patch-size"]
    if kind == "learnable-tokens":
        return p("tokens", settings["design"]["tokens"], layers.dim), None, None
    tokens = coarse.flatten(0, 1)
    if kind == "direct-xyz":
        return tokens, None, None
    if kind == "ray-depth":
        count = config["head"]["gaussians-per-token"]
        rows = max(r for r in range(1, count + 1) if count % r == 0 and r * r <= count)
        columns = count // rows
        origins, directions = scene.rays(centres(grid[0] * rows, size / rows), centres(grid[1] * columns, size / columns))

        def by_token(x):
            x = x.reshape(len(x), grid[0], rows, grid[1], columns, 3).permute(0, 1, 3, 2, 4, 5)
            return x.reshape(-1, count, 3)

        return tokens, None, (by_token(origins), by_token(directions))
    assert kind == "patch-depth"
    depths = depth_of(settings["depth"], layers.head(p.below("depth"), tokens, 1))
    origins, directions = scene.rays(centres(grid[0], size), centres(grid[1], size))
    anchors = origins.reshape(-1, 3) + depths * directions.reshape(-1, 3)
    seen["depths"], seen["anchors"] = depths[:, 0], anchors
    if settings["context"]["kind"] == "point-net":
        tokens = pointnet(config, layers, p.below("context"), tokens, anchors, seen)
    if config["head"].get("frame", "world") == "world":
        return tokens, anchors, None
    # Patch width over focal length, both in pixels.
    slope = size / (scene.intrinsics[:, 0] * scene.images.shape[2])
    per_view = grid[0] * grid[1]
    footprints = depths[:, 0] * slope.repeat_interleave(per_view)
    return tokens, anchors, (scene.poses[:, :3, :3].repeat_interleave(per_view, 0), footprints)


def how_many(ratio, tokens, rounding):
    product = round(ratio * 10**6) * tokens
    return -(-product // 10**6) if rounding == "ceil" else product // 10**6


def farthest_points(points, count):
    distances = squared_distances(points)
    chosen, nearest = [0], distances[0].clone()
    while len(chosen) < count:
        nearest[chosen] = -1
        best = int(nearest.argmax())  # the first of equals
        assert nearest[best] == nearest.max() and best == int((nearest == nearest.max()).nonzero()[0])
        chosen.append(best)
        nearest = torch.minimum(nearest, distances[best])
    return sorted(chosen[:count])


def select(config, layers, p, tokens, anchors, expansion, block, call_seed):
    """Indices in ascending order, and the scores if this selection has any."""
    settings = config["expansion"]
    kind = settings["selection"]["kind"]
    count = how_many(expansion["ratio"], len(tokens), settings["ratio-rounding"]) if "ratio" in expansion else None
    if kind == "random":
        scores = hashed.bits(hashed.stream(settings["selection"]["seed"], call_seed, block), len(tokens))
        return sorted(np.argsort(~scores, kind="stable")[:count].tolist()), None
    if kind == "farthest-point":
        return farthest_points(anchors, count) if count else [], None
    assert kind in ("uncertainty", "straight-through")
    scores = F.softplus(layers.head(p.below("score"), tokens, 1)[:, 0])
    if count is None:
        assert (scores - expansion["threshold"]).abs().min() > 1e-4, "scores at the threshold"
        return (scores > expansion["threshold"]).nonzero()[:, 0].tolist(), scores
    order = scores.argsort(descending=True, stable=True)
    if 0 < count < len(tokens):
        gap = (scores[order[count - 1]] - scores[order[count]]).item()
        assert gap > 1e-4, f"scores that are nearly equal: {gap}"
    return sorted(order[:count].tolist()), scores


def expand(config, layers, p, tokens, selected):
    """Tokens afterwards, and where each came from: unselected in order, then children by parent."""
    chosen = torch.zeros(len(tokens), dtype=bool)
    chosen[selected] = True
    count = config["expansion"]["children"]
    parents = tokens[chosen]
    residuals = layers.linear(p, "children", parents, count * layers.dim).unflatten(-1, (count, layers.dim))
    children = parents[:, None] + residuals
    index = torch.arange(len(tokens))
    origin = torch.cat([index[~chosen], index[chosen].repeat_interleave(count)])
    return torch.cat([tokens[~chosen], children.flatten(0, 1)]), origin


def cells_of(count):
    """Centres of a patch's cells, [K, 3]: right, down and forward of the patch's centre in units of its width; columns."""
    rows = max(r for r in range(1, count + 1) if count % r == 0 and r * r <= count)
    columns = count // rows
    cells = [[(column + 0.5) / columns - 0.5, (row + 0.5) / rows - 0.5, 0] for row in range(rows) for column in range(columns)]
    return torch.tensor(cells).double(), columns


def gaussians(config, layers, p, tokens, anchors, rays):
    """Means [G, 3], quaternions wxyz [G, 4], log scales [G, 3], opacity logits [G], SH [G, coefficients, 3]."""
    settings, design = config["head"], config["anchors"]["design"]["kind"]
    count, coefficients = settings["gaussians-per-token"], (settings["sh-degree"] + 1) ** 2
    place = 1 if design == "ray-depth" else 3
    x = layers.head(p.below("head"), tokens, count * (place + 8 + 3 * coefficients))
    centre, quaternion, scale, opacity, sh = x.unflatten(-1, (count, -1)).split([place, 4, 3, 1, 3 * coefficients], -1)
    in_patch = settings.get("frame", "world") == "patch"
    if design == "ray-depth":
        means = rays[0] + depth_of(config["anchors"]["depth"], centre) * rays[1]
    elif in_patch:
        world_from_camera, footprints = rays
        cells, columns = cells_of(count)
        in_camera = (cells + 0.5 * centre) * footprints[:, None, None]
        means = anchors[:, None] + in_camera @ world_from_camera.transpose(1, 2)
    else:
        offset = settings["offset"]
        means = centre if offset["kind"] == "linear" else centre.sign() * (centre.abs().exp() - 1)
        means = offset["gain"] * means
        if anchors is not None:
            means = anchors[:, None] + means
    if settings["quaternion"] == "normalize-from-identity":
        quaternion = quaternion + torch.tensor([1.0, 0, 0, 0]).double()
    quaternion = F.normalize(quaternion, dim=-1)
    kind = settings["scale"]
    if in_patch:
        log_scale = (scale + math.log(0.6 / columns)).clamp(max=0.7)
        assert 0 < (log_scale == 0.7).sum() < log_scale.numel(), "scales on one side of the cut-off"
        log_scale = log_scale + footprints.log()[:, None, None]
    elif kind["kind"] == "exp-clamped":
        log_scale = (scale + kind["shift"]).clamp(max=kind["max"])
    else:
        log_scale = (kind["gain"] * F.softplus(scale + kind["shift"])).log()
    return {
        "means": means.flatten(0, 1),
        "quaternions": quaternion.flatten(0, 1),
        "log_scales": log_scale.flatten(0, 1),
        "opacity_logits": (opacity + settings["opacity"]["shift"]).flatten(),
        "sh": sh.unflatten(-1, (coefficients, 3)).flatten(0, 1),
    }


def reconstruct(config, p, scene, call_seed):
    """Gaussians of a scene, and everything that was seen on the way."""
    layers, seen = Layers(config), {}
    coarse_scene = scene.smaller(config["coarse"]["image-downscale"]) if config["coarse"]["image-downscale"] > 1 else scene
    fine_scene = scene.smaller(config["fine"]["image-downscale"]) if config["fine"]["image-downscale"] > 1 else scene
    size = config["coarse"]["patch-size"]
    grid = (coarse_scene.images.shape[1] // size, coarse_scene.images.shape[2] // size)
    coarse = coarse_branch(config, layers, p, coarse_scene, seen)
    context = fine_branch(config, layers, p, fine_scene, coarse, grid, seen)
    tokens, anchors, rays = initial_tokens(config, layers, p, coarse_scene, coarse, grid, seen)
    seen["tokens_initial"] = tokens
    for position, block in enumerate(config["decoder"]["blocks"]):
        below = p.below(f"decoder.blocks.{position}")
        if "expansion" in block and block.get("expand", True):
            selected, scores = select(config, layers, below.below("expansion"), tokens, anchors, block["expansion"],
                                      position, call_seed)
            tokens, origin = expand(config, layers, below.below("expansion"), tokens, selected)
            anchors = anchors[origin] if anchors is not None else None
            rays = tuple(ray[origin] for ray in rays) if rays is not None else None
            seen[f"selected_{position}"], seen[f"parents_{position}"] = torch.tensor(selected), origin
            if scores is not None:
                seen[f"scores_{position}"] = scores
        for layer in range(block["layers"]):
            tokens = layers.decoder_layer(below.below(f"layers.{layer}"), tokens, context)
        seen[f"tokens_{position}"] = tokens
    return gaussians(config, layers, p, tokens, anchors, rays), seen
