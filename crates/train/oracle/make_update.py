"""Eight updates of a small network in PyTorch, float64: what `src/update.rs` must do to the same parameters.

    python make_update.py    # writes ../tests/training/fixtures/update.json

A batch is three samples. PyTorch takes the mean of their losses, goes back once, clips and steps; each sample's own gradient is
written down beside it, for an optimiser that has to average them itself. The embedding's rows are each for one kind of sample,
and the gate takes part in every second sample alone: a gradient that is absent counts as zero.
"""

import json
from pathlib import Path

import torch

torch.set_default_dtype(torch.float64)
FIXTURE = Path(__file__).parent / "../tests/training/fixtures/update.json"
# An epsilon that matters: without one, Adam does not see how large gradients are.
CLIP, DECAY, BETAS, EPSILON, BATCH, STEPS = 0.5, 0.1, (0.9, 0.95), 1e-3, 3, 8

generator = torch.Generator().manual_seed(20)
SHAPES = {
    "embedding": (2, 2, 3),
    "first.weight": (5, 3),
    "first.bias": (5,),
    "norm.weight": (5,),
    "gate.weight": (5,),
    "last.weight": (2, 5),
    "last.bias": (2,),
}


def rounded(tensor):
    """As f32, because the crate holds f32."""
    return tensor.float().double()


def flat(tensor):
    return [float(f"{v:.9g}") for v in tensor.detach().reshape(-1).tolist()]


parameters = {name: torch.nn.Parameter(rounded(torch.randn(shape, generator=generator))) for name, shape in SHAPES.items()}


def loss(x, y, kind, size):
    p = parameters
    hidden = torch.tanh((x + p["embedding"][kind].sum(0)) @ p["first.weight"].T + p["first.bias"]) * p["norm.weight"]
    if kind == 0:
        hidden = hidden * torch.sigmoid(p["gate.weight"])
    return size * ((hidden @ p["last.weight"].T + p["last.bias"] - y) ** 2).mean()


matrices = [p for p in parameters.values() if p.ndim >= 2]
vectors = [p for p in parameters.values() if p.ndim < 2]
optimiser = torch.optim.AdamW(
    [dict(params=matrices, weight_decay=DECAY), dict(params=vectors, weight_decay=0.0)], betas=BETAS, eps=EPSILON
)
run = dict(
    clip=CLIP,
    weight_decay=DECAY,
    betas=BETAS,
    epsilon=EPSILON,
    parameters=[dict(name=name, shape=list(p.shape), values=flat(p)) for name, p in parameters.items()],
    steps=[],
)
for step in range(STEPS):
    rate = 3e-2 * min(step + 1, 3) / 3
    for group in optimiser.param_groups:
        group["lr"] = rate
    # Every other step's losses are so small that nothing is clipped.
    size = 1.0 if step % 2 == 0 else 0.02
    samples = [
        (rounded(torch.randn(3, generator=generator)), rounded(torch.randn(2, generator=generator)), number % 2, size)
        for number in range(step * BATCH, (step + 1) * BATCH)
    ]
    lessons = []
    for sample in samples:
        gradients = torch.autograd.grad(loss(*sample), list(parameters.values()), allow_unused=True)
        lessons.append({name: flat(g) for name, g in zip(parameters, gradients) if g is not None})
    optimiser.zero_grad()
    torch.stack([loss(*sample) for sample in samples]).mean().backward()
    norm = torch.nn.utils.clip_grad_norm_(list(parameters.values()), CLIP).item()
    optimiser.step()
    run["steps"].append(dict(rate=rate, lessons=lessons, norm=norm, after=[flat(p) for p in parameters.values()]))
    print(step, norm)
FIXTURE.write_text(json.dumps(run))
