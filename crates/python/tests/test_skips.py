"""Skipped tests are seen."""

import os
import subprocess
import sys
from pathlib import Path

MODULE = """
import pytest
pytest.importorskip("no_module_of_this_name")
"""

TESTS = """
import pytest

@pytest.fixture
def lacking():
    pytest.importorskip("no_module_of_this_name")

@pytest.mark.parametrize("path", ["a/b", "c"])
def test_of_two(path):
    if path == "a/b":
        pytest.skip("not\\nthis one")

def test_of_a_fixture(lacking):
    pass
"""


def test_skipped_modules_and_tests_reach_the_log(tmp_path):
    conftest = (Path(__file__).parent / "conftest.py").read_text()
    for name, text in [("conftest", conftest), ("test_module", MODULE), ("test_parts", TESTS)]:
        (tmp_path / f"{name}.py").write_text(text)
    log = tmp_path / "skipped"
    environment = {**os.environ, "ATSPLAT_SKIP_LOG": str(log)}
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", "--rootdir", tmp_path, tmp_path], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    absent = "could not import 'no_module_of_this_name': No module named 'no_module_of_this_name'"
    expected = [f"SKIPPED test_module.py: {absent}", "SKIPPED test_of_a_fixture: " + absent, "SKIPPED test_of_two: not this one"]
    assert sorted(log.read_text().splitlines()) == expected
