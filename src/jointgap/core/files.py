"""Files are written whole or not at all."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from jointgap.core.errors import InputError


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """The place of a temporary file in the folder of `path`, which is made if need be; gone in the end."""
    temporary = path.with_name(f".{path.stem}-{os.getpid()}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"{path}: cannot be written ({why}); check permission and space") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_atomically(path: Path | str, save: Callable[[str], object]) -> None:
    """Let `save(temporary_path)` write a file beside `path`, then rename it: nothing half-written stays behind."""
    with _beside(Path(path)) as temporary:
        save(str(temporary))
        temporary.replace(path)


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
        made = [folder for folder in path.parents if not folder.exists()]
        try:
            with _beside(path) as temporary:
                temporary.touch()
        finally:  # work that fails leaves no empty folders
            with suppress(OSError):  # not there, or in use by now
                for folder in made:
                    folder.rmdir()
