"""Simulated rooms, and images that the binary rendered of them."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

import atsplat

WORKSPACE = Path(__file__).resolve().parents[3]
INDEX = WORKSPACE / "eval/indices/rooms-2v.json"
PROTOCOL = "rooms-2v-128"
SCENES = 3


def record_skip(report):
    """Appends a skipped test to the file from which CI lists them, as the tests in Rust do (tests/src/lib.rs)."""
    log = os.environ.get("ATSPLAT_SKIP_LOG")
    if log and report.skipped and isinstance(report.longrepr, tuple):
        name = report.nodeid.split("[")[0].split("/")[-1].split("::")[-1]
        reason = " ".join(report.longrepr[-1].split()).removeprefix("Skipped: ")
        with open(log, "a", encoding="utf-8") as file:
            file.write(f"SKIPPED {name}: {reason}\n")


pytest_runtest_logreport = pytest_collectreport = record_skip


@pytest.fixture(scope="session")
def binary():
    """Runs the binary; its standard output."""
    path = os.environ["ATSPLAT_BINARY"]

    def run(*arguments, succeeds=True):
        done = subprocess.run([path, *map(str, arguments)], capture_output=True, text=True)
        assert (done.returncode == 0) == succeeds, done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="session")
def rooms(tmp_path_factory, binary):
    """RE10K-like scenes of 128 × 128."""
    folder = tmp_path_factory.mktemp("data") / "rooms"
    binary("data", "simulate", folder, "--scenes", SCENES, "--size", "128x128", "--samples", 1)
    return folder / "test"


@pytest.fixture(scope="session")
def warped(tmp_path_factory, rooms, binary):
    """A store of the plane warp with its images as PNG."""
    out = tmp_path_factory.mktemp("stores") / "warp"
    common = (PROTOCOL, "--data", rooms, "--index", INDEX, "--limit", SCENES)
    binary("run", *common, "--method", "warp", "--keep-images", "all", "--out", out)
    return out


@pytest.fixture
def data(rooms):
    return atsplat.protocol(PROTOCOL).open(rooms, index=INDEX)


@pytest.fixture
def trials(data):
    return list(atsplat.protocol(PROTOCOL).trials(data))


def nearest(context_images, context_cameras, target_cameras):
    """The context image whose camera is closest to each target's."""
    apart = np.linalg.norm(target_cameras.centres[:, None] - context_cameras.centres[None], axis=-1)
    return context_images[apart.argmin(axis=1)]
