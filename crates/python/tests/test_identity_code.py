"""Which code is a method's: what runs, under names that several things have, in files and in compiled extensions."""

import functools
import glob
import importlib.util
import itertools
import os
import subprocess
import sys
import sysconfig
import textwrap

import pytest

from atsplat import _methods
from atsplat._identity import LISTED, RULES, examined, identity
from atsplat._walk import Walk


def method_of(text, **scope):
    scope = {"__name__": "user", "functools": functools, **scope}
    exec(textwrap.dedent(text), scope)
    return scope["method"]


def differ(*methods):
    """Whether methods differ from each other, and none of them has parts that are not seen."""
    found = [examined(method) for method in methods]
    assert all(unseen == [] for _, unseen in found)
    return all(a[0] != b[0] for a, b in itertools.combinations(found, 2))


LOCAL = """
def make(gain):
    def method(images, context, target):
        def scale(v):
            gain = v.mean()
            return lambda y: y / gain
        return scale(images)(images) * gain
    return method
"""
COMPREHENSION = """
def make(gain):
    def method(images, context, target):
        return [lambda y: y * gain for gain in (1, 2)][0](images) * gain
    return method
"""


@pytest.mark.parametrize("text", [LOCAL, COMPREHENSION])
def test_a_variable_of_a_scope_inside_is_not_the_method_s_state(text):
    make = method_of(f"{text}\nmethod = make")
    assert differ(make(1.0), make(2.0))


def test_what_a_scope_inside_assigns_by_nonlocal_is_state():
    make = method_of("""
        def method(calls):
            def counting(images, context, target):
                def count():
                    nonlocal calls
                    calls += 1
                count()
                return images
            return counting
    """)
    assert identity(make(1)) == identity(make(2))


TABLE = """
TABLE = {"same": lambda x: x, "half": lambda x: x * 0.5}
chosen = TABLE[CHOICE]
class Held:
    table = TABLE
    def __init__(self): self.chosen = self.table[CHOICE]
    def __call__(self, images, context, target): return self.chosen(images)
"""


def test_the_one_of_several_functions_of_one_name_counts():
    for method in ("def method(images, context, target): return chosen(images) if chosen in TABLE.values() else 0", "method = Held()"):
        assert differ(*(method_of(TABLE + method, CHOICE=choice) for choice in ("same", "half")))

    def scaling(gain):
        return lambda images: images * gain

    def through(*steps):
        return lambda images, context, target: functools.reduce(lambda image, step: step(image), steps, images)

    a, b = scaling(2), scaling(3)
    assert differ(through(a, b, a), through(a, b, b))
    one, two = (type("Gain", (), {"gain": gain}) for gain in (1, 2))
    assert differ(through(one, two, one), through(one, two, two))


def test_functions_in_sets_have_the_same_identity_in_another_process(tmp_path):
    (tmp_path / "mine.py").write_text(textwrap.dedent("""
        def scaling(gain): return lambda x: x * gain
        STEPS = [scaling(gain) for gain in range(9)]
        SET, KEYS, PAIRS = set(STEPS), {step: 1 for step in set(STEPS)}, {(step, 1) for step in STEPS}
        used = STEPS[4]
        def method(images, context, target): return SET, KEYS, PAIRS, used
    """))
    code = """if True:
        import mine, sys
        from atsplat._identity import identity
        mine.used = mine.STEPS[int(sys.argv[1])]
        print(identity(mine.method))
    """
    env = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    arguments = ["4", "4", "4", "4", "5"]
    # Memory is laid out in another way each time.
    found = [subprocess.run([sys.executable, "-c", "x = [object() for _ in range(" + str(at * 999) + ")]\n" + code, which],
                            env=env, capture_output=True, text=True, check=True).stdout for at, which in enumerate(arguments)]
    assert len(set(found[:4])) == 1 and found[4] != found[0]


def imported_from(folder, name, text):
    (folder / f"{name}.py").write_text(text)
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


OLD = "def method(i, c, t):\n    return i * 0.5\n"


@pytest.mark.parametrize("edited", [OLD.replace("0.5", "0.75"), f"# Below.\n\n{OLD}"])
def test_the_identity_is_that_of_the_code_that_runs(tmp_path, monkeypatch, edited):
    name = "edited_by_test"
    monkeypatch.setitem(sys.modules, name, None)
    module = imported_from(tmp_path, name, OLD)
    before = identity(module.method)
    for _ in range(100):
        module.method(1, 2, 3)
    assert identity(module.method) == before, "whatever the interpreter makes of it"
    (tmp_path / f"{name}.py").write_text(edited)
    running = identity(module.method)
    assert module.method(1, 2, 3) == 0.5
    new = imported_from(tmp_path, name, edited)
    assert running != identity(new.method)
    assert (identity(new.method) == before) == ("0.5" in edited), "a text counts wherever it is in a file"


@pytest.mark.parametrize("edited", ["GAIN = 1\ndef gain(): return 2\n", "GAIN = 2\ndef gain(): return 1\n"])
def test_a_module_whose_file_has_changed_since_it_was_imported_is_a_warning(tmp_path, monkeypatch, edited):
    # Constants are compared with the compiled form of a module.
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.syspath_prepend(str(tmp_path))
    file, method = tmp_path / "changed_since.py", method_of("""
        def method(images, context, target):
            import changed_since
    """)
    file.write_text("GAIN = 1\ndef gain(): return 1\n")
    before = examined(method)
    monkeypatch.setitem(sys.modules, "changed_since", None)
    del sys.modules["changed_since"]
    importlib.import_module("changed_since")
    assert examined(method) == before and before[1] == []
    file.write_text(edited)
    parts, unseen = examined(method)
    assert unseen == ["the module changed_since, whose file has changed since it was imported"]
    del sys.modules["changed_since"]
    assert len({str(found) for found in (parts, identity(method), before[0])}) == 3, "it is neither the new file nor the old one"


def test_compiled_extensions_that_are_not_installed_count_by_their_files(tmp_path, monkeypatch):
    folder = sysconfig.get_config_var("DESTSHARED") or ""
    found = sorted(file for name in ("_bisect", "_heapq", "_json") for file in glob.glob(f"{folder}/{name}.*"))
    if not found:
        pytest.skip("this Python has its extensions inside")
    file = tmp_path / os.path.basename(found[0])
    name = file.name.split(".")[0]
    content = open(found[0], "rb").read()
    file.write_bytes(content)
    spec = importlib.util.spec_from_file_location(f"of_test.{name}", file)
    # As torch.utils.cpp_extension.load does, without an entry in sys.modules.
    extension = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(extension)
    function = next(value for value in vars(extension).values() if type(value) is type(len))
    made = type("Made", (), {"__module__": extension.__name__})
    methods = {
        "module": method_of(f"def method(images, context, target): return extension.{function.__name__}", extension=extension),
        "function": method_of("def method(images, context, target): return function", function=function),
        "object": method_of("def method(images, context, target): return made", made=made()),
    }
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, extension.__name__, extension)
        before = {key: examined(method) for key, method in methods.items()}
        # What follows an ELF file's sections is not loaded. The old file is still mapped.
        file.unlink()
        file.write_bytes(content + b"\0")
        after = {key: examined(method) for key, method in methods.items()}
    for key in methods:
        changed = {part for part, hashed in after[key][0].items() if hashed != before[key][0][part]}
        assert changed == {f"module of_test.{name}"}
    assert [len(after[key][1]) for key in methods] == [0, 0, 1], "what an object holds is not seen"


def test_the_versions_of_installed_packages_are_parts(tmp_path, monkeypatch):
    for folder in ("site-packages", "site-packages/of_test-2.5.dist-info"):
        (tmp_path / folder).mkdir()
    (tmp_path / "site-packages/of_test.py").write_text("def render(images): return images\n")
    (tmp_path / "site-packages/of_test-2.5.dist-info/METADATA").write_text("Metadata-Version: 2.1\nName: of_test\nVersion: 2.5\n")
    (tmp_path / "site-packages/of_test-2.5.dist-info/top_level.txt").write_text("of_test\n")
    monkeypatch.syspath_prepend(str(tmp_path / "site-packages"))
    from atsplat import _files

    _files._distributions.cache_clear()
    monkeypatch.delitem(sys.modules, "of_test", raising=False)
    import of_test

    methods = [method_of("def method(images, context, target): return of_test.render(images)", of_test=of_test),
               method_of("def method(images, context, target): return render(images)", render=of_test.render)]
    assert [identity(method)["package of_test"] for method in methods] == ["of_test 2.5"] * 2
    of_test.__version__ = "2.4"
    assert [identity(method)["package of_test"] for method in methods] == ["2.4"] * 2, "which is loaded"
    assert identity(of_test.render)["package of_test"] == "2.4" and "render" in identity(of_test.render)
    monkeypatch.delitem(sys.modules, "of_test")
    _files._distributions.cache_clear()


def test_records_say_by_which_rules_they_were_hashed():
    class Called:
        def __init__(self, **attributes):
            vars(self).update(attributes)

        def __call__(self, images, context, target):
            return images

    def recorded(method):
        return _methods.json.loads(_methods.record(method, "mine", None, {}, "ATSplat", False))["parameters"]["identity"]

    many = functools.partial(Called(), **{f"of_{n}": Called(value=n) for n in range(3)})
    for method, expected in [(len, 2), (Called(), 2), (many, 2), (Called(draw=len), 2), (Called(draw=len, weight=3), RULES)]:
        found = recorded(method)
        assert list(found)[0] == min(found) == "(rules)", "also where names are sorted"
        assert found["(rules)"] == str(expected)
    # Which of its parts are attributes is not seen.
    text = "\n".join([f"v{n} = {n}" for n in range(LISTED)] + [f"def method(*_): return {', '.join(f'v{n}' for n in range(LISTED))}"])
    assert recorded(method_of(text))["(rules)"] == str(RULES)


def test_what_has_no_attributes_of_its_own_is_hashed_as_before():
    class Called:
        def __init__(self, **attributes):
            vars(self).update(attributes)

        def __call__(self, images, context, target):
            return images

    def before(method):
        walk = Walk()
        return walk.value(method).hex()[:16]

    for method in (Called(), Called(draw=len, apply=differ, of=functools)):
        assert identity(method)["method"] == before(method)
    assert identity(Called(weight=3))["method"] != before(Called(weight=3))
