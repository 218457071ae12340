"""Configurations in layers: what is laid over what, and from which file each value came.

A mechanism is the path of a file, the name of one that comes with jointgap, or its content, and it is whole; other
mechanisms are not in it. What is laid over another mechanism says so: ``base``, the path or name of that one, beside
the keys that differ. A file may have a ``base`` too.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jointgap.core.errors import InputError

BASE = "base"
"""Key of a mechanism: the path of the one over which the keys beside it are laid."""


@dataclass(frozen=True)
class Layer:
    """Keys with their values, and where these are written."""

    source: str
    data: Mapping[str, Any]


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with `over` laid on it: mappings merge key by key, everything else is replaced."""
    merged = dict(base)
    for key, value in over.items():
        both = isinstance(merged.get(key), Mapping) and isinstance(value, Mapping)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def merged(layers: Iterable[Layer]) -> dict[str, Any]:
    """All `layers` laid on one another, the first one lowest."""
    whole: dict[str, Any] = {}
    for layer in layers:
        whole = merge(whole, layer.data)
    return whole


def sources(layers: Iterable[Layer]) -> dict[tuple[str, ...], tuple[Any, str]]:
    """Of `layers`, the first one lowest: by the path of each key, its value and the source that it is from."""
    known: dict[tuple[str, ...], tuple[Any, str]] = {}
    for layer in layers:
        for path, value in leaves(layer.data):
            known = {other: entry for other, entry in known.items() if not (_holds(path, other) or _holds(other, path))}
            known[path] = (value, layer.source)
    return known


def leaves(data: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The path of each key in nested mappings `data` that holds no further keys, after a `path`, and its value."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield from leaves(value, (*path, str(key)))
    else:
        yield path, data


def _holds(outer: tuple[str, ...], inner: tuple[str, ...]) -> bool:
    return inner[: len(outer)] == outer


def mechanism_layers(
    mechanism: Any, folders: Sequence[Path], source: str, read: Callable[[Path], Mapping[str, Any]], key: str
) -> list[Layer]:
    """The layers of a mechanism, the lowest first: one, and one for each ``base``."""
    found: list[Layer] = []
    passed: list[Path] = []
    while True:
        if isinstance(mechanism, str):
            file = mechanism_file(mechanism, folders, key)
            if file.resolve() in passed:
                raise InputError(f"{key}: '{mechanism}' is laid over itself; take it away where it is given last")
            passed.append(file.resolve())
            mechanism, source, folders, key = read(file), str(file), (file.parent, *folders), f"{file}: {BASE}"
        elif isinstance(mechanism, Mapping) and BASE in mechanism:
            own = {name: value for name, value in mechanism.items() if name != BASE}
            own = _with_files(own, folders, key.removesuffix(f": {BASE}"))
            found.append(Layer(source, {"mechanism": own}))
            mechanism, key = mechanism[BASE], key if key.endswith(BASE) else f"{key}.{BASE}"
            if not isinstance(mechanism, str):
                raise InputError(f"{key} = {mechanism!r}: must be the path of a mechanism file")
        else:
            mechanism = _with_files(mechanism, folders, key.removesuffix(f": {BASE}"))
            return [Layer(source, {"mechanism": mechanism}), *reversed(found)]


def _with_files(mechanism: Any, folders: Sequence[Path], key: str) -> Any:
    """The content of a `mechanism` with the files of its effects looked for in `folders`."""
    effects = mechanism.get("effects") if isinstance(mechanism, Mapping) else None
    if not isinstance(effects, list | tuple):
        return mechanism
    looked = []
    for effect in effects:
        given = effect.get("parameters") if isinstance(effect, Mapping) else None
        if isinstance(given, Mapping) and isinstance(given.get("file"), str):
            file = existing_file(given["file"], folders, f"{key}: effects.{effect.get('name')}.parameters.file")
            effect = {**effect, "parameters": {**given, "file": str(file)}}
        looked.append(effect)
    return {**mechanism, "effects": looked}


def shipped_mechanisms() -> dict[str, Path]:
    """The mechanism files that come with jointgap, by name; wherever it is installed a name can stand for its path."""
    return {file.stem: file for file in sorted((Path(__file__).parents[1] / "data/mechanisms").glob("*.yaml"))}


def mechanism_file(mechanism: str, folders: Sequence[Path], key: str) -> Path:
    """The file of a mechanism: the one at this path in `folders`, else the shipped one of this name."""
    shipped = shipped_mechanisms()
    if mechanism in shipped and _found(mechanism, folders) is None:
        return shipped[mechanism]
    return existing_file(mechanism, folders, key, f", or one of the names {', '.join(shipped)}")


def existing_file(path: str, folders: Sequence[Path], key: str, more: str = "") -> Path:
    """The file at `path`, looked for in `folders`; `key` is where it is given, `more` what else could be given."""
    file = _found(path, folders)
    if file is None:
        places = ", ".join(dict.fromkeys(map(str, folders)))
        raise InputError(f"{key}: no file '{path}' (looked in {places}); give a path relative to one of these{more}")
    return file


def _found(path: str, folders: Sequence[Path]) -> Path | None:
    # a Path's own is_file fails on a name that is too long
    return next((folder / path for folder in folders if os.path.isfile(folder / path)), None)
