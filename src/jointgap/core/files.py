"""Files are written whole or not at all."""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from jointgap.core.errors import InputError


def write_atomically(path: Path | str, save: Callable[[str], object]) -> None:
    """Let `save(temporary_path)` write a file beside `path`, then rename it: nothing half-written stays behind."""
    path = Path(path)
    temporary = _temporary_file(path)
    try:
        save(temporary)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        Path(temporary).unlink(missing_ok=True)  # still there where something failed


def write_text(path: Path | str, text: str) -> None:
    """Write `text` to `path` in UTF-8, whole or not at all; errors as `write_atomically`."""
    write_atomically(path, lambda temporary: Path(temporary).write_text(text, encoding="utf-8"))


def check_writable(*paths: Path | str) -> None:
    """Make sure that files can be written, before hours of work whose result would find no place."""
    taken = set()
    for path in map(Path, paths):
        if path.resolve() in taken:
            raise InputError(f"{path}: is named for two results; give each a file of its own")
        taken.add(path.resolve())
        if path.is_dir():
            raise InputError(f"{path}: is a folder, not a file; give another name")
        Path(_temporary_file(path)).unlink()


def _temporary_file(path: Path) -> str:
    """An empty temporary file in the folder of `path`, which is made if need be."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
        os.close(handle)
    except OSError as error:
        raise _unwritable(path, error) from error
    return temporary


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be written ({error.strerror or error}); check permission and space")


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current
