"""Names that a user gives: to columns, runs, campaigns, scenarios, boxes."""

import re
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema

MOST_LETTERS, MOST_BYTES = 60, 180
"""Of a name that files or folders get: with what stands before and behind it, it is still a file's name (255 bytes)."""


def text_of(value: Any) -> Any:
    """A whole number as the text that a user means by it, such as the run 1 or the column 3; all else as it is."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


Name = Annotated[
    str, Field(min_length=1), BeforeValidator(text_of), WithJsonSchema({"type": ["string", "integer"], "minLength": 1})
]


def word(name: str) -> str:
    """`name`, which files, folders and MLflow's parameters can have in theirs; ValueError for any other."""
    if re.fullmatch(r"[\w-]+", name) is None:
        raise ValueError("use letters, digits, '_' and '-' only, for files or folders are called so")
    if len(name) > MOST_LETTERS or len(name.encode()) > MOST_BYTES:
        raise ValueError(
            f"use {MOST_LETTERS} letters at most, not {len(name)}, and fewer of alphabets other than Latin, for files "
            "or folders are called so"
        )
    return name


Word = Annotated[Name, AfterValidator(word)]
"""A name that files or folders get."""
