"""Files of settings, YAML or JSON, read strictly and laid over one another; from which file each value came.

A mechanism is the path of a file, the name of one that comes with jointgap, or its content, and it is whole. What is
laid over another one says so: ``base``, the path or name of that one, beside the keys that differ. A file may have a
``base`` too.
"""

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from jointgap.core.errors import InputError

BASE = "base"
"""Key of a mechanism: the path of the one over which the keys beside it are laid."""

_TWO_MEANINGS = re.compile(
    r"[-+]?0[0-9_]+|[-+]?[0-9][0-9.]*[_:][0-9._:]*|[-+]?0[box][0-9a-f_]*|yes|no|on|off", re.IGNORECASE
)
"""Numbers and words that YAML 1.1, which Snakemake reads, and YAML 1.2 take for different things."""


class _StrictLoader(yaml.SafeLoader):
    """YAML whose every value means one thing, and whose keys stand once; days are text."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node:
        event = self.peek_event()
        if tag := getattr(event, "tag", None):
            self._refuse(f"the tag {tag} is not read; take it away", event)
        if isinstance(event, yaml.ScalarEvent) and event.implicit[0] and _TWO_MEANINGS.fullmatch(event.value):
            self._refuse(
                f"{event.value} is one thing to some programs and another to others; write a plain decimal number, "
                f'true or false, or "{event.value}" in quotation marks where a text is meant',
                event,
            )
        return super().compose_node(parent, index)

    def compose_mapping_node(self, anchor: str | None) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                line = key.start_mark.line + 1
                if before := lines.get(key.value):
                    self._refuse(
                        f"the key '{key.value}' is given twice, in line {before} and in line {line}; remove one", key
                    )
                lines[key.value] = line
        return node

    @staticmethod
    def _refuse(problem: str, where: yaml.Node | yaml.Event) -> None:
        raise yaml.MarkedYAMLError(problem=problem, problem_mark=where.start_mark)


def _day(loader: _StrictLoader, node: yaml.ScalarNode) -> str:
    """The text of a day that there is: Snakemake's reader ends in a traceback on one that there is not."""
    loader.construct_yaml_timestamp(node)
    return loader.construct_yaml_str(node)


_StrictLoader.add_constructor("tag:yaml.org,2002:timestamp", _day)
_StrictLoader.add_constructor("tag:yaml.org,2002:value", yaml.SafeLoader.construct_yaml_str)


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
    content = parse_json(text, str(path)) if str(path).endswith(".json") else _parse_yaml(text, str(path))
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


def parse_json(text: str, source: str) -> Any:
    """What a JSON `text` holds."""

    def refuse(constant: str) -> float:
        raise InputError(f"{source}: holds {constant}, which is not a number; remove it")

    def without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in pairs]
        if double := next((key for key in keys if keys.count(key) > 1), None):
            raise InputError(f"{source}: the key '{double}' is given twice in one mapping; remove one")
        return dict(pairs)

    try:
        return json.loads(text, parse_constant=refuse, object_pairs_hook=without_doubles)
    except InputError:
        raise
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
