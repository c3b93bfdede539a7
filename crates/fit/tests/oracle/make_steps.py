"""Steps of 3DGS, Mip-Splatting and MCMC in PyTorch at double precision, from the published formulas.

    python crates/fit/tests/oracle/make_steps.py > crates/fit/tests/fixtures/steps.json

Random numbers come from SplitMix64 as crates/fit/src/random.rs derives its streams, written here a second time.
"""
import json
import math

import torch
import torch.nn.functional as F

torch.set_default_dtype(torch.float64)
generator = torch.Generator().manual_seed(20)
MASK = (1 << 64) - 1
STEP = 0x9E3779B97F4A7C15
ORDER, BACKGROUND, SPLIT, RELOCATION, GROWTH, NOISE, START = range(7)


def split_mix(state):
    z = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


class Stream:
    def __init__(self, seed, purpose, number):
        state = 0
        for value in (seed, purpose, number):
            state = split_mix((state + STEP + value) & MASK)
        self.state = state

    def bits(self):
        self.state = (self.state + STEP) & MASK
        return split_mix(self.state)

    def uniform(self):
        return (self.bits() >> 11) / 2**53

    def normals(self):
        out = []
        for _ in range(2):
            radius = math.sqrt(-2 * math.log(1 - self.uniform()))
            angle = 2 * math.pi * self.uniform()
            out += [radius * math.cos(angle), radius * math.sin(angle)]
        return torch.tensor(out[:3])

    def weighted(self, weights, count):
        sums = torch.cumsum(weights, 0)
        return [int(torch.searchsorted(sums, self.uniform() * float(sums[-1]), right=True)) for _ in range(count)]


def rand(*shape, low=0.0, high=1.0):
    # Rounded to f32, so that both sides start from the same numbers.
    return (torch.rand(*shape, generator=generator) * (high - low) + low).float().double()


def scene(count, degree=1):
    coefficients = (degree + 1) ** 2
    return {
        "means": rand(count, 3, low=-1, high=1),
        "quaternions": rand(count, 4, low=-1, high=1),
        "log_scales": rand(count, 3, low=-5, high=-1),
        "opacity_logits": rand(count, low=-7, high=4),
        "sh": rand(count, coefficients, 3, low=-1, high=1),
    }


def rotation(quaternion):
    w, x, y, z = (quaternion / quaternion.norm(dim=-1, keepdim=True)).unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def plain(value):
    if isinstance(value, torch.Tensor):
        return value.tolist()
    if isinstance(value, dict):
        return {name: plain(entry) for name, entry in value.items()}
    return value


def ssim(a, b):
    gauss = torch.tensor([math.exp(-((x - 5) ** 2) / (2 * 1.5**2)) for x in range(11)])
    gauss = gauss / gauss.sum()
    window = torch.outer(gauss, gauss).expand(3, 1, 11, 11)
    blur = lambda x: F.conv2d(x, window, padding=5, groups=3)
    ma, mb = blur(a), blur(b)
    va, vb, cov = blur(a * a) - ma**2, blur(b * b) - mb**2, blur(a * b) - ma * mb
    c1, c2 = 0.01**2, 0.03**2
    return (((2 * ma * mb + c1) * (2 * cov + c2)) / ((ma**2 + mb**2 + c1) * (va + vb + c2))).mean()


def loss():
    height, width = 14, 19
    render, truth = rand(height, width, 3, low=-0.1, high=1.2), rand(height, width, 3)
    truth[3, 4] = render[3, 4]
    render.requires_grad_()
    planes = lambda x: x.permute(2, 0, 1)[None]
    l1 = (render - truth).abs().mean()
    d_ssim = 1 - ssim(planes(render), planes(truth))
    (0.8 * l1 + 0.2 * d_ssim).backward()
    return {"height": height, "width": width, "render": render.detach(), "truth": truth, "l1": l1.item(),
            "d_ssim": d_ssim.item(), "gradient": render.grad}


def adam():
    """Two steps of torch.optim.Adam in 3DGS' parameter groups."""
    start = scene(5)
    gradients = [{name: rand(*value.shape, low=-1, high=1) ** 3 for name, value in start.items()} for _ in range(2)]
    values = {name: value.clone().requires_grad_() for name, value in start.items() if name != "sh"}
    values["dc"] = start["sh"][:, :1].clone().requires_grad_()
    values["rest"] = start["sh"][:, 1:].clone().requires_grad_()
    rates = {"means": 1.6e-4 * 3.0, "quaternions": 1e-3, "log_scales": 5e-3, "opacity_logits": 0.05, "dc": 2.5e-3,
             "rest": 2.5e-3 / 20}
    optimiser = torch.optim.Adam([{"params": [values[name]], "lr": rate} for name, rate in rates.items()], eps=1e-15)
    for step in gradients:
        for name in values:
            source = step["sh"] if name in ("dc", "rest") else step[name]
            values[name].grad = source[:, :1] if name == "dc" else source[:, 1:] if name == "rest" else source
        optimiser.step()
    after = {name: value.detach() for name, value in values.items()}
    after["sh"] = torch.cat([after.pop("dc"), after.pop("rest")], 1)
    return {"extent": 3.0, "start": start, "gradients": gradients, "after": after}


def adaptive():
    """densify_and_prune after the first reset of opacities, then reset_opacity."""
    count, extent, seed, step = 12, 4.0, 9, 3100
    start = scene(count)
    start["opacity_logits"][:2] = torch.tensor([-6.0, 1.0])
    start["log_scales"][1] = torch.tensor([0.25, -3.0, -3.0])
    start["log_scales"][4:8] -= 4
    # Two views with their gradients in pixels, which positions they draw, and their sizes.
    views = [{"means_2d": rand(count, 2, low=-1, high=1) * 1.2e-5, "drawn": drawn, "size": size}
             for drawn, size in ([list(range(0, 12, 1)), [64, 48]], [list(range(2, 12, 2)), [32, 80]])]
    sums, counts = torch.zeros(count), torch.zeros(count)
    for view in views:
        half = torch.tensor(view["size"]) * 0.5
        for at in view["drawn"]:
            sums[at] += (view["means_2d"][at] * half).norm()
            counts[at] += 1
    mean = torch.nan_to_num(sums / counts)
    largest = start["log_scales"].exp().max(1).values
    clone = (mean >= 2e-4) & (largest <= 0.01 * extent)
    split = (mean >= 2e-4) & (largest > 0.01 * extent)
    assert clone.any() and split.any() and (~clone & ~split).any()
    parents = {name: value[split] for name, value in start.items()}
    random = Stream(seed, SPLIT, step)
    children = []
    for _ in range(2):
        child = {name: value.clone() for name, value in parents.items()}
        for at in range(int(split.sum())):
            offset = rotation(parents["quaternions"][at]) @ (parents["log_scales"][at].exp() * random.normals())
            child["means"][at] += offset
        child["log_scales"] = (parents["log_scales"].exp() / (0.8 * 2)).log()
        children.append(child)
    parts = [{name: value[~split] for name, value in start.items()}, {name: value[clone] for name, value in start.items()}]
    after = {name: torch.cat([part[name] for part in parts + children]) for name in start}
    faint = torch.sigmoid(after["opacity_logits"]) < 0.005
    large = after["log_scales"].exp().max(1).values > 0.1 * extent
    assert faint.any() and (large & ~faint).any()
    after = {name: value[~(faint | large)] for name, value in after.items()}
    # Mip-Splatting's reset, with a filter.
    filters = rand(count, low=0.005, high=0.05)
    scales, opacity = start["log_scales"].exp(), torch.sigmoid(start["opacity_logits"])
    coefficient = torch.sqrt((scales**2).prod(1) / (scales**2 + filters[:, None] ** 2).prod(1))
    lowered = torch.minimum(opacity * coefficient, torch.tensor(0.01)) / coefficient
    return {"extent": extent, "seed": seed, "step": step, "start": start, "views": views, "after": after,
            "cloned": int(clone.sum()), "split": int(split.sum()), "pruned": int((faint | large).sum()),
            "filters": filters, "reset_logits": torch.logit(lowered)}


def compute_relocation(opacity, together):
    new = 1 - (1 - opacity) ** (1 / together)
    denominator = sum(math.comb(i - 1, k) * (-1) ** k / math.sqrt(k + 1) * new ** (k + 1)
                      for i in range(1, together + 1) for k in range(i))
    return new, opacity / denominator


def shared(values, sources):
    for source in sorted(set(sources)):
        opacity = torch.sigmoid(values["opacity_logits"][source]).item()
        new, factor = compute_relocation(opacity, sources.count(source) + 1)
        values["opacity_logits"][source] = torch.logit(torch.tensor(min(max(new, 0.005), 1 - 2**-23)))
        values["log_scales"][source] += math.log(factor)


def mcmc():
    """Relocation of dead Gaussians, growth by a twentieth, noise; and the regularisers' gradients."""
    count, seed, step, means_rate, limit = 40, 4, 600, 2e-4, 100
    start = scene(count)
    start["opacity_logits"][::9] = -6.5
    values = {name: value.clone() for name, value in start.items()}
    opacity = torch.sigmoid(values["opacity_logits"])
    dead = [at for at in range(count) if opacity[at] <= 0.005]
    sources = Stream(seed, RELOCATION, step).weighted(torch.where(opacity > 0.005, opacity, 0.0), len(dead))
    shared(values, sources)
    for to, source in zip(dead, sources):
        for name in values:
            values[name][to] = values[name][source]
    added = min(limit, int(1.05 * count)) - count
    sources_of_added = Stream(seed, GROWTH, step).weighted(torch.sigmoid(values["opacity_logits"]), added)
    shared(values, sources_of_added)
    values = {name: torch.cat([value, value[sources_of_added]]) for name, value in values.items()}
    block = Stream(Stream(seed, NOISE, step).bits(), NOISE, 0)
    matrices = rotation(values["quaternions"])
    for at in range(count + added):
        opacity = torch.sigmoid(values["opacity_logits"][at])
        gate = 1 / (1 + torch.exp(-100 * ((1 - opacity) - 0.995)))
        factor = matrices[at] @ torch.diag(values["log_scales"][at].exp())
        values["means"][at] += factor @ factor.T @ (block.normals() * gate * 5e5 * means_rate)
    logits = start["opacity_logits"].clone().requires_grad_()
    logs = start["log_scales"].clone().requires_grad_()
    regularisers = 0.01 * torch.sigmoid(logits).mean() + 0.01 * logs.exp().mean()
    regularisers.backward()
    table = [[o, n, *compute_relocation(o, n)] for o in (0.02, 0.5, 0.9, 0.999) for n in (1, 2, 5, 17, 51)]
    return {"seed": seed, "step": step, "means_rate": means_rate, "limit": limit, "start": start, "after": values,
            "relocated": len(dead), "added": added, "table": table, "regularisers": regularisers.item(),
            "opacity_gradient": logits.grad, "scale_gradient": logs.grad}


def filter_3d():
    """compute_3D_filter of mip-splatting, with principal points that are off the centre."""
    means = rand(60, 3, low=-4, high=4)
    cameras, distance = [], torch.full((60,), 100000.0)
    seen = torch.zeros(60, dtype=torch.bool)
    for width, height, fx, fy, cx, cy in ((64, 48, 70.0, 66.0, 30.0, 26.0), (40, 80, 55.0, 90.0, 20.0, 37.0)):
        matrix = rotation(rand(4, low=-1, high=1))
        translation = rand(3, low=-1, high=1) + torch.tensor([0.0, 0.0, 2.0])
        x, y, z = (means @ matrix.T + translation).unbind(1)
        u, v = x / z.clamp_min(0.001) * fx + cx, y / z.clamp_min(0.001) * fy + cy
        inside = (u >= -0.15 * width) & (u <= 1.15 * width) & (v >= -0.15 * height) & (v <= 1.15 * height)
        valid = (z > 0.2) & inside
        distance[valid] = torch.minimum(distance[valid], z[valid])
        seen |= valid
        cameras.append({"size": [width, height], "intrinsics": [fx, fy, cx, cy], "rotation": matrix,
                        "translation": translation})
    distance[~seen] = distance[seen].max()
    assert seen.any() and (~seen).any()
    return {"means": means, "cameras": [plain(camera) for camera in cameras], "filters": distance / 70.0 * 0.2**0.5}


result = {"loss": loss(), "adam": adam(), "adaptive": adaptive(), "mcmc": mcmc(), "filter_3d": filter_3d()}
result["adam"]["gradients"] = [plain(step) for step in result["adam"]["gradients"]]
result["adaptive"]["views"] = [plain(view) for view in result["adaptive"]["views"]]
print(json.dumps(plain(result)))
