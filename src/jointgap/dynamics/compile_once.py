"""One process compiles what several need at once, and whoever waits for it is told.

Jobs that start side by side with nothing kept yet would each compile the same. Whoever is first holds a lock, the
others wait and then find the result on disk. The kernel frees the lock of a process that ends, however it ends.
"""

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from numba.core import event

try:
    import fcntl
except ImportError:  # Windows: each process compiles for itself
    fcntl = None

PATIENCE = 300.0  # s after which a lock is taken for stuck
ANNOUNCED_AFTER = 1.0  # s

SECONDS = 15  # of one core, all that a first simulation needs
_LOADING = "loading the compiled simulation ..."
_COMPILING = f"compiling the simulation for this machine, once (about {SECONDS} s) ..."
_WAITING = f"waiting for another process to load the simulation, or to compile it (about {SECONDS} s) ..."

_said: set[str] = set()


def say(message: str) -> None:
    """Print a line on stderr, once in a process."""
    if message not in _said:
        _said.add(message)
        print(f"jointgap: {message}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def announced(message: str, after: float = ANNOUNCED_AFTER) -> Iterator[None]:
    """Say `message` if what is done meanwhile takes longer than `after` [s]."""
    timer = threading.Timer(after, say, (message,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


class _Announcer(event.Listener):
    """Says what takes long: loading, until numba begins to compile."""

    def __init__(self):
        self.stack, self.compiles = contextlib.ExitStack(), False
        self.stack.enter_context(announced(_LOADING))

    def on_start(self, event) -> None:
        if not self.compiles:  # functions that are called meanwhile are compiled within
            self.compiles = True
            self.stack.close()
            self.stack.enter_context(announced(_COMPILING))

    def on_end(self, event) -> None:
        pass


@contextlib.contextmanager
def _announced_loading_or_compiling() -> Iterator[None]:
    announcer = _Announcer()
    with announcer.stack, event.install_listener("numba:compile", announcer):
        yield


@contextlib.contextmanager
def locked(path: Path, patience: float = PATIENCE) -> Iterator[bool]:
    """Hold the lock file `path`, which stays behind, empty; or go on without."""
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o600) if fcntl else None
    except OSError:
        file = None
    if file is None:
        yield False
        return
    try:
        yield _taken(file, patience)
    finally:
        os.close(file)  # frees the lock


def _taken(file: int, patience: float) -> bool:
    end = time.monotonic() + patience
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            if time.monotonic() > end:
                return False
            time.sleep(0.05)
        except OSError:
            return False


def compiled_by_one(compile_function: Callable, lock: Path) -> Callable:
    """`compile_function`, called by one process at a time, and announced where it or the wait takes long."""

    def compile_once(signature):
        with contextlib.ExitStack() as stack:
            with announced(_WAITING):
                stack.enter_context(locked(lock))
            stack.enter_context(_announced_loading_or_compiling())
            return compile_function(signature)

    return compile_once
