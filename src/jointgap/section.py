"""Base of every part of a configuration."""

from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import BaseModel, ConfigDict, ValidationError

from jointgap.complaints import complaints
from jointgap.core.errors import InputError


class _Called(type(BaseModel)):
    """What is made in Python, ``Simulate(sped="600 rpm")``, is told what is wrong in the words of a file's errors.

    Not in ``__init__``, which pydantic would call for nested sections too: their errors would lose the path of the key.
    """

    if not TYPE_CHECKING:  # checkers and editors read the keys of a section from its fields

        def __call__(cls, *args: Any, **keys: Any) -> Any:
            if args:
                raise InputError(f"{cls.__name__}: takes keys by name alone, such as {cls.__name__}({_example(cls)})")
            try:
                return super().__call__(**keys)
            except ValidationError as error:
                raise InputError(*(f"{cls.__name__}: {line}" for line in complaints(error, cls))) from error


def _example(section: type[BaseModel]) -> str:
    return f"{next(iter(section.model_fields))}=..."


class Section(BaseModel, metaclass=_Called):
    """A part of a configuration: frozen, no unknown keys, defaults validated too."""

    removed: ClassVar[dict[str, str]] = {}
    """Keys of earlier versions, with what to use instead."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)
