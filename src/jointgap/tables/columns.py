"""What a table is: named columns with unit, description and type, and its place. Imports nothing heavy."""

import re
from dataclasses import dataclass, replace
from importlib import import_module


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    unit: str  # SI unit, ``'rad'``, ``'1'`` for pure numbers, ``''`` for text
    description: str
    kind: str = "float"  # ``'float'``, ``'int'``, ``'text'``, ``'category'`` (one of a few texts) or ``'bool'``
    nullable: bool = False  # Whether the quantity can be undefined


@dataclass(frozen=True)
class Table:
    """A table that stages hand on."""

    name: str
    description: str
    content: tuple[Column, ...] | str  # The columns in the order of the file
    path: str = ""  # Its place within the results folder of a scenario or a campaign

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns in the order of the file."""
        if isinstance(self.content, tuple):
            return self.content
        module, name = self.content.split(":")
        return getattr(import_module(module), name)

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [column.name for column in self.columns]

    def at(self, part: str) -> "Table":
        """The same table where `part` of the work writes it: an output, or one of several stages."""
        return replace(self, path=re.sub(r"{\w+}", part, self.path))
