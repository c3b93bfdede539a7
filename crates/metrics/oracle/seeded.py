"""Numbers that Python and Rust both make from a seed (`src/learned/tests.rs`): SplitMix64's finaliser of a place."""

from pathlib import Path

import numpy as np

IMAGES = Path(__file__).resolve().parents[2] / "pixels/tests/fixtures/images"


def uniform(seed: int, count: int, bound: float) -> np.ndarray:
    """Uniform f32 numbers in (−bound, bound)."""
    with np.errstate(over="ignore"):
        z = (np.uint64(seed) + np.arange(1, count + 1, dtype=np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        unit = ((z ^ (z >> np.uint64(31))) >> np.uint64(11)).astype(np.float64) / 2.0**53
    return ((2.0 * unit - 1.0) * bound).astype(np.float32)


def render(image: np.ndarray, seed: int) -> np.ndarray:
    """A stand-in for a render, of 8-bit samples: shrunk steps, shifted by a pixel, with noise that leaves [0, 1]."""
    truth = image.astype(np.float32) / np.float32(255)
    shifted = np.roll(truth, 1, axis=1)
    noise = uniform(seed, truth.size, 0.08).reshape(truth.shape)
    return (np.float32(0.75) * truth + np.float32(0.3) * shifted + noise).astype(np.float32)
