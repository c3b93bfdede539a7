"""Evaluations on a Ray cluster of two nodes on this machine; skipped without Ray."""

import filecmp
import os
import sys
import threading
import time

import pytest
from conftest import INDEX, PROTOCOL, nearest

import atsplat


def evaluated(method, data, out, **options):
    return atsplat.evaluate(method, PROTOCOL, data=data, index=INDEX, out=out, **options)


def test_without_ray_the_error_says_what_to_install(rooms, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(atsplat.InvalidError, match="pip install ray") as raised:
        evaluated(nearest, rooms, tmp_path / "store", ray=True)
    assert raised.value.field == "ray"


def test_what_ray_cannot_do_is_rejected(rooms, data, tmp_path):
    rejected = [
        ({"ray": {"worker": 2}}, "ray"),
        ({"ray": True, "shard": (1, 2)}, "shard"),
        ({"ray": True, "keep_images": "all"}, "keep_images"),
    ]
    for options, field in rejected:
        with pytest.raises(atsplat.InvalidError) as raised:
            evaluated(nearest, rooms, tmp_path / "store", **options)
        assert raised.value.field == field
    with pytest.raises(atsplat.InvalidError, match="each worker"):
        atsplat.evaluate(nearest, PROTOCOL, data=data, out=tmp_path / "store", ray=True)
    evaluated(nearest, rooms, tmp_path / "store")
    with pytest.raises(atsplat.InvalidError, match="without results"):
        evaluated(nearest, rooms, tmp_path / "store", ray=True)


@pytest.fixture(scope="module")
def cluster():
    """Two nodes of one processor each; `cluster.second` may be killed."""
    ray = pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    quick = {"health_check_initial_delay_ms": 1000, "health_check_period_ms": 500, "health_check_failure_threshold": 4}
    small = {"num_cpus": 1, "object_store_memory": 100_000_000}
    cluster = Cluster(initialize_head=True, head_node_args={**small, "include_dashboard": False, "_system_config": quick})
    cluster.second = cluster.add_node(**small)
    ray.init(address=cluster.address, logging_level="warning", log_to_driver=False)
    # Workers cannot import the tests.
    for module in (nearest.__module__, __name__):
        ray.cloudpickle.register_pickle_by_value(sys.modules[module])
    yield cluster
    ray.shutdown()
    cluster.shutdown()


@pytest.fixture(scope="module")
def many(tmp_path_factory, binary):
    """Eight scenes, and their store by one process."""
    folder = tmp_path_factory.mktemp("many")
    binary("data", "simulate", folder / "rooms", "--scenes", 8, "--size", "128x128", "--samples", 1)
    return folder / "rooms/test", evaluated(nearest, folder / "rooms/test", folder / "store", deterministic=True, version=1)


def same(store, whole):
    """The files of rows, and what a table shows of them."""
    assert len(whole) == 24
    for rows in ("trials.parquet", "targets.parquet"):
        assert filecmp.cmp(f"{store.path}/{rows}", f"{whole.path}/{rows}", shallow=False)
    tables = [[table.to_csv() for table in atsplat.report(one)] for one in (store, whole)]
    assert tables[0] == tables[1]
    of_run = ("methods", "presets", "metrics", "warnings", "skipped", "limit", "shard", "command")
    assert [store.provenance[key] for key in of_run] == [whole.provenance[key] for key in of_run]
    return True


class Loaded:
    """A method that says where it was loaded, and where it was called."""

    def __init__(self, notes):
        import ray

        self.notes, self.node = notes, ray.get_runtime_context().get_node_id()
        self.note("loaded")

    def note(self, what):
        (self.notes / f"{what}-{self.node}-{os.getpid()}-{time.monotonic_ns()}").touch()

    def __call__(self, images, context, target):
        self.note("called")
        time.sleep(0.5)
        return nearest(images, context, target)


def test_a_lost_node_and_a_killed_worker_change_no_table(cluster, many, tmp_path):
    rooms, whole = many
    notes = tmp_path / "notes"
    notes.mkdir()
    second = cluster.second.node_id

    def kill():
        while not list(notes.glob(f"called-{second}-*")):
            time.sleep(0.05)
        cluster.remove_node(cluster.second, allow_graceful=False)
        seen = len(list(notes.glob("called-*")))
        while len(list(notes.glob("called-*"))) == seen:
            time.sleep(0.05)
        latest = max(notes.glob("called-*"), key=lambda note: int(note.name.split("-")[-1]))
        os.kill(int(latest.name.split("-")[2]), 9)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    steps = []
    store = evaluated(
        lambda: Loaded(notes), rooms, tmp_path / "store", name="nearest", deterministic=True, version=1,
        progress=lambda: steps.append(1), ray={"factory": True},
    )
    killer.join(1)
    assert not killer.is_alive()
    assert same(store, whole) and len(steps) == 8
    of = {what: [note.name.split("-")[1] for note in notes.glob(f"{what}-*")] for what in ("loaded", "called")}
    assert second in of["called"], "the lost node had begun a shard"
    assert len(of["called"]) >= 10, "two were evaluated again"
    assert len(of["loaded"]) == 3, "an actor keeps the method; a killed one is replaced"
    assert not (tmp_path / "store/shards").exists()


def test_a_worker_that_always_dies_ends_the_run_and_another_goes_on(cluster, many, tmp_path):
    rooms, whole = many
    out, calls = tmp_path / "store", tmp_path / "calls"
    calls.mkdir()

    def nearest_or_death(images, context, target, *, trial, deadly):
        (calls / f"{trial.scene}-{deadly}").touch()
        if deadly and trial.scene.endswith("6"):
            os._exit(1)
        return nearest(images, context, target)

    def method(deadly):
        return lambda images, context, target, trial: nearest_or_death(images, context, target, trial=trial, deadly=deadly)

    options = {"name": "nearest", "deterministic": True, "version": 1, "ray": {"shards": 4, "workers": 1, "retries": 1}}
    with pytest.raises(atsplat.AtsplatError, match="worker died with shard 4 of 4, 2 times"):
        evaluated(method(True), rooms, out, **options)
    assert sorted(os.listdir(out / "shards")) == ["1-of-4", "2-of-4", "3-of-4"]
    for change, differs in [({"version": 2}, "version"), ({"version": None}, "identity")]:
        with pytest.raises(atsplat.InvalidError, match=differs) as raised:
            evaluated(method(False), rooms, out, **{**options, **change})
        assert raised.value.field == "method"
    assert same(evaluated(method(False), rooms, out, **options), whole)
    assert sorted(call.name.split("-")[2] for call in calls.glob("*-False")) == ["00000006", "00000007"]


def test_errors_and_failed_rows_are_those_of_one_process(cluster, many, tmp_path):
    rooms, _ = many

    def broken(images, context, target, trial):
        raise ValueError(f"no idea of {trial.scene}")

    for out, ray in [("ray", {"workers": 1}), ("one", False)]:
        with pytest.raises(atsplat.AtsplatError, match="nothing was evaluated.*no idea of rooms-test-00000000"):
            evaluated(broken, rooms, tmp_path / out, ray=ray)
    stores = [atsplat.open_store(tmp_path / out) for out in ("ray", "one")]
    assert len(stores[0].failures()) == 8 and stores[0].trials() == stores[1].trials() and stores[0].rows() == stores[1].rows()
    with pytest.raises(atsplat.InvalidError, match="factory that returns a callable") as raised:
        evaluated(lambda: 3, rooms, tmp_path / "none", ray={"factory": True, "workers": 1})
    assert raised.value.field == "method"
