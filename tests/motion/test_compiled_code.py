"""The cache of compiled code."""

import os
import subprocess
import sys
import time

import numba
import pytest

from jointgap.core import numba_cache
from jointgap.core.numba_cache import compiled, compiled_by_one, remove_old_folders
from jointgap.motion.slider_crank import model_of
from tests.motion.cases import mechanism, options

HOLD = (
    "import fcntl, sys; f = open(sys.argv[1], 'w'); fcntl.flock(f, fcntl.LOCK_EX); print(1,"
    " flush=True); input()"
)


def test_old_compiled_code_is_removed_except_recent_folders(tmp_path):
    now, day = time.time(), 24 * 3600
    ages = {
        f"{i:016x}": age for i, age in enumerate([60, 3600, *(days * day for days in range(2, 9))])
    }
    for name, age in (ages | {"not-a-digest": now}).items():
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (now - age, now - age))
    remove_old_folders(tmp_path)
    assert {folder.name for folder in tmp_path.iterdir()} == {*list(ages)[:5], "not-a-digest"}


def test_the_lock_of_a_killed_process_is_released(tmp_path):
    pytest.importorskip("fcntl")
    lock = tmp_path / "f.lock"
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, lock], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    holder.stdout.readline()
    holder.kill()
    holder.communicate()
    assert compiled_by_one(str, lock)(1) == "1"
    # without a folder for the lock the work continues
    assert compiled_by_one(str, tmp_path / "absent" / "f.lock")(1) == "1"


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_compiled_code_links_its_callees_and_python_can_call_them():
    assert numba_cache.AVAILABLE, "the pinned numba is not the one that linked_code is written for"

    @compiled
    def halved(x):
        return 0.5 * x

    @compiled
    def quartered(x):
        return halved(halved(x))

    assert quartered(3.0) == 0.75
    assert not halved.overloads
    assert halved(3.0) == 1.5


def test_workspaces_begin_at_a_line_of_the_cache():
    """Elsewhere vectors lie across two lines, and a step takes up to half as long again."""
    model = model_of(mechanism(), options())
    workspaces = [model.workspace() for _ in range(20)]
    workspaces += [each.copy() for each in workspaces]
    assert {int(each.k.place) % 64 for each in workspaces} == {0}
