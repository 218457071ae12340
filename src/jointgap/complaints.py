"""What is wrong with a configuration, in words that name the key, the value and the fix."""

import re
from collections.abc import Iterator, Mapping
from typing import get_args

from pydantic import BaseModel, ValidationError

from jointgap.core.errors import did_you_mean

_UNION_ERRORS = {"union_tag_invalid", "union_tag_not_found"}
_LONGEST = 200  # characters of a value that are shown
_KINDS = {"name": "effect", "kind": "kind", "distribution": "distribution"}
"""Keys that say of which kind a section is, and what they are called."""
_LAID_OVER = ", or the key base, the path of a mechanism file over which these keys are laid"
_ALSO = {"mechanism": "the path of a mechanism file, or ", "contact": "the name of an entry of contacts, or "}

# pydantic's types of errors whose own words speak of Python
_PLAIN = {
    "string_type": "must be text",
    "path_type": "must be a path, written as text",
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "dict_type": "must be a mapping of names to values",
    "model_attributes_type": "must be a mapping of keys to values",
}
_SUBJECT = re.compile(r"^(Input|String|Tuple|List) should ")
_COUNTED = re.compile(r" after validation, not \d+$")


def complaints(error: ValidationError, model: type[BaseModel], data: object = None) -> list[str]:
    """What pydantic reports as wrong with a `model` in its `error`, one line each, none twice; a quantity is repeated
    as it is written in `data`.
    """
    items = error.errors()
    reported = {problem for item in items if (problem := _within("contacts", item, 2))}
    lines = []
    for item in items:
        if _within("contact", item, 1) in reported:
            continue  # the joint only repeats what its entry of contacts says
        if item["type"] == "too_short" and len(item["input"]) >= item["ctx"]["min_length"]:
            continue  # pydantic counts entries that are wrong, of which it complains by themselves, as absent
        lines.append(_complaint(item, model, data))
    return list(dict.fromkeys(lines))


def _within(key: str, item: dict, deeper: int) -> tuple | None:
    """Message and location of `item`, counted from `deeper` steps below `key` on; None where it lies elsewhere."""
    location = item["loc"]
    return (location[location.index(key) + deeper :], item["msg"]) if key in location else None


def _complaint(item: dict, model: type[BaseModel], data: object) -> str:
    location = item["loc"]
    key = ".".join(_written(location, model))
    if item["type"] == "extra_forbidden":
        section = _model_at(model, location[:-1])
        if instead := getattr(section, "removed", {}).get(location[-1]):
            return f"key '{key}' is gone; {instead}"
        hint = did_you_mean(location[-1], section.model_fields)
        return f"unknown key '{key}'; {hint}"
    if item["type"] == "missing":
        also = _LAID_OVER if "mechanism" in location[-2:-1] else ""
        return f"key '{key}' is missing; add it{also}"
    if item["type"] in _UNION_ERRORS:
        return _wrong_kind(key, item)
    message, value = _message(item, model), item["input"]
    shown = "" if isinstance(value, dict | BaseModel) else f" = {_shortened(repr(value))}"
    written = _value_at(location, data)
    if isinstance(value, float) and isinstance(written, str):  # converted before it was found to be out of its range
        shown = f" = {_shortened(repr(written))}, {value:.6g} in SI"
    return f"{key}{shown}: {message[0].lower() + message[1:]}" if key else message


def _written(location: tuple, model: type[BaseModel]) -> list[str]:
    """The steps of a `location` as a file has them: pydantic marks a key that is wrong itself, and puts the kind of a
    distribution between the parameter and its keys.
    """
    steps, was_kind = [], False
    for place, step in enumerate(location):
        section = _model_at(model, location[: place + 1])
        was_kind = not was_kind and "distribution" in section.model_fields and step in _kind(section)
        if step != "[key]" and not was_kind:
            steps.append(str(step))
    return steps


def _value_at(location: tuple, data: object) -> object:
    """What is written in `data` at a `location`, in which the name of a section's kind leads no deeper."""
    for step in location:
        if isinstance(data, list | tuple) and isinstance(step, int) and step < len(data):
            data = data[step]
        elif isinstance(data, Mapping) and step in data:
            data = data[step]
    return data


def _message(item: dict, model: type[BaseModel]) -> str:
    """What is expected instead, in words that need no Python."""
    kind, location = item["type"], item["loc"]
    field = _model_at(model, location[:-1]).model_fields.get(str(location[-1])) if location else None
    if kind == "model_type":
        needed = _needed(_model_at(model, location))
        message = f"must be {_ALSO.get(location[-1], '') if location else ''}a mapping {needed or 'of keys to values'}"
    elif kind in ("tuple_type", "list_type"):
        entry = next(_sections(field.annotation), None) if field else None
        message = f"must be a list{f' of mappings, each {_needed(entry)}' if entry else ''}"
    else:
        own = _COUNTED.sub("", item["msg"].removeprefix("Value error, "))
        message = _PLAIN.get(kind) or _SUBJECT.sub("must ", own)
        if kind == "string_type" and not isinstance(item["input"], list | dict | None):  # a number, true, a date
            message += "; write it in quotation marks"
    optional = item["input"] is None and field is not None and not field.is_required()
    return f"{message}; or leave the key out" if optional else message


def _needed(section: type[BaseModel]) -> str:
    """``with the keys id and file``: what the section cannot do without; empty where that is nothing."""
    keys = [key for key, field in section.model_fields.items() if field.is_required()]
    if len(keys) < 2:
        return f"with the key {keys[0]}" if keys else ""
    return f"with the keys {', '.join(keys[:-1])} and {keys[-1]}"


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _wrong_kind(key: str, item: dict) -> str:
    """The key that says which of several kinds a section is of is missing or unknown."""
    discriminator = item["ctx"]["discriminator"].strip("'")
    if item["type"] == "union_tag_not_found":
        return f"key '{key}.{discriminator}' is missing; add it"
    tag, expected = item["ctx"]["tag"], [word.strip(" '") for word in item["ctx"]["expected_tags"].split(",")]
    return f"{key}.{discriminator} = {tag!r}: no such {_KINDS[discriminator]}; {did_you_mean(tag, expected)}"


def _model_at(model: type[BaseModel], location: tuple) -> type[BaseModel]:
    """The section at `location`; an index, a free key and the name of a section's kind lead no deeper."""
    for place, step in enumerate(location):
        if isinstance(step, str) and step in model.model_fields:
            sections = list(_sections(model.model_fields[step].annotation))
            kinds = [section for section in sections if set(location[place + 1 :]) & _kind(section)]
            model = next(iter(kinds or sections), model)
    return model


def _sections(annotation: object) -> Iterator[type[BaseModel]]:
    """All sections that a type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _sections(part)


def _kind(section: type[BaseModel]) -> set[str]:
    """The words that distinguish a section from others in its place."""
    return {
        word for key in _KINDS if key in section.model_fields for word in get_args(section.model_fields[key].annotation)
    }
