"""Arrays of other libraries, metrics and files of Gaussians."""

import copy
import pickle
import warnings

import numpy as np
import pytest

import atsplat


class OnlyArray:
    def __init__(self, array):
        self.array = array

    def __array__(self, dtype=None, copy=None):
        return self.array


class OnlyDlpack:
    def __init__(self, array):
        self.array = array

    def __dlpack__(self, **options):
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


def pair():
    rng = np.random.default_rng(3)
    truth = rng.uniform(size=(2, 24, 32, 3)).astype(np.float32)
    return (truth + rng.normal(scale=[[[[0.02]]], [[[0.2]]]], size=truth.shape)).astype(np.float32), truth


def test_psnr_is_its_definition():
    render, truth = pair()
    clipped = np.clip(render.astype(np.float64), 0, 1)
    expected = -10 * np.log10(((clipped - truth) ** 2).mean(axis=(1, 2, 3)))
    found = atsplat.psnr(render, truth)
    assert np.allclose(found, expected, rtol=1e-6) and found[0] > found[1] + 10
    unclipped = -10 * np.log10(((render.astype(np.float64) - truth) ** 2).mean(axis=(1, 2, 3)))
    assert np.allclose(atsplat.psnr(render, truth, convention="unclipped"), unclipped, rtol=1e-6)
    assert atsplat.psnr(render[1], truth[1]) == found[1] and atsplat.psnr(truth[0], truth[0]) == np.inf


@pytest.mark.parametrize("metric", [atsplat.psnr, atsplat.ssim, atsplat.lpips])
def test_every_convention_is_documented(metric):
    name = metric.__name__
    conventions = [known["id"].removeprefix(f"{name}-") for known in atsplat.metrics() if known["id"].startswith(f"{name}-")]
    assert len(conventions) >= 3
    assert [convention for convention in conventions if f"``{convention}``" not in metric.__doc__] == []


def test_ssim_has_conventions_and_lpips_says_what_it_needs(tmp_path, monkeypatch):
    render, truth = pair()
    found = {convention: atsplat.ssim(render, truth, convention=convention) for convention in ("pixelsplat", "inria", "uniform-7x7")}
    assert all(scores[0] > scores[1] for scores in found.values())
    assert len({tuple(scores) for scores in found.values()}) == 3
    for convention, scores in found.items():
        assert np.array_equal(atsplat.ssim(render, truth, convention=convention.upper()), scores)
    with pytest.raises(atsplat.InvalidError, match="pixelsplat, clipped"):
        atsplat.ssim(render, truth, convention="gsplat")
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    with pytest.raises(atsplat.InvalidError, match="vgg16-397923af.pth"):
        atsplat.lpips(render, truth, weights=tmp_path)


def test_wrong_images_are_errors():
    render, truth = pair()
    for wrong, reason in [(render[:, :, :-1], "32 × 3 as|found"), (np.full_like(render, np.nan), "finite")]:
        with pytest.raises(atsplat.InvalidError, match=reason):
            atsplat.psnr(wrong, truth)


@pytest.mark.parametrize("score", [atsplat.psnr, atsplat.ssim])
def test_images_in_another_range_are_errors(score):
    render, truth = pair()
    for images, field in [((255 * render, truth), "render"), ((render, 2 * truth - 1), "truth")]:
        with pytest.raises(atsplat.InvalidError, match="expected samples in") as raised:
            score(*images)
        assert raised.value.field == field
    assert score((255 * truth).astype(np.uint8), truth)[1] > score(render, truth)[1]


def test_what_is_wrong_with_one_of_several_images_is_told_with_its_number():
    render, truth = pair()
    render[1, 2, 3, 0] = np.nan
    with pytest.raises(atsplat.InvalidError, match="psnr: image 1 of 2: .*expected finite samples"):
        atsplat.psnr(render, truth)
    render[1] = 200
    with pytest.raises(atsplat.InvalidError, match=r"render: image 1 of 2: expected samples in \[0, 1\]") as raised:
        atsplat.psnr(render, truth)
    assert raised.value.field == "render"


@pytest.mark.parametrize("images, problem", [
    (np.ones((8, 8, 3), np.uint8), "multiply them by 255"),
    (np.zeros((0, 8, 8, 3)), "at least one image"),
    ([np.ones((8, 8, 3)), np.full((8, 8, 3), 255, np.uint8)], "float64 and uint8"),
    (np.ma.masked_greater(np.linspace(0, 1, 192).reshape(8, 8, 3), 0.5), "masked"),
    (None, "found NoneType"),
])
def test_arrays_that_would_be_taken_for_others_are_errors(images, problem):
    with pytest.raises(atsplat.InvalidError, match=problem) as raised:
        atsplat.psnr(images, images)
    assert raised.value.field == "render"
    with pytest.raises(atsplat.InvalidError, match="existing folder") as raised:
        atsplat.lpips(np.zeros((64, 64, 3)), np.zeros((64, 64, 3)), weights="/nope")
    assert raised.value.field == "weights"


def test_rendering_stops_on_ctrl_c():
    script = """if True:
        import signal, threading, time
        import numpy as np
        import atsplat
        signal.signal(signal.SIGINT, signal.default_int_handler)
        rng, count = np.random.default_rng(0), 20000
        means, quaternions = rng.normal(size=(count, 3)) + [0, 0, 4], np.tile([1, 0, 0, 0], (count, 1))
        shape = {"scales": np.full((count, 3), 0.1), "opacities": np.full(count, 0.1), "colours": np.ones((count, 3))}
        made, matrix = atsplat.Gaussians(means, quaternions, **shape), [[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]]
        many = np.tile(np.eye(4), (2000, 1, 1))
        cameras = atsplat.Cameras.from_arrays(camera_from_world=many, intrinsics=matrix, height=64, width=64)
        threading.Timer(1, lambda: signal.raise_signal(signal.SIGINT)).start()
        try:
            atsplat.render(made, cameras)
        except KeyboardInterrupt:
            print("stopped")
    """
    import subprocess
    import sys

    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=100).stdout == "stopped\n"


def test_wrong_arguments_of_rendering_are_named():
    cameras = atsplat.Cameras.from_arrays(camera_from_world=np.eye(4), intrinsics=[[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]], height=8, width=8)
    for arguments, options, field in [
        (((1, 2), cameras), {}, "gaussians"),
        ((gaussians(), [cameras]), {}, "cameras"),
        ((gaussians(), cameras), {"width": 0}, "width"),
        ((gaussians(), cameras), {"background": (0, 0)}, "background"),
    ]:
        with pytest.raises(atsplat.InvalidError) as raised:
            atsplat.render(*arguments, **options)
        assert raised.value.field == field
    for background, hint in [((255, 128, 0), ": divide by 255"), ((-1, 0, 0), ""), ((0, float("nan"), 0), ""), ((0, 256, 0), "")]:
        with pytest.raises(atsplat.InvalidError, match=r"background: expected red, green and blue in \[0, 1\]") as raised:
            atsplat.render(gaussians(), cameras, background=background)
        assert raised.value.field == "background" and str(raised.value).endswith(f"found {background!r}{hint}")
    for width in (3, None):
        assert atsplat.render(gaussians(), cameras, width=width).images.shape == (1, 8, width or 8, 3)


@pytest.mark.parametrize("wrap", [
    OnlyArray,
    OnlyDlpack,
    lambda array: np.asfortranarray(array),
    lambda array: array.astype(np.float64),
    lambda array: list(array),
    lambda array: array[:, ::-1][:, ::-1],
])
def test_any_array_is_read_alike(wrap):
    render, truth = pair()
    assert np.array_equal(atsplat.psnr(wrap(render), wrap(truth)), atsplat.psnr(render, truth))


def test_tensors_are_read_and_torch_is_not_imported_without_need():
    import subprocess
    import sys

    code = "import sys, atsplat, numpy as np; atsplat.psnr(np.zeros((8, 8, 3)), np.ones((8, 8, 3))); assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
    torch = pytest.importorskip("torch")
    render, truth = pair()
    expected = atsplat.psnr(render, truth)
    tensor = torch.from_numpy(render).requires_grad_()
    assert np.array_equal(atsplat.psnr(tensor, torch.from_numpy(truth)), expected)
    channels_first = torch.from_numpy(render).permute(0, 3, 1, 2).contiguous()
    assert np.array_equal(atsplat.psnr(channels_first.permute(0, 2, 3, 1), truth), expected)
    with pytest.raises(atsplat.InvalidError, match="permute"):
        atsplat.psnr(channels_first, channels_first)
    half = torch.from_numpy(truth).bfloat16()
    assert atsplat.psnr(half, truth)[0] > 40


def gaussians(count=5, degree=2):
    rng = np.random.default_rng(5)
    return atsplat.Gaussians(
        rng.normal(size=(count, 3)),
        rng.normal(size=(count, 4)),
        log_scales=rng.normal(size=(count, 3)) - 3,
        opacity_logits=rng.normal(size=count),
        sh=rng.normal(size=(count, (degree + 1) ** 2, 3)),
    )


def same(a, b):
    names = ("means", "quaternions", "log_scales", "opacity_logits", "sh", "scalars", "filter_3d")
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names)


def test_gaussians_survive_files_and_pickling(tmp_path):
    made = gaussians()
    made.write(tmp_path / "scene.ply")
    read = atsplat.Gaussians.read(tmp_path / "scene.ply")
    assert len(read) == 5 and read.sh_degree == 2 and same(read, made)
    assert same(pickle.loads(pickle.dumps(made)), made)
    with pytest.raises(atsplat.InvalidError, match=".spz"):
        made.write(tmp_path / "scene.obj")
    with pytest.raises(atsplat.FileError) as raised:
        atsplat.Gaussians.read(tmp_path / "none.ply")
    assert raised.value.errno == 2 and raised.value.file == str(tmp_path / "none.ply")
    (tmp_path / "bad.ply").write_bytes(b"ply\nformat binary_little_endian 1.0\nelement vertex 3\n")
    with pytest.raises(atsplat.InvalidError) as raised:
        atsplat.Gaussians.read(tmp_path / "bad.ply")
    assert raised.value.file == str(tmp_path / "bad.ply") and raised.value.field


def test_filter_and_uncertainty_survive_copies_and_pickling(tmp_path):
    names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 filter_3D uncertainty"
    header = ["ply", "format ascii 1.0", "element vertex 2", *(f"property float {name}" for name in names.split()), "end_header"]
    rows = ["0 0 4 1 0 0 2 -3 -3 -3 1 0 0 0 0.5 0.125", "0 1 4 0 1 0 3 -3 -3 -3 1 0 0 0 0.25 0.75"]
    (tmp_path / "mip.ply").write_text("\n".join([*header, *rows, ""]))
    read = atsplat.Gaussians.read(tmp_path / "mip.ply")
    for found in (read, copy.copy(read), copy.deepcopy(read), pickle.loads(pickle.dumps(read))):
        assert np.array_equal(found.filter_3d, [0.5, 0.25]) and np.array_equal(found.scalars, [0.125, 0.75])
        assert same(found, read)
    without = gaussians()
    assert without.filter_3d is None and without.scalars is None and not same(without, read)


def test_what_gaussians_cannot_keep_of_a_file_is_a_warning(tmp_path):
    made = gaussians()
    made.write(tmp_path / "smooth.spz", antialiased=True)
    with pytest.warns(UserWarning, match="antialiased=True"):
        atsplat.Gaussians.read(tmp_path / "smooth.spz")
    made.write(tmp_path / "classic.spz")
    made.write(tmp_path / "classic.ply")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        atsplat.Gaussians.read(tmp_path / "classic.spz")
        atsplat.Gaussians.read(tmp_path / "classic.ply")
    with pytest.raises(atsplat.InvalidError) as raised:
        made.write(tmp_path / "smooth.ply", antialiased=True)
    assert raised.value.field == "antialiased" and not (tmp_path / "smooth.ply").exists()
    stored = (tmp_path / "classic.ply").read_bytes()
    (tmp_path / "named.ply").write_bytes(stored.replace(b"property float nx", b"property float age"))
    with pytest.warns(UserWarning, match="property age"):
        atsplat.Gaussians.read(tmp_path / "named.ply")


def test_values_beyond_the_ranges_of_spz_are_a_warning(tmp_path):
    made = atsplat.Gaussians(np.zeros((1, 3)), [[1, 0, 0, 0]], log_scales=[[-12, 0, 7]], opacities=[0.5], colours=[[0.5, 0.5, 0.5]])
    with pytest.warns(UserWarning, match=r"far\.spz: log-scales clamped to SPZ's range .*: 2$"):
        made.write(tmp_path / "far.spz")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made.write(tmp_path / "far.ply")


def test_logits_that_are_read_as_opacities_are_a_warning(tmp_path):
    shape = {"scales": np.ones((2, 3)), "colours": np.zeros((2, 3))}
    made = atsplat.Gaussians(np.zeros((2, 3)), [[1, 0, 0, 0]] * 2, opacity_logits=[2.0, 0.75], **shape)
    made.write(tmp_path / "logits.ply")
    with pytest.warns(UserWarning, match="1 of 2 stored opacities"):
        read = atsplat.Gaussians.read(tmp_path / "logits.ply", opacities_as_stored=True)
    assert np.isnan(read.opacity_logits).tolist() == [True, False] and np.isclose(read.opacity_logits[1], np.log(3))


def test_formats_that_store_opacities_are_not_converted_again(tmp_path):
    rows = {"means": np.zeros((2, 3)), "quaternions": [[1, 0, 0, 0]] * 2, "scales": np.ones((2, 3)), "colours": np.zeros((2, 3))}
    atsplat.Gaussians(**rows, opacities=[0.9, 0.25]).write(tmp_path / "scene.spz")
    with pytest.raises(atsplat.AtsplatError, match=r"scene\.spz.*SPZ 3, which stores opacities anyway"):
        atsplat.Gaussians.read(tmp_path / "scene.spz", opacities_as_stored=True)


def test_black_is_an_image():
    black, grey = np.zeros((1, 16, 16, 3), np.uint8), np.full((1, 16, 16, 3), 128, np.uint8)
    assert np.isclose(atsplat.psnr(black, grey)[0], -20 * np.log10(128 / 255), rtol=1e-6)
    with pytest.raises(atsplat.InvalidError, match="floats that were cast"):
        atsplat.psnr(black + (np.arange(16) % 2 == 0)[:, None].astype(np.uint8), grey)


def test_scales_that_may_be_no_logarithms_are_a_warning(tmp_path):
    rows = {"means": np.zeros((2, 3)), "quaternions": [[1, 0, 0, 0]] * 2, "opacities": [0.9, 0.8], "colours": np.zeros((2, 3))}
    atsplat.Gaussians(**rows, log_scales=[[0.5, 0.25, 1.0]] * 2).write(tmp_path / "scales.ply")
    with pytest.warns(UserWarning, match="may be scales without their logarithm"):
        atsplat.Gaussians.read(tmp_path / "scales.ply")
    atsplat.Gaussians(**rows, log_scales=[[0.5, 0.25, -1.0]] * 2).write(tmp_path / "logarithms.ply")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        atsplat.Gaussians.read(tmp_path / "logarithms.ply")


def test_gaussians_that_are_not_drawn_are_a_warning():
    cameras = atsplat.Cameras.from_arrays(camera_from_world=np.eye(4), intrinsics=[[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]], height=8, width=8)
    means, quaternions = np.tile([0.0, 0, 2], (4, 1)), np.tile([1.0, 0, 0, 0], (4, 1))
    # A surfel with an opacity of 1 is drawn.
    shape = {"scales": [[0.5, 0.5, 0]] * 4, "opacities": np.ones(4), "colours": np.ones((4, 3))}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert atsplat.render(atsplat.Gaussians(means, quaternions, **shape), cameras).alpha.max() > 0.9
    means[1, 0], quaternions[3] = np.nan, 0
    with pytest.warns(UserWarning, match="2 of 4 Gaussians") as raised:
        rendered = atsplat.render(atsplat.Gaussians(means, quaternions, **shape), cameras)
    assert np.isfinite(rendered.images).all() and raised[0].filename == __file__


def test_colours_of_bytes_are_those_of_floats():
    def made(colours):
        return atsplat.Gaussians(np.zeros((2, 3)), [[1, 0, 0, 0]] * 2, scales=np.ones((2, 3)), opacities=[0.5] * 2, colours=colours)

    colours = np.array([[0, 51, 255], [102, 1, 0]], np.uint8)
    assert np.allclose(made(colours).sh, made(colours / 255).sh, atol=1e-6)
    with pytest.raises(atsplat.InvalidError, match="log_scales takes their logarithms"):
        atsplat.Gaussians(np.zeros((1, 3)), [[1, 0, 0, 0]], scales=[[-3, -3, -3]], opacities=[0.5], colours=[[1, 1, 1]])
    with pytest.raises(atsplat.InvalidError, match="found 0 to 255; divide"):
        made(255.0 * (colours > 0))


def test_plain_parameters_are_converted():
    made = atsplat.Gaussians([[0, 0, 1]], [[1, 0, 0, 0]], scales=[[0.5, 1, 2]], opacities=[0.2], colours=[[0.5, 1, 0]])
    assert np.allclose(made.log_scales, np.log([[0.5, 1, 2]]))
    assert np.allclose(1 / (1 + np.exp(-made.opacity_logits)), [0.2])
    assert np.allclose(made.sh * 0.28209479 + 0.5, [[[0.5, 1, 0]]])


@pytest.mark.parametrize("change, field", [
    ({"means": np.zeros((2, 3))}, "quaternions"),
    ({"opacities": [1.5]}, "opacities"),
    ({"opacities": None}, "opacity_logits"),
    ({"opacities": [np.nan]}, "opacities"),
    ({"scales": [[-3, -3, -3]]}, "scales"),
    ({"scales": [[1, np.nan, 1]]}, "scales"),
    ({"colours": [[0, 128.0, 255]]}, "colours"),
    ({"colours": [[-1.0, 0, 1]]}, "colours"),
    ({"filter_3d": [-0.5]}, "filter_3d"),
    ({"filter_3d": [np.nan]}, "filter_3d"),
    ({"colours": None, "sh": np.zeros((1, 3, 3))}, "sh"),
    ({"scales": [["a", "b", "c"]]}, "scales"),
    ({"scalars": [0.5, 0.5]}, "scalars"),
    ({"filter_3d": [[0.5]]}, "filter_3d"),
])
def test_wrong_arrays_are_named(change, field):
    good = {"means": [[0, 0, 1]], "quaternions": [[1, 0, 0, 0]], "scales": [[1, 1, 1]], "opacities": [0.5], "colours": [[1, 1, 1]]}
    with pytest.raises(atsplat.InvalidError) as raised:
        atsplat.Gaussians(**{**good, **change})
    assert raised.value.field == field
