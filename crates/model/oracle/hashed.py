"""Numbers that a seed and a name define, the same here and in `src/hash.rs` and `src/weights/generated.rs`.

Weights and images of the fixtures come from here, so that no fixture stores them.
Run as a script, it prints the vectors that the Rust tests hold.
"""

import math

import numpy as np

GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def mix(z):
    """The finaliser of SplitMix64."""
    z = np.asarray(z, np.uint64)
    with np.errstate(over="ignore"):
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return z ^ (z >> np.uint64(31))


def stream(*keys):
    """Where the sequence of these keys starts."""
    start = np.uint64(0)
    with np.errstate(over="ignore"):
        for key in keys:
            start = mix(start + np.uint64(key) + GOLDEN)
    return start


def named(seed, name):
    """The sequence of a seed and a name; FNV-1a stands for the name."""
    value = 0xCBF29CE484222325
    for byte in name.encode():
        value = ((value ^ byte) * 0x100000001B3) % 2**64
    return stream(seed, value)


def bits(start, count):
    with np.errstate(over="ignore"):
        return mix(start + GOLDEN * (np.arange(count, dtype=np.uint64) + np.uint64(1)))


def signed_unit(start, count):
    """Numbers from -1 to 1, below 1, in steps of 2**-23."""
    return (bits(start, count) >> np.uint64(40)).astype(np.float64) / 2.0**23 - 1.0


def weight(seed, name, shape):
    """A parameter: what kind it is follows from its name and shape."""
    if len(shape) == 1 and name.endswith("bias"):
        offset, scale = 0.0, 0.1
    elif len(shape) == 1:
        offset, scale = 1.0, 0.1
    elif len(shape) == 3:
        offset, scale = 0.0, 0.5
    else:
        offset, scale = 0.0, math.sqrt(3.0 / math.prod(shape[1:]))
    values = offset + scale * signed_unit(named(seed, name), math.prod(shape))
    return values.astype(np.float32).reshape(shape)


def image(seed, views, height, width):
    """Noise in 0..1 as float32, [view, row, column, channel]."""
    values = 0.5 + 0.5 * signed_unit(named(seed, "picture"), views * height * width * 3)
    return values.astype(np.float32).reshape(views, height, width, 3)


if __name__ == "__main__":
    start = named(7, "coarse.fuse.weight")
    print([hex(value) for value in bits(start, 1001)[[0, 1, 1000]]], repr(float(signed_unit(start, 1)[0])))
