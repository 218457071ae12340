"""Atomic writing of files."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import yaml

from jointgap.core.errors import InputError


def package_data(path: str) -> Any:
    """Content of a YAML file of the package, by its path in it."""
    file = Path(__file__).parents[1] / path
    return yaml.load(file.read_text(encoding="utf-8"), yaml.CSafeLoader)


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """A temporary path in the folder of `path`, which is created if necessary; removed in the
    end."""
    temporary = path.with_name(f".{path.stem}-{os.getpid()}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
    except OSError as error:
        why = error.strerror or error
        raise InputError(
            f"{path}: cannot be written ({why}); check permissions and disk space"
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_atomically(path: Path | str, save: Callable[[str], object]) -> None:
    """Write a file by `save(temporary_path)`, then rename it to `path`: no incomplete files."""
    with _beside(Path(path)) as temporary:
        save(str(temporary))
        temporary.replace(path)


def write_text(path: Path | str, text: str) -> None:
    """Write `text` to `path` in UTF-8; errors as `write_atomically`."""
    write_atomically(path, lambda temporary: Path(temporary).write_text(text, encoding="utf-8"))


def check_writable(*paths: Path | str) -> None:
    """InputError, before long computations, where files cannot be written."""
    taken = set()
    for path in map(Path, paths):
        if path.resolve() in taken:
            raise InputError(f"{path}: is the path of two results; give each its own file")
        taken.add(path.resolve())
        if path.is_dir():
            raise InputError(f"{path}: is a folder, not a file; give another name")
        missing_folders = [folder for folder in path.parents if not folder.exists()]
        try:
            with _beside(path) as temporary:
                temporary.touch()
        finally:  # no empty folders after a failure
            with suppress(OSError):  # missing, or in use
                for folder in missing_folders:
                    folder.rmdir()
