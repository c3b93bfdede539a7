"""Writes the seeds of `weights_file` and `model_toml`.

    python make_weights_seeds.py

Checkpoints and configurations are copies of the model crate's fixtures, without their CRCs; the rest are safetensors written by hand.
"""

import re
import shutil
import struct
from pathlib import Path

HERE = Path(__file__).parent
MODEL = HERE / "../crates/model"


def safetensors(header, data):
    header = header.encode()
    return struct.pack("<Q", len(header)) + header + data


def without_crcs(file):
    """A zip file as after torch.serialization.set_crc32_options(False): a fuzzer that changes an entry cannot mend its CRC-32."""
    return re.sub(rb"(PK\x01\x02.{12}).{4}", rb"\g<1>\0\0\0\0", file, flags=re.DOTALL)


def main():
    weights, configurations = HERE / "corpus/weights_file", HERE / "corpus/model_toml"
    for folder in (weights, configurations):
        folder.mkdir(parents=True, exist_ok=True)
    for name in ("files/training.pt", "files/legacy.pt", "dinov2/tiny_2x5.safetensors"):
        source = MODEL / "tests/fixtures" / name
        (weights / source.name).write_bytes(without_crcs(source.read_bytes()))
    for path in (MODEL / "oracle/tiny.toml", MODEL / "key-maps/dinov2-hugging-face.toml",
                 HERE / "../eval/models/paper-dl3dv-hr.toml"):
        shutil.copy(path, configurations)
    (weights / "mixed.safetensors").write_bytes(safetensors(
        '{"__metadata__":{"a":"b"},"x.weight":{"dtype":"F16","shape":[2,1],"data_offsets":[0,4]},'
        '"x.bias":{"dtype":"BF16","shape":[2],"data_offsets":[4,8]},"n":{"dtype":"I64","shape":[],"data_offsets":[8,16]},'
        '"e":{"dtype":"F32","shape":[0,3],"data_offsets":[16,16]}}', bytes(range(16))))
    (weights / "length_overflow.safetensors").write_bytes(struct.pack("<Q", 2**64 - 1) + b"{}")
    (weights / "offsets_beyond_the_address_space.safetensors").write_bytes(safetensors(
        '{"a":{"dtype":"U8","shape":[18446744073709551615],"data_offsets":[0,18446744073709551615]}}', b"12345678"))


if __name__ == "__main__":
    main()
