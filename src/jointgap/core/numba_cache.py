"""Compilation for this machine, cached on disk."""

import contextlib
import hashlib
import os
import re
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numba
from numba.core import event
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher

try:
    import fcntl
except ImportError:  # Windows: each process compiles
    fcntl = None

ANNOUNCED_AFTER = 1.0  # s
SECONDS = 90  # on one core, for all functions
_COMPILING = f"compiling the simulation for this machine, once (about {SECONDS} s) ..."
_WAITING = f"waiting for another process to load or compile the simulation (about {SECONDS} s) ..."

_said: set[str] = set()


def say(message: str) -> None:
    """Print a line on stderr, once per process."""
    if message not in _said:
        _said.add(message)
        print(f"jointgap: {message}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def announced(message: str) -> Iterator[threading.Timer]:
    """A timer that, once started, prints `message` unless the block ends before."""
    timer = threading.Timer(ANNOUNCED_AFTER, say, (message,))
    timer.daemon = True
    try:
        yield timer
    finally:
        timer.cancel()


class _OnCompiling(event.Listener):
    """Starts a timer when numba first compiles (not when it loads from the cache)."""

    def __init__(self, timer: threading.Timer):
        self.timer = timer

    def on_start(self, event) -> None:
        if self.timer.ident is None:
            self.timer.start()

    def on_end(self, event) -> None:
        pass


def compiled_by_one(compile_function: Callable, lock: Path) -> Callable:
    """`compile_function`, by one process at a time, with a message if it or the wait takes long."""

    def compile_once(signature):
        with contextlib.ExitStack() as stack:
            with announced(_WAITING) as timer, contextlib.suppress(OSError):
                timer.start()
                file = stack.enter_context(open(lock, "a"))
                if fcntl:
                    fcntl.flock(file, fcntl.LOCK_EX)
            timer = stack.enter_context(announced(_COMPILING))
            stack.enter_context(event.install_listener("numba:compile", _OnCompiling(timer)))
            return compile_function(signature)

    return compile_once


_NO_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

AVAILABLE = numba.version_info.short == (0, 68)
"""Whether numba's internals are those that this file requires; otherwise functions are compiled in
numba's way."""


class _LinkedCode(JITCodeLibrary):
    """Code for linking: optimised per function, but neither as a whole nor to machine code."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _ToLink(Compiler):
    def define_pipelines(self):
        self.state.flags.no_compile = True
        self.state.library = _LinkedCode(
            self.state.targetctx.codegen(), self.state.func_id.func_qualname
        )
        return super().define_pipelines()


class _Part(CPUDispatcher):
    """A function for calls from compiled code; its libraries replace the missing entry points."""

    def add_overload(self, cres) -> None:
        self.overloads[tuple(cres.signature.args)] = cres
        self.targetctx.insert_user_function(cres.library, cres.fndesc, [cres.library])

    def get_overload(self, sig):
        return self.overloads[tuple(sig)].library


def linked_where_called(dispatcher: Dispatcher) -> Callable:
    """`dispatcher`, which compiled code calls in its linked form, and Python as usual."""
    if AVAILABLE:
        options = dispatcher.targetoptions | _NO_WRAPPERS
        part = _Part(dispatcher.py_func, targetoptions=options, pipeline_class=_ToLink)
        dispatcher.get_call_template, dispatcher.get_overload = (
            part.get_call_template,
            part.get_overload,
        )
    return dispatcher


_PACKAGE = Path(__file__).parent.parent
_ELSEWHERE = (
    "core/formula.py",
    "core/numba_cache.py",
    "core/records.py",
    "config/friction_laws.py",
    "effects/pivots.py",
    "effects/slides.py",
)
_LINKAGE = ("linkage/drive.py", "linkage/laws.py", "linkage/parameters.py")
SOURCES = (
    *(path for room in ("contact", "motion") for path in sorted((_PACKAGE / room).rglob("*.py"))),
    *(_PACKAGE / name for name in (*_ELSEWHERE, *_LINKAGE)),
)
"""Source files of the compiled code."""


def _is_usable(folder: Path) -> bool:
    """Whether `folder` can be created, belongs to the user and is writable; permission bits are not
    sufficient (root, mounts).

    Compiled code in another user's folder is not trusted.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryFile(dir=folder):
            return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()
    except OSError:
        return False


def cache_folder(sources_folder: Path) -> str:
    """First usable one of: the user's choice, a folder next to the sources, the user's cache, the
    temporary folder.

    Independent of the caller: commands, notebooks and jobs of an installation share it. '' (numba's
    own choice) when none is usable.
    """
    sources = b"".join(path.read_bytes() for path in SOURCES)
    digest = hashlib.sha256(sources).hexdigest()[:16]
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    user = f"jointgap-{os.getuid()}" if hasattr(os, "getuid") else "jointgap"
    bases = [
        *([Path(chosen) / "jointgap"] if chosen else []),
        sources_folder,
        Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "jointgap",
        Path(tempfile.gettempdir()) / user,
    ]
    for base in bases:
        if _is_usable(base / digest):
            os.utime(base / digest)  # time of last use
            remove_old_folders(base)
            return str(base / digest)
    return ""


_KEPT, _RECENT = 5, 24 * 3600.0  # the newest folders and those of the last day [s] may be in use


def remove_old_folders(base: Path) -> None:
    """Remove folders of other source versions in `base`, except the newest and those used within
    the last day."""
    with contextlib.suppress(OSError):  # removed by another process at the same time
        used = {
            path: path.stat().st_mtime
            for path in base.iterdir()
            if re.fullmatch("[0-9a-f]{16}", path.name)
        }
        for path in sorted(used, key=used.get)[:-_KEPT]:
            if used[path] < time.time() - _RECENT:
                shutil.rmtree(path, ignore_errors=True)


_FOLDER = cache_folder(_PACKAGE / "motion" / "__pycache__")


def compiled(function, **flags) -> Callable:
    """`function` as machine code: cached on disk, without the interpreter's lock, with IEEE
    division.

    Products and sums may fuse (faster, smaller rounding errors); nothing else is reordered.
    """
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _FOLDER or before
    try:
        code = numba.njit(
            cache=True,
            nogil=True,
            error_model="numpy",
            fastmath={"contract"},
            no_cfunc_wrapper=True,
            **flags,
        )(function)
    finally:
        numba.config.CACHE_DIR = before
    if not isinstance(code, Dispatcher):
        return code  # a plain function: NUMBA_DISABLE_JIT
    if _FOLDER:
        lock = Path(_FOLDER) / f"{function.__module__}.{function.__qualname__}.lock"
        code.compile = compiled_by_one(code.compile, lock)
    return linked_where_called(code)


def inlined(function) -> Callable:
    """`compiled`, and inlined at every call."""
    return compiled(function, forceinline=True)
