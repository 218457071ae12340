"""Compilation of the numerical core, cached on disk where the installation may be written to and where it may not.

numba renews a cached function when the file that holds it changes, but not when a function that it calls in another
file does. The cache folder is therefore named after a digest of all sources of this package, of the formulas' operation
codes and of the list of joints: any change compiles anew.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numba
from numba.core.dispatcher import Dispatcher

from jointgap.dynamics.linked_code import linked_where_called

_PACKAGE = Path(__file__).parent
SOURCES = (*sorted(_PACKAGE.rglob("*.py")), _PACKAGE.parent / "formula.py", _PACKAGE.parent / "joints.py")
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

    Returns an empty string (numba's own choice) when none is.
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
            return str(base / digest)
    return ""


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
    return linked_where_called(code) if isinstance(code, Dispatcher) else code  # the function itself: NUMBA_DISABLE_JIT


def inlined(function) -> Callable:
    """`compiled`, and put in wherever it is called: for what runs millions of times."""
    return compiled(function, forceinline=True)
