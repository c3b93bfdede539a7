"""Stores, tables and drift, against what the binary says of the same files."""

import csv
import io
import json
import shutil

import numpy as np
import pytest
from conftest import INDEX, PROTOCOL, SCENES, nearest

import atsplat
from atsplat.reports import Table
from atsplat.stores import _column


@pytest.fixture(scope="module")
def store(rooms, tmp_path_factory):
    out = tmp_path_factory.mktemp("drift") / "store"
    return atsplat.evaluate(nearest, PROTOCOL, data=rooms, index=INDEX, out=out, deterministic=True)


def test_rows_and_columns_agree(store):
    rows, columns = store.rows(), store.columns()
    assert len(rows) == len(store) == 3 * SCENES
    assert columns["psnr"].dtype == np.float64 and columns["frame"].dtype == np.int64 and columns["leaked"].dtype == bool
    for at, row in enumerate(rows):
        assert columns["psnr"][at] == row["psnr"] and columns["scene"][at] == row["scene"]
    assert store.provenance["methods"][0]["kind"] == "python"
    assert "nearest" in str(store) and PROTOCOL in str(store)
    # LPIPS has no weights here: no number, and the reason.
    if rows[0]["lpips"] is None:
        assert np.isnan(columns["lpips"]).all() and rows[0]["not_computed"]["lpips"]


def test_rows_of_failed_targets_have_keys_of_metrics_and_are_copies(rooms, tmp_path):
    def method(images, context, target, trial):
        if trial.scene.endswith("1"):
            raise ValueError("no idea")
        return nearest(images, context, target)

    store = atsplat.evaluate(method, PROTOCOL, data=rooms, index=INDEX, out=tmp_path / "store")
    rows = store.rows()
    assert {tuple(sorted(row)) for row in rows} == {tuple(sorted(rows[0]))}
    failed = [row for row in rows if row["status"] == "failed"]
    assert len(failed) == 3 and all(row["psnr"] is None for row in failed)
    assert np.isnan(store.columns()["psnr"]).sum() == 3
    rows[0]["not_computed"]["psnr"] = "mine"
    store.trials()[0]["notes"].append("mine")
    assert "psnr" not in store.rows()[0]["not_computed"] and "mine" not in store.trials()[0]["notes"]
    for wrong in ([store, store], None):
        with pytest.raises(atsplat.InvalidError):
            atsplat.report(wrong)


def test_tables_are_the_binarys(store, warped, binary, tmp_path):
    binary("report", store.path, warped, "--out", tmp_path / "page")
    report = atsplat.report(store, warped)
    for table in report:
        texts = {"md": table.to_markdown(), "tex": table.to_latex(), "csv": table.to_csv(), "txt": str(table)}
        for extension, text in texts.items():
            assert (tmp_path / "page" / "tables" / f"{table.name}.{extension}").read_text() == text
    table = report.table(PROTOCOL)
    shown = table._repr_html_()
    assert "<table" in shown and "plane warp" in shown
    psnr = {row["method"]: row["PSNR"] for row in table.rows}
    assert set(psnr) == {"nearest", "warp"}
    printed = {row["method_id"]: float(row["psnr"]) for row in csv.DictReader(io.StringIO(table.to_csv()))}
    assert psnr == printed
    by_scene = {}
    for row in store.rows():
        by_scene.setdefault(row["scene"], []).append(row["psnr"])
    assert np.isclose(psnr["nearest"], np.mean([np.mean(scores) for scores in by_scene.values()]))
    with pytest.raises(atsplat.InvalidError, match=f"protocol-{PROTOCOL}"):
        report.table("re20k")
    files = report.write(tmp_path / "written")
    assert (tmp_path / "written/index.html").is_file() and len(files) > 5


def test_a_folder_that_another_process_writes_into_is_left_alone(store, tmp_path):
    import fcntl

    page = tmp_path / "page"
    page.mkdir()
    with open(page / "run.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(atsplat.AtsplatError, match="page is being written by") as raised:
            atsplat.report(store).write(page)
        assert raised.value.file == str(page) and not (page / "index.html").exists()
    assert str(page / "index.html") in atsplat.report(store).write(page)


def test_rows_are_told_apart_by_their_remarks():
    def row(remarks, number):
        cells = [[{"value": {"number": number}}, {"value": "absent"}]]
        measured = {"measured-on": {"text": "rooms", "published-setting": False}, "origin": "measured"}
        return {"labels": ["A"], "remarks": remarks, "method": "a", "store": "run", "cells": cells, **measured}

    columns = [{"title": "PSNR"}, {"title": "LPIPS"}]
    rows = [row([], 20.5), row(["leaked targets excluded"], 19.5)]
    text = json.dumps({"table": {"labels": ["Method"], "groups": [{"title": "2 views", "columns": columns}], "rows": rows}})
    whole, without = Table("t", "T", [text, *[""] * 5]).rows
    assert (whole["remarks"], whole["2 views PSNR"], whole["2 views LPIPS"]) == ([], 20.5, None)
    assert without == {**whole, "remarks": ["leaked targets excluded"], "2 views PSNR": 19.5}
    assert whole["measured on"] == "rooms" and whole["Method"] == "A"


def test_a_missing_boolean_is_not_false():
    assert _column([True, None], False).tolist() == [True, None]
    assert _column([True, False], False).dtype == bool


def test_drift_sees_what_moved_and_in_which_direction(store, rooms, binary, tmp_path):
    baseline = tmp_path / "baseline.json"
    with pytest.raises(atsplat.InvalidError) as raised:
        atsplat.accept_baseline(store, baseline, why=" ")
    assert raised.value.field == "why"
    atsplat.accept_baseline(store, baseline, why="first results")
    same = atsplat.drift(store, baseline)
    assert same.verdict == "same" and not same.drifted
    same.raise_if_drifted()

    def darker(images, context, target):
        return 0.97 * nearest(images, context, target)

    moved = atsplat.evaluate(darker, PROTOCOL, data=rooms, index=INDEX, out=tmp_path / "moved", name="nearest", deterministic=True)
    found = atsplat.drift(moved, baseline)
    assert found.verdict == "drifted" and found.drifted
    with pytest.raises(atsplat.DriftedError, match="psnr") as raised:
        found.raise_if_drifted()
    assert raised.value.drift is found
    psnr = next(one for one in found.comparisons if one["metric"] == "psnr")
    assert psnr["baseline"] != psnr["now"]
    told = json.loads(binary("drift", moved.path, "--baseline", baseline, "--no-probe", "--json", succeeds=False))
    assert told == found.report


def test_targets_that_vanish_are_lost(store, rooms, tmp_path):
    baseline, entries = tmp_path / "baseline.json", json.loads(INDEX.read_text())
    atsplat.accept_baseline(store, baseline, why="first results")
    first, second, third = (row["scene"] for row in store.trials())

    def lost_without(remove, name, **options):
        data = tmp_path / name / "data"
        shutil.copytree(rooms, data)
        remove(data)
        run = {"data": data, "index": INDEX, "out": tmp_path / name / "store", "deterministic": True, **options}
        return atsplat.drift(atsplat.evaluate(nearest, PROTOCOL, **run), baseline).lost

    def without_context(data):
        entry = entries[second][0] if isinstance(entries[second], list) else entries[second]
        images = sorted((data / second).glob("*.png"), key=lambda path: int(path.stem))
        images[entry["context"][0]].unlink()

    def without_scene(data):
        shutil.rmtree(data / third)
        for path in list(data.rglob(f"{third}.txt")):
            path.unlink()

    assert lost_without(lambda data: None, "whole") == []
    skipped = lost_without(without_context, "skipped")
    assert len(skipped) == 3 and all(second in text and "skipped, " in text for text in skipped), skipped
    gone = lost_without(without_scene, "gone")
    assert len(gone) == 3 and all(third in text and "was not evaluated" in text for text in gone), gone
    assert lost_without(lambda data: None, "part", limit=1) == [], "a part that was asked for"


def test_what_a_new_baseline_no_longer_guards_is_a_warning(store, rooms, tmp_path):
    baseline = tmp_path / "baseline.json"
    atsplat.accept_baseline(store, baseline, why="first results")
    part = atsplat.evaluate(nearest, PROTOCOL, data=rooms, index=INDEX, out=tmp_path / "part", limit=1, deterministic=True)
    with pytest.warns(UserWarning, match=f"{3 * (SCENES - 1)} targets of the old baseline are no longer guarded, such as "):
        atsplat.accept_baseline(part, baseline, why="one scene")


def test_limits_come_from_repetitions_or_are_stated(rooms, tmp_path):
    def noisy(images, context, target):
        return np.clip(nearest(images, context, target) + np.random.default_rng().normal(scale=0.01), 0, 1)

    first, second = (
        atsplat.evaluate(noisy, PROTOCOL, data=rooms, index=INDEX, out=tmp_path / out, name="noisy") for out in ("first", "second")
    )
    baseline = tmp_path / "baseline.json"

    def limit_of_psnr(**options):
        atsplat.accept_baseline(first, baseline, why="noise", **options)
        limit = next(one for one in json.loads(baseline.read_text())["limits"] if one["metric"] == "psnr")
        return limit["runs"], limit["limit"]

    runs, estimated = limit_of_psnr(repeats=[second])
    assert runs == 2 and estimated >= 0.01
    assert limit_of_psnr() == (2, estimated), "kept"
    assert limit_of_psnr(limits={"PSNR": 0.5}) == (0, 0.5)
    assert limit_of_psnr() == (0, 0.5), "kept"
    shutil.copytree(second.path, tmp_path / "copy")
    for options, field, message in [
        ({"repeats": [first]}, "repeats", "found a copy of it"),
        ({"repeats": [second, tmp_path / "copy"]}, "repeats", "found a copy of another repetition"),
        ({"repeats": second}, "repeats", "expected a sequence of stores"),
        ({"limits": {"beauty": 0.5}}, "limits", "expected a metric with a limit"),
        ({"limits": {"psnr": 0.5, "Psnr": 0.1}}, "limits", "expected each metric once, found psnr"),
        ({"limits": {"psnr": -0.5}}, "limits", "expected a positive change of psnr"),
    ]:
        with pytest.raises(atsplat.InvalidError, match=message) as raised:
            atsplat.accept_baseline(first, baseline, why="noise", **options)
        assert raised.value.field == field


def test_an_unfinished_run_is_no_baseline(store, tmp_path):
    killed, baseline = tmp_path / "killed", tmp_path / "baseline.json"
    shutil.copytree(store.path, killed)
    provenance = json.loads((killed / "provenance.json").read_text())
    provenance["presets"][0]["entries"] += 1
    (killed / "provenance.json").write_text(json.dumps(provenance))
    with pytest.raises(atsplat.InvalidError, match="expected a finished run, found a store is not done") as raised:
        atsplat.accept_baseline(killed, baseline, why="first results")
    assert raised.value.field == "store" and not baseline.exists()


def test_the_probe_of_a_baseline_is_kept(store, binary, tmp_path):
    baseline = tmp_path / "baseline.json"
    binary("drift", "accept", store.path, "--baseline", baseline, "--why", "first results")
    recipe = json.loads(baseline.read_text())["probe"]["recipe"]
    atsplat.accept_baseline(store, baseline, why="the same results")
    accepted = json.loads(baseline.read_text())
    assert accepted["probe"]["recipe"] == recipe and len(accepted["history"]) == 2
    assert len(atsplat.drift(store, baseline, probe=True).report["attribution"]["stages"]) == 5


def test_the_first_baseline_has_the_probe_that_the_binary_gives_it(store, binary, tmp_path):
    ours, theirs = tmp_path / "ours.json", tmp_path / "theirs.json"
    atsplat.accept_baseline(store, ours, why="first results")
    binary("drift", "accept", store.path, "--baseline", theirs, "--why", "first results")
    assert json.loads(ours.read_text())["probe"] == json.loads(theirs.read_text())["probe"]
    assert (tmp_path / "ours.probe.safetensors").read_bytes() == (tmp_path / "theirs.probe.safetensors").read_bytes()
