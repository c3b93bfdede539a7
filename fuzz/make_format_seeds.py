"""Writes the first inputs of the targets camera_file, colmap_binary, colmap_text, npy_images, re10k_trajectory and transforms_json.

    python make_format_seeds.py

Nothing but the standard library; the COLMAP seeds are the scene crate's fixtures with the byte in front that
picks the file.
"""

import json
import pathlib
import struct

FUZZ = pathlib.Path(__file__).parent
COLMAP = FUZZ.parent / "crates/scene/tests/fixtures/colmap"
ROW = "45979267 0.482334223 0.857483078 0.5 0.5 0 0 1 0 0 -0.024142186 0 1 0 0.009485263 0 0 1 -0.347580578"
POSE = [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]


def save(target, name, data):
    folder = FUZZ / "corpus" / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())


def with_column(column, text):
    columns = ROW.split(" ")
    columns[column] = text
    return " ".join(columns)


def main():
    url = "https://www.youtube.com/watch?v=QShWPZxTDoE"
    trajectories = {
        "two-rows": f"{url}\n{ROW}\n{ROW}\n",
        "comment-crlf": f"# recovered\r\n{ROW}\r\n",
        "byte-order-mark": f"\ufeff{url}\n{ROW}\t \n\n",
        "no-header": ROW,
        "exponents": with_column(10, "-2.4e-2"),
        "long-mantissa": with_column(10, "0.12345678901234567890123"),
        "nan": with_column(3, "nan"),
        "infinite": with_column(10, "1e999"),
        "zero-focal": with_column(1, "0"),
        "reflection": with_column(7, "-1"),
        "short-row": f"{url}\n{ROW[:60]}",
        "late-time": with_column(0, str(2**63)),
        "empty": "",
        "not-utf8": b"\xff\xfe4\x005\x00",
    }
    for name, text in trajectories.items():
        save("re10k_trajectory", name, text)

    frame = {"file_path": "images/frame_00001.png", "transform_matrix": POSE}
    lens = {"w": 1920, "h": 1080.0, "fl_x": 1658.4, "fl_y": 1660.6, "cx": 958.1, "cy": 541.0}
    documents = {
        "nerfstudio": lens | {"camera_model": "OPENCV", "k1": 0.1, "p1": 0, "frames": [frame]},
        "per-frame": {"frames": [frame | lens, frame | lens | {"k1": 0.2}]},
        "blender": {"camera_angle_x": 0.69, "frames": [frame | {"file_path": "./train/r_0"}]},
        "two-angles": {"w": 640, "h": 360, "camera_angle_x": 1.2, "x_fov": 52.0, "frames": [frame]},
        "other-angle": lens | {"camera_angle_x": 1.9, "frames": [frame]},
        "half-size-frame": lens | {"frames": [frame | {"w": 960, "h": 540}]},
        "instant-ngp": lens | {"x_fov": 50.0, "is_fisheye": True, "k4": 1, "aabb_scale": 4, "frames": [frame]},
        "applied": {"applied_transform": POSE[:3], "applied_scale": 0.5, "frames": [frame]},
        "escaping": lens | {"frames": [frame | {"file_path": "../../etc/passwd"}]},
        "short-matrix": {"frames": [frame | {"transform_matrix": [[1, 0], [0, 1]]}]},
        "unknown-model": {"camera_model": "EQUIRECTANGULAR", "frames": [frame]},
        "no-frames": {"frames": []},
    }
    for name, document in documents.items():
        save("transforms_json", name, json.dumps(document))
    save("transforms_json", "deep", "[" * 1000)
    save("transforms_json", "nan", '{"frames": [{"file_path": "a", "transform_matrix": [[NaN]]}]}')

    for selector, stem in enumerate(["cameras", "images", "points3D"]):
        for encoding, extension in [("text", "txt"), ("binary", "bin")]:
            data = (COLMAP / encoding / f"{stem}.{extension}").read_bytes()
            save(f"colmap_{encoding}", stem, bytes([selector]) + data)
        save("colmap_binary", f"{stem}-huge-count", bytes([selector]) + struct.pack("<Q", 2**64 - 1))
    point = struct.pack("<QQ3d3BdQ", 1, 1, 0, 0, 0, 1, 2, 3, 0.0, 2**61)
    save("colmap_binary", "points3D-huge-track", b"\x02" + point)
    save("colmap_text", "name-with-blanks", b"\x011 1 0 0 0 0 0 0 1 a b.png\r\n\r\n")
    save("colmap_text", "short-camera", b"\x001 OPENCV 640 480 1 2 3\n")

    turned = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    trained = {"id": 0, "img_name": "a", "width": 40, "height": 30, "position": [1, 2, 3], "rotation": turned, "fx": 32.5, "fy": 32}
    row = [1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7]
    intrinsics = {"fx": 0.8, "fy": 1.1, "cx": 0.5, "cy": 0.5}
    view = {"number": 3, "name": "a", "width": 40, "height": 30, "camera-from-world": row, "intrinsics": intrinsics}
    cameras = {
        "trained": [trained, trained | {"exposure": POSE[:3]}],
        "trained-huge-width": [trained | {"width": 2**40}],
        "trained-mirrored": [trained | {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}],
        "rendered": {"views": [view, view | {"distortion": {"fisheye": {"k": [0.1, 0, 0, 0]}}}]},
        "rendered-no-view": {"views": []},
        "rendered-side-of-zero": {"views": [view | {"width": 0}]},
        "poses-of-rows": [row, row],
        "poses-of-matrices": [POSE, POSE],
        "poses-short": [row, row[:11]],
        "openmvg": {"sfm_data_version": "0.3", "views": []},
        "none": [],
    }
    for name, document in cameras.items():
        save("camera_file", name, json.dumps(document))
    save("camera_file", "deep", "[" * 1000)
    save("camera_file", "trajectory", f"{url}\n{ROW}\n{ROW}\n")

    def npy(descr, data, shape="(2, 1, 3, 3)", order="False", version=b"\x01\x00", length=None):
        header = f"{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n".encode()
        size = struct.pack("<H" if version[0] == 1 else "<I", len(header) if length is None else length)
        return b"\x93NUMPY" + version + size + header + data

    numbers = [at / 16 for at in range(18)]
    arrays = {
        "bytes": npy("|u1", bytes(range(18))),
        "floats": npy("<f4", struct.pack("<18f", *numbers)),
        "doubles": npy("<f8", struct.pack("<18d", *numbers)),
        "version-2": npy("|u1", bytes(18), version=b"\x02\x00"),
        "not-finite": npy("<f4", struct.pack("<18f", *[float("nan"), float("inf")] * 9)),
        "fortran-order": npy("|u1", bytes(18), order="True"),
        "big-endian": npy(">f4", bytes(72)),
        "other-shape": npy("|u1", bytes(18), shape="(2, 3, 1, 3)"),
        "huge-shape": npy("|u1", b"", shape="(99999999999999999999, 1, 3, 3)"),
        "open-shape": npy("|u1", bytes(18), shape="(2, 1, 3"),
        "short": npy("<f4", bytes(71)),
        "header-beyond-the-end": npy("|u1", b"", length=65535),
        "version-9": npy("|u1", bytes(18), version=b"\x09\x00"),
        "render": npy("<f2", struct.pack("<24e", *[at / 32 for at in range(24)]), shape="(2, 4, 3)"),
        "render-channels-first": npy("|u1", bytes(range(24)), shape="(1, 3, 2, 4)"),
        "render-fortran": npy(">f8", struct.pack(">24d", *[at / 32 for at in range(24)]), shape="(3, 2, 4)", order="True"),
        "render-of-either-order": npy("|u1", bytes(36), shape="(3, 4, 3)"),
    }
    for name, data in arrays.items():
        save("npy_images", name, data)


main()
