"""Writes the first inputs of the target scenes: a few ordinary Gaussians under each preset, mode and lens, and the
numbers at which arithmetic changes its rules in each field.

    python make_scene_seeds.py

Nothing but the standard library; the layout is that of scene_of_bytes.rs.
"""

import pathlib
import struct

CORPUS = pathlib.Path(__file__).parent / "corpus/scenes"
IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]
POISON = [float("nan"), float("inf"), float("-inf"), 1e-45, 3.4e38, 1e20, -1e6, 88.7, -103.9]


def gaussian(n, degree):
    shift = 0.1 * n
    own = [0.1 - shift, shift - 0.2, 2 + shift, 1, 0.2, -0.3, 0.1, -1.5, -2, -1, 0.5, 0.7, 0.01]
    return own + [0.2 - 0.01 * k for k in range(3 * (degree + 1) ** 2)]


def scene(preset=0, switches=0, degree=1, lens=0, size=(11, 8), coefficients=(0, 0, 0, 0, 0), poison=None, count=3):
    head = bytes([preset, switches, degree, 4, *size]) + struct.pack("<15f", *IDENTITY, 0.2, 0.3, 0.4)
    camera = bytes([lens]) + struct.pack("<15f", 0.1, -0.1, 0, 0, 0, 0.1, 0.9, 1.1, 0.5, 0.5, *coefficients)
    numbers = [value for n in range(count) for value in gaussian(n, degree % 5)]
    if poison:
        numbers[poison[0]] = poison[1]
    return head + camera + struct.pack(f"<{len(numbers)}f", *numbers)


def main():
    CORPUS.mkdir(parents=True, exist_ok=True)
    seeds = {f"preset-{preset}-switches-{switches}": scene(preset, switches, degree=1 + 8 + 16)
             for preset in range(5) for switches in (0, 0x1F, 0x7F)}
    seeds |= {f"degree-{degree}": scene(degree=degree, switches=0x1F) for degree in range(5)}
    seeds |= {f"lens-{lens}": scene(lens=lens, coefficients=(-0.2, 0.05, 0.01, 0.002, -0.003)) for lens in (1, 2)}
    seeds |= {f"poison-{slot}-{n}": scene(degree=25, switches=0x1F, poison=(slot, value))
              for slot in range(16) for n, value in enumerate(POISON) if (slot + n) % 3 == 0}
    seeds |= {"nothing": b"", "no-gaussians": scene(count=0), "one-pixel": scene(size=(0, 0)), "many": scene(count=40)}
    for name, data in seeds.items():
        (CORPUS / name).write_bytes(data)


main()
