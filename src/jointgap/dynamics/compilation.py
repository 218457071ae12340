"""Compilation of the numerical core, cached on disk where the installation may be written to and where it may not.

numba renews a cached function when the file that holds it changes, but not when a function that it calls in another
file does. The cache folder is therefore named after a digest of all sources of this package, of the formulas' operation
codes, of the friction laws' codes and of the list of joints: any change compiles anew. Folders of earlier sources are
removed once they are old.
"""

import contextlib
import hashlib
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numba
from numba.core.dispatcher import Dispatcher

from jointgap.dynamics.compile_once import compiled_by_one
from jointgap.dynamics.linked_code import linked_where_called

_PACKAGE = Path(__file__).parent
_ELSEWHERE = ("formula.py", "joints.py", "config/friction_laws.py")
SOURCES = (*sorted(_PACKAGE.rglob("*.py")), *(_PACKAGE.parent / name for name in _ELSEWHERE))
"""All that compiled code of this package is made from."""


def _is_usable(folder: Path) -> bool:
    """Whether `folder` can be made, is one's own and takes files; permission bits alone do not say so (root, mounts).

    Compiled code in a folder of somebody else is not to be trusted.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryFile(dir=folder):
            return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()
    except OSError:
        return False


def cache_folder(beside: Path) -> str:
    """First usable place of: the user's choice, `beside` the sources, the user's cache, the temporary folder.

    It does not depend on what calls: command, notebook and job of the same installation share it. Returns an empty
    string (numba's own choice) when none is usable.
    """
    sources = b"".join(path.read_bytes() for path in SOURCES)
    digest = hashlib.sha256(sources).hexdigest()[:16]
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    user = f"jointgap-{os.getuid()}" if hasattr(os, "getuid") else "jointgap"
    bases = [
        *([Path(chosen) / "jointgap"] if chosen else []),
        beside,
        Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "jointgap",
        Path(tempfile.gettempdir()) / user,
    ]
    for base in bases:
        if _is_usable(base / digest):
            os.utime(base / digest)  # says when it was used last
            remove_old_folders(base, digest)
            return str(base / digest)
    return ""


_KEPT, _RECENT = 4, 24 * 3600.0  # the newest folders and those of the last day [s]: somebody may be using them


def remove_old_folders(base: Path, digest: str) -> None:
    """Remove the folders of other digests in `base` but the newest few and those used within the last day."""
    used = {}
    with contextlib.suppress(OSError):  # another process may be removing the same
        for folder in os.scandir(base):
            if (
                re.fullmatch("[0-9a-f]{16}", folder.name)
                and folder.name != digest
                and folder.is_dir(follow_symlinks=False)
            ):
                used[folder.path] = folder.stat().st_mtime
    for path in sorted(used, key=used.get, reverse=True)[_KEPT:]:
        if used[path] < time.time() - _RECENT:
            shutil.rmtree(path, ignore_errors=True)


_FOLDER = cache_folder(_PACKAGE / "__pycache__")


def compiled(function, **flags) -> Callable:
    """`function` as machine code: cached on disk, free of the interpreter's lock, dividing by IEEE rules.

    Products and sums may fuse (faster and rounding less); nothing else is reordered.
    """
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _FOLDER or before
    try:
        code = numba.njit(
            cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, no_cfunc_wrapper=True, **flags
        )(function)
    finally:
        numba.config.CACHE_DIR = before
    if not isinstance(code, Dispatcher):
        return code  # the function itself: NUMBA_DISABLE_JIT
    if _FOLDER:
        lock = Path(_FOLDER) / f"{function.__module__}.{function.__qualname__}.lock"
        code.compile = compiled_by_one(code.compile, lock)
    return linked_where_called(code)


def inlined(function) -> Callable:
    """`compiled`, and put in wherever it is called: for what runs millions of times."""
    return compiled(function, forceinline=True)
