"""Losses and optimiser in PyTorch, float64: values and gradients that the crate's tests compare with.

    python make_fixtures.py    # writes ../tests/training/fixtures/losses.json and adam_w.json
"""

import json
import math
from pathlib import Path

import torch

torch.set_default_dtype(torch.float64)
FOLDER = Path(__file__).parent / "../tests/training/fixtures"


def images(seed, views, height, width):
    """Renders that leave [0, 1] a little, and a truth with flat and busy parts."""
    generator = torch.Generator().manual_seed(seed)
    truth = torch.rand(views, height, width, 3, generator=generator)
    truth[:, : height // 2] = 0.5
    truth[:, :, : width // 4] = 0.0
    render = truth + 0.2 * torch.randn(views, height, width, 3, generator=generator)
    # As f32, because the crate reads f32.
    return [x.float().double() for x in (render, truth)]


def ssim_map(x, y):
    """`ssim` of graphdeco-inria/gaussian-splatting before its mean, on [views, height, width, 3]."""
    taps = torch.tensor([math.exp(-((i - 5) ** 2) / (2 * 1.5**2)) for i in range(11)])
    taps = taps / taps.sum()
    window = (taps[:, None] * taps[None, :]).expand(3, 1, 11, 11)
    blur = lambda z: torch.nn.functional.conv2d(z, window, padding=5, groups=3)
    x, y = x.permute(0, 3, 1, 2), y.permute(0, 3, 1, 2)
    mx, my = blur(x), blur(y)
    xx, yy, xy = blur(x * x) - mx * mx, blur(y * y) - my * my, blur(x * y) - mx * my
    c1, c2 = 0.01**2, 0.03**2
    value = ((2 * mx * my + c1) * (2 * xy + c2)) / ((mx * mx + my * my + c1) * (xx + yy + c2))
    return value.permute(0, 2, 3, 1)


def flat(tensor):
    return [float(f"{v:.9g}") for v in tensor.detach().reshape(-1).tolist()]


def losses():
    cases = []
    for seed, (views, height, width) in enumerate([(1, 16, 16), (2, 9, 21), (1, 5, 4)]):
        render, truth = images(seed, views, height, width)
        render.requires_grad_()
        mse = ((render - truth) ** 2).mean()
        (mse_gradient,) = torch.autograd.grad(mse, render)
        d_map = 1 - ssim_map(render, truth)
        d_ssim = d_map.mean()
        (d_gradient,) = torch.autograd.grad(d_ssim, render)
        # The uncertainty loss against the error map, through which nothing flows.
        scalar = torch.rand(views, height, width, generator=torch.Generator().manual_seed(seed + 50)).float().double()
        scalar.requires_grad_()
        uncertainty = (scalar - d_map.mean(3).detach()).abs().mean()
        (u_gradient,) = torch.autograd.grad(uncertainty, scalar)
        cases.append(
            dict(
                views=views, height=height, width=width, render=flat(render), truth=flat(truth), scalar=flat(scalar),
                mse=mse.item(), mse_gradient=flat(mse_gradient),
                d_ssim=d_ssim.item(), d_ssim_gradient=flat(d_gradient), d_ssim_map=flat(d_map.mean(3)),
                uncertainty=uncertainty.item(), uncertainty_gradient=flat(u_gradient),
            )
        )
    return cases


def adam_w():
    """Twelve steps of torch.optim.AdamW after clip_grad_norm_, a matrix that decays and a vector that does not."""
    generator = torch.Generator().manual_seed(9)
    matrix = torch.randn(4, 3, generator=generator).float().double()
    vector = torch.randn(5, generator=generator).float().double()
    start = [flat(matrix), flat(vector)]
    parameters = [torch.nn.Parameter(matrix.clone()), torch.nn.Parameter(vector.clone())]
    optimiser = torch.optim.AdamW(
        [dict(params=[parameters[0]], weight_decay=0.05), dict(params=[parameters[1]], weight_decay=0.0)],
        betas=(0.9, 0.95),
    )
    steps = []
    for step in range(12):
        rate = 1e-2 * (step + 1) / 12
        for group in optimiser.param_groups:
            group["lr"] = rate
        gradients = [torch.randn(p.shape, generator=generator).float().double() * (0.1 if step % 3 else 2.0) for p in parameters]
        for parameter, gradient in zip(parameters, gradients):
            parameter.grad = gradient.clone()
        norm = torch.nn.utils.clip_grad_norm_(parameters, 1.0).item()
        optimiser.step()
        steps.append(dict(rate=rate, gradients=[flat(g) for g in gradients], norm=norm, after=[flat(p) for p in parameters]))
    return dict(start=start, steps=steps)


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "losses.json").write_text(json.dumps(losses()))
    (FOLDER / "adam_w.json").write_text(json.dumps(adam_w()))
