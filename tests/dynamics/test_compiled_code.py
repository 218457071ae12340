"""What compiled code is kept, where, for how long; one process compiles for all; who waits is told."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numba
import pytest
from numba.core import event

from jointgap.dynamics import numba_cache
from jointgap.dynamics.numba_cache import cache_folder, compiled, compiled_by_one, remove_old_folders

ROOT = Path(__file__).parents[2]
HOLD = "import fcntl, sys, time; f = open(sys.argv[1], 'w'); fcntl.flock(f, fcntl.LOCK_EX); print(1, flush=True)"


def folders(base, ages):
    for number, age in enumerate(ages):
        folder = base / f"{number:016x}"
        folder.mkdir()
        os.utime(folder, (time.time() - age, time.time() - age))


def test_every_way_of_calling_shares_one_cache(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    beside = tmp_path / "beside"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "one"))  # as scripts/in-venv sets it
    in_venv = cache_folder(beside)
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert in_venv == cache_folder(beside)
    assert in_venv.startswith(str(beside))


def test_the_environment_of_the_project_leaves_the_place_of_compiled_code_alone():
    assert "NUMBA_CACHE_DIR" not in (ROOT / "scripts/in-venv").read_text()


def test_compiled_code_of_earlier_sources_goes_but_for_the_newest_and_those_of_the_last_day(tmp_path):
    day = 24 * 3600
    folders(tmp_path, [60, 3600, *(days * day for days in range(2, 9))])
    (tmp_path / "not-a-digest").mkdir()
    os.utime(tmp_path / "not-a-digest", (0, 0))
    remove_old_folders(tmp_path)
    kept = {f"{number:016x}" for number in range(5)} | {"not-a-digest"}
    assert {folder.name for folder in tmp_path.iterdir()} == kept


def test_many_edits_of_one_day_are_kept_until_the_day_is_over(tmp_path):
    folders(tmp_path, range(10))
    remove_old_folders(tmp_path)
    assert len(list(tmp_path.iterdir())) == 10


def test_one_compiles_at_a_time(tmp_path):
    under_way = []
    seen = []

    def compile_slowly(signature):
        under_way.append(signature)
        seen.append(len(under_way))
        time.sleep(0.1)
        under_way.pop()

    compile_by_one = compiled_by_one(compile_slowly, tmp_path / "f.lock")
    threads = [threading.Thread(target=compile_by_one, args=((),)) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert seen == [1, 1, 1]


def test_the_lock_of_a_process_that_is_killed_is_free(tmp_path, monkeypatch, capsys):
    pytest.importorskip("fcntl")
    monkeypatch.setattr(numba_cache, "_said", set())
    lock = tmp_path / "f.lock"
    holder = subprocess.Popen([sys.executable, "-c", HOLD + "; time.sleep(60)", lock], stdout=subprocess.PIPE)
    holder.stdout.readline()
    threading.Timer(1.5, holder.kill).start()
    assert compiled_by_one(str, lock)(1) == "1"
    assert "waiting for another process" in capsys.readouterr().err
    holder.communicate()


def test_without_a_place_for_the_lock_the_work_goes_on(tmp_path):
    assert compiled_by_one(str, tmp_path / "absent" / "f.lock")(1) == "1"


def test_what_is_loaded_is_not_said_to_be_compiled(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(numba_cache, "_said", set())

    def load(signature):
        time.sleep(1.3)

    def compile_anew(signature):
        with event.trigger_event("numba:compile"):
            time.sleep(1.3)

    compiled_by_one(load, tmp_path / "f.lock")(())
    assert capsys.readouterr().err == ""
    compiled_by_one(compile_anew, tmp_path / "f.lock")(())
    said = capsys.readouterr().err
    assert "compiling the simulation" in said


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_what_compiled_code_calls_is_linked_into_it_and_python_may_call_it_too():
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
