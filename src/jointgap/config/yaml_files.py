"""YAML and JSON files, read strictly and merged.

A mechanism is the path of a file, the name of a shipped one, or its content, complete. It may
instead modify another one: ``base``, the path or name of that one, together with the keys that
differ. A file may have a ``base`` too.
"""

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from math import tau
from pathlib import Path
from typing import Any

import yaml

from jointgap.core.errors import InputError
from jointgap.core.words import joined

BASE = "base"
"""Key of a mechanism: the path of the one that its other keys modify."""

FILL_IN = "FILL_IN"
"""Value of a key that `jointgap new` cannot know."""

_TWO_MEANINGS = re.compile(
    r"[-+]?0[0-9_]+|[-+]?[0-9][0-9.]*[_:][0-9._:]*"
    r"|[-+]?0(?:b[01_]*|o[0-7_]*|x[0-9a-f_]*)|yes|no|on|off",
    re.IGNORECASE,
)
"""Numbers and words that differ between YAML 1.1, which Snakemake reads, and YAML 1.2."""


_NO_QUOTES_BEFORE = r"(?m)^[^#'\"\n]*?"
_DECIMAL_COMMAS = (
    # a number between entries that are separated by comma and space
    rf"{_NO_QUOTES_BEFORE}\[(?=[^\]\n]*, )[^\]\n]*?(?<![\w.,])([-+]?\d+,\d+)(?![\d.,])",
    # a key without value
    rf"{_NO_QUOTES_BEFORE}\{{[^}}\n]*:\s*([-+]?\d+,\d+)(?![\d.])[^,:}}\n]*[,}}]",
)
"""Numbers such as 2,4 in brackets and braces, where a comma separates entries."""


class _StrictLoader(yaml.SafeLoader):
    """YAML without ambiguous values and duplicate keys; dates are text."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node:
        node = super().compose_node(parent, index)
        if isinstance(node, yaml.ScalarNode):
            if node.style is None and _TWO_MEANINGS.fullmatch(node.value):
                problem = (
                    f"{node.value} differs between YAML versions; write a plain decimal number,"
                    f' true or false, or "{node.value}" in quotation marks for a text'
                )
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
        elif isinstance(node, yaml.MappingNode):
            lines: dict[str, int] = {}
            for key, _ in node.value:
                name, line = str(key.value), key.start_mark.line + 1
                if name in lines:
                    problem = (
                        f"the key '{name}' is a duplicate, in lines {lines[name]} and {line};"
                        " remove one"
                    )
                    raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
                lines[name] = line
        return node


def _day(loader: _StrictLoader, node: yaml.ScalarNode) -> str:
    """The text of a valid date; Snakemake's reader fails with a traceback on an invalid one."""
    loader.construct_yaml_timestamp(node)
    return node.value


_StrictLoader.add_constructor("tag:yaml.org,2002:timestamp", _day)


def read_yaml(path: Path | str) -> dict[str, Any]:
    """The mapping in a YAML file, or in a JSON file whose name ends in ``.json``.

    Numbers, true, false and null are recognised where YAML 1.1 and 1.2 agree; dates are text.

    Raises
    ------
    InputError
        No such file, not a mapping, a duplicate key, an ambiguous value, or values to fill in; the
        message contains file and line or key.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is not text in UTF-8 (byte {error.start}); save the file as UTF-8"
        ) from error
    # YAML would read 1e-9 as text
    parse = read_json if str(path).endswith(".json") else _parse_yaml
    content = parse(text, str(path))
    if not isinstance(content, dict):
        problem = "is empty" if content is None else "has no keys"
        raise InputError(
            f"{path}: {problem}; write a mapping of keys to values, such as 'key: value', one per"
            " line"
        )
    if missing := [".".join(key) for key, value in _entries(content) if value == FILL_IN]:
        keys = f"{joined(missing)} {'is' if len(missing) == 1 else 'are'} not filled in"
        raise InputError(f"{path}: {keys}; replace each {FILL_IN} by the value, with its unit")
    return content


def _parse_yaml(text: str, source: str) -> Any:
    for pattern in _DECIMAL_COMMAS:
        if comma := re.search(pattern, text):
            number, line = comma[1], text.count("\n", 0, comma.start(1)) + 1
            raise InputError(
                f"{source}, line {line}: {number} has a decimal comma, which separates entries"
                f" here; write {number.replace(',', '.')}, or a space after every comma"
            )
    try:
        return yaml.load(text, _StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        prefix = "" if type(error) is yaml.MarkedYAMLError else "is not YAML: "
        raise InputError(f"{source}{place}: {prefix}{error.problem or error.context}") from error
    # invalid characters, endless digits, nesting
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{source}: is not YAML: {error}") from error


def read_json(text: str, source: str) -> Any:
    """The content of a JSON `text`."""

    def without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in pairs]
        if double := next((key for key in keys if keys.count(key) > 1), None):
            raise ValueError(f"the key '{double}' is a duplicate; remove one")
        return dict(pairs)

    try:
        return json.loads(text, object_pairs_hook=without_doubles)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source}: is not JSON: {error}") from error


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` overridden by `over`: mappings merge key by key, everything else is replaced."""
    merged = dict(base)
    for key, value in over.items():
        both = isinstance(merged.get(key), Mapping) and isinstance(value, Mapping)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def leaves(data: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Path and value of each key in nested mappings `data` that is not a mapping itself, below a
    `path`."""
    if not isinstance(data, Mapping):
        yield path, data
        return
    for key, value in data.items():
        yield from leaves(value, (*path, str(key)))


def _entries(data: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """As `leaves`, and the entries of lists, by their id or number."""
    for key, value in leaves(data, path):
        if isinstance(value, list):
            for number, entry in enumerate(value):
                name = entry.get("id", number) if isinstance(entry, Mapping) else number
                yield from _entries(entry, (*key, str(name)))
        else:
            yield key, value


def plain_speeds(path: Path | str) -> list[str]:
    """A remark on each crank or motor speed without a unit in a YAML file; programs write JSON
    files in SI units."""
    if str(path).endswith(".json"):
        return []
    remarks = []
    for keys, value in _entries(read_yaml(path)):
        is_speed = not {"speed", "no_load_speed"}.isdisjoint(keys)
        if not is_speed or keys[-1] == "number":  # of values of a sweep
            continue
        try:
            speed = float(value)
        except (TypeError, ValueError):  # with a unit
            continue
        remarks.append(
            f"{path}: {'.'.join(keys)} = {speed:g} has no unit and is read as {speed:g} rad/s,"
            f" {60 * speed / tau:.5g} rpm; write '{speed:g} rad/s' or '{speed:g} rpm'"
        )
    return remarks


def complete_mechanism(
    mechanism: Any, folders: Sequence[Path], key: str, files: tuple[Path, ...] = ()
) -> Any:
    """The content of a mechanism, merged over its ``base``; `files` are those that refer to it."""
    if isinstance(mechanism, str):
        path = mechanism_file(mechanism, folders, key)
        if (file := path.resolve()) in files:
            raise InputError(
                f"{key}: '{mechanism}' is its own base; remove the last reference to it"
            )
        folders = (path.parent, *folders)
        return complete_mechanism(read_yaml(path), folders, str(path), (*files, file))
    content = with_effect_files(mechanism, folders, key)
    if not isinstance(content, Mapping) or BASE not in content:
        return content
    base, key = content.pop(BASE), f"{key}{': ' if files else '.'}{BASE}"
    if not isinstance(base, str):
        raise InputError(f"{key} = {base!r}: must be the path of a mechanism file")
    return merge(complete_mechanism(base, folders, key, files), content)


def with_effect_files(mechanism: Any, folders: Sequence[Path], key: str) -> Any:
    """The content of a `mechanism`, or of a run, with the files of its effects resolved in
    `folders`."""
    if not isinstance(mechanism, Mapping):
        return mechanism
    content, effects = dict(mechanism), mechanism.get("effects")
    if isinstance(effects, list | tuple):
        content["effects"] = [
            with_file(effect, "parameters", folders, f"{key}: effects.{{name}}.parameters.file")
            for effect in effects
        ]
    return content


def with_file(data: Any, section: str, folders: Sequence[Path], key: str) -> Any:
    """`data` with the ``file`` in a `section`, if any, resolved in `folders`; `key`, with the name
    in `data`, is for error messages."""
    inner = data.get(section) if isinstance(data, Mapping) else None
    if not isinstance(inner, Mapping) or not isinstance(inner.get("file"), str):
        return data
    file = existing_file(inner["file"], folders, key.replace("{name}", str(data.get("name"))))
    return {**data, section: {**inner, "file": str(file)}}


def shipped_mechanisms() -> dict[str, Path]:
    """The shipped mechanism files by name; a name can replace a path."""
    folder = Path(__file__).parents[1] / "data/mechanisms"
    return {file.stem: file for file in sorted(folder.glob("*.yaml"))}


def mechanism_file(mechanism: str, folders: Sequence[Path], key: str) -> Path:
    """The file of a mechanism: at this path in `folders`, or the shipped one of this name."""
    return existing_file(mechanism, folders, key, shipped_mechanisms())


def existing_file(
    path: str, folders: Sequence[Path], key: str, named: Mapping[str, Path] | None = None
) -> Path:
    """The file at `path` in `folders`, or one of the files `named`; `key` is for error messages."""
    for folder in folders:
        if os.path.isfile(folder / path):  # Path.is_file raises for a name that is too long
            return folder / path
    if named and path in named:
        return named[path]
    searched = ", ".join(dict.fromkeys(map(str, folders)))
    names = f", or one of the names {', '.join(named)}" if named else ""
    raise InputError(
        f"{key}: no file '{path}' (looked in {searched}); give a path relative to one of these"
        f"{names}"
    )
