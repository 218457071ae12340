"""Mappings from YAML and JSON files, read strictly: what two readers would take for two things is refused.

PyYAML keeps to YAML 1.1, in which 0600 is 384, 10:30 is 630 and off is false; the last of two equal keys wins without a
word; and a file of a few lines may stand for more than memory holds.
"""

import json
import re
from collections.abc import Hashable
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from jointgap.core.errors import InputError

MOST_BYTES = {"YAML": 200_000, "JSON": 10_000_000}
"""Size of a file; those of this project have a few thousand bytes, and YAML takes a second for each 100 kB."""

MOST_ENTRIES = 20_000
"""Keys and values of a YAML file, those of an alias counted wherever it stands."""

DEEPEST_NESTING = 50
"""Levels of mappings and lists; a configuration has ten."""

MOST_DIGITS = 310
"""Of a whole number: the largest float has as many."""

_WHOLE = re.compile(r"0|[-+]?[1-9][0-9]*")
_INTEGER = re.compile(r"[-+]?[0-9]+")
_LEADING_ZEROS = re.compile(r"(?<![0-9])0+(?=[0-9])")
_TRUE_OR_FALSE = re.compile(r"true|True|TRUE|false|False|FALSE")
_NO_TEXT = re.compile("[\\x00-\\x08\\x0b\\x0c\\x0e-\\x1f\\ud800-\\udfff]")
_TAG = "tag:yaml.org,2002:"


def read_yaml(path: Path | str) -> dict[str, Any]:
    """The mapping in a YAML file, or in a JSON file whose name ends in ``.json``.

    Numbers, true, false and null are read as such where YAML 1.1 and 1.2 agree; dates are text.
    """
    if str(path).endswith(".json"):  # YAML would take 1e-9 for a text
        content = parse_json(_text(path, "JSON"), str(path))
    else:
        content = _parse_yaml(_text(path, "YAML"), str(path))
    if isinstance(content, dict):
        return content
    what = "is empty" if content is None else f"holds {_name_of(content)} and no keys"
    raise InputError(f"{path}: {what}; write a mapping of keys to values, such as 'key: value', a line each")


def _text(path: Path | str, kind: str) -> str:
    most = MOST_BYTES[kind]
    try:
        with Path(path).open("rb") as file:
            content = file.read(most + 1)
        if len(content) > most:
            raise InputError(
                f"{path}: has more than {most} bytes, too many for a {kind} file of settings; measured samples "
                "belong into files of their own, CSV or Parquet"
            )
        return content.decode("utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(
            f"{path}, line {line}: is not text in UTF-8 (byte {error.start}); save the file as UTF-8"
        ) from error


def _name_of(content: Any) -> str:
    names = {str: "text", list: "a list", bool: "true or false", int: "a number", float: "a number"}
    return names.get(type(content), "something else")


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return node.value if isinstance(node, yaml.SequenceNode) else []


class _Refused(yaml.MarkedYAMLError):
    """What is YAML, but not taken."""


class _StrictLoader(yaml.SafeLoader):
    """YAML whose every value means one thing, and that is as large as it looks."""

    def __init__(self, text: str):
        super().__init__(text)
        self._depth = 0
        self._sizes: dict[int, int] = {}  # entries of each node that is complete

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node:
        event = self.peek_event()
        if getattr(event, "tag", None) is not None:
            raise _Refused(problem=f"the tag {event.tag} is not read; take it away", problem_mark=event.start_mark)
        self._depth += 1
        if self._depth > DEEPEST_NESTING:
            raise _Refused(
                problem=f"is nested more than {DEEPEST_NESTING} deep; no settings are", problem_mark=event.start_mark
            )
        node = super().compose_node(parent, index)
        self._depth -= 1
        if isinstance(node, yaml.ScalarNode) and (strange := _NO_TEXT.search(node.value)):
            raise _Refused(
                problem=f"holds the character #x{ord(strange[0]):04x}, which no text has; remove it",
                problem_mark=node.start_mark,
            )
        if id(node) not in self._sizes and isinstance(event, yaml.AliasEvent):
            raise _Refused(problem=f"*{event.anchor} stands within itself; take it away", problem_mark=event.start_mark)
        self._sizes[id(node)] = 1 + sum(self._sizes[id(child)] for child in _children(node))
        if max(self._sizes[id(node)], len(self._sizes)) > MOST_ENTRIES:
            raise _Refused(
                problem=f"holds more than {MOST_ENTRIES} keys and values, aliases counted wherever they stand; no "
                "settings do",
                problem_mark=node.start_mark,
            )
        return node

    def compose_mapping_node(self, anchor: str | None) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        lines: dict[Hashable, int] = {}
        _check_decimal_commas(node)
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _Refused(problem="a key must be a text or a number", problem_mark=key.start_mark)
            # as text too: the run 1 is the run '1' later on
            same = {key.value} if key.tag == f"{_TAG}merge" else {key.value, self.construct_object(key)}
            line = key.start_mark.line + 1
            if before := next((lines[name] for name in same if name in lines), None):
                raise _Refused(
                    problem=f"the key '{key.value}' is given twice, in line {before} and in line {line}; remove one",
                    problem_mark=key.start_mark,
                )
            lines |= dict.fromkeys(same, line)
        return node

    def construct_whole_number(self, node: yaml.ScalarNode) -> int:
        if len(node.value) > MOST_DIGITS:
            raise _Refused(
                problem=f"a number of {len(node.value)} digits is too large; 1.8e308 is the largest",
                problem_mark=node.start_mark,
            )
        if _WHOLE.fullmatch(node.value) is None:
            raise _two_meanings(node)
        return int(node.value)

    def construct_number(self, node: yaml.ScalarNode) -> float:
        if ":" in node.value or "_" in node.value:
            raise _two_meanings(node)
        return self.construct_yaml_float(node)

    def construct_truth(self, node: yaml.ScalarNode) -> bool:
        if _TRUE_OR_FALSE.fullmatch(node.value) is None:
            raise _two_meanings(node, "true" if node.value.lower() in ("yes", "on") else "false")
        return self.construct_yaml_bool(node)

    def construct_day(self, node: yaml.ScalarNode) -> str:
        try:
            self.construct_yaml_timestamp(node)
        except (ValueError, OverflowError) as error:
            raise _Refused(
                problem=f"'{node.value}' is no day or time ({error}); correct it, or write it in quotation marks",
                problem_mark=node.start_mark,
            ) from error
        return node.value


def _check_decimal_commas(node: yaml.MappingNode) -> None:
    """Refuses ``{mass: 0,19 kg}``, in which the comma ends the value."""
    for (_, value), (key, nothing) in pairwise(node.value if node.flow_style else ()):
        parts = (value, key, nothing)
        if not all(isinstance(part, yaml.ScalarNode) and part.style is None for part in parts) or nothing.value:
            continue
        if _INTEGER.fullmatch(value.value) and key.value[:1].isdigit():
            raise _Refused(
                problem=f"the comma in {value.value},{key.value} ends the value; write {value.value}.{key.value}",
                problem_mark=value.start_mark,
            )


def _two_meanings(node: yaml.ScalarNode, plain: str = "") -> _Refused:
    decimal = _LEADING_ZEROS.sub("", node.value.replace("_", ""))
    plain = plain or (decimal if _WHOLE.fullmatch(decimal) else "a plain decimal number")
    return _Refused(
        problem=f"{node.value} is one thing to some programs and another to others; write {plain}, or "
        f'"{node.value}" in quotation marks where a text is meant',
        problem_mark=node.start_mark,
    )


for _kind, _constructor in {
    "int": _StrictLoader.construct_whole_number,
    "float": _StrictLoader.construct_number,
    "bool": _StrictLoader.construct_truth,
    "timestamp": _StrictLoader.construct_day,
    "value": _StrictLoader.construct_yaml_str,
}.items():
    _StrictLoader.add_constructor(_TAG + _kind, _constructor)


def _parse_yaml(text: str, source: str) -> Any:
    try:
        loader = _StrictLoader(text)
        try:
            return loader.get_single_data()
        finally:
            loader.dispose()
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise InputError(
            f"{source}, line {line}: holds the character #x{error.character:04x}, which no text has; remove it"
        ) from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        what = "" if isinstance(error, _Refused) else "is not YAML: "
        raise InputError(f"{source}{where}: {what}{error.problem or error.context}") from error


def parse_json(text: str, source: str) -> Any:
    """What a JSON `text` holds."""

    def refuse(constant: str) -> float:
        raise InputError(f"{source}: holds {constant}, which is not a number; remove it")

    def whole(digits: str) -> int:
        if len(digits) > MOST_DIGITS:
            raise InputError(f"{source}: a number of {len(digits)} digits is too large; 1.8e308 is the largest")
        return int(digits)

    def without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        mapping = dict(pairs)
        if len(mapping) < len(pairs):
            keys = [key for key, _ in pairs]
            double = next(key for key in keys if keys.count(key) > 1)
            raise InputError(f"{source}: the key '{double}' is given twice in one mapping; remove one")
        return mapping

    too_deep = f"{source}: is nested more than {DEEPEST_NESTING} deep; no settings are"
    try:
        content = json.loads(text, parse_constant=refuse, parse_int=whole, object_pairs_hook=without_doubles)
    except json.JSONDecodeError as error:
        raise InputError(f"{source}: is not JSON: {error.msg} at character {error.pos}") from error
    except RecursionError as error:
        raise InputError(too_deep) from error
    level = [content]
    for _ in range(DEEPEST_NESTING):
        if strange := next(filter(None, (_NO_TEXT.search(part) for part in level if isinstance(part, str))), None):
            raise InputError(f"{source}: holds the character #x{ord(strange[0]):04x}, which no text has; remove it")
        level = [part for outer in level for part in _parts(outer)]
    if level:
        raise InputError(too_deep)
    return content


def _parts(content: Any) -> list[Any]:
    if isinstance(content, dict):
        return [*content, *content.values()]
    return content if isinstance(content, list) else []
