"""Runs the example notebook as a user would."""

import os
from pathlib import Path

import pytest
from conftest import INDEX

nbclient = pytest.importorskip("nbclient")
import nbformat  # noqa: E402


def test_the_notebook_runs_and_shows_its_table(tmp_path, monkeypatch):
    assert os.environ["ATSPLAT_BINARY"]
    monkeypatch.setenv("ATSPLAT_INDEX", str(INDEX))
    path = Path(__file__).resolve().parents[1] / "examples/score_a_method.ipynb"
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = notebook.cells[-1].outputs[0].data["text/html"]
    assert "<table" in shown and "blend" in shown and "nearest view" in shown
