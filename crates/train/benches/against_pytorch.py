"""Times the network's part of a training step in turns with the PyTorch reference, two threads each.

    cargo build --release -p atsplat-train --example time_step
    python -O crates/train/benches/against_pytorch.py target/release/examples/time_step [rounds]

The reference is `../../model/oracle/reference.py` in float32 with PyTorch's fused attention, and autograd. Both go forward, make
the Gaussians of every set that is rendered, and go back from the sum of all of them and of all scores. A step of two
samples runs them side by side here, and one after the other, on both threads each, there.
"""

import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "../../model/benches"))
import against_pytorch as forward  # noqa: E402
import reference  # noqa: E402
import torch  # noqa: E402


class Trained(forward.Cached):
    """Parameters that gradients are asked of."""

    def below(self, name):
        return Trained(self.seed, f"{self.prefix}{name}.", self.shapes)

    def __call__(self, name, *shape):
        return super().__call__(name, *shape).requires_grad_(True)


def without_gradient(select):
    def scored(config, layers, p, tokens, *rest):
        return select(config, layers, p, tokens.detach(), *rest)

    return scored


def theirs(config, parameters, scene):
    start = time.perf_counter()
    made, seen = reference.reconstruct(config, parameters, scene, 0)
    layers, sets, anchors = reference.Layers(config), [made], seen["anchors"]
    for block in range(len(config["decoder"]["blocks"]) - 1):
        if f"parents_{block}" in seen:
            anchors = anchors[seen[f"parents_{block}"]]
        sets.append(reference.gaussians(config, layers, parameters, seen[f"tokens_{block}"], anchors, None))
    middle = time.perf_counter()
    scores = [value for name, value in seen.items() if name.startswith("scores_")]
    total = sum(part.sum() for own in sets for part in own.values()) + sum(score.sum() for score in scores)
    total.backward()
    end = time.perf_counter()
    gradients = sum(tensor.grad is not None for tensor in Trained.made.values())
    for tensor in Trained.made.values():
        tensor.grad = None
    return {"total": end - start, "forward": middle - start, "backward": end - middle, "gradients": gradients}


def main():
    forward.in_float32()
    torch.set_grad_enabled(True)
    reference.select = without_gradient(reference.select)
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 15
    environment = dict(os.environ, RAYON_NUM_THREADS=str(forward.THREADS))
    ours = subprocess.Popen([sys.argv[1], HERE / "../../../eval/experiments/nano-rooms.toml"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)

    def ask(line):
        ours.stdin.write(line + "\n")
        ours.stdin.flush()
        return json.loads(ours.stdout.readline())

    config = ask("model")
    height, width = config["resolution"]
    scene, parameters = forward.scene(2, height, width), Trained(1)
    for samples in [1, 2]:
        def both():
            mine = ask(f"network {samples}")
            yours = [theirs(config, parameters, scene) for _ in range(samples)]
            return mine["total"], sum(one["total"] for one in yours), yours[0]["gradients"]

        gradients = both()[2]
        pairs = [both() for _ in range(rounds)]
        ratio = statistics.median(a / b for a, b, _ in pairs)
        mine, yours = [a for a, _, _ in pairs], [b for _, b, _ in pairs]
        print(f"{samples} samples: ours {statistics.median(mine):.4f} s, PyTorch {torch.__version__} "
              f"{statistics.median(yours):.4f} s, median of ratios {ratio:.2f}, ratio of the least "
              f"{min(mine) / min(yours):.2f}; {gradients} of {len(Trained.made)} parameters with gradients")
    ours.stdin.close()
    ours.wait()


if __name__ == "__main__":
    main()
