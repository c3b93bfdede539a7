"""What configurations are made of, and imports inside functions: a method with another value there is another method."""

import os
import subprocess
import sys
import textwrap
import types
import warnings

import numpy as np
import pytest
from conftest import INDEX, PROTOCOL, nearest

import atsplat
from atsplat import _methods
from atsplat._identity import examined, identity

IMPORTS = """
import argparse, array, collections, datetime, decimal, enum, fractions, functools, operator, re, types, typing
import numpy as np
class Items(dict):
    def __getattr__(self, name): return self[name]
class Linked(dict):
    def __init__(self, **items):
        super().__init__(items)
        self.__dict__ = self
class Silent(dict):
    __getattr__ = lambda self, name: self.get(name)
class Sequence(list): pass
class Pair(tuple): pass
class Group(set): pass
class Queue(collections.deque): pass
class Day(datetime.date): pass
class Number(float):
    def __repr__(self): return "a number"
class Text(str): pass
class Image(np.ndarray): pass
class Level(enum.Enum):
    LOW, HIGH, NESTED = 1, 2, (1, [2])
class Bits(enum.Flag):
    A, B = 1, 2
def having(value, **attributes):
    vars(value).update(attributes)
    return value
def itself(gain):
    found = argparse.Namespace(gain=gain)
    found.again, found.all = found, [found]
    return found
class Decorator:
    def __init__(self, function, gain):
        functools.update_wrapper(self, function)
        self.gain = gain
    def __call__(self, *views): return self.__wrapped__(*views) * self.gain
def plain(images, context, target): return images
class Descriptor:
    def __init__(self, gain): self.gain = gain
    def __get__(self, of, kind=None): return self.gain
class Private:
    __slots__ = "__gain",
    def __init__(self, gain): self.__gain = gain
class _More(Private):
    __slots__ = ("__gain", "other")
    def __init__(self, gain):
        super().__init__(1)
        self.__gain = gain
def setting(gain):
    def k(self): pass
    def k2(self, value): self.value = value * gain
    return property(k, k2), property(k, None, k2)
def dispatched(gain):
    def k(self, images): return images * gain
    return functools.singledispatchmethod(k)
"""
#: Each with a place for a number.
VALUES = [
    "argparse.Namespace(k={})", "types.SimpleNamespace(k=[{}])", "itself({})", "Items(k={})", "Linked(k={})", "Silent(k={})",
    "having(Items(), k={})", "Sequence([{}])", "having(Sequence(), k={})", "Pair([{}])", "having(Pair(), k={})", "Group([{}])",
    "having(Group(), k={})", "Queue([{}])", "collections.deque([{}])", "collections.deque([], {})", "collections.OrderedDict(k={})",
    "collections.defaultdict(lambda: {})", "collections.UserDict(k={})", "collections.ChainMap({{'k': {}}})",
    "fractions.Fraction({}, 7)", "decimal.Decimal({})", "re.compile('a' * {})", "re.compile(b'a', 1 << {})", "bytearray([{}])",
    "memoryview(bytes([{}]))", "array.array('d', [{}])", "datetime.timedelta({})", "datetime.datetime(2000, 1, {})", "Day(2000, 1, {})",
    "np.array([{}, 'a', None], dtype=object)", "np.array([(1, {{'k': {}}})], dtype='i4,O')", "operator.itemgetter({})",
    "operator.attrgetter('a' * {})", "operator.methodcaller('m', k={})", "np.vectorize(lambda x: x + {})", "{{'k': {}}}.get",
    "(1, {}).__getitem__", "Number({})", "having(Number(1), k={})", "Text({})", "having(np.zeros(1).view(Image), k={})", "Level({})",
    "[Level({})]", "Bits(1 + {})", "enum.Enum('Made', {{'ONE': {}}}).ONE", "enum.Enum('Made', {{'ONE': ({},)}})",
    "collections.namedtuple('T', ['a', 'b', 'c'][:: 3 - 2 * {}])", "Decorator(plain, {})",
    "type('C', (), {{'k': ({},)}})", "type('C', (), {{'k': {{1: {}}}}})", "type('C', (), {{'k': np.arange({})}})",
    "type('C', (), {{'k': [max, min, sum][{}]}})", "type('C', (), {{'__call__': [plain, lambda *x: 0, lambda *x: 1][{}]}})",
    "type('C', (), {{'k': functools.cached_property(lambda self: {})}})", "type('C', (), {{'k': functools.lru_cache(lambda self: {})}})",
    "having(lambda *views: 0, k={})", "Private({})", "_More({})",
    "type('C', (), {{'k': Descriptor({})}})", "type('C', (), {{'k': setting({})[0]}})", "type('C', (), {{'k': setting({})[1]}})",
    "type('C', (), {{'k': dispatched({})}})",
    "type('C', (), {{'k': functools.partialmethod(plain, {})}})", "type('M', (type,), {{'k': {}}})('C', (), {{}})",
]


def made(text):
    scope = {"__name__": "user"}
    exec(f"{IMPORTS}K = {text}\ndef method(images, context, target): return K", scope)
    return scope["method"]


@pytest.mark.parametrize("value", VALUES)
def test_configurations_are_part_of_a_method(value):
    one, same, two = (identity(made(value.format(number))) for number in (1, 1, 2))
    assert one == same and one != two
    assert examined(made(value.format(1)))[1] == []


def test_fields_of_an_enumeration_and_of_a_named_tuple_count():
    methods = {}
    for number in (1, 2):
        for kind in ("class E(enum.Enum):\n    A = ({}, 2)", "class E(enum.Enum):\n    A = 1\n    def gain(self): return {}",
                     "class E(typing.NamedTuple):\n    a: int = {}"):
            scope = {"__name__": "user"}
            exec(f"{IMPORTS}{kind.format(number)}\ndef method(images, context, target): return E", scope)
            methods.setdefault(kind, []).append(identity(scope["method"]))
    assert all(one != two for one, two in methods.values())


def test_configurations_have_the_same_identity_in_another_process(tmp_path):
    values = ", ".join(value.format(1) for value in VALUES)
    more = "{'a', 'b', 'c'}, Group(['x', 'y', 'z']), {Level.LOW, Level.HIGH}, frozenset({(1, 'a'), (2, 'b')}), itself(Group('abc'))"
    (tmp_path / "mine.py").write_text(f"{IMPORTS}K = [{values}, {more}]\ndef method(images, context, target): return K")
    code = "import mine\nfrom atsplat._identity import identity\nprint(identity(mine.method))"
    found = set()
    for seed in ("1", "2", "random"):
        env = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
        found.add(subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True).stdout)
    assert len(found) == 1 and "method, K" in found.pop()


METHOD = """
def method(images, context, target):
    from lazy_gain import gain
    return images * gain()
def relative(images, context, target):
    import lazy_package.inner
    from lazy_package import other as used
    import json, numpy.linalg
"""
FILES = {
    "lazy_gain.py": "import lazy_below\ndef gain(): return lazy_below.GAIN",
    "lazy_below.py": "GAIN = 1\nraise RuntimeError('is not imported')",
    "lazy_unused.py": "GAIN = 1",
    "lazy_package/__init__.py": "",
    "lazy_package/inner.py": "def f():\n    from .deep import leaf\n    from ..lazy_package import inner",
    "lazy_package/deep/__init__.py": "",
    "lazy_package/deep/leaf.py": "X = 1",
    "lazy_package/other.py": "not Python, but a file",
}


def test_modules_that_a_function_imports_are_part_of_it(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).write_text(text)
    scope = {"__name__": "user"}
    exec(METHOD, scope)
    before = {name: identity(scope[name]) for name in ("method", "relative")}
    assert set(before["method"]) == {"method", "module lazy_gain", "module lazy_below"}
    package = ["", ".inner", ".other", ".deep", ".deep.leaf"]
    assert set(before["relative"]) == {"relative", *(f"module lazy_package{name}" for name in package)}
    assert not {"lazy_gain", "lazy_below", "lazy_package"} & set(sys.modules), "nothing is imported"
    for file, changed in [("lazy_unused.py", []), ("lazy_below.py", ["method"]), ("lazy_package/deep/leaf.py", ["relative"])]:
        (tmp_path / file).write_text("GAIN = 2")
        after = {name: identity(scope[name]) for name in before}
        assert [name for name in before if before[name] != after[name]] == changed
        before = after
    import lazy_below

    assert identity(scope["method"]) == before["method"], "also when it was imported since"
    assert lazy_below.GAIN == 2


def test_modules_in_modules_and_in_attributes_are_part_of_a_method(tmp_path, monkeypatch):
    outer, inner = types.ModuleType("outer_of_test"), types.ModuleType("inner_of_test")
    outer.inner, inner.outer, inner.gain, inner.unused = inner, outer, 1, 1
    scope = {"__name__": "user", "outer": outer}
    exec("def method(images, context, target): return outer.inner.gain + outer.inner.outer.inner.gain", scope)
    before = identity(scope["method"])
    inner.unused = 2
    assert identity(scope["method"]) == before
    inner.gain = 2
    assert identity(scope["method"]) != before
    monkeypatch.syspath_prepend(str(tmp_path))
    found = []
    for gain in (1, 2):
        (tmp_path / "held_by_test.py").write_text(f"GAIN = {gain}")
        import held_by_test

        found.append(identity(made_with(types.SimpleNamespace(ops=held_by_test))))
    assert found[0] != found[1]


def made_with(value):
    def method(images, context, target):
        return value

    return method


def test_an_object_that_only_its_type_is_known_of_is_a_warning():
    def recorded(value, parameters=None, version=None):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            _methods.record(made_with(value), None, None, parameters or {}, "ATSplat", False, version)
        return [str(one.message) for one in caught]

    generators = [np.random.default_rng(0), np.random.default_rng(1), np.random.RandomState(0)]
    (said,) = recorded(generators)
    assert "Generator" in said and "RandomState" in said and "give parameters=… or version=…" in said
    assert len(recorded(generators, {"state-sha256": "0"})) == 1, "which Evaluation states"
    assert recorded(generators, {"seed": 0}) == recorded(generators, version=1) == []
    import logging
    import threading
    import typing

    commonplace = [np.arange(3), np.sin, np.sum, np.float32, max, str.upper, object(), logging.getLogger("a"), threading.Lock(),
                   list[int], typing.Optional[int], int | None, nearest, np.linalg, os.environ, sys.stderr, property(), NotImplemented]
    assert recorded(commonplace) == []
    torch = pytest.importorskip("torch")
    net = torch.nn.Sequential(torch.nn.Conv2d(3, 3, 3), torch.nn.BatchNorm2d(3))
    optimiser = torch.optim.Adam(net.parameters())
    assert recorded([net, net.forward, torch.no_grad()(nearest), optimiser, torch.relu, torch.nn.functional.relu, torch.float32]) == []


def test_numbers_of_modules_of_pytorch_count():
    torch = pytest.importorskip("torch")
    ways = [torch.nn.Conv2d(1, 1, 3, padding=1, dilation=dilation, bias=False) for dilation in (1, 1, 2)]
    for conv in ways:
        torch.nn.init.ones_(conv.weight)
    one, same, two = (identity(made_with(conv)) for conv in ways)
    assert one == same and one != two


def test_a_store_of_another_configuration_is_rejected(rooms, tmp_path):
    def method_of(gain):
        scope = {"__name__": "user", "nearest": nearest}
        exec(textwrap.dedent(f"""
            from argparse import Namespace
            args = Namespace(gain={gain})
            def method(images, context, target): return nearest(images, context, target) * args.gain
        """), scope)
        return scope["method"]

    def evaluated(gain, out, **options):
        return atsplat.evaluate(method_of(gain), PROTOCOL, data=rooms, index=INDEX, out=out, name="mine", **options)

    first = evaluated(0.5, tmp_path / "store")
    assert evaluated(0.5, tmp_path / "store").rows() == first.rows()
    with pytest.raises(atsplat.InvalidError, match=r"identity\.method, args"):
        evaluated(0.9, tmp_path / "store")
    parts = [evaluated(gain, tmp_path / f"part{k}", shard=(k, 2)) for k, gain in [(1, 0.5), (2, 0.9)]]
    with pytest.raises(atsplat.InvalidError, match="args"):
        atsplat.merge(parts, tmp_path / "merged")
