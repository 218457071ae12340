"""What is wrong with a configuration, in words that name the key, the value and the mend."""

from collections.abc import Iterator
from typing import get_args

from pydantic import BaseModel, ValidationError

from jointgap.errors import did_you_mean

_UNION_ERRORS = {"union_tag_invalid", "union_tag_not_found"}
_LONGEST = 200  # characters of a value that are shown
_KINDS = {"name": "effect", "kind": "kind"}  # keys by which sections in one place are told apart, and what they tell


def complaints(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """All that pydantic found wrong with a `model`, one line each, none twice."""
    items = error.errors()
    told = {found for item in items if (found := _within("contacts", item, 2))}
    lines = []
    for item in items:
        if _within("contact", item, 1) in told:
            continue  # the joint only repeats what its entry of contacts says
        lines.append(_complaint(item, model))
    return list(dict.fromkeys(lines))


def _within(key: str, item: dict, deeper: int) -> tuple | None:
    """Message and location of `item`, counted from `deeper` steps below `key` on; None where it lies elsewhere."""
    location = item["loc"]
    return (location[location.index(key) + deeper :], item["msg"]) if key in location else None


def _complaint(item: dict, model: type[BaseModel]) -> str:
    location = item["loc"]
    key = ".".join(str(step) for step in location)
    if item["type"] == "extra_forbidden":
        hint = did_you_mean(str(location[-1]), _model_at(model, location[:-1]).model_fields)
        return f"unknown key '{key}'; {hint}"
    if item["type"] == "missing":
        return f"key '{key}' is missing; add it"
    if item["type"] in _UNION_ERRORS:
        return _wrong_kind(key, item)
    message = item["msg"].removeprefix("Value error, ")
    value = item["input"]
    shown = "" if isinstance(value, dict | BaseModel) else f" = {_shortened(repr(value))}"
    return f"{key}{shown}: {message[0].lower() + message[1:]}" if key else message


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _wrong_kind(key: str, item: dict) -> str:
    """The key that says which of several kinds a section is of is missing or unknown."""
    discriminator = item["ctx"]["discriminator"].strip("'")
    if item["type"] == "union_tag_not_found":
        return f"key '{key}.{discriminator}' is missing; add it"
    tag, known = item["ctx"]["tag"], [word.strip(" '") for word in item["ctx"]["expected_tags"].split(",")]
    return f"{key}.{discriminator} = {tag!r}: no such {_KINDS[discriminator]}; {did_you_mean(tag, known)}"


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
    """The words by which a section is told from others in its place."""
    return {
        word for key in _KINDS if key in section.model_fields for word in get_args(section.model_fields[key].annotation)
    }
