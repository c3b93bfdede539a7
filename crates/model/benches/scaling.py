"""What views and pixels cost: runs a network for growing input and fits `seconds = a * tokens ** b`.

    cargo build --release -p atsplat-model --example time_network
    python crates/model/benches/scaling.py target/release/examples/time_network [NAME [rounds]]

Each line is the least of the rounds. Gaussians, stages in seconds, peak resident memory of the process so far.
"""

import json
import math
import os
import subprocess
import sys

VIEWS = [(views, 256, 256) for views in (1, 2, 3, 4, 6, 8, 12)]
SIZES = [(2, side, side) for side in (128, 192, 256, 320, 384)]


def fitted(points):
    """Exponent of a power law by least squares of logarithms."""
    x, y = [math.log(a) for a, _ in points], [math.log(b) for _, b in points]
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    return sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y)) / sum((a - mean_x) ** 2 for a in x)


def main():
    name = sys.argv[2] if len(sys.argv) > 2 else "mini"
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 2
    environment = dict(os.environ, RAYON_NUM_THREADS="2")
    process = subprocess.Popen([sys.argv[1]], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)

    def ask(views, height, width):
        process.stdin.write(f"{name} {views} {height} {width}\n")
        process.stdin.flush()
        return json.loads(process.stdout.readline())

    for title, cases, size in [("views", VIEWS, lambda case: case[0]), ("pixels", SIZES, lambda case: case[1] * case[2])]:
        points = []
        print(f"{name}, {title}")
        for case in cases:
            answers = [ask(*case) for _ in range(rounds)]
            best = min(answers, key=lambda answer: answer["total"])
            points.append((size(case), best["total"]))
            stages = "  ".join(f"{stage} {seconds:.3f}" for stage, seconds in best["seconds"].items())
            print(f"{case[0]:2} x {case[1]}x{case[2]}: {best['gaussians']:7} Gaussians  {best['total']:.3f} s  {stages}  "
                  f"{best['peak_kilobytes'] / 2**20:.2f} GiB")
        print(f"exponent {fitted(points):.2f}")
    process.stdin.close()
    process.wait()


if __name__ == "__main__":
    main()
