"""Commands killed at any moment leave complete files and can be repeated."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fuzz.command import check_tables, fuzz

pytestmark = pytest.mark.slow

PARAMETERS = {"clearance": {"from": "0.1 mm", "to": "1 mm"}, "friction": {"from": 0, "to": 0.2}}
OPTIONS = {
    "mechanism": "erkaya2009",
    "simulate": {"revolutions": 2, "samples_per_revolution": 360, "tolerance": "1e-8 m"},
    "sweep": {"number": 50, "parameters": PARAMETERS},
}
COMMANDS = {
    "simulate": ("--options", "mine.yaml", "--results", "out"),
    "sweep": ("--options", "mine.yaml", "--results", "out", "--workers", "1"),
}


def started(folder: Path, command: str) -> subprocess.Popen:
    words = [sys.executable, "-m", "jointgap", command, *COMMANDS[command]]
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    return subprocess.Popen(words, cwd=folder, text=True, start_new_session=True, **quiet)


def completed(folder: Path, command: str) -> tuple[dict[str, bytes], float]:
    """The tables that a command leaves, and its wall time [s]."""
    began = time.monotonic()
    process = started(folder, command)
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    left = {
        str(path.relative_to(folder)): path.read_bytes()
        for path in (folder / "out").rglob("*.parquet")
        if not path.name.startswith(".")
        or path.parent.name == "designs"  # other programs read all of a dataset
    }
    return left, time.monotonic() - began


@pytest.fixture(scope="module", params=COMMANDS)
def undisturbed(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    (folder / "mine.yaml").write_text(yaml.safe_dump(OPTIONS))
    completed(folder, request.param)  # compiles
    shutil.rmtree(folder / "out")
    return folder, request.param, *completed(folder, request.param)


@settings(fuzz, max_examples=3)
@given(st.floats(0.02, 1.02))
def test_a_killed_command_can_be_repeated(undisturbed, share):
    folder, command, wanted, seconds = undisturbed
    shutil.rmtree(folder / "out", ignore_errors=True)
    process = started(folder, command)
    time.sleep(share * seconds)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    check_tables(folder / "out")
    assert completed(folder, command)[0] == wanted
