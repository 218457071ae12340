"""Base of every part of a configuration, types of its keys, and what is wrong with it in plain words."""

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

_LONGEST = 200  # characters of a value that are shown
_MOST_LISTED = 8  # values that can be chosen: of more the nearest is shown
_ALSO = {"mechanism": "the path of a mechanism file, or ", "contact": "the name of an entry of contacts, or "}
_PLAIN = {
    "string": "text",
    "path": "a path, written as text",
    "bool": "true or false",
    "int": "a whole number",
    "float": "a number",
    "list": "a list",
    "tuple": "a list",
}
"""What pydantic's errors of a wrong type expect, by the first word of their kind."""
_WRONG_TYPE = {"type", "parsing", "from_float"}
_SUBJECT = re.compile(r"^(Value error, )?((Input|String|Tuple|List|Dictionary) should )?")
_COUNTED = re.compile(r" after validation, not \d+$")
_UNSAID = ("[key]", "uniform", "log_uniform", "normal", "triangular", "values")  # pydantic's steps that no file has


class _Called(type(BaseModel)):
    """What is made in Python, ``Simulate(sped="600 rpm")``, is told what is wrong in the words of a file's errors.

    Not in ``__init__``, which pydantic would call for nested sections too: their errors would lose the path of the key.
    """

    if not TYPE_CHECKING:  # checkers and editors read the keys of a section from its fields

        def __call__(cls, *args: Any, **keys: Any) -> Any:
            if args:
                example = f"{cls.__name__}({next(iter(cls.model_fields))}=...)"
                raise InputError(f"{cls.__name__}: takes keys by name alone, such as {example}")
            try:
                return super().__call__(**keys)
            except ValidationError as error:
                raise InputError(*(f"{cls.__name__}: {line}" for line in complaints(error, keys))) from error


class Section(BaseModel, metaclass=_Called):
    """A part of a configuration: frozen, no unknown keys, defaults validated too."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)
    removed: ClassVar[dict[str, str]] = {}
    """Keys that there were once, each with what to use instead."""

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, data: Any) -> Any:
        fields = cls.__pydantic_fields__  # model_fields costs a tenth of a design of a sweep
        if isinstance(data, dict) and not fields.keys() >= data.keys():
            known = [field.alias or name for name, field in fields.items()]
            words = {}  # by key: what stands before and behind its path
            for key in data:
                if instead := cls.removed.get(key):
                    words[key] = ("", f" is gone; {instead}")
                elif key not in known:
                    words[key] = ("unknown ", f"; {did_you_mean(key, known)}")
            if words:
                raise PydanticCustomError("unknown_keys", "has unknown keys", {"keys": words})
        return data

    def errors(self) -> Iterator[str]:
        """What is wrong with values that are right by themselves, each with its fix."""
        return iter(())

    @model_validator(mode="after")
    def _go_together(self):
        for error in self.errors():  # the first: others may follow from it
            raise ValueError(error)
        return self


def complaints(error: ValidationError, data: object = None) -> list[str]:
    """What pydantic reports as wrong with `data` in its `error`, one line each, none twice."""
    lines: dict[str, None] = {}
    for item in error.errors():
        # pydantic counts entries that are wrong, of which it complains by themselves, as absent
        if item["type"] != "too_short" or len(item["input"]) < item["ctx"]["min_length"]:
            lines |= dict.fromkeys(_complaint(item, data))
    return list(lines)


def checked(kind: Any, value: Any) -> Any:
    """`value` as a `kind`, an annotated type; ValueError says what is wrong with it."""
    try:
        return TypeAdapter(kind).validate_python(value)
    except ValidationError as error:
        raise ValueError(_message(error.errors()[0])) from None


def _complaint(item: Mapping, data: object) -> list[str]:
    key, written = _found(item["loc"], data)
    kind, value, context = item["type"], item["input"], item.get("ctx", {})
    if kind == "unknown_keys":
        inside = f"{key}." if key else ""
        return [f"{before}key '{inside}{name}'{after}" for name, (before, after) in context["keys"].items()]
    if kind == "missing":
        laid_over = ", or the key base, the path of a mechanism file over which these keys are laid"
        return [f"key '{key}' is missing; add it{laid_over if 'mechanism' in item['loc'][-2:-1] else ''}"]
    if kind == "union_tag_not_found":
        return [f"key '{key}.{_unquoted(context['discriminator'])[0]}' is missing; add it"]
    if kind.startswith("union_tag"):
        (choice,), tag = _unquoted(context["discriminator"]), context["tag"]
        what = "effect" if choice == "name" else choice
        return [f"{key}.{choice} = {tag!r}: no such {what}; {did_you_mean(tag, _unquoted(context['expected_tags']))}"]
    shown = "" if isinstance(value, dict | BaseModel) else f" = {_shortened(repr(value))}"
    if isinstance(value, float) and isinstance(written, str):  # converted before it was found to be out of its range
        shown = f" = {_shortened(repr(written))}, {value:.6g} in SI"
    message = _message(item)
    return [f"{key}{shown}: {message[0].lower() + message[1:]}" if key else message]


def _unquoted(words: str) -> list[str]:
    return re.findall("'(.*?)'", words)


def _found(location: tuple, data: object) -> tuple[str, object]:
    """The path of a key as a file has it, and what is written there."""
    steps = []
    for step in location:
        if (isinstance(data, Mapping) and step in data) or (
            isinstance(data, list | tuple) and isinstance(step, int) and step < len(data)
        ):
            data = data[step]
        elif step in _UNSAID:
            continue
        elif not (isinstance(data, Mapping) and step in data.values()):  # else the name of an effect, a kind of drive
            data = None
        steps.append(str(step))
    return ".".join(steps), data


def _message(item: Mapping) -> str:
    """What is expected instead, in words that need no Python."""
    kind, given = item["type"], item["input"]
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"must be {_ALSO.get(item['loc'][-1], '') if item['loc'] else ''}a mapping of keys to values"
    if kind == "literal_error" and len(choices := _unquoted(item["ctx"]["expected"])) > _MOST_LISTED:
        return f"there is no such choice; {did_you_mean(given, choices)}"
    family, _, what = kind.partition("_")
    if what in _WRONG_TYPE and family in _PLAIN:
        is_scalar = given is not None and not isinstance(given, list | dict)
        return f"must be {_PLAIN[family]}{'; write it in quotation marks' * (family == 'string' and is_scalar)}"
    message = _COUNTED.sub("", item["msg"])
    return _SUBJECT.sub(lambda found: "must " if found[2] else "", message)


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def whole_number(**limits: float) -> Any:
    """Type of a whole number within `limits` (gt, ge, lt, le); true and false, to Python 1 and 0, are none."""

    def no_truth(value: Any) -> Any:
        if isinstance(value, bool):
            raise ValueError("must be a whole number, not true or false")
        return value

    return Annotated[int, Field(**limits), BeforeValidator(no_truth)]


Seed = whole_number(ge=0, le=2**32 - 1)


def distinct(values: tuple) -> tuple:
    """`values`, of which none is there twice."""
    if len(set(values)) < len(values):
        raise ValueError("lists a value twice; give each once")
    return values


def text_of(value: Any) -> Any:
    """A whole number as the text that a user means by it, such as the run 1 or the column 3; all else as it is."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


def word(name: str) -> str:
    """`name`, which files, folders and MLflow's parameters can have in theirs; ValueError for any other."""
    if re.fullmatch(r"[\w-]+", name) is None:
        raise ValueError("use letters, digits, '_' and '-' only, for files or folders are called so")
    if len(name) > 60 or len(name.encode()) > 180:  # with what stands before and behind it, a file's name has 255 bytes
        raise ValueError(f"use 60 letters at most, not {len(name)}, and fewer of other alphabets than Latin")
    return name


Name = Annotated[
    str, Field(min_length=1), BeforeValidator(text_of), WithJsonSchema({"type": ["string", "integer"], "minLength": 1})
]
Word = Annotated[Name, AfterValidator(word)]
"""A name that files or folders get."""
