"""Writes the first inputs of the target splat_files: the splat crate's fixtures, SPZ without gzip (whose checksum no
mutation survives), and headers that lie.

    python make_splat_seeds.py

Nothing but the standard library.
"""

import gzip
import pathlib
import struct

FUZZ = pathlib.Path(__file__).parent
FIXTURES = FUZZ.parent / "crates/splat/tests/fixtures/files"
CORPUS = FUZZ / "corpus/splat_files"
PROPERTIES = "x y z rot_0 rot_1 rot_2 rot_3 scale_0 scale_1 scale_2 opacity f_dc_0 f_dc_1 f_dc_2".split()


def ply(encoding, count, rows, properties=PROPERTIES, before=""):
    lines = ["ply", f"format {encoding} 1.0", *before.split("\n"), f"element vertex {count}"]
    lines += [f"property float {name}" for name in properties] + ["end_header\n"]
    return "\n".join(line for line in lines if line).encode() + rows


def main():
    CORPUS.mkdir(parents=True, exist_ok=True)
    for path in FIXTURES.iterdir():
        data = path.read_bytes()
        if data[:2] == b"\x1f\x8b":
            (CORPUS / f"raw-{path.name}").write_bytes(gzip.decompress(data))
        if len(data) < 2000:
            (CORPUS / path.name).write_bytes(data)
    row = b"0 1 2 1 0 0 0 -1 -2 -3 inf 0.5 nan 1e-3\n"
    lists = "element face 2\nproperty list uchar int vertices"
    spz = lambda version, count, degree, streams: struct.pack(
        "<4sIIBBBBI12x", b"NGSP", version, count, degree, 12, 0, streams, 32
    )
    seeds = {
        "nan-and-infinity.ply": ply("ascii", 1, row),
        "crlf.ply": ply("ascii", 1, row).replace(b"\n", b"\r\n"),
        "lists-before.ply": ply("binary_little_endian", 1, b"\x01" + bytes(4) + b"\x00" + bytes(56), before=lists),
        "list-too-long.ply": ply("binary_big_endian", 1, b"\xff" + bytes(70), before=lists),
        "huge-count.ply": ply("binary_little_endian", 2**63 - 1, bytes(56)),
        "huge-void.ply": ply("binary_little_endian", 0, b"", before=f"element void {2**63 - 1}"),
        "no-opacity.ply": ply("ascii", 1, row, [name for name in PROPERTIES if name != "opacity"]),
        "one-rest.ply": ply("ascii", 1, row, [*PROPERTIES, "f_rest_0"]),
        "huge-count-v2.spz": spz(2, 2**32 - 1, 4, 0),
        "huge-count-v4.spz": spz(4, 2**32 - 1, 4, 6),
        "huge-window-v4.spz": spz(4, 1, 0, 5)
        + struct.pack("<QQ", 9, 9) * 5
        + bytes.fromhex("28b52ffd00ff010000") * 5,
        "none-v4.spz": spz(4, 0, 0, 0),
        "row-and-a-half.splat": bytes(48),
    }
    for name, data in seeds.items():
        (CORPUS / name).write_bytes(data)


if __name__ == "__main__":
    main()
