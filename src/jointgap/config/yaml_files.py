"""Files of settings, YAML or JSON, read strictly and laid over one another; from which file each value came.

A mechanism is the path of a file, the name of one that comes with jointgap, or its content, and it is whole. What is
laid over another one says so: ``base``, the path or name of that one, beside the keys that differ. A file may have a
``base`` too.
"""

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import yaml

from jointgap.core.errors import InputError

BASE = "base"
"""Key of a mechanism: the path of the one over which the keys beside it are laid."""

_TWO_MEANINGS = re.compile(
    r"[-+]?0[0-9_]+|[-+]?[0-9][0-9.]*[_:][0-9._:]*|[-+]?0(?:b[01_]*|o[0-7_]*|x[0-9a-f_]*)|yes|no|on|off",
    re.IGNORECASE,
)
"""Numbers and words that YAML 1.1, which Snakemake reads, and YAML 1.2 take for different things."""


class _StrictLoader(yaml.SafeLoader):
    """YAML whose every value means one thing, and whose keys stand once; days are text."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node:
        node = super().compose_node(parent, index)
        if isinstance(node, yaml.ScalarNode) and node.style is None and _TWO_MEANINGS.fullmatch(node.value):
            problem = (
                f"{node.value} is one thing to some programs and another to others; write a plain decimal number, true "
                f'or false, or "{node.value}" in quotation marks where a text is meant'
            )
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
        lines: dict[str, int] = {}
        for key, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            name, line = str(key.value), key.start_mark.line + 1
            if name in lines:
                problem = f"the key '{name}' is given twice, in line {lines[name]} and in line {line}; remove one"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            lines[name] = line
        return node


def _day(loader: _StrictLoader, node: yaml.ScalarNode) -> str:
    """The text of a day that there is: Snakemake's reader ends in a traceback on one that there is not."""
    loader.construct_yaml_timestamp(node)
    return node.value


_StrictLoader.add_constructor("tag:yaml.org,2002:timestamp", _day)


def read_yaml(path: Path | str) -> dict[str, Any]:
    """The mapping in a YAML file, or in a JSON file whose name ends in ``.json``.

    Numbers, true, false and null are read as such where YAML 1.1 and 1.2 agree; dates are text.

    Raises
    ------
    InputError
        No such file, no mapping, a key given twice, a value with two meanings; the message names file and line.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8 (byte {error.start}); save the file as UTF-8") from error
    # YAML would take 1e-9 for a text
    content = read_json(text, str(path)) if str(path).endswith(".json") else _parse_yaml(text, str(path))
    if isinstance(content, dict):
        return content
    what = "is empty" if content is None else "holds no keys"
    raise InputError(f"{path}: {what}; write a mapping of keys to values, such as 'key: value', a line each")


def _parse_yaml(text: str, source: str) -> Any:
    try:
        return yaml.load(text, _StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        what = "" if type(error) is yaml.MarkedYAMLError else "is not YAML: "
        raise InputError(f"{source}{where}: {what}{error.problem or error.context}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # signs that no text has, endless digits, nesting
        raise InputError(f"{source}: is not YAML: {error}") from error


def read_json(text: str, source: str) -> Any:
    """What a JSON `text` holds."""

    def without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in pairs]
        if double := next((key for key in keys if keys.count(key) > 1), None):
            raise ValueError(f"the key '{double}' is given twice in one mapping; remove one")
        return dict(pairs)

    try:
        return json.loads(text, object_pairs_hook=without_doubles)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source}: is not JSON: {error}") from error


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
    return reduce(merge, (layer.data for layer in layers), {})


def sources(layers: Iterable[Layer]) -> dict[tuple[str, ...], tuple[Any, str]]:
    """Of `layers`, the first one lowest: by the path of each key, its value and the source that it is from."""
    known: dict[tuple[str, ...], tuple[Any, str]] = {}
    for layer in layers:
        for path, value in leaves(layer.data):
            replaced = [other for other in known if path[: len(other)] == other or other[: len(path)] == path]
            for other in replaced:
                del known[other]
            known[path] = (value, layer.source)
    return known


def leaves(data: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The path of each key in nested mappings `data` that holds no further keys, after a `path`, and its value."""
    if not isinstance(data, Mapping):
        yield path, data
        return
    for key, value in data.items():
        yield from leaves(value, (*path, str(key)))


def mechanism_layers(mechanism: Any, folders: Sequence[Path], source: str, key: str) -> list[Layer]:
    """The layers of a mechanism, the lowest first: one, and one for each ``base``."""
    layers: list[Layer] = []
    passed: list[Path] = []
    while True:
        if isinstance(mechanism, str):
            file = mechanism_file(mechanism, folders, key)
            if file.resolve() in passed:
                raise InputError(f"{key}: '{mechanism}' is laid over itself; take it away where it is given last")
            passed.append(file.resolve())
            mechanism, source, folders, key = read_yaml(file), str(file), (file.parent, *folders), f"{file}: {BASE}"
        own = _with_files(mechanism, folders, key.removesuffix(f": {BASE}"))
        if not isinstance(mechanism, Mapping) or BASE not in mechanism:
            return [Layer(source, {"mechanism": own}), *reversed(layers)]
        mechanism, key = own.pop(BASE), key if key.endswith(BASE) else f"{key}.{BASE}"
        layers.append(Layer(source, {"mechanism": own}))
        if not isinstance(mechanism, str):
            raise InputError(f"{key} = {mechanism!r}: must be the path of a mechanism file")


def _with_files(mechanism: Any, folders: Sequence[Path], key: str) -> Any:
    """The content of a `mechanism` with the files of its effects looked for in `folders`."""
    if not isinstance(mechanism, Mapping):
        return mechanism
    mechanism = dict(mechanism)
    if isinstance(effects := mechanism.get("effects"), list | tuple):
        mechanism["effects"] = [
            with_file(effect, "parameters", folders, f"{key}: effects.{effect.get('name')}.parameters.file")
            if isinstance(effect, Mapping)
            else effect
            for effect in effects
        ]
    return mechanism


def with_file(data: Mapping[str, Any], section: str, folders: Sequence[Path], key: str) -> dict[str, Any]:
    """`data` with the ``file`` in a `section`, if there is one, looked for in `folders`; `key` is where it is given."""
    inner = data.get(section)
    if not isinstance(inner, Mapping) or not isinstance(inner.get("file"), str):
        return dict(data)
    return {**data, section: {**inner, "file": str(existing_file(inner["file"], folders, key))}}


def shipped_mechanisms() -> dict[str, Path]:
    """The mechanism files that come with jointgap, by name; wherever it is installed a name can stand for its path."""
    return {file.stem: file for file in sorted((Path(__file__).parents[1] / "data/mechanisms").glob("*.yaml"))}


def mechanism_file(mechanism: str, folders: Sequence[Path], key: str) -> Path:
    """The file of a mechanism: the one at this path in `folders`, else the shipped one of this name."""
    return existing_file(mechanism, folders, key, shipped_mechanisms())


def existing_file(path: str, folders: Sequence[Path], key: str, named: Mapping[str, Path] | None = None) -> Path:
    """The file at `path`, looked for in `folders`, or one that is `named` so; `key` is where it is given."""
    for folder in folders:
        if os.path.isfile(folder / path):  # a Path's own is_file fails on a name that is too long
            return folder / path
    if named and path in named:
        return named[path]
    places = ", ".join(dict.fromkeys(map(str, folders)))
    more = f", or one of the names {', '.join(named)}" if named else ""
    raise InputError(f"{key}: no file '{path}' (looked in {places}); give a path relative to one of these{more}")
