"""Makes tests/fixtures/statistics.json with numpy and scipy: quantiles, expanded percentile intervals, sign tests.

The resamples are those of src/statistics/bootstrap.rs: SplitMix64 seeds one stream for each, and Lemire's method draws
from it. Everything after the draws is numpy's and scipy's.
"""

import json
from pathlib import Path

import numpy as np
from scipy import stats

MASK = (1 << 64) - 1
SEED = 0x6174_7370_6C61_7421


class SplitMix64:
    def __init__(self, seed: int):
        self.state = seed

    def next(self) -> int:
        self.state = (self.state + 0x9E3779B97F4A7C15) & MASK
        z = self.state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
        return z ^ (z >> 31)

    def below(self, bound: int) -> int:
        while True:
            product = self.next() * bound
            if product & MASK >= (1 << 64) % bound:
                return product >> 64


def interval(clusters: list[list[float]], resamples: int) -> list[float]:
    n = len(clusters)
    seeds = SplitMix64(SEED)
    streams = [SplitMix64(seeds.next()) for _ in range(resamples)]
    drawn = np.array([[stream.below(n) for _ in range(n)] for stream in streams])
    sums, weights = np.array(clusters).T
    means = sums[drawn].sum(axis=1) / weights[drawn].sum(axis=1)
    tail = stats.norm.sf(np.sqrt(n / (n - 1)) * stats.t.ppf(0.975, n - 1))
    return np.quantile(means, [tail, 1 - tail]).tolist()


def main() -> None:
    random = np.random.default_rng(20)
    intervals = []
    for n, resamples in [(2, 2000), (3, 2000), (7, 2000), (40, 2000), (140, 2000)]:
        clusters = [[float(v), 1.0] for v in random.normal(25, 4, n).round(6)]
        intervals.append({"clusters": clusters, "resamples": resamples, "interval": interval(clusters, resamples)})
    weights = random.integers(1, 101, 25)
    clusters = [[float(v * w), float(w)] for v, w in zip(random.gamma(2, 0.1, 25).round(6), weights)]
    intervals.append({"clusters": clusters, "resamples": 2000, "interval": interval(clusters, 2000)})
    signs = [
        [w, l, float(stats.binomtest(w, w + l).pvalue)]
        for w, l in [(0, 1), (1, 1), (5, 0), (0, 20), (7, 3), (60, 80), (80, 60), (3237, 3237), (3100, 3374), (3000, 3474)]
    ]
    quantiles = [[d, p, float(stats.t.ppf(p, d))] for d in [1, 2, 3, 4, 9, 10, 139, 6473] for p in (0.6, 0.975, 0.995)]
    tails = [[x, float(stats.norm.sf(x))] for x in (1.0, 1.5, 1.96, 2.5, 4.0, 9.0, 17.97)]
    here = Path(__file__).resolve().parents[1] / "tests/fixtures/statistics.json"
    parts = {"intervals": intervals, "sign-tests": signs, "student-quantiles": quantiles, "normal-tails": tails}
    here.write_text(json.dumps(parts, separators=(",", ":")).replace("],", "],\n") + "\n")


if __name__ == "__main__":
    main()
