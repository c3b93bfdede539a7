"""Trials: what a method sees, and scoring of images and Gaussians."""

import json
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
from conftest import INDEX, PROTOCOL, SCENES

import atsplat
from atsplat.protocols import scores


def test_a_method_sees_context_images_and_target_cameras_only(trials):
    assert len(trials) == SCENES
    for trial in trials:
        images = trial.context.images
        assert images.shape == (2, 128, 128, 3) and images.dtype == np.float32
        assert 0 <= images.min() < images.max() <= 1
        assert len(trial.target) == 3
        with pytest.raises(AttributeError, match="may not see"):
            trial.target.images
        assert trial.near_far[0] < trial.near_far[1]


def test_images_are_the_files_pixels(trials, rooms):
    Image = pytest.importorskip("PIL.Image")
    trial = trials[0]
    for image, frame in zip(trial.context.images, trial.context.cameras.frames):
        folder = next(path for path in rooms.rglob(trial.scene) if path.is_dir())
        stored = np.asarray(Image.open(sorted(folder.glob("*.png"), key=lambda path: int(path.stem))[frame]))
        assert np.array_equal(np.round(image * 255).astype(np.uint8), stored)


def test_limit_spreads_and_skipped_entries_are_listed(rooms):
    protocol = atsplat.protocol(PROTOCOL)
    first, third = (trial.scene for trial in protocol.trials(rooms, index=INDEX, limit=2))
    every = [trial.scene for trial in protocol.trials(rooms, index=INDEX)]
    assert [first, third] == [every[0], every[1]]
    unsized = atsplat.protocol("re10k-2v-256").trials(rooms, index=INDEX)
    assert list(unsized) == [] and len(unsized.skipped) == SCENES
    assert unsized.skipped[0].reason and "128" in unsized.skipped[0].detail


def test_entries_that_a_loop_does_not_see_are_warnings(rooms, data):
    protocol, unsized = atsplat.protocol(PROTOCOL), atsplat.protocol("re10k-2v-256")
    lacks = f"{len(data.missing)} × scenes of the index that are not in the data: "
    with pytest.warns(UserWarning, match=f"^{PROTOCOL}: .*{lacks}") as warned:
        trials = protocol.trials(data)
    assert len(warned) == 1 and warned[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(list(trials)) == SCENES
    with pytest.warns(UserWarning, match="not in the data"):
        trials = unsized.trials(rooms, index=INDEX)
    with pytest.warns(UserWarning, match=rf"^re10k-2v-256: {SCENES} entries of the index gave no trial, first .*128") as warned:
        assert list(trials) == [] and list(trials) == []
    assert len(warned) == 1


def test_scores_of_gaussians_are_those_of_their_rendering(trials):
    trial = trials[0]
    cameras = trial.context.cameras
    rng = np.random.default_rng(7)
    rays = np.stack([rng.uniform(-0.5, 0.5, 400), rng.uniform(-0.4, 0.4, 400), np.ones(400)], axis=-1) * 3
    means = rays @ cameras.world_from_camera[0, :3, :3].T + cameras.centres[0]
    gaussians = atsplat.Gaussians(
        means,
        np.tile([1, 0, 0, 0], (400, 1)),
        scales=np.full((400, 3), 0.05),
        opacities=np.full(400, 0.8),
        colours=rng.uniform(size=(400, 3)),
    )
    scored = trial.score(gaussians)
    assert scored.status == "done" and 0 < scored.mean["psnr"] < 40
    # Another order of the colours is another image.
    other = atsplat.Gaussians(
        gaussians.means, gaussians.quaternions, log_scales=gaussians.log_scales,
        opacity_logits=gaussians.opacity_logits, sh=gaussians.sh[:, :, ::-1],
    )
    assert trial.score(other).mean["psnr"] != scored.mean["psnr"]


def test_targets_identical_to_the_truth_are_in_no_mean():
    def row(status, scored, missing):
        return {"status": status, "scores": scored, "not_computed": missing}

    targets = [
        row("scored", {"psnr": 20.0, "ssim": 0.5}, {"psnr-8bit-rounded": "identical", "lpips": "weights absent"}),
        row("identical", {"ssim": 1.0}, {"psnr": "identical", "psnr-8bit-rounded": "identical", "lpips": "weights absent"}),
        row("scored", {"psnr": 23.0, "ssim": 0.75, "psnr-8bit-rounded": 23.5}, {"lpips": "weights absent"}),
        row("non-finite", {}, {"psnr": "NaN or infinite samples"}),
    ]
    scored = scores({"status": "done", "detail": None}, targets)
    assert scored.mean == {"psnr": 21.5, "ssim": 0.625, "psnr-8bit-rounded": 23.5}
    assert (scored.identical, len(scored.targets), scored.targets[1]["psnr"]) == (1, 4, float("inf"))


def test_scores_of_gaussians_are_the_binarys_of_their_files(trials, rooms, binary, tmp_path):
    rng = np.random.default_rng(11)
    by_scene = {}
    for trial in trials:
        count = 300
        rays = np.stack([rng.uniform(-0.6, 0.6, count), rng.uniform(-0.5, 0.5, count), np.ones(count)], axis=-1) * 2.5
        posed = trial.context.cameras
        means = rays @ posed.world_from_camera[1, :3, :3].T + posed.centres[1]
        gaussians = atsplat.Gaussians(
            means, rng.normal(size=(count, 4)), scales=rng.uniform(0.01, 0.1, (count, 3)),
            opacities=rng.uniform(0.1, 0.9, count), colours=rng.uniform(size=(count, 3)),
        )
        (tmp_path / "ply").mkdir(exist_ok=True)
        gaussians.write(tmp_path / "ply" / f"{trial.scene}.ply")
        by_scene[trial.scene] = trial.score(gaussians)
    binary("score", PROTOCOL, "--data", rooms, "--index", INDEX, "--ply", tmp_path / "ply", "--ply-frame", "trial", "--out", tmp_path / "out")
    rows = atsplat.open_store(tmp_path / "out").rows()
    assert len(rows) == 3 * SCENES
    for row in rows:
        scored = by_scene[row["scene"]].targets[row["target"]]
        assert (scored["psnr"], scored["ssim"], scored["render_hash"]) == (row["psnr"], row["ssim"], row["render_hash"])


@pytest.fixture(scope="module")
def large_room(tmp_path_factory, binary):
    """One scene that is large enough for RE10K's protocol, which has settings with renderers of their own."""
    folder = tmp_path_factory.mktemp("data") / "large"
    binary("data", "simulate", folder, "--scenes", 1, "--size", "256x256", "--samples", 1)
    return folder / "test"


@pytest.mark.parametrize("setting", ["ATSplat", "iLRM", "Long-LRM"])
def test_gaussians_are_scored_as_the_setting_renders_them(large_room, tmp_path, setting):
    rng = np.random.default_rng(5)
    offsets, colours = rng.uniform(-0.5, 0.5, (200, 3)), rng.uniform(size=(200, 3))

    def method(images, context, target):
        # A few in front of the first camera: the background is seen.
        means = (offsets + [0, 0, 2]) @ context.world_from_camera[0, :3, :3].T + context.centres[0]
        turns = np.tile([1, 0, 0, 0], (200, 1))
        return atsplat.Gaussians(means, turns, scales=np.full((200, 3), 0.05), opacities=np.full(200, 0.8), colours=colours)

    where = {"index": INDEX, "any_size": True, "setting": setting}
    store = atsplat.evaluate(method, "re10k-2v-256", data=large_room, out=tmp_path / "store", version=1, **where)
    evaluated = [(row["psnr"], row["render_hash"]) for row in store.rows()]
    (trial,) = atsplat.protocol("re10k-2v-256").trials(large_room, **where)
    scored = trial.score(method(trial.context.images, trial.context.cameras, trial.target.cameras))
    assert [(row["psnr"], row["render_hash"]) for row in scored.targets] == evaluated and len(evaluated) == 3


def test_identical_images_have_no_finite_psnr(trials, rooms):
    trial = trials[0]
    truth = trial._native.target_images()
    scored = trial.score(np.round(truth * 255).astype(np.uint8))
    assert all(row["status"] == "identical" and row["psnr"] == np.inf and row["ssim"] == 1 for row in scored.targets)


def test_scores_of_failed_output_say_why(trials):
    scored = trials[0].score(np.zeros((2, 128, 128, 3)))
    assert scored.status == "failed" and len(scored.targets) == 3
    assert all(row["psnr"] is None and row["ssim"] is None for row in scored.targets)
    for again in (scored, pickle.loads(pickle.dumps(scored))):
        with pytest.raises(atsplat.InvalidError, match="found 2 × 128 × 128 × 3") as raised:
            again.mean["psnr"]
        assert raised.value.field == "psnr" and again.mean.get("psnr") is None


def test_wrong_arguments_of_trials_are_named(rooms, data):
    protocol = atsplat.protocol(PROTOCOL)
    wrong = [({"limit": limit}, "limit") for limit in (-1, 0, 2.0)]
    for options, field in [*wrong, ({"weights": "/nope"}, "weights"), ({"setting": 3}, "setting")]:
        with pytest.raises(atsplat.InvalidError) as raised:
            protocol.trials(data, **options)
        assert raised.value.field == field
    wrong = [({"images": 1.5}, "images"), ({"any_size": "no"}, "any_size"), ({"index": 3}, "index")]
    for options, field in [*wrong, *(({"prefer_undistorted": flag}, "prefer_undistorted") for flag in (1, True))]:
        with pytest.raises(atsplat.InvalidError) as raised:
            protocol.open(rooms, **options)
        assert raised.value.field == field and str(raised.value).startswith(f"{field}: ")
    assert len(protocol.open(rooms, sampler=Path("re10k-2v")).entries) == SCENES


def test_an_index_with_a_repeated_target_is_in_the_warnings(rooms, tmp_path):
    entries = json.loads(INDEX.read_text())
    first = next(iter(entries))
    entry = entries[first][0] if isinstance(entries[first], list) else entries[first]
    (tmp_path / "index.json").write_text(json.dumps({first: {**entry, "target": [entry["target"][0]] * 3}}))
    opened = atsplat.protocol(PROTOCOL).open(rooms, index=tmp_path / "index.json")
    kind = next(kind for kind in opened.warnings if "target" in kind)
    assert opened.warnings[kind] >= 1 and first in opened.examples[kind]


def test_open_data_keeps_its_protocol_and_index(data):
    for protocol, options in [("re10k-2v-256", {}), (PROTOCOL, {"sampler": "re10k-2v"})]:
        with pytest.raises(atsplat.InvalidError) as raised:
            atsplat.protocol(protocol).trials(data, **options)
        assert raised.value.field == "data"


@pytest.mark.parametrize("options, field", [
    ({"index": INDEX, "sampler": "re10k-2v"}, "sampler"),
    ({"index": INDEX, "images": 8}, "images"),
])
def test_options_that_would_be_ignored_are_errors(rooms, options, field):
    with pytest.raises(atsplat.InvalidError) as raised:
        atsplat.protocol(PROTOCOL).open(rooms, **options)
    assert raised.value.field == field


def test_a_protocol_names_its_metrics(rooms, tmp_path):
    usual = atsplat.protocol(PROTOCOL)
    assert usual.metrics == ["psnr", "ssim", "lpips"]
    own = tmp_path / "own.toml"
    text = usual.toml.replace(f'name = "{usual.name}"', 'name = "own"', 1)
    own.write_text(text.replace('ssim = "ssim"', 'ssim = "ssim-inria-8bit-rounded"'))
    protocol = atsplat.protocol(own)
    assert protocol.metrics == ["psnr", "ssim-inria-8bit-rounded", "lpips"] and protocol.hash != usual.hash
    trial = next(iter(protocol.trials(rooms, index=INDEX, limit=1)))
    scored = trial.score(np.full((3, 128, 128, 3), 0.5, np.float32))
    assert {"psnr", "ssim-inria-8bit-rounded"} <= scored.targets[0].keys() and "ssim" not in scored.targets[0]
    own.write_text(text.replace('ssim = "ssim"', 'ssim = "ssim-inria-8bits"'))
    with pytest.raises(atsplat.InvalidError, match="expected one of ssim, ssim-clipped, ") as raised:
        atsplat.protocol(own)
    assert raised.value.file == str(own)


def test_errors_name_file_and_field(rooms, tmp_path):
    with pytest.raises(atsplat.InvalidError, match="re10k-2v-256") as raised:
        atsplat.protocol("re10k")
    assert raised.value.field == "protocol" and isinstance(raised.value, ValueError)
    with pytest.raises(atsplat.FileError) as raised:
        atsplat.protocol(tmp_path / "none.toml")
    assert raised.value.file == str(tmp_path / "none.toml") and raised.value.errno == 2 and isinstance(raised.value, OSError)
    (tmp_path / "broken.toml").write_text('name = "x"\ntitle = 3\n')
    with pytest.raises(atsplat.InvalidError) as raised:
        atsplat.protocol(tmp_path / "broken.toml")
    assert raised.value.file == str(tmp_path / "broken.toml") and raised.value.field.startswith("line 2")
    with pytest.raises(atsplat.InvalidError, match=r'no evaluation index.*\(index=…\).*\(sampler=') as raised:
        atsplat.protocol(PROTOCOL).open(rooms)
    assert raised.value.file == str(rooms) and raised.value.field == "index"
    with pytest.raises(atsplat.AtsplatError) as raised:
        atsplat.open_store(tmp_path)
    assert raised.value.file == str(tmp_path)
