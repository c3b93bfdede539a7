"""The dataset and the training callbacks; skipped without PyTorch."""

import functools
import json
import pickle
import warnings
import weakref

import numpy as np
import pytest
from conftest import INDEX, PROTOCOL, SCENES

import atsplat
from atsplat._methods import name_of

torch = pytest.importorskip("torch")
from atsplat.torch import Evaluation, TrialDataset, state_hash  # noqa: E402


class Blend(torch.nn.Module):
    """Mixes the context images; its best mixture is even."""

    def __init__(self, weight=0.5):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.tensor(weight))
        self.modes = set()

    def forward(self, images, context, target):
        self.modes.add((self.training, torch.is_grad_enabled()))
        mixed = self.weight * torch.from_numpy(images[0]) + (1 - self.weight) * torch.from_numpy(images[1])
        return mixed.clamp(0, 1).expand(len(target), *mixed.shape)


@pytest.mark.parametrize("workers", [0, 2])
def test_a_data_loader_gives_the_trials(trials, rooms, workers):
    dataset = TrialDataset(PROTOCOL, rooms, index=INDEX, supervise=True)
    assert len(dataset) == SCENES
    loader = torch.utils.data.DataLoader(dataset, batch_size=None, num_workers=workers)
    for item, trial in zip(loader, trials, strict=True):
        assert item["scene"] == trial.scene
        assert np.array_equal(item["context_images"].permute(0, 2, 3, 1).numpy(), trial.context.images)
        assert item["target_images"].shape == (3, 3, 128, 128)
        expected = trial.target.cameras.world_from_camera.astype(np.float32)
        assert np.array_equal(item["target_world_from_camera"].numpy(), expected)
        scored = trial.score((item["target_images"] * 255).round().byte().permute(0, 2, 3, 1))
        assert all(row["status"] == "identical" for row in scored.targets)
    assert "target_images" not in TrialDataset(PROTOCOL, rooms, index=INDEX, limit=1)[0]


def test_entries_without_a_trial_are_a_warning(rooms):
    listed = len(json.loads(INDEX.read_text()))
    with pytest.warns(UserWarning, match=f"{listed} of {listed} entries"):
        dataset = TrialDataset("re10k-2v-256", rooms, index=INDEX)
    assert len(dataset) == 0 and len(dataset.skipped) == listed
    missing, unsized = dataset.skipped[: listed - SCENES], dataset.skipped[listed - SCENES :]
    assert {entry.reason for entry in missing} == {"missing-scene"} and all("128" in entry.detail for entry in unsized)
    with pytest.warns(UserWarning, match=f"{listed - SCENES} of {listed} entries .*not in the data"):
        assert len(TrialDataset(PROTOCOL, rooms, index=INDEX)) == SCENES


def test_opened_data_may_be_given_and_items_have_frames(data, trials):
    dataset = pickle.loads(pickle.dumps(TrialDataset(PROTOCOL, data)))
    assert len(dataset) == SCENES
    for item, trial in zip(dataset, trials):
        assert tuple(item["context_frames"].tolist()) == trial.context.cameras.frames
        assert tuple(item["target_frames"].tolist()) == trial.target.cameras.frames
    assert dataset[torch.tensor(1)]["scene"] == trials[1].scene
    with pytest.raises(atsplat.InvalidError, match="Subset"):
        dataset[0:2]
    with pytest.raises(atsplat.InvalidError, match="open"):
        TrialDataset("re10k-2v-256", data)


def test_lens_distortion_that_items_leave_out_is_one_warning(tmp_path, binary):
    small = ("--scenes", 1, "--size", "128x128", "--samples", 1, "--effects", "none")
    binary("data", "simulate", tmp_path / "data", *small, "--layout", "nerfstudio")
    (file,) = (tmp_path / "data").glob("*/nerfstudio/transforms.json")
    file.write_text(json.dumps({**json.loads(file.read_text()), "k1": 0.01}))
    dataset = TrialDataset(PROTOCOL, tmp_path / "data", index=INDEX)
    with pytest.warns(UserWarning, match="5 views have lens distortion"):
        dataset[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dataset[0]


def baseline_of(rooms, folder):
    # One mean over three scenes has no interval: methods that are deterministic are compared bit by bit.
    store = atsplat.evaluate(Blend(), PROTOCOL, data=rooms, index=INDEX, out=folder / "good", deterministic=True)
    atsplat.accept_baseline(store, folder / "baseline.json", why="an even mixture")
    return folder / "baseline.json"


def test_an_evaluation_runs_every_n_steps_and_fails_if_it_is_worse(rooms, tmp_path):
    baseline = baseline_of(rooms, tmp_path)
    check = Evaluation(PROTOCOL, rooms, tmp_path / "runs", every=10, baseline=baseline, index=INDEX, deterministic=True, name="Blend")
    model = Blend()
    for step in range(25):
        check(step, model if step < 15 else model.forward)
    assert sorted(check.stores) == [10, 20] and check.drift.verdict == "same"
    assert model.modes == {(False, False)} and model.training
    model.weight.data.fill_(3.0)
    with pytest.raises(atsplat.DriftedError):
        check(30, model)
    with pytest.raises(atsplat.InvalidError):
        Evaluation(PROTOCOL, rooms, tmp_path, every=0)


@pytest.mark.parametrize("fail", ["worse", "any"])
def test_a_baseline_of_another_method_is_not_passed_in_silence(rooms, tmp_path, fail):
    common = {"every": 1, "baseline": baseline_of(rooms, tmp_path), "index": INDEX, "deterministic": True, "fail": fail}
    check = Evaluation(PROTOCOL, rooms, tmp_path / "other", name="other", **common)
    with pytest.raises(atsplat.DriftedError, match="targets are missing"):
        check(1, Blend(3.0))
    assert all(one["verdict"] == "nothing" for one in check.drift.comparisons)


def test_a_part_of_the_baselines_scenes_is_compared(rooms, tmp_path):
    common = {"every": 1, "baseline": baseline_of(rooms, tmp_path), "index": INDEX, "deterministic": True, "name": "Blend", "limit": 1}
    check = Evaluation(PROTOCOL, rooms, tmp_path / "same", **common)
    assert check(1, Blend()) is not None and {one["verdict"] for one in check.drift.comparisons} == {"same"}
    with pytest.raises(atsplat.DriftedError):
        Evaluation(PROTOCOL, rooms, tmp_path / "worse", **common)(1, Blend(3.0))


def test_the_results_of_an_earlier_training_are_not_taken_for_those_of_this_one(rooms, tmp_path):
    def trained(method, **options):
        check = Evaluation(PROTOCOL, rooms, tmp_path / "runs", every=1, index=INDEX, limit=1, name="Blend", **options)
        return check(1, method)

    first, same = trained(Blend()), Blend()
    assert trained(same).rows() == first.rows() and not same.modes, "with the same state, they are kept"
    with pytest.raises(atsplat.InvalidError, match="state-sha256"):
        trained(Blend(0.25))
    with pytest.raises(atsplat.InvalidError, match="recipe"):
        trained(Blend(), parameters={"recipe": "another"})
    # Nothing tells which state a function has.
    for _ in range(2):
        with pytest.warns(UserWarning, match="no module"), pytest.raises(atsplat.InvalidError, match="without results"):
            trained(lambda images, context, target: np.zeros((3, 128, 128, 3)))


class Wrapper:
    def __init__(self, module):
        self.module = module

    def __call__(self, *views):
        return self.module(*views)


@pytest.mark.parametrize("wrap", [
    lambda model: lambda *views: model(*views),
    lambda model: functools.partial(lambda model, *views: model(*views), model),
    Wrapper,
])
def test_a_wrapped_module_is_in_eval_mode_and_resumed_with_its_state(rooms, tmp_path, wrap):
    model = Blend()
    first = Evaluation(PROTOCOL, rooms, tmp_path / "runs", every=1, index=INDEX, limit=1, name="Blend")(1, wrap(model))
    assert model.modes == {(False, False)} and model.training
    assert "state-sha256" in first.provenance["methods"][0]["parameters"]
    with pytest.raises(atsplat.InvalidError, match="state-sha256"):
        Evaluation(PROTOCOL, rooms, tmp_path / "runs", every=1, index=INDEX, limit=1, name="Blend")(1, wrap(Blend(0.25)))


def test_a_hidden_module_may_be_named(rooms, tmp_path):
    model = Blend()
    models = weakref.WeakValueDictionary({"model": model})

    def hidden(*views):
        return models["model"](*views)

    def evaluated(folder, **options):
        return Evaluation(PROTOCOL, rooms, tmp_path / folder, every=1, index=INDEX, limit=1, **options)(1, hidden)

    with pytest.warns(UserWarning, match="no module was found in hidden"):
        evaluated("silent")
    assert model.modes == {(True, False)}
    model.modes.clear()
    evaluated("named", module=model)
    assert model.modes == {(False, False)} and model.training


@pytest.mark.parametrize("break_it", ["raise", "nan", "reject"])
def test_targets_that_fail_now_are_worse(rooms, tmp_path, break_it):
    baseline = baseline_of(rooms, tmp_path)

    class Breaking(Blend):
        def forward(self, images, context, target, trial):
            mixed = super().forward(images, context, target)
            if trial.scene.endswith("1") and break_it == "raise":
                raise ValueError("diverged")
            if trial.scene.endswith("1") and break_it == "reject":
                raise atsplat.NotApplicable("diverged")
            return mixed * float("nan") if trial.scene.endswith("1") else mixed

    check = Evaluation(PROTOCOL, rooms, tmp_path / "runs", every=1, baseline=baseline, index=INDEX, deterministic=True, name="Blend")
    with pytest.raises(atsplat.DriftedError):
        check(1, Breaking())
    assert len(check.drift.lost) == 3 and "rooms-test-00000001" in check.drift.lost[0]


def test_the_hash_of_a_state_is_that_of_names_types_shapes_and_values():
    def hashed(**state):
        module = torch.nn.Module()
        for name, value in state.items():
            module.register_buffer(name, value)
        return state_hash(module)

    ones, zeros = torch.ones(2, 3, dtype=torch.bfloat16), torch.zeros(())
    state = hashed(a=ones, b=zeros)
    assert state == hashed(b=zeros, a=ones.clone()), "whatever the order"
    others = [(zeros, ones), (ones.T, zeros), (ones.half(), zeros), (ones, zeros + 1), (ones, zeros.double())]
    assert len({state, hashed(a=ones), *(hashed(a=a, b=b) for a, b in others)}) == 7


def test_better_is_a_failure_only_if_any_drift_is(rooms, tmp_path):
    worse = atsplat.evaluate(Blend(3.0), PROTOCOL, data=rooms, index=INDEX, out=tmp_path / "bad", deterministic=True)
    atsplat.accept_baseline(worse, tmp_path / "baseline.json", why="the start")
    common = {"every": 1, "baseline": tmp_path / "baseline.json", "index": INDEX, "deterministic": True}
    check = Evaluation(PROTOCOL, rooms, tmp_path / "worse", **common)
    assert check(1, Blend()) is not None and check.drift.drifted
    with pytest.raises(atsplat.DriftedError):
        Evaluation(PROTOCOL, rooms, tmp_path / "any", fail="any", **common)(1, Blend())


class Sighted(Blend):
    """Has a parameter for what it may know about a trial, which it can do without."""

    def forward(self, images, context, target, trial=None):
        self.seen = trial
        return super().forward(images, context, target)

    def predict(self, images, context, target, trial=None):
        return self(images, context, target, trial)


@pytest.mark.parametrize("wrap", [
    lambda model: model,
    functools.partial,
    lambda model: torch.compile(model, backend="eager"),
    torch.nn.DataParallel,
    lambda model: functools.partial(torch.nn.DataParallel(model)),
    lambda model: model.predict,
    lambda model: functools.partial(model.predict),
])
def test_wrappers_pass_on_what_a_method_may_know_and_its_name(rooms, tmp_path, wrap):
    model = Sighted().eval()
    assert name_of(wrap(model)) == "Sighted"
    atsplat.evaluate(wrap(model), PROTOCOL, data=rooms, index=INDEX, out=tmp_path / "store", limit=1, version=1)
    assert model.seen.near_far[0] > 0


def test_a_trial_that_is_given_beforehand_is_kept(rooms, tmp_path):
    model = Sighted().eval()
    method = functools.partial(torch.nn.DataParallel(model), trial="mine")
    atsplat.evaluate(method, PROTOCOL, data=rooms, index=INDEX, out=tmp_path / "store", limit=1, version=1)
    assert model.seen == "mine"
