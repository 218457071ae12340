"""What a YAML text says, read independently of the package: each value as it is written, with the part of a JSON schema
that describes it.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import yaml

Schema = dict[str, Any]
Path = tuple[str | int, ...]


class Written(NamedTuple):
    """A value as it is written.

    Attributes
    ----------
    path : tuple of str or int
        Keys, and places in lists.
    text : str
        The signs themselves.
    quoted : bool
        Whether they stand in quotation marks.
    schemas : tuple of dict
        What the schema allows there; empty where it knows no such key.
    """

    path: Path
    text: str
    quoted: bool
    schemas: tuple[Schema, ...]


def branches(schema: Schema, root: Schema) -> list[Schema]:
    """All that a `schema` of the file `root` allows, without references; a unit beside choices holds for each."""
    if "$ref" in schema:
        target = root
        for step in schema["$ref"].removeprefix("#/").split("/"):
            target = target[step]
        return branches(target, root)
    choices = schema.get("anyOf") or schema.get("oneOf")
    if not choices:
        return [schema]
    shared = {key: schema[key] for key in ("unit", "default", "examples") if key in schema}
    return [shared | branch for choice in choices for branch in branches(choice, root)]


def fitting(options: list[Schema], keys: dict[str, str], root: Schema) -> Schema | None:
    """The mapping among `options` that `keys` with the texts of their values tell of; all together where none does."""
    mappings = [option for option in options if option.get("type") == "object" or "properties" in option]

    def told(option: Schema) -> int:
        """Words such as a kind or a name that say that it is this one, less those that say otherwise."""
        known = option.get("properties", {})
        words = [
            (key, branch["const"])
            for key in keys.keys() & known.keys()
            for branch in branches(known[key], root)
            if "const" in branch
        ]
        return sum(1 if keys[key] == word else -1 for key, word in words)

    best = max(mappings, key=told, default=None)
    if best is None or told(best) > 0 or len(mappings) == 1:
        return best
    together = {key: entry for option in reversed(mappings) for key, entry in option.get("properties", {}).items()}
    return {**best, "properties": together}


def values(node: yaml.Node, options: list[Schema], root: Schema, path: Path = ()) -> Iterator[Written]:
    """Every value below a `node`, with what `options` of the schema `root` say of it; duplicate keys all come."""
    if isinstance(node, yaml.ScalarNode):
        yield Written(path, node.value, node.style in ("'", '"', "|", ">"), tuple(options))
    elif isinstance(node, yaml.SequenceNode):
        lists = [option for option in options if option.get("type") == "array"]
        for place, child in enumerate(node.value):
            below = [branch for option in lists if (entry := _entry(option, place)) for branch in branches(entry, root)]
            yield from values(child, below, root, (*path, place))
    elif isinstance(node, yaml.MappingNode):
        texts = {key.value: str(value.value) for key, value in node.value if isinstance(key, yaml.ScalarNode)}
        chosen = fitting(options, texts, root) or {}
        for key, child in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else "?"
            entry = chosen.get("properties", {}).get(name, chosen.get("additionalProperties"))
            below = branches(entry, root) if isinstance(entry, dict) else []
            yield from values(child, below, root, (*path, name))


def _entry(option: Schema, place: int) -> Schema | None:
    prefix = option.get("prefixItems", [])
    return prefix[place] if place < len(prefix) else option.get("items")


def duplicates(node: yaml.Node, path: Path = ()) -> Iterator[Path]:
    """Keys that are written twice in one mapping."""
    if isinstance(node, yaml.MappingNode):
        seen = set()
        for key, child in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else "?"
            if name in seen and name != "<<":
                yield (*path, name)
            seen.add(name)
            yield from duplicates(child, (*path, name))
    elif isinstance(node, yaml.SequenceNode):
        for place, child in enumerate(node.value):
            yield from duplicates(child, (*path, place))


def child(node: yaml.Node, key: str) -> yaml.Node | None:
    """What stands under a `key` of a mapping; None without it."""
    pairs = node.value if isinstance(node, yaml.MappingNode) else ()
    return next((value for name, value in pairs if name.value == key), None)
