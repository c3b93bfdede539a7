"""How far this crate's JPEG decoding is from Pillow's libjpeg-turbo; the figures of JPEG.md.

    cargo build --release -p atsplat-pixels --example decode_rgb
    python crates/pixels/benches/jpeg_parity.py target/release/examples/decode_rgb FOLDER_OR_CHUNK...

Every argument is a folder of .jpg files or a .torch chunk (a zip whose stored entries are JPEG). Images of
every quality, subsampling and mode are generated from the first one and checked as well.
"""

import io
import itertools
import pathlib
import subprocess
import sys
import tempfile
import zipfile

import numpy as np
import PIL
from PIL import Image, features


class Decoder:
    def __init__(self, program):
        self.process = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def __call__(self, path):
        self.process.stdin.write(f"{path}\n".encode())
        self.process.stdin.flush()
        width, height = map(int, self.process.stdout.readline().split())
        samples = np.frombuffer(self.process.stdout.read(width * height * 3), np.uint8)
        return samples.reshape(height, width, 3)


def jpegs(source):
    source = pathlib.Path(source)
    if source.is_dir():
        return [path.read_bytes() for path in sorted(source.glob("*.jpg"))]
    with zipfile.ZipFile(source) as chunk:
        entries = (chunk.read(name) for name in chunk.namelist())
        return [data for data in entries if data[:3] == b"\xff\xd8\xff"]


def generated(image):
    kinds = itertools.product((5, 30, 50, 75, 90, 95, 100), (0, 1, 2), (False, True))
    for quality, subsampling, progressive in kinds:
        file = io.BytesIO()
        image.save(file, "JPEG", quality=quality, subsampling=subsampling, progressive=progressive)
        name = f"quality {quality}, {['4:4:4', '4:2:2', '4:2:0'][subsampling]}"
        yield name + (", progressive" if progressive else ""), [file.getvalue()]


def main():
    decoder = Decoder(sys.argv[1])
    sets = [(pathlib.Path(source).name, jpegs(source)) for source in sys.argv[2:]]
    first = Image.open(io.BytesIO(sets[0][1][0])).convert("RGB")
    print(f"Pillow {PIL.__version__}, libjpeg-turbo {features.version('libjpeg_turbo')}")
    print("| files | identical | samples equal | largest difference | PSNR |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "image.jpg"
        for name, files in [*sets, *generated(first)]:
            identical, equal, count, largest, squares = 0, 0, 0, 0, 0
            for data in files:
                path.write_bytes(data)
                expected = np.asarray(Image.open(path).convert("RGB")).astype(np.int64)
                difference = np.abs(expected - decoder(path))
                identical += not difference.any()
                equal += int((difference == 0).sum())
                count += difference.size
                largest = max(largest, int(difference.max()))
                squares += int((difference**2).sum())
            psnr = 10 * np.log10(255**2 * count / squares) if squares else float("inf")
            print(f"| {name} ({len(files)}) | {identical} | {equal / count:.4f} | {largest} | {psnr:.2f} dB |")


if __name__ == "__main__":
    main()
