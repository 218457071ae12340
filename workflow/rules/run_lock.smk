# One run at a time works in a folder, however it was started. scripts/run-workflow, which `make` calls, waits for the lock before
# Snakemake looks at what is there, and hands it on as an open file. Snakemake itself refuses: what it has looked at
# would be out of date after waiting. The kernel takes the lock back when the run ends or is killed.

import fcntl
import os
import sys
from pathlib import Path

RUN_LOCK = Path(".cache/run.lock")
RUN_LOCK_HANDED_ON = 9  # the number of the open file in scripts/run-workflow
run_lock_held = []  # an open file that nobody keeps is closed


def hold_run_lock():
    """Hold the lock of the folder until the end of this process, or refuse to go on."""
    if run_lock_held:
        return
    RUN_LOCK.parent.mkdir(exist_ok=True)
    lock = open(RUN_LOCK, "a")
    run_lock_held.append(lock)
    try:
        if os.path.sameopenfile(RUN_LOCK_HANDED_ON, lock.fileno()):
            return
    except OSError:  # no such open file
        pass
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        sys.exit(
            "jointgap: error: another run works in this folder; try again when it has ended, or use `make`, which waits"
        )
