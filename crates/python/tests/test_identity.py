"""What a method is: equal in every process, and different when its code or values are."""

import functools
import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from conftest import INDEX, PROTOCOL, nearest

import atsplat
from atsplat import _methods
from atsplat._identity import LISTED, identity, modules

SHARPNESS = 2.0


def helper(images):
    return images**SHARPNESS


def through_a_helper(images, context, target):
    return helper(images)


def made(value, default=1):
    def method(images, context, target, scale=default):
        return images * scale, value

    return method


class Held:
    def __init__(self, weight):
        self.weight = weight

    def __call__(self, images, context, target):
        return images * self.weight

    def run(self, images, context, target):
        return self(images, context, target)


VALUES = [1, 2, 1.0, True, None, "a", b"a", (1, 2), (2, 1), [1, 2], {"a": 1, "b": 2}, {"a": 1, "b": 3}, {1, 2}, {1, 3},
          np.arange(3), np.arange(3.0), np.zeros((2, 1)), np.zeros((1, 2)), np.float32(1), slice(3), Held(1), Held(2), np.sin, np.cos]


def test_every_value_has_an_identity_of_its_own():
    for make in (made, lambda value: made(None, value), lambda value: functools.partial(nearest, extra=value),
                 lambda value: Held(value), lambda value: Held(value).run):
        found = [tuple(sorted(identity(make(value)).items())) for value in VALUES]
        assert len(set(found)) == len(VALUES)
        assert found == [tuple(sorted(identity(make(value)).items())) for value in VALUES]
    assert identity(made({"b": 2, "a": 1})) == identity(made({"a": 1, "b": 2})), "whatever the order"


def test_what_differs_is_named(monkeypatch):
    before = identity(through_a_helper)
    assert set(before) == {"through_a_helper", "helper", "helper, SHARPNESS"}
    monkeypatch.setitem(globals(), "SHARPNESS", 3.0)
    assert {name for name, part in identity(through_a_helper).items() if part != before[name]} == {"helper, SHARPNESS"}

    def helper(images):
        return images

    monkeypatch.setitem(globals(), "helper", helper)
    assert "helper, SHARPNESS" not in identity(through_a_helper)
    assert identity(through_a_helper)["helper"] != before["helper"]


def test_attributes_of_the_object_that_is_called_are_named():
    class Counting:
        def __init__(self):
            self.calls, self.weights = 0, np.arange(3)

        def __call__(self, images, context, target):
            self.calls += 1
            return images

    counting = Counting()
    for method in (counting, counting.__call__, functools.partial(counting)):
        before = identity(method)
        counting(1, 2, 3)
        after = identity(method)
        assert before.keys() == after.keys() >= {"method", "method.calls", "method.weights"}
        assert {name for name in after if after[name] != before[name]} == {"method.calls"}


def test_state_that_a_method_assigns_itself_is_no_part_of_it():
    calls = 0

    def counting(images, context, target):
        nonlocal calls
        calls += 1
        return images

    before = identity(counting)
    counting(1, 2, 3)
    assert calls == 1 and identity(counting) == before

    @functools.lru_cache
    def cached(images):
        return images

    assert set(identity(lambda images, context, target: cached(images))) > {"cached"}


def test_many_parts_are_listed_in_short():
    namespace = {}
    for number in range(60):
        exec(f"def part{number}(x): return x + {number}", namespace)
    exec("def method(images, context, target): return [" + ", ".join(f"part{n}(images)" for n in range(60)) + "]", namespace)
    listed = identity(namespace["method"])
    assert len(listed) == LISTED and any(name.endswith(" others") for name in listed)
    exec("def part59(x): return x - 59", namespace)
    assert identity(namespace["method"]) != listed


def test_the_identity_is_that_of_another_process(tmp_path):
    (tmp_path / "mine.py").write_text(textwrap.dedent("""
        import numpy as np
        WEIGHTS, NAMES = np.arange(5.0), {"b", "a", "c"}
        class Part:
            def __init__(self): self.options = {"x": {1, 2}, "y": object()}
            def apply(self, x): return x
        part = Part()
        def method(images, context, target):
            if "a" in {"b", "a", "zz", "q"}: return part.apply(images) * WEIGHTS[0]
            return NAMES
    """))
    code = """if True:
        import mine
        from atsplat._identity import identity
        print(identity(mine.method), identity(lambda a, b, c: mine.method(a, b, c)))
    """
    found = set()
    for seed in ("1", "2", "random"):
        env = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
        found.add(subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True).stdout)
    assert len(found) == 1 and "method, WEIGHTS" in found.pop()


def test_modules_are_found_and_their_state_counts():
    torch = pytest.importorskip("torch")

    class Net(torch.nn.Module):
        def __init__(self, weight, gain=1.0):
            super().__init__()
            self.inner, self.drop, self.gain = torch.nn.Linear(1, 1), torch.nn.Dropout(0.5), gain
            torch.nn.init.constant_(self.inner.weight, weight)
            torch.nn.init.zeros_(self.inner.bias)

        def forward(self, images, context, target):
            return self.drop(images)

    def ways(net):
        def closure(images, context, target):
            return net(images, context, target)

        return [net, net.forward, lambda *views: net(*views), functools.partial(lambda net, *views: net(*views), net),
                Held(net), Held([net]).run, torch.no_grad()(closure)]

    nets = [Net(1.0), Net(1.0), Net(2.0), Net(1.0, gain=3.0)]
    for first, same, other, gain in zip(*map(ways, nets)):
        assert identity(first) == identity(same)
        assert identity(first) != identity(other) and identity(first) != identity(gain)
    for way in ways(nets[0]):
        assert [id(module) for module in modules(way)] == [id(nets[0])]
    nets[0].train(not nets[0].training)
    assert identity(nets[0]) == identity(nets[1]), "the mode is none of its state"
    assert modules(nearest) == []


def evaluated(method, rooms, out, **options):
    return atsplat.evaluate(method, PROTOCOL, data=rooms, index=INDEX, out=out, name="mine", **options)


def darker(factor):
    def method(images, context, target):
        return factor * nearest(images, context, target)

    return method


def test_another_method_under_the_same_name_is_rejected(rooms, tmp_path):
    first = evaluated(darker(0.5), rooms, tmp_path / "store")
    assert evaluated(darker(0.5), rooms, tmp_path / "store").rows() == first.rows()
    with pytest.raises(atsplat.InvalidError, match=r"mine in .*identity\.method, factor: .*another folder") as raised:
        evaluated(darker(0.9), rooms, tmp_path / "store")
    assert raised.value.field == "method" and raised.value.file == str(tmp_path / "store")
    with pytest.raises(atsplat.InvalidError, match="identity"):
        evaluated(nearest, rooms, tmp_path / "store")
    parts = [evaluated(darker(factor), rooms, tmp_path / f"part{k}", shard=(k, 2)) for k, factor in [(1, 0.5), (2, 0.9)]]
    with pytest.raises(atsplat.InvalidError, match="factor") as raised:
        atsplat.merge(parts, tmp_path / "merged")
    assert raised.value.field == "stores"


def test_results_under_other_rules_are_rejected_as_such(rooms, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(_methods, "rules", lambda parts: 1)
        old = evaluated(darker(0.5), rooms, tmp_path / "one", shard=(1, 2))
        # As before there were any.
        patch.setattr(_methods, "_identity", lambda method, stated: identity(method))
        evaluated(darker(0.5), rooms, tmp_path / "none", shard=(1, 2))
    for folder, found in (("one", 1), ("none", "none")):
        with pytest.raises(atsplat.InvalidError, match=rf"by another version of atsplat.*\(rules\): {found} and 2"):
            evaluated(darker(0.5), rooms, tmp_path / folder, shard=(1, 2))
    with pytest.raises(atsplat.InvalidError, match=r"\(rules\): 1 and"):
        atsplat.merge([old, evaluated(darker(0.5), rooms, tmp_path / "two", shard=(2, 2))], tmp_path / "merged")


def test_a_version_replaces_the_code(rooms, tmp_path):
    first = evaluated(darker(0.5), rooms, tmp_path / "store", version="1")
    assert evaluated(darker(0.9), rooms, tmp_path / "store", version="1").rows() == first.rows()
    assert "identity" not in first.provenance["methods"][0]["parameters"]
    for version in ("2", None):
        with pytest.raises(atsplat.InvalidError, match="version"):
            evaluated(darker(0.5), rooms, tmp_path / "store", version=version)


def test_failed_trials_are_tried_again(rooms, tmp_path):
    calls, broken = tmp_path / "calls", tmp_path / "broken"
    broken.touch()

    def method(images, context, target, trial):
        with calls.open("a") as file:
            file.write(f"{trial.scene}\n")
        if trial.scene.endswith("1") and broken.exists():
            raise RuntimeError("out of memory")
        return nearest(images, context, target)

    with pytest.warns(UserWarning, match="1 × trials of mine failed: .*out of memory"):
        first = evaluated(method, rooms, tmp_path / "store")
    assert len(first.failures()) == 1
    broken.unlink()
    calls.unlink()
    assert not evaluated(method, rooms, tmp_path / "store").failures()
    assert [scene[-1] for scene in calls.read_text().split()] == ["1"], "finished trials are kept"


def test_a_value_that_a_helper_loads_once_is_state_and_its_modules_are_found(monkeypatch):
    namespace = {}
    exec(textwrap.dedent("""
        loaded, shape, log = None, (1, 2), []
        def load():
            global loaded
            loaded = loaded or make()
            return loaded
        def method(images, context, target):
            return load(), loaded, images.shape
    """), namespace)
    namespace["make"] = lambda: 3
    before = identity(namespace["method"])
    namespace["method"](np.zeros(3), None, None)
    assert namespace["loaded"] == 3 and identity(namespace["method"]) == before
    namespace["shape"] = (3, 4)
    assert identity(namespace["method"]) == before, "an attribute is not a global"
    torch = pytest.importorskip("torch")
    namespace["loaded"] = torch.nn.Linear(1, 1)
    assert modules(namespace["method"]) == [namespace["loaded"]]
