"""Prints samples a second against threads and batch, and what each part of a step takes.

    cargo build --release -p atsplat-train --example time_step
    python crates/train/benches/steps.py target/release/examples/time_step EXPERIMENT [WEIGHTS]
"""

import json
import os
import statistics
import subprocess
import sys

COUNT, WARM_UP = 16, 4


def ask(threads, *lines):
    environment = dict(os.environ, RAYON_NUM_THREADS=str(threads))
    answer = subprocess.run(sys.argv[1:], input="\n".join(lines) + "\n", capture_output=True, text=True,
                            check=True, env=environment)
    return [json.loads(line) for line in answer.stdout.splitlines()]


def median(records, of):
    return statistics.median(of(record) for record in records)


def main():
    most = os.cpu_count()
    threads = sorted({1, 2, most} | {2 ** power for power in range(2, 10) if 2 ** power < most})
    print("threads  batch  samples/s  seconds a sample: sample  forward  splat  losses  backward")
    for count in threads:
        for batch in [1, 2, 4, 8]:
            records = ask(count, f"steps {batch} {COUNT + WARM_UP}")[0][WARM_UP:]
            parts = [median(records, lambda r: r["parts"][name]) / batch
                     for name in ["sample", "forward", "splat", "losses", "backward"]]
            rate = batch / median(records, lambda r: r["secs"])
            print(f"{count:7}  {batch:5}  {rate:9.2f}  {'':16}" + "".join(f"{part:9.4f}" for part in parts))
    for count in threads:
        answers = ask(count, *(["network 1"] * (COUNT + WARM_UP)), *(["splatting 1"] * (COUNT + WARM_UP)))
        network, splatting = answers[WARM_UP:COUNT + WARM_UP], answers[COUNT + 2 * WARM_UP:]
        both = [[median(part, lambda r: r[way]) for way in ["forward", "backward"]] for part in [network, splatting]]
        print(f"{count} threads: network {both[0][0]:.4f} + {both[0][1]:.4f} s, splatter {both[1][0]:.4f} + "
              f"{both[1][1]:.4f} s a sample, forward + backward")


if __name__ == "__main__":
    main()
