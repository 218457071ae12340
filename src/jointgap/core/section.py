"""Base class of configuration sections, types of their keys, and plain error messages."""

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.units import plain_numbers

_LONGEST = 200  # [characters] of a value in messages
_MOST_LISTED = 8  # choices in a message; of more, the most similar one is shown
_ALSO = {
    "mechanism": "the path of a mechanism file, or ",
    "contact": "the name of an entry of contacts, or ",
}
_PLAIN = {
    "string": "text",
    "path": "a path, written as text",
    "bool": "true or false",
    "int": "a whole number",
    "float": "a number",
    "list": "a list",
    "tuple": "a list",
}
"""Expected type, by the first word of pydantic's kind of error."""
_WRONG_TYPE = {"type", "parsing", "from_float"}
_SUBJECT = re.compile(r"^(Value error, )?((Input|String|Tuple|List|Dictionary) should )?")
_COUNTED = re.compile(r" after validation, not \d+$")
_IMPLICIT = (
    "[key]",
    "uniform",
    "log_uniform",
    "normal",
    "triangular",
    "values",
)  # pydantic's steps that no file has


class _Called(type(BaseModel)):
    """Gives errors in Python, ``Simulate(sped="600 rpm")``, the same text as errors in files.

    Not in ``__init__``, which pydantic calls for nested sections too: their errors would lose the
    path of the key.
    """

    if not TYPE_CHECKING:  # type checkers read the keys from the fields

        def __call__(cls, *args: Any, **keys: Any) -> Any:
            if args:
                example = f"{cls.__name__}({next(iter(cls.model_fields))}=...)"
                raise InputError(
                    f"{cls.__name__}: accepts keyword arguments only, such as {example}"
                )
            keys = plain_numbers(keys)
            try:
                return super().__call__(**keys)
            except ValidationError as error:
                raise InputError(
                    *(f"{cls.__name__}: {line}" for line in complaints(error, keys))
                ) from error


class ConfigModel(BaseModel, metaclass=_Called):
    """A section of a configuration: frozen, without unknown keys, with validated defaults."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)
    removed: ClassVar[dict[str, str]] = {}
    """Removed keys, each with its replacement."""

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, data: Any) -> Any:
        fields = (
            cls.__pydantic_fields__
        )  # model_fields takes a tenth of the time of a sweep's design
        if isinstance(data, dict) and not fields.keys() >= data.keys():
            descriptions = {
                field.alias or name: field.description or "" for name, field in fields.items()
            }
            words = {}  # by key: text before and after its path
            for key in data:
                if instead := cls.removed.get(key):
                    words[key] = ("", f" was removed; {instead}")
                elif key not in descriptions:
                    words[key] = ("unknown ", f"; {did_you_mean(key, descriptions)}")
            if words:
                raise PydanticCustomError("unknown_keys", "has unknown keys", {"keys": words})
        return data

    def errors(self) -> Iterator[str]:
        """Errors of combinations of values, each with its fix."""
        return iter(())

    @model_validator(mode="after")
    def _go_together(self):
        for error in self.errors():  # the first: others may be consequences
            raise ValueError(error)
        return self


def complaints(error: ValidationError, data: object = None) -> list[str]:
    """Messages for the `error` of pydantic in `data`, without duplicates."""
    lines: dict[str, None] = {}
    for item in error.errors():
        # pydantic counts invalid entries, which have their own errors, as missing
        if item["type"] != "too_short" or len(item["input"]) < item["ctx"]["min_length"]:
            lines |= dict.fromkeys(_complaint(item, data))
    return list(lines)


def checked(kind: Any, value: Any) -> Any:
    """`value` as a `kind`, an annotated type; ValueError where it is invalid."""
    try:
        return TypeAdapter(kind).validate_python(value)
    except ValidationError as error:
        raise ValueError(_message(error.errors()[0])) from None


def _complaint(item: Mapping, data: object) -> list[str]:
    key, written = _found(item["loc"], data)
    kind, value, context = item["type"], item["input"], item.get("ctx", {})
    if kind == "unknown_keys":
        inside = f"{key}." if key else ""
        return [
            f"{prefix}key '{inside}{name}'{suffix}"
            for name, (prefix, suffix) in context["keys"].items()
        ]
    if kind == "missing":
        laid_over = ", or the key base, the path of a mechanism file that these keys modify"
        return [
            f"key '{key}' is missing; add"
            f" it{laid_over if 'mechanism' in item['loc'][-2:-1] else ''}"
        ]
    if kind == "union_tag_not_found":
        return [f"key '{key}.{_unquoted(context['discriminator'])[0]}' is missing; add it"]
    if kind.startswith("union_tag"):
        (choice,), tag = _unquoted(context["discriminator"]), context["tag"]
        noun = "effect" if choice == "name" else choice
        return [
            f"{key}.{choice} = {tag!r}: no such {noun};"
            f" {did_you_mean(tag, _unquoted(context['expected_tags']))}"
        ]
    shown = "" if isinstance(value, dict | BaseModel) else f" = {_shortened(repr(value))}"
    if isinstance(value, float) and isinstance(
        written, str
    ):  # converted before its range was checked
        shown = f" = {_shortened(repr(written))}, {value:.6g} in SI"
    message = _message(item)
    return [f"{key}{shown}: {message[0].lower() + message[1:]}" if key else message]


def _unquoted(words: str) -> list[str]:
    return re.findall("'(.*?)'", words)


def _found(location: tuple, data: object) -> tuple[str, object]:
    """The path of a key as in the file, with the ids or names of the entries of lists, and its
    value there."""
    steps = []
    for place, step in enumerate(location):
        if isinstance(data, Mapping) and step in data:
            data = data[step]
        elif isinstance(data, list | tuple) and isinstance(step, int) and step < len(data):
            step, data = entry_name(data, step, location[place + 1 :]), data[step]
        elif step in _IMPLICIT:
            continue
        elif not (
            isinstance(data, Mapping) and step in data.values()
        ):  # the name of an effect, or a kind of drive
            data = None
        elif str(step) == steps[-1].partition("@")[0]:  # an effect that is called so
            continue
        steps.append(str(step))
    return ".".join(steps), data


def entry_name(entries: list | tuple, place: int, following: tuple = ()) -> str:
    """The id of an entry of a list, or the name of an effect (with its site if there are several);
    else `place`."""

    def label(entry: Any, *keys: str) -> str:
        return (
            "@".join(str(entry[key]) for key in keys)
            if isinstance(entry, Mapping) and {*keys} <= {*entry}
            else ""
        )

    is_effect = label(entries[place], "name") in following[:1]
    for keys in (("id",), *((("name",), ("name", "site")) if is_effect else ())):
        labels = [label(entry, *keys) for entry in entries]
        if labels[place] and labels.count(labels[place]) == 1:
            return labels[place]
    return str(place)


def _message(item: Mapping) -> str:
    """The expected value, without Python terms."""
    kind, value = item["type"], item["input"]
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return (
            f"must be {_ALSO.get(item['loc'][-1], '') if item['loc'] else ''}a mapping of keys to"
            " values"
        )
    if (
        kind == "literal_error"
        and len(choices := _unquoted(item["ctx"]["expected"])) > _MOST_LISTED
    ):
        return f"is not one of the choices; {did_you_mean(value, choices)}"
    family, _, problem = kind.partition("_")
    if problem in _WRONG_TYPE and family in _PLAIN:
        is_scalar = value is not None and not isinstance(value, list | dict)
        quotes = "; write it in quotation marks" if family == "string" and is_scalar else ""
        return f"must be {_PLAIN[family]}{quotes}"
    message = _COUNTED.sub("", item["msg"])
    return _SUBJECT.sub(lambda match: "must " if match[2] else "", message)


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def whole_number(**limits: float) -> Any:
    """Type of an integer within `limits` (gt, ge, lt, le); true and false, 1 and 0 in Python, are
    rejected."""

    def no_truth(value: Any) -> Any:
        if isinstance(value, bool):
            raise ValueError("must be a whole number, not true or false")
        return value

    return Annotated[int, Field(**limits), BeforeValidator(no_truth)]


Seed = whole_number(ge=0, le=2**32 - 1)


def distinct(values: tuple) -> tuple:
    """`values`; ValueError for duplicates."""
    if len(set(values)) < len(values):
        raise ValueError("contains a duplicate; give each value once")
    return values


def text_of(value: Any) -> Any:
    """A whole number as text, such as the run 1 or the column 3; all else unchanged."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


def word(name: str) -> str:
    """`name`, valid in names of files, folders and MLflow's parameters; ValueError otherwise."""
    if re.fullmatch(r"[\w-]+", name) is None:
        raise ValueError(
            "use letters, digits, '_' and '-' only: it becomes the name of files or folders"
        )
    if (
        len(name) > 60 or len(name.encode()) > 180
    ):  # file names with prefix and suffix have at most 255 bytes
        raise ValueError(
            f"use at most 60 letters, not {len(name)}, and fewer of other alphabets than Latin"
        )
    return name


Name = Annotated[
    str,
    Field(min_length=1),
    BeforeValidator(text_of),
    WithJsonSchema({"type": ["string", "integer"], "minLength": 1}),
]
Word = Annotated[Name, AfterValidator(word)]
"""A name of files or folders."""
