"""Axes and intrinsics, each with a case that fails if a sign, an order or a direction is swapped."""

from dataclasses import replace

import numpy as np
import pytest

import atsplat
from atsplat import Cameras

#: Looks along world +x from (1, 2, 3), with its image's up along world +z.
FORWARD, UP, CENTRE = np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), np.array([1.0, 2, 3])
RIGHT = np.cross(FORWARD, UP)
INTRINSICS = np.array([[96.0, 0, 70], [0, 90, 40], [0, 0, 1]])


def pose(x, y, z):
    matrix = np.eye(4)
    matrix[:3] = np.stack([x, y, z, CENTRE], axis=-1)
    return matrix


AXES = {
    "opencv": pose(RIGHT, -UP, FORWARD),
    "opengl": pose(RIGHT, UP, -FORWARD),
    "pytorch3d": pose(-RIGHT, UP, FORWARD),
}


@pytest.mark.parametrize("convention", AXES)
def test_conventions_describe_one_camera(convention):
    cameras = Cameras.from_arrays(
        world_from_camera=AXES[convention][None], pixel_intrinsics=INTRINSICS, height=80, width=128, convention=convention
    )
    assert np.allclose(cameras.world_from_camera[0], AXES["opencv"])
    assert np.allclose(cameras.camera_from_world[0] @ AXES["opencv"], np.eye(4))
    for other, expected in AXES.items():
        assert np.allclose(cameras.world_from_camera_in(other)[0], expected), other
        assert np.allclose(cameras.camera_from_world_in(other)[0], np.linalg.inv(expected)), other
    again = Cameras.from_arrays(
        camera_from_world=np.linalg.inv(AXES[convention]), pixel_intrinsics=INTRINSICS, height=80, width=128, convention=convention
    )
    assert np.allclose(again.world_from_camera, cameras.world_from_camera)
    assert np.allclose(cameras.centres, [CENTRE])


def test_intrinsics_are_in_units_of_the_image():
    cameras = Cameras.from_arrays(world_from_camera=np.eye(4), pixel_intrinsics=INTRINSICS, height=80, width=128)
    assert np.allclose(cameras.intrinsics[0], [[0.75, 0, 70 / 128], [0, 1.125, 0.5], [0, 0, 1]])
    assert np.allclose(cameras.pixel_intrinsics[0], INTRINSICS)


def test_a_gaussian_is_drawn_where_the_camera_projects_it():
    cameras = Cameras.from_arrays(
        world_from_camera=AXES["opengl"][None], pixel_intrinsics=INTRINSICS, height=80, width=128, convention="opengl"
    )
    # Right of and above the axis: 4 units ahead, 1 right, 0.5 up.
    mean = CENTRE + 4 * FORWARD + 1 * RIGHT + 0.5 * UP
    gaussian = atsplat.Gaussians([mean], [[1, 0, 0, 0]], scales=[[0.02] * 3], opacities=[0.95], colours=[[1, 0.5, 0]])
    rendered = atsplat.render(gaussian, cameras, background=(0, 0, 0.25), depth=True)
    assert rendered.images.shape == (1, 80, 128, 3) and rendered.alpha.shape == (1, 80, 128)
    row, column = np.unravel_index(rendered.alpha[0].argmax(), (80, 128))
    assert (column, row) == (int(70 + 96 / 4), int(40 - 90 * 0.5 / 4))
    assert abs(rendered.depth[0, row, column] - 4) < 1e-3
    red, green, blue = rendered.images[0, row, column]
    assert red > 2 * blue and red > green > 0.3
    assert np.allclose(rendered.images[0, 0, 0], [0, 0, 0.25])


def test_wrong_cameras_say_what_is_wrong():
    with pytest.raises(atsplat.InvalidError, match="opengl"):
        Cameras.from_arrays(world_from_camera=np.eye(4), intrinsics=np.eye(3), height=8, width=8, convention="blender")
    with pytest.raises(atsplat.InvalidError, match="3 × 4"):
        Cameras.from_arrays(world_from_camera=np.eye(3), intrinsics=np.eye(3), height=8, width=8)


@pytest.mark.parametrize("change, problem", [
    (lambda pose: pose * [-1.0, 1, 1, 1], "mirrored"),
    (lambda pose: np.diag([1.1, 1.1, 1.1, 1]), "a scale of 1.1"),
    (lambda pose: pose * [0.0, 0, 0, 1], "rotation"),
    (lambda pose: pose * np.nan, "finite"),
])
def test_poses_that_are_no_rotations_are_rejected_with_their_number(change, problem):
    poses = np.stack([np.eye(4)[:3], change(np.eye(4))[:3]])
    for field in ("world_from_camera", "camera_from_world"):
        with pytest.raises(atsplat.InvalidError, match=f"pose 1: .*{problem}") as raised:
            Cameras.from_arrays(**{field: poses}, intrinsics=np.eye(3), height=8, width=8)
        assert raised.value.field == field
    good = Cameras.from_arrays(world_from_camera=np.stack([np.eye(4)] * 2), intrinsics=np.eye(3), height=8, width=8)
    whole = np.tile(np.eye(4), (2, 1, 1))
    whole[:, :3] = poses
    with pytest.raises(atsplat.InvalidError, match="pose 1"):
        replace(good, camera_from_world=whole)


@pytest.mark.parametrize("field, matrix, problem", [
    ("intrinsics", [[-1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]], "positive focal lengths, found -1 and 1"),
    ("intrinsics", [[1, 0, 0.5], [0, 0, 0.5], [0, 0, 1]], "positive focal lengths, found 1 and 0"),
    ("intrinsics", [[1, 0, 0.5], [0, np.nan, 0.5], [0, 0, 1]], "positive focal lengths"),
    ("intrinsics", INTRINSICS, "pixel_intrinsics takes those in pixels"),
    ("pixel_intrinsics", [[0.9, 0, 0.5], [0, 0.9, 0.5], [0, 0, 1]], "intrinsics takes those in units"),
    ("pixel_intrinsics", INTRINSICS * [[1, 1, 10], [1, 1, 1], [1, 1, 1]], "this height and width"),
])
def test_intrinsics_of_another_unit_are_rejected(field, matrix, problem):
    good = INTRINSICS if field == "pixel_intrinsics" else np.eye(3)
    with pytest.raises(atsplat.InvalidError, match=f"matrix 1: .*{problem}") as raised:
        Cameras.from_arrays(world_from_camera=np.stack([np.eye(4)] * 2), height=80, width=128, **{field: np.stack([good, matrix])})
    assert raised.value.field == field


@pytest.mark.parametrize("height", [0, -64, 64.0, "64", True, None])
def test_sizes_are_positive_integers(height):
    with pytest.raises(atsplat.InvalidError, match="integer from 1") as raised:
        Cameras.from_arrays(world_from_camera=np.eye(4), intrinsics=np.eye(3), height=height, width=8)
    assert raised.value.field == "height"
    cameras = Cameras.from_arrays(world_from_camera=np.eye(4), intrinsics=np.eye(3), height=np.int64(8), width=8)
    gaussian = atsplat.Gaussians([[0, 0, 1]], [[1, 0, 0, 0]], scales=[[0.1] * 3], opacities=[0.5], colours=[[1, 1, 1]])
    if height is not None:
        with pytest.raises(atsplat.InvalidError) as raised:
            atsplat.render(gaussian, cameras, height=height)
        assert raised.value.field == "height"


def test_what_pinhole_cameras_cannot_have_is_rejected():
    def problem(pose=np.eye(4), field="pixel_intrinsics", matrix=INTRINSICS):
        poses, matrices = np.stack([np.eye(4), pose]), np.stack([INTRINSICS, matrix])
        with pytest.raises(atsplat.InvalidError) as raised:
            Cameras.from_arrays(camera_from_world=poses, height=80, width=128, **{field: matrices})
        return raised.value.field, str(raised.value)

    scaled = np.eye(4)
    scaled[3, 3] = 2
    field, text = problem(pose=scaled)
    assert field == "camera_from_world" and "pose 1: expected the last row 0 0 0 1, found 0 0 0 2" in text
    translated = np.eye(4)
    translated[3, :3] = 1, 2, 3
    assert "found 1 2 3 1" in problem(pose=translated)[1], "a transposed pose"
    for row, column in [(0, 1), (1, 0), (2, 0), (2, 1), (2, 2)]:
        matrix = INTRINSICS.copy()
        matrix[row, column] += 0.5
        field, text = problem(matrix=matrix)
        assert field == "pixel_intrinsics" and f"matrix 1: expected {int(row == 2 == column)} in row {row}, column {column}" in text
    assert problem(field="intrinsics", matrix=np.full((3, 3), np.nan))[0] == "intrinsics"
    # Rounding is allowed for.
    almost = INTRINSICS + 1e-6
    assert len(Cameras.from_arrays(world_from_camera=np.eye(4) + 1e-7, pixel_intrinsics=almost, height=80, width=128)) == 1


def moved(x, y, z):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


@pytest.mark.parametrize("change, field, problem", [
    ({"camera_from_world": np.eye(4)}, "camera_from_world", "expected N × 4 × 4, found 4 × 4"),
    ({"camera_from_world": np.zeros((3, 3, 4))}, "camera_from_world", "expected N × 4 × 4, found 3 × 3 × 4"),
    ({"camera_from_world": np.zeros((2, 4, 4))}, "intrinsics", "expected 2 × 3 × 3, found 3 × 3 × 3"),
    ({"intrinsics": np.eye(3)}, "intrinsics", "expected 3 × 3 × 3, found 3 × 3"),
    ({"frames": (0, 1)}, "frames", "expected 3, one for each pose, found 2"),
    ({"lenses": (("pinhole", ()),) * 4}, "lenses", "expected 3, one for each pose, found 4"),
    ({"camera_from_world": np.stack([moved(1, 2, 3).T] * 3)}, "camera_from_world", "expected the last row 0 0 0 1, found 1 2 3 1"),
    ({"intrinsics": np.stack([np.eye(3) + [[0, 0.2, 0], [0, 0, 0], [0, 0, 0]]] * 3)}, "intrinsics", "expected 0 in row 0, column 1"),
])
def test_arrays_that_are_no_cameras_are_rejected(change, field, problem):
    cameras = Cameras.from_arrays(world_from_camera=np.stack([np.eye(4)] * 3), intrinsics=np.eye(3), height=8, width=8)
    with pytest.raises(ValueError, match=problem) as raised:
        replace(cameras, **change)
    assert raised.value.field == field
    assert len(cameras[3:]) == 0, "none is a number too"


def test_parts_of_cameras():
    poses = np.stack([np.eye(4)] * 3)
    poses[:, 0, 3] = [5, 6, 7]
    cameras = Cameras.from_arrays(world_from_camera=poses, intrinsics=np.eye(3), height=8, width=8)
    assert len(cameras) == 3 and cameras[-1].centres[0, 0] == 7 and cameras[1:].frames == (1, 2)
    assert [camera.centres[0, 0] for camera in cameras] == [5, 6, 7]
