"""The runner: numbers of the binary, failures, interruption, resuming."""

import functools
import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
import warnings

import numpy as np
import pytest
from conftest import INDEX, PROTOCOL, SCENES, nearest

import atsplat
from atsplat import _methods


def scores(store, method):
    """Everything of a target's row that a method determines, exactly."""
    left_out = {"method", "input_hash"}
    return [{k: v for k, v in row.items() if k not in left_out} for row in store.rows() if row["method"] == method]


def evaluated(method, rooms, out, **options):
    return atsplat.evaluate(method, PROTOCOL, data=rooms, index=INDEX, out=out, **options)


def test_a_python_method_has_the_binarys_numbers_to_the_bit(rooms, warped, binary, tmp_path):
    binary("run", PROTOCOL, "--data", rooms, "--index", INDEX, "--method", "nearest-view", "--out", tmp_path / "rust")
    store = evaluated(nearest, rooms, tmp_path / "python")
    theirs = atsplat.open_store(tmp_path / "rust")
    assert len(store) == len(theirs) == 3 * SCENES
    assert scores(store, "nearest") == scores(theirs, "nearest-view")
    assert all(row["psnr"] > 5 and 0 < row["ssim"] < 1 for row in store.rows())
    # The baselines themselves may be called by name.
    assert scores(evaluated("warp", rooms, tmp_path / "warp"), "warp") == scores(atsplat.open_store(warped), "warp")


def test_ready_images_have_the_binarys_tables(rooms, warped, binary, tmp_path):
    """uint8 images from files: `atsplat score` and `evaluate` of a method that reads them."""
    Image = pytest.importorskip("PIL.Image")
    ready = warped / "images" / PROTOCOL / "warp"
    binary("score", PROTOCOL, "--data", rooms, "--index", INDEX, "--renders", ready, "--name", "mine", "--out", tmp_path / "rust")

    def mine(images, context, target, *, trial):
        files = [ready / f"{trial.scene}-{trial.entry}" / f"{frame:06}.png" for frame in target.frames]
        return np.stack([np.asarray(Image.open(file)) for file in files])

    store = evaluated(mine, rooms, tmp_path / "python", title="mine")
    assert scores(store, "mine") == scores(atsplat.open_store(tmp_path / "rust"), "mine")
    tables = []
    for out in ("rust", "python"):
        binary("report", tmp_path / out, "--out", tmp_path / f"page-{out}", "--format", "json")
        table = json.loads((tmp_path / f"page-{out}" / "tables" / f"protocol-{PROTOCOL}.json").read_text())
        tables.append([[row["labels"], [[cell["value"], cell["interval"]] for group in row["cells"] for cell in group]] for row in table["table"]["rows"]])
    assert tables[0] == tables[1]


def test_a_trials_scores_are_those_of_a_run(trials, rooms, tmp_path):
    store = evaluated(nearest, rooms, tmp_path / "store")
    rows = {(row["scene"], row["target"]): row for row in store.rows()}
    for trial in trials:
        scored = trial.score(nearest(trial.context.images, trial.context.cameras, trial.target.cameras))
        assert scored.status == "done" and len(scored.targets) == len(trial.target)
        for target in scored.targets:
            ran = rows[trial.scene, target["target"]]
            assert (target["psnr"], target["ssim"], target["render_hash"]) == (ran["psnr"], ran["ssim"], ran["render_hash"])
        assert scored.mean["psnr"] == np.mean([row["psnr"] for row in scored.targets])


def test_broken_methods_are_failed_rows_and_the_run_goes_on(rooms, tmp_path):
    calls = []

    def broken(images, context, target):
        calls.append(len(calls))
        good = np.full((len(target), target.height, target.width, 3), 0.5)
        if len(calls) == 1:
            raise ValueError("no idea")
        if len(calls) == 2:
            return good[:, :-1]
        good[1, 5, 7, 2] = np.nan
        return good

    store = evaluated(broken, rooms, tmp_path / "store")
    assert len(calls) == SCENES
    details = sorted((row["status"], row["detail"]) for row in store.trials())
    assert [status for status, _ in details] == ["done", "failed", "failed"]
    reasons = " | ".join(str(detail) for _, detail in details)
    assert "ValueError: no idea (test_evaluate.py:" in reasons
    assert "expected targets × height × width × 3 of 3 × 128 × 128 × 3, found 3 × 127 × 128 × 3" in reasons
    bad = [row for row in store.rows() if row["status"] == "non-finite"]
    assert [(row["target"], row["non_finite"]) for row in bad] == [(1, 1)]
    assert "column 7, row 5" in bad[0]["detail"] and bad[0]["psnr"] is None
    assert len(store.failures()) == 3


def test_gaussians_with_nan_are_a_failed_row_and_others_that_are_not_drawn_a_note(rooms, tmp_path):
    calls = []

    def broken(images, context, target):
        calls.append(len(calls))
        means, quaternions = np.tile(context.centres[:1] + [0, 0, 2], (3, 1)), np.tile([1.0, 0, 0, 0], (3, 1))
        if len(calls) == 1:
            means[1, 2] = np.nan
        if len(calls) == 2:
            quaternions[2] = 0
        return atsplat.Gaussians(means, quaternions, scales=np.full((3, 3), 0.1), opacities=[0.5] * 3, colours=np.ones((3, 3)))

    trials = evaluated(broken, rooms, tmp_path / "store").trials()
    assert len(calls) == SCENES
    assert sorted(row["status"] for row in trials) == ["done", "done", "failed"]
    assert [row["detail"] for row in trials if row["status"] == "failed"] == ["Gaussians: means not a number in 1, first 1, of 3"]
    notes = [note for row in trials for note in row["notes"] if note.startswith("broken Gaussians: ")]
    assert notes == ["broken Gaussians: quaternions zero in 1, first 2, of 3: they are not drawn"]


@pytest.mark.parametrize("output, reason", [
    (lambda n: np.zeros((n, 3, 128, 128)), "permute channels"),
    (lambda n: np.zeros((n + 1, 128, 128, 3)), "found 4 × 128 × 128 × 3"),
    (lambda n: np.zeros((n, 128, 128, 3), dtype=np.int64), "int64"),
    (lambda n: np.tile(np.linspace(-1, 1, 128)[:, None, None], (n, 1, 128, 3)), "which seems to be −1…1"),
    (lambda n: None, "found NoneType"),
    (lambda n: {"rgb": 0}, "found dict"),
    (lambda n: (image for image in np.zeros((n, 128, 128, 3))), "found generator"),
    (lambda n: "images.npy", "found str"),
    (lambda n: atsplat.Rendering(np.zeros((n, 128, 128, 3)), np.zeros((n, 128, 128))), "return its .images"),
    (lambda n: (np.zeros((n, 128, 128, 3)), np.zeros((n, 128, 128))), "found 3 × 128 × 128 × 3 and 3 × 128 × 128"),
    (lambda n: [np.zeros((128, 128, 3)), np.full((128, 128, 3), 200, np.uint8), np.zeros((128, 128, 3))], "float64 and uint8"),
    (lambda n: np.linspace(0, 1, n * 128 * 128 * 3).reshape(n, 128, 128, 3).astype(np.uint8), "multiply them by 255"),
    (lambda n: np.ma.masked_less(np.tile(np.linspace(0, 1, 128)[:, None, None], (n, 1, 128, 3)), 0.5), "masked"),
    (lambda n: [np.zeros((128, 128, 3)), np.zeros((64, 128, 3))], "same shape"),
])
def test_wrong_output_says_what_is_wrong(rooms, tmp_path, output, reason):
    with pytest.raises(atsplat.AtsplatError, match=reason):
        evaluated(lambda images, context, target: output(len(target)), rooms, tmp_path / "store", limit=1)
    (row,) = atsplat.open_store(tmp_path / "store").trials()
    assert row["status"] == "failed" and reason in row["detail"]


def test_a_method_may_say_that_a_trial_is_not_for_it(rooms, tmp_path):
    def picky(images, context, target):
        if picky.first:
            picky.first = False
            raise atsplat.NotApplicable("needs three views")
        return nearest(images, context, target)

    picky.first = True
    store = evaluated(picky, rooms, tmp_path / "store")
    assert sorted(row["status"] for row in store.trials()) == ["done", "done", "not-applicable"]
    assert store.failures() == []


def test_calls_are_on_the_callers_thread_and_may_use_the_package(rooms, tmp_path):
    threads = set()

    def method(images, context, target):
        threads.add(threading.get_ident())
        assert np.isinf(atsplat.psnr(images, images)).all()
        return nearest(images, context, target)

    assert not evaluated(method, rooms, tmp_path / "store").failures()
    assert threads == {threading.get_ident()}


def test_results_are_kept_and_a_changed_method_is_an_error(rooms, tmp_path):
    calls = 0

    def method(images, context, target):
        nonlocal calls
        calls += 1
        return nearest(images, context, target)

    settings = {"limit": 2, "metrics": ["ssim-inria"], "parameters": {"step": 1}}
    evaluated(method, rooms, tmp_path / "store", **settings)
    first = calls
    for options, field in [({"limit": 1}, "limit"), ({"metrics": []}, "metrics"), ({"any_size": True}, "out")]:
        with pytest.raises(atsplat.InvalidError, match="another folder|choose another") as raised:
            evaluated(method, rooms, tmp_path / "store", **{**settings, **options})
        if field != "out":
            assert (raised.value.field, raised.value.file) == (field, str(tmp_path / "store"))
    evaluated(method, rooms, tmp_path / "store", **settings)
    assert calls == first
    with pytest.raises(atsplat.InvalidError, match="step"):
        evaluated(method, rooms, tmp_path / "store", **{**settings, "parameters": {"step": 2}})
    with pytest.raises(atsplat.InvalidError, match="without results") as raised:
        evaluated(method, rooms, tmp_path / "store", limit=1, parameters={"step": 1}, resume=False)
    assert (raised.value.field, raised.value.file) == ("out", str(tmp_path / "store"))


def test_metrics_and_scenes_are_added(rooms, tmp_path):
    few = evaluated(nearest, rooms, tmp_path / "store", limit=1)
    whole = evaluated(nearest, rooms, tmp_path / "store", metrics=["L1"])
    assert 0 < len(few) < len(whole) and all(row["l1"] > 0 for row in whole.rows())
    assert whole.rows() == evaluated(nearest, rooms, tmp_path / "fresh", metrics=["l1"]).rows()
    assert "l1" in [metric["id"] for metric in whole.provenance["metrics"]], "by its id, however it is written"
    with pytest.raises(atsplat.AtsplatError, match='expected one of psnr, .*, found "l3"'):
        evaluated(nearest, rooms, tmp_path / "unknown", metrics=["l3"])


def test_shards_merge_into_the_whole(rooms, tmp_path):
    whole = evaluated(nearest, rooms, tmp_path / "whole")
    parts = [evaluated(nearest, rooms, tmp_path / f"part{k}", shard=(k, 2)) for k in (1, 2)]
    assert [len(part) for part in parts] == [3, 6]
    with pytest.raises(atsplat.InvalidError, match="missing"):
        atsplat.merge(parts[:1], tmp_path / "half")
    with pytest.raises(atsplat.InvalidError, match="stores: .*part1 is the same store as .*part1: name each store once"):
        atsplat.merge([*parts, tmp_path / "." / "part1" / ".." / "part1"], tmp_path / "twice")
    assert atsplat.merge(parts, tmp_path / "merged").rows() == whole.rows()
    assert atsplat.merge(parts, tmp_path / "merged").rows() == whole.rows()
    with pytest.raises(atsplat.AtsplatError, match="expected a folder without results"):
        atsplat.merge(parts[:1], tmp_path / "merged", partial=True)


def test_a_shard_says_that_it_is_a_part_and_is_complete_nevertheless(rooms, tmp_path):
    """The index has scenes that the data lack, which is wrong in any part."""
    part = evaluated(nearest, rooms, tmp_path / "part", shard=(1, 2))
    assert [gap["missing_shards"] for gap in part.gaps] == [True, False], part.gaps
    with pytest.raises(atsplat.AtsplatError, match="not in the data") as raised:
        evaluated(nearest, rooms, tmp_path / "part", shard=(1, 2), strict=True)
    assert "shard" not in str(raised.value)


def test_ctrl_c_stops_and_the_next_run_resumes(rooms, tmp_path):
    script = textwrap.dedent(f"""
        import signal, sys, time
        import numpy as np
        import atsplat
        sys.path.insert(0, {os.path.dirname(__file__)!r})
        from conftest import nearest, INDEX, PROTOCOL
        # A shell lets what it starts in the background ignore the signal.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        calls = 0
        def slow(images, context, target):
            global calls
            calls += 1
            if calls == 2 and sys.argv[1] == "interrupt":
                print("ready", flush=True)
                time.sleep(60)
            return nearest(images, context, target)
        try:
            atsplat.evaluate(slow, PROTOCOL, data={str(rooms)!r}, index=INDEX, out={str(tmp_path / "store")!r})
        except KeyboardInterrupt:
            print("interrupted", calls)
        else:
            print("done", calls)
    """)
    env = {**os.environ, "RAYON_NUM_THREADS": "1"}
    first = subprocess.Popen([sys.executable, "-c", script, "interrupt"], stdout=subprocess.PIPE, text=True, env=env)
    assert first.stdout.readline() == "ready\n"
    first.send_signal(signal.SIGINT)
    assert first.communicate(timeout=30)[0] == "interrupted 2\n"
    kept = atsplat.open_store(tmp_path / "store").trials()
    assert len(kept) <= 1 and all(row["status"] == "done" for row in kept), "a trial that was interrupted has no row"
    second = subprocess.run([sys.executable, "-c", script, "go on"], stdout=subprocess.PIPE, text=True)
    assert second.stdout == f"done {SCENES - len(kept)}\n"
    assert [row["status"] for row in atsplat.open_store(tmp_path / "store").trials()] == ["done"] * SCENES


def test_ctrl_c_stops_a_baseline_whose_results_follow_each_other_closely(rooms, tmp_path):
    names, index = [f"scene{number:03}" for number in range(200)], json.loads(INDEX.read_text())
    first = next(iter(index))
    (tmp_path / "index.json").write_text(json.dumps({name: index[first] for name in names}))
    (tmp_path / "data").mkdir()
    for name in names:
        (tmp_path / "data" / name).symlink_to(rooms / first)
        (tmp_path / "data" / f"{name}.txt").symlink_to(rooms / f"{first}.txt")
    script = textwrap.dedent(f"""
        import os, pathlib, signal, threading, time
        import atsplat
        folder = pathlib.Path({str(tmp_path)!r})
        def interrupt():
            while not (folder / "store/provenance.json").exists():
                time.sleep(0.001)
            os.kill(os.getpid(), signal.SIGINT)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        threading.Thread(target=interrupt, daemon=True).start()
        try:
            atsplat.evaluate("nearest-view", {PROTOCOL!r}, data=folder / "data", index=folder / "index.json", out=folder / "store")
        except KeyboardInterrupt:
            print("interrupted")
    """)
    env = {**os.environ, "RAYON_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=env)
    assert done.stdout == "interrupted\n", done.stderr
    assert len(atsplat.open_store(tmp_path / "store").trials()) < len(names)


def test_an_interrupted_trial_is_never_stored(rooms, tmp_path):
    """Its thread waits for an answer that never comes, and must not take that for a failure: often, as threads race."""

    def interrupted(images, context, target):
        raise KeyboardInterrupt

    for attempt in range(40):
        store = tmp_path / f"store{attempt}"
        with pytest.raises(KeyboardInterrupt):
            atsplat.evaluate(interrupted, PROTOCOL, data=rooms, index=INDEX, out=store)
        assert atsplat.open_store(store).trials() == []


@pytest.mark.parametrize("field, given", [("name", "mine"), ("title", "Mine"), ("parameters", {"depth": 3}), ("setting", "NoPoSplat")])
def test_what_a_built_in_method_would_ignore_is_an_error(field, given):
    plain = {"name": None, "title": None, "parameters": {}, "setting": "atsplat", "deterministic": False}
    assert json.loads(_methods.record("warp", **plain))["title"] == "plane warp"
    assert json.loads(_methods.record(nearest, **{**plain, field: given}))["kind"] == "python"
    with pytest.raises(atsplat.InvalidError) as raised:
        _methods.record("warp", **{**plain, field: given})
    assert raised.value.field == field


def test_settings_are_checked(rooms, tmp_path):
    wrong = [
        ({"setting": "pixelsplats"}, "setting"),
        ({"name": "truth"}, "name"),
        ({"keep_images": "some"}, "keep_images"),
        ({"limit": -1}, "limit"),
        ({"limit": 0}, "limit"),
        ({"limit": 1.5}, "limit"),
        ({"limit": 10**30}, "limit"),
        *(({"title": title}, "title") for title in ("two\nlines", "a" * 81, " ", 3)),
        ({"shard": "1/2"}, "shard"),
        ({"shard": (3, 2)}, "shard"),
        ({"weights": "/nope"}, "weights"),
        ({"sampler": 3}, "sampler"),
        ({"parameters": {"setting": "MVSplat"}}, "parameters"),
        ({"parameters": {"a": object()}}, "parameters"),
        ({"parameters": [1]}, "parameters"),
        ({"version": 1.5}, "version"),
        ({"constants": "gsplat"}, "constants"),
        ({"background": 0}, "background"),
        ({"background": (-0.5, 0, 0)}, "background"),
        *(({"ray": ray}, "ray") for ray in (None, 2, {"workers": 0}, {"shards": 0}, {"retries": 1.5}, {"num_cpus": -1})),
    ]
    for options, field in wrong:
        with pytest.raises(atsplat.InvalidError) as raised:
            evaluated(nearest, rooms, tmp_path / "store", **options)
        assert raised.value.field == field, options
    with pytest.raises(atsplat.InvalidError, match="nearest-view, warp"):
        evaluated("nearest", rooms, tmp_path / "store")
    with pytest.raises(atsplat.InvalidError, match="at least one") as raised:
        atsplat.evaluate(nearest, [], data=rooms, out=tmp_path / "store")
    assert raised.value.field == "protocols"
    with pytest.raises(atsplat.InvalidError) as raised:
        evaluated("warp", rooms, tmp_path / "store", antialiased=True)
    assert raised.value.field == "antialiased"
    store = evaluated(nearest, rooms, tmp_path / "store", parameters={"rate": np.float32(0.5)})
    assert store.provenance["methods"][0]["parameters"]["rate"] == 0.5


def test_a_bound_argument_named_trial_stays(rooms, tmp_path):
    def method(images, context, target, trial):
        assert trial == 7
        return nearest(images, context, target)

    assert not evaluated(functools.partial(method, trial=7), rooms, tmp_path / "store").failures()


def test_what_is_missing_is_a_warning_and_an_error_if_strict(rooms, tmp_path, binary):
    broken = tmp_path / "broken"
    shutil.copytree(rooms, broken)
    entries = json.loads(INDEX.read_text())
    first, *_ = entries
    entry = entries[first][0] if isinstance(entries[first], list) else entries[first]
    images = sorted((broken / first).glob("*.png"), key=lambda path: int(path.stem))
    images[entry["context"][0]].unlink()

    def method(images, context, target, trial):
        if trial.scene.endswith("1"):
            raise ValueError("no idea")
        return nearest(images, context, target)

    with pytest.warns(UserWarning) as warned:
        store = evaluated(method, broken, tmp_path / "store")
    texts = [str(one.message) for one in warned if str(one.message).startswith(PROTOCOL)]
    assert len(texts) == len(set(texts)) and warned[0].filename == __file__
    for expected in (f"{len(entries) - SCENES} × scenes of the index that are not in the data", "1 × index entries skipped", "failed: "):
        assert any(expected in text for text in texts), expected
    assert [row["scene"] for row in store.skipped] == [first] and store.skipped[0]["detail"]
    assert any(row["count"] == len(entries) - SCENES for row in store.warnings)
    gaps = [gap["text"].split(": ")[1] for gap in store.gaps]
    assert gaps == [
        f"{len(entries) - SCENES} scenes of the index are not in the data",
        "1 index entry was skipped",
        "1 trial of method is incomplete",
    ]
    missing = "21 scenes of the index are not in the data: .*; .*1 index entry was skipped: .*; .*1 trial of method is incomplete: .*no idea"
    with pytest.raises(atsplat.AtsplatError, match=missing) as raised:
        evaluated(method, broken, tmp_path / "strict", strict=True)
    assert raised.value.file == str(tmp_path / "strict") and len(atsplat.open_store(tmp_path / "strict").rows()) == len(store.rows())
    index = tmp_path / "index.json"
    index.write_text(json.dumps({scene: entries[scene] for scene in list(entries)[1:SCENES]}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*no better than one flat colour")
        atsplat.evaluate(nearest, PROTOCOL, data=broken, index=index, out=tmp_path / "whole", strict=True)
    data = atsplat.protocol(PROTOCOL).open(rooms, index=INDEX)
    assert data.warnings["scenes of the index that are not in the data"] == len(data.missing) == len(entries) - SCENES
    with pytest.warns(UserWarning, match="not in the data"):
        atsplat.accept_baseline(store, tmp_path / "baseline.json", why="first")


@pytest.mark.parametrize("options, flags", [
    ({}, []),
    ({"antialiased": True}, ["--mode", "antialiased"]),
    (
        {"antialiased": False, "constants": "inria", "background": (0.25, 0.5, 1)},
        ["--mode", "classic", "--constants", "inria", "--background", "0.25,0.5,1"],
    ),
])
def test_gaussians_are_drawn_as_the_binary_draws_them(rooms, binary, tmp_path, options, flags):
    (tmp_path / "ply").mkdir()

    def method(images, context, target, trial):
        rng = np.random.default_rng(3)
        rays = np.stack([rng.uniform(-0.6, 0.6, 200), rng.uniform(-0.5, 0.5, 200), np.ones(200)], axis=-1) * 2
        made = atsplat.Gaussians(
            rays @ context.world_from_camera[0, :3, :3].T + context.centres[0], rng.normal(size=(200, 4)),
            scales=rng.uniform(0.001, 0.05, (200, 3)), opacities=rng.uniform(0.1, 0.9, 200), colours=rng.uniform(size=(200, 3)),
        )
        made.write(tmp_path / "ply" / f"{trial.scene}.ply")
        return made

    store = evaluated(method, rooms, tmp_path / "python", name="mine", deterministic=True, **options)
    common = (PROTOCOL, "--data", rooms, "--index", INDEX, "--ply", tmp_path / "ply", "--ply-frame", "trial", "--name", "mine")
    binary("score", *common, *flags, "--out", tmp_path / "rust")
    theirs = atsplat.open_store(tmp_path / "rust")
    columns = ("scene", "target", "psnr", "ssim", "render_hash", "status")
    assert [[row[key] for key in columns] for row in store.rows()] == [[row[key] for key in columns] for row in theirs.rows()]
    record, other = (one.provenance["methods"][0] for one in (store, theirs))
    if options:
        named = ("background", "effects", "tolerance", "renderer", "mode")
        assert [record[key] for key in ("constants", "backend")] == [other[key] for key in ("constants", "backend")]
        assert [record["parameters"][key] for key in named] == [other["parameters"][key] for key in named]
        with pytest.raises(atsplat.InvalidError, match="mine"):
            evaluated(method, rooms, tmp_path / "python", name="mine", deterministic=True)


@pytest.mark.parametrize("option", [{"antialiased": True}, {"constants": "inria"}, {"background": (0, 0, 0)}])
def test_images_are_not_recorded_as_rendered_gaussians(rooms, tmp_path, option):
    name, = option
    with pytest.raises(atsplat.AtsplatError, match=f"expected Gaussians, because {name} is given, found images"):
        evaluated(nearest, rooms, tmp_path / "store", **option)
    assert {row["status"] for row in atsplat.open_store(tmp_path / "store").trials()} == {"failed"}


def test_stores_in_a_forked_process_are_an_error_and_do_not_hang(rooms, tmp_path):
    script = textwrap.dedent(f"""
        import multiprocessing, sys
        import atsplat
        sys.path.insert(0, {os.path.dirname(__file__)!r})
        from conftest import nearest, INDEX, PROTOCOL

        def run(out):
            return atsplat.evaluate(nearest, PROTOCOL, data={str(rooms)!r}, index=INDEX, out=out, limit=1)

        def child(queue):
            store, baseline = {str(tmp_path / "store")!r}, {str(tmp_path / "baseline.json")!r}
            uses = [lambda: run({str(tmp_path / "other")!r}), lambda: atsplat.open_store(store), lambda: atsplat.report(store),
                    lambda: atsplat.merge([store], {str(tmp_path / "merged")!r}), lambda: atsplat.drift(store, baseline),
                    lambda: atsplat.accept_baseline(store, baseline, why="x")]
            for use in uses:
                try:
                    use()
                except RuntimeError as error:
                    queue.put(str(error))

        run({str(tmp_path / "store")!r})
        context = multiprocessing.get_context("fork")
        queue = context.Queue()
        process = context.Process(target=child, args=(queue,))
        process.start()
        print(sum("spawn" in queue.get(timeout=50) for _ in range(6)))
        process.join(10)
        print(process.exitcode)
    """)
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", script], capture_output=True, text=True, timeout=100)
    assert done.stdout == "6\n0\n", done.stderr


def test_results_are_not_written_into_the_folder_of_the_dataset(rooms, tmp_path):
    files = sorted(rooms.rglob("*"))
    for out in (rooms, rooms / ".." / rooms.name):
        with pytest.raises(atsplat.InvalidError, match="is the folder of the dataset; choose another one for the results") as raised:
            evaluated(nearest, rooms, out, limit=1)
        assert raised.value.field == "out"
    assert sorted(rooms.rglob("*")) == files
    link = tmp_path / "data"
    link.symlink_to(rooms)
    assert not evaluated(nearest, link, tmp_path / "store", limit=1).failures()


def test_advice_is_about_arguments_and_not_about_options(rooms, tmp_path):
    def method(images, context, target):
        with pytest.raises(atsplat.InvalidError, match=r"shard=\(1, 2\) and shard=\(2, 2\), and merge the parts with atsplat\.merge"):
            evaluated(nearest, rooms, tmp_path / "store")
        return nearest(images, context, target)

    assert not evaluated(method, rooms, tmp_path / "store", limit=1, version=1).failures()
