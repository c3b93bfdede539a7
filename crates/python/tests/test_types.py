"""Type hints as a user's strict type checker sees them; skipped without mypy."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import atsplat

pytest.importorskip("mypy")

CODE = """
from __future__ import annotations
from typing import Any
import numpy as np
import atsplat

def method(images: np.ndarray, context: atsplat.Cameras, target: atsplat.Cameras) -> np.ndarray:
    return images[:1].repeat(len(target), axis=0)

def each(data: atsplat.Data) -> list[atsplat.Skipped]:
    trials: atsplat.Trials = data.protocol.trials(data, limit=1)
    for trial in trials:
        mean: float = trial.score(trial.context.images).mean["psnr"]
        one: float = atsplat.psnr(trial.context.images[0], trial.context.images[1])
    return [*data.missing, *trials.skipped]

single: float = atsplat.psnr(np.zeros((3, 3, 3)), np.zeros((3, 3, 3)))
several: np.ndarray = atsplat.ssim(np.zeros((2, 3, 3, 3)), np.zeros((2, 3, 3, 3)))
store: atsplat.Store = atsplat.evaluate(method, "p", data="d", out="o", version=1, strict=True, background=(0, 0, 0), ray={"workers": 2})
"""
WRONG = """
atsplat.evaluate(method, "p", data="d", out="o", ray={"workerz": 1})
text: str = store.rows()
"""


def test_a_strict_type_checker_accepts_calls_and_finds_mistakes(tmp_path):
    env = {**os.environ, "MYPYPATH": str(Path(atsplat.__file__).parents[1])} if "site-packages" not in atsplat.__file__ else None

    def checked(code):
        (tmp_path / "user.py").write_text(textwrap.dedent(code))
        command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--cache-dir", tmp_path / "cache", "user.py"]
        return subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True).stdout

    assert checked(CODE).startswith("Success"), checked(CODE)
    found = checked(CODE + WRONG)
    assert "RayOptions" in found and 'variable has type "str"' in found, found
