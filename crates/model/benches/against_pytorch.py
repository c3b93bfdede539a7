"""Times the whole network in turns with the PyTorch reference, two threads each, and prints a table of stages.

    cargo build --release -p atsplat-model --example time_network
    python -O crates/model/benches/against_pytorch.py target/release/examples/time_network [rounds [NAME VIEWS HEIGHT WIDTH]]

The reference is `../oracle/reference.py` in float32, with PyTorch's fused attention in place of its own formula; `-O`, because its
checks for ties are for fixtures.
"""

import json
import os
import statistics
import subprocess
import sys
import time
import tomllib
from pathlib import Path

# Idle workers of PyTorch must not spin while the other side is timed.
os.environ["OMP_WAIT_POLICY"] = "PASSIVE"
os.environ["KMP_BLOCKTIME"] = "0"

import torch  # noqa: E402
import torch.nn.functional as F  # noqa: E402

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "../oracle"))
import dinov2  # noqa: E402
import hashed  # noqa: E402
import reference  # noqa: E402

THREADS = 2


class Cached(reference.Parameters):
    """Parameters in float32, made once."""

    made = {}

    def below(self, name):
        return Cached(self.seed, f"{self.prefix}{name}.", self.shapes)

    def __call__(self, name, *shape):
        name = self.prefix + name
        if name not in self.made:
            self.made[name] = torch.from_numpy(hashed.weight(self.seed, name, shape))
        return self.made[name]


def attend(self, p, queries, keys, values):
    queries, keys, values = map(self.heads, (queries, keys, values))
    if self.config["query-key-norm"]["kind"] == "rms":
        eps = self.config["query-key-norm"]["eps"]
        queries = F.rms_norm(queries, (self.head_dim,), p("q_norm.weight", self.head_dim), eps)
        keys = F.rms_norm(keys, (self.head_dim,), p("k_norm.weight", self.head_dim), eps)
    batched = queries.dim() == 4
    if not batched:
        queries, keys, values = queries[None], keys[None], values[None]
    seen = F.scaled_dot_product_attention(queries, keys, values)
    seen = seen if batched else seen[0]
    return self.linear(p, "proj", seen.transpose(-2, -3).flatten(-2), self.dim)


def dino_attention(p, x, dim, heads):
    qkv = dinov2.linear(p, "qkv", x, 3 * dim).unflatten(-1, (3, heads, dim // heads)).permute(2, 0, 3, 1, 4)
    return dinov2.linear(p, "proj", F.scaled_dot_product_attention(*qkv).transpose(1, 2).flatten(-2), dim)


def in_float32():
    torch.set_num_threads(THREADS)
    torch.Tensor.double = torch.Tensor.float
    dinov2.MEAN, dinov2.DEVIATION = dinov2.MEAN.float(), dinov2.DEVIATION.float()
    dinov2.attention = dino_attention
    reference.Layers.attend = attend


def scene(views, height, width):
    images = torch.arange(views * height * width * 3).remainder(251).float().div(250).reshape(views, height, width, 3)
    poses = torch.eye(4).repeat(views, 1, 1)
    poses[:, 0, 3] = 0.2 * torch.arange(views)
    return reference.Scene(images, poses, torch.tensor([[0.9, 0.9, 0.5, 0.5]]).repeat(views, 1))


def main():
    in_float32()
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 5
    case = sys.argv[3:7] or ["paper-re10k", "2", "256", "256"]
    config = tomllib.loads((HERE / f"../../../eval/models/{case[0]}.toml").read_text())
    environment = dict(os.environ, RAYON_NUM_THREADS=str(THREADS))
    ours = subprocess.Popen([sys.argv[1]], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
    images, parameters, stages = scene(*map(int, case[1:])), Cached(1), {}

    def timed(name):
        function = getattr(reference, name)

        def run(*arguments):
            start = time.perf_counter()
            result = function(*arguments)
            stages[name] = stages.get(name, 0) + time.perf_counter() - start
            return result

        setattr(reference, name, run)

    for name in ["coarse_branch", "fine_branch", "initial_tokens", "gaussians"]:
        timed(name)

    def ask():
        ours.stdin.write(" ".join(case) + "\n")
        ours.stdin.flush()
        return json.loads(ours.stdout.readline())

    def theirs():
        stages.clear()
        start = time.perf_counter()
        made, _ = reference.reconstruct(config, parameters, images, 0)
        total = time.perf_counter() - start
        seconds = {"coarse": stages["coarse_branch"], "anchors": stages["initial_tokens"],
                   "fine": stages["fine_branch"], "head": stages["gaussians"]}
        return {"gaussians": len(made["means"]), "total": total,
                "seconds": seconds | {"decoder": total - sum(seconds.values())}}

    first, other = ask(), theirs()
    if first["gaussians"] != other["gaussians"]:
        sys.exit(f"{first['gaussians']} Gaussians here, {other['gaussians']} there")
    pairs = [(ask(), theirs()) for _ in range(rounds)]
    print(f"{' '.join(case)}: {first['gaussians']} Gaussians; PyTorch {torch.__version__}, {THREADS} threads each, "
          f"{rounds} rounds; seconds, median / least")

    def row(name, of):
        mine, yours = [of(a) for a, _ in pairs], [of(b) for _, b in pairs]
        ratio = statistics.median(a / b for a, b in zip(mine, yours))
        print(f"{name:8} ours {statistics.median(mine):.3f} / {min(mine):.3f}   PyTorch {statistics.median(yours):.3f} / "
              f"{min(yours):.3f}   median of ratios {ratio:.2f}, ratio of the least {min(mine) / min(yours):.2f}")

    for stage in ["coarse", "anchors", "fine", "decoder", "head"]:
        row(stage, lambda answer: answer["seconds"][stage])
    row("total", lambda answer: answer["total"])
    ours.stdin.close()
    ours.wait()


if __name__ == "__main__":
    main()
