"""Times transformer blocks of this crate and of PyTorch in turns, both with two threads, and prints medians.

    cargo build --release -p atsplat-nn --example time_blocks
    python crates/nn/benches/against_pytorch.py target/release/examples/time_blocks [rounds]
"""

import os
import statistics
import subprocess
import sys
import time

# Idle workers of PyTorch must not spin while the other side is timed.
os.environ["OMP_WAIT_POLICY"] = "PASSIVE"
os.environ["KMP_BLOCKTIME"] = "0"

import torch  # noqa: E402
from torch import nn  # noqa: E402
from torch.nn import functional  # noqa: E402

THREADS = 2


class Block(nn.Module):
    def __init__(self, width, heads):
        super().__init__()
        self.heads = heads
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.qkv, self.proj = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.fc1, self.fc2 = nn.Linear(width, 4 * width), nn.Linear(4 * width, width)

    def forward(self, x):
        batch, tokens, width = x.shape
        packed = self.qkv(self.norm1(x)).reshape(batch, tokens, 3, self.heads, width // self.heads)
        q, k, v = packed.permute(2, 0, 3, 1, 4)
        attended = functional.scaled_dot_product_attention(q, k, v)
        x = x + self.proj(attended.transpose(1, 2).reshape(batch, tokens, width))
        return x + self.fc2(functional.gelu(self.fc1(self.norm2(x))))


def forward_768():
    block, x = Block(768, 12), torch.randn(1, 514, 768)

    def run():
        with torch.no_grad():
            block(x)

    return run


def training_192():
    block, x = Block(192, 6), torch.randn(8, 256, 192)

    def run():
        block.zero_grad()
        y = block(x)
        (y * y).mean().backward()

    return run


def main():
    torch.set_num_threads(THREADS)
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 30
    environment = dict(os.environ, RAYON_NUM_THREADS=str(THREADS))
    ours = subprocess.Popen([sys.argv[1]], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)

    def ask(case):
        ours.stdin.write(case + "\n")
        ours.stdin.flush()
        return float(ours.stdout.readline())

    def time_torch(run):
        start = time.perf_counter()
        run()
        return (time.perf_counter() - start) * 1e3

    print(f"PyTorch {torch.__version__}, {THREADS} threads each, {rounds} rounds; milliseconds")
    for case, make in [("forward-768", forward_768), ("training-192", training_192)]:
        run = make()
        for _ in range(3):
            ask(case), run()
        pairs = [(ask(case), time_torch(run)) for _ in range(rounds)]
        mine, theirs = zip(*pairs)
        ratio = statistics.median(a / b for a, b in pairs)
        print(
            f"{case}: ours median {statistics.median(mine):.2f}, least {min(mine):.2f}; "
            f"PyTorch median {statistics.median(theirs):.2f}, least {min(theirs):.2f}; "
            f"median of ratios {ratio:.3f}, ratio of the least {min(mine) / min(theirs):.3f}"
        )
    ours.stdin.close()
    ours.wait()


if __name__ == "__main__":
    main()
