"""Posed cameras as arrays, with conversions of axes and intrinsics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._arguments import whole
from ._arrays import as_array, describe, invalid

#: The camera's axes in each convention, as multiples of OpenCV's: +x right, +y down, +z forward.
CONVENTIONS = {
    "opencv": (1.0, 1.0, 1.0),  # COLMAP, RE10K, pixelSplat, 3DGS
    "opengl": (1.0, -1.0, -1.0),  # nerfstudio, Blender, instant-ngp: +y up, looking along -z
    "pytorch3d": (-1.0, -1.0, 1.0),  # +x left, +y up
}

#: Entries of intrinsics that are the same for every camera: those of the identity.
FIXED = np.array([[False, True, False], [True, False, False], [True, True, True]])
#: How far they, and the last row of a pose, may be off by rounding.
ROUNDING = 1e-5
#: The same of a rotation times its transpose.
ROTATION = 1e-2
#: Normalised principal points beyond it are in pixels, and focal lengths below it in pixels are normalised.
PRINCIPAL = (-1.0, 2.0)
FOCAL_PIXELS = 2.0


@dataclass(frozen=True, eq=False)
class Cameras:
    """N posed cameras.

    Attributes:
        camera_from_world: N × 4 × 4, float64: world to camera ("extrinsics", "w2c"), OpenCV axes.
        intrinsics: N × 3 × 3, float64, in units of the image's width and height: ``fx / width``, ``cy / height``.
        height: of the images, in pixels.
        width: of the images, in pixels.
        frames: N positions of the frames in their scene.
        lenses: N pairs of a model and its coefficients: ``("pinhole", ())``, ``("opencv", (k1, k2, p1, p2, k3))``,
            ``("fisheye", (k1, k2, k3, k4))``.
    """

    camera_from_world: np.ndarray
    intrinsics: np.ndarray
    height: int
    width: int
    frames: tuple[int, ...]
    lenses: tuple[tuple[str, tuple[float, ...]], ...]

    def __post_init__(self) -> None:
        poses, matrices = (np.array(value, dtype=np.float64) for value in (self.camera_from_world, self.intrinsics))
        object.__setattr__(self, "camera_from_world", poses)
        object.__setattr__(self, "intrinsics", matrices)
        for field in ("height", "width"):
            object.__setattr__(self, field, whole(getattr(self, field), field, 1 if len(poses) else 0))
        if poses.ndim != 3 or poses.shape[1:] != (4, 4):
            raise invalid("camera_from_world", f"expected N × 4 × 4, found {describe(poses)}")
        count = len(poses)
        if matrices.shape != (count, 3, 3):
            raise invalid("intrinsics", f"expected {count} × 3 × 3, found {describe(matrices)}")
        for field, listed in (("frames", self.frames), ("lenses", self.lenses)):
            if len(listed) != count:
                raise invalid(field, f"expected {count}, one for each pose, found {len(listed)}")
        _check_poses(poses, "camera_from_world")
        _check_fixed(matrices, matrices, "intrinsics")
        _check_focal(matrices, matrices, "intrinsics")

    @classmethod
    def from_arrays(
        cls,
        *,
        height: int,
        width: int,
        world_from_camera: Any = None,
        camera_from_world: Any = None,
        intrinsics: Any = None,
        pixel_intrinsics: Any = None,
        convention: str = "opencv",
    ) -> Cameras:
        """Cameras without lens distortion.

        Args:
            world_from_camera: N × 4 × 4 (or 3 × 4), camera to world, with the last row 0 0 0 1; or
            camera_from_world: N × 4 × 4 (or 3 × 4), world to camera.
            intrinsics: N × 3 × 3 or 3 × 3, in units of the image's size, without skew; or
            pixel_intrinsics: N × 3 × 3 or 3 × 3, in pixels, with pixel centres at + 0.5.
            convention: the camera's axes: ``opencv``, ``opengl`` (nerfstudio, Blender) or ``pytorch3d``.

        Raises:
            InvalidError: naming the argument and the camera, if a matrix has another shape, is not a rotation with a translation, has
                focal lengths that are not positive, or intrinsics of the other unit.
        """
        if (world_from_camera is None) == (camera_from_world is None):
            raise invalid("cameras", "expected one of world_from_camera and camera_from_world")
        if (intrinsics is None) == (pixel_intrinsics is None):
            raise invalid("cameras", "expected one of intrinsics and pixel_intrinsics")
        flip = _flip(convention)
        height, width = whole(height, "height"), whole(width, "width")
        if camera_from_world is None:
            camera_from_world = np.linalg.inv(_poses(world_from_camera, "world_from_camera") @ flip)
        else:
            camera_from_world = flip @ _poses(camera_from_world, "camera_from_world")
        count = len(camera_from_world)
        if intrinsics is None:
            matrices = _intrinsics(pixel_intrinsics, "pixel_intrinsics", count, (width, height))
        else:
            matrices = _intrinsics(intrinsics, "intrinsics", count, (1, 1))
        return cls(camera_from_world, matrices, height, width, tuple(range(count)), (("pinhole", ()),) * count)

    @classmethod
    def _of(cls, cameras: list[Any], frames: Sequence[int]) -> Cameras:
        poses = np.tile(np.eye(4), (len(cameras), 1, 1))
        matrices = np.tile(np.eye(3), (len(cameras), 1, 1))
        for at, (pose, (fx, fy, cx, cy), *_) in enumerate(cameras):
            poses[at, :3] = np.reshape(pose, (3, 4))
            matrices[at] = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
        sizes = {(height, width) for *_, width, height in cameras} or {(0, 0)}
        if len(sizes) > 1:
            raise invalid("cameras", f"expected one image size, found {sorted(sizes)} (height, width)")
        height, width = sizes.pop()
        lenses = tuple((lens, tuple(coefficients)) for _, _, lens, coefficients, _, _ in cameras)
        return cls(poses, matrices, height, width, tuple(frames), lenses)

    def _numbers(self) -> list[Any]:
        k = self.intrinsics
        return [
            (pose[:3].ravel().tolist(), [k[0, 0], k[1, 1], k[0, 2], k[1, 2]], lens, list(coefficients), self.width, self.height)
            for pose, k, (lens, coefficients) in zip(self.camera_from_world, k, self.lenses)
        ]

    def __len__(self) -> int:
        return len(self.camera_from_world)

    def __getitem__(self, at: int | slice) -> Cameras:
        """Some of the cameras; a single position gives ``Cameras`` of one."""
        if not isinstance(at, slice):
            position = range(len(self))[at]
            at = slice(position, position + 1)
        parts = (self.camera_from_world[at], self.intrinsics[at], self.height, self.width, self.frames[at], self.lenses[at])
        return Cameras(*parts)

    def __iter__(self) -> Iterator[Cameras]:
        return (self[at] for at in range(len(self)))

    @property
    def world_from_camera(self) -> np.ndarray:
        """N × 4 × 4, float64: camera to world ("c2w"), OpenCV axes. The last column is the camera's centre."""
        return np.linalg.inv(self.camera_from_world)

    @property
    def pixel_intrinsics(self) -> np.ndarray:
        """N × 3 × 3, float64, in pixels, with the centre of the first pixel at (0.5, 0.5)."""
        matrices = self.intrinsics.copy()
        matrices[:, 0] *= self.width
        matrices[:, 1] *= self.height
        return matrices

    @property
    def centres(self) -> np.ndarray:
        """N × 3, float64: the cameras' centres in the world."""
        centres: np.ndarray = self.world_from_camera[:, :3, 3]
        return centres

    def world_from_camera_in(self, convention: str) -> np.ndarray:
        """N × 4 × 4, float64: camera to world for cameras with the axes of ``opengl`` (nerfstudio, Blender) or ``pytorch3d``.
        Only the camera's axes differ between conventions, never the world's."""
        converted: np.ndarray = self.world_from_camera @ _flip(convention)
        return converted

    def camera_from_world_in(self, convention: str) -> np.ndarray:
        """N × 4 × 4, float64: world to camera for cameras with the axes of ``convention``."""
        converted: np.ndarray = _flip(convention) @ self.camera_from_world
        return converted


def _flip(convention: str) -> np.ndarray:
    if convention not in CONVENTIONS:
        raise invalid("convention", f"expected one of {', '.join(CONVENTIONS)}, found {convention!r}")
    return np.diag([*CONVENTIONS[convention], 1.0])


def _poses(value: Any, field: str) -> np.ndarray:
    poses = np.array(as_array(value, field), dtype=np.float64)
    poses = poses[None] if poses.ndim == 2 else poses
    if poses.ndim != 3 or poses.shape[1:] not in ((3, 4), (4, 4)):
        raise invalid(field, f"expected N × 4 × 4 or N × 3 × 4, found {describe(poses)}")
    _check_poses(poses, field)
    whole = np.tile(np.eye(4), (len(poses), 1, 1))
    whole[:, :3] = poses[:, :3]
    return whole


def _intrinsics(value: Any, field: str, count: int, size: tuple[int, int]) -> np.ndarray:
    """Matrices in units of the image's size, from those for an image of ``size``: one for each camera, or one for all."""
    given = np.array(as_array(value, field), dtype=np.float64)
    if given.shape[-2:] != (3, 3) or given.ndim > 3:
        raise invalid(field, f"expected N × 3 × 3 or 3 × 3, found {describe(given)}")
    given = given.reshape(-1, 3, 3)
    if len(given) not in (1, count):
        raise invalid(field, f"expected 1 or {count} matrices, found {len(given)}")
    matrices = given / np.array([[size[0]], [size[1]], [1.0]])
    _check_fixed(matrices, given, field)
    _check_focal(matrices, given, field)
    _check_unit(matrices, given, field)
    return np.broadcast_to(matrices, (count, 3, 3)).copy()


def _check_poses(poses: np.ndarray, field: str) -> None:
    for at, pose in enumerate(poses):
        if not np.isfinite(pose).all():
            raise invalid(field, f"pose {at}: expected finite numbers")
        rotation = pose[:3, :3]
        residual, determinant = abs(rotation @ rotation.T - np.eye(3)).max(), np.linalg.det(rotation)
        if not (residual <= ROTATION and determinant > 0):
            scale = np.cbrt(abs(determinant))
            kind = f"one with a scale of {scale:.4g}" if abs(scale - 1) > ROTATION / 10 else f"a matrix that is off by {residual:.2g}"
            kind = "a mirrored one" if determinant < 0 else kind
            raise invalid(field, f"pose {at}: expected a rotation in the left 3 × 3, found {kind}")
        for row in pose[3:]:
            if (abs(row - (0, 0, 0, 1)) > ROUNDING).any():
                raise invalid(field, f"pose {at}: expected the last row 0 0 0 1, found {' '.join(f'{value:g}' for value in row)}")


def _check_fixed(matrices: np.ndarray, given: np.ndarray, field: str) -> None:
    # NaN is wrong too.
    wrong = np.argwhere(FIXED & ~(abs(matrices - np.eye(3)) <= ROUNDING))
    if len(wrong):
        at, row, column = wrong[0]
        expected, found = np.eye(3)[row, column], given[at, row, column]
        raise invalid(field, f"matrix {at}: expected {expected:g} in row {row}, column {column}, found {found:g}")


def _check_focal(matrices: np.ndarray, given: np.ndarray, field: str) -> None:
    for at, (matrix, stated) in enumerate(zip(matrices, given)):
        focal = np.diagonal(matrix)[:2]
        if not (np.isfinite(focal) & (focal > 0)).all():
            raise invalid(field, f"matrix {at}: expected positive focal lengths, found {stated[0, 0]:g} and {stated[1, 1]:g}")
        if not np.isfinite(matrix[:2, 2]).all():
            raise invalid(field, f"matrix {at}: expected a finite principal point, found {stated[0, 2]:g}, {stated[1, 2]:g}")


def _check_unit(matrices: np.ndarray, given: np.ndarray, field: str) -> None:
    """Whether normalised ``matrices`` were ``given`` in the unit of their argument."""
    least, most = PRINCIPAL
    for at, (matrix, stated) in enumerate(zip(matrices, given)):
        centre = matrix[:2, 2]
        if field == "pixel_intrinsics" and (np.diagonal(stated)[:2] < FOCAL_PIXELS).any():
            problem = f"expected focal lengths in pixels, found {stated[0, 0]:g} and {stated[1, 1]:g}"
            raise invalid(field, f"matrix {at}: {problem}: intrinsics takes those in units of the image's size")
        if not ((centre >= least) & (centre <= most)).all():
            other = "pixel_intrinsics takes those in pixels" if field == "intrinsics" else "in pixels of this height and width"
            problem = f"expected a principal point in or near the image, found {stated[0, 2]:g}, {stated[1, 2]:g}"
            raise invalid(field, f"matrix {at}: {problem}: {other}")
