"""What a table is: named columns with unit, description and type, and its place. Imports nothing heavy."""

import re
from dataclasses import dataclass, replace
from importlib import import_module


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes
    ----------
    name : str
    unit : str
        SI unit, ``'rad'``, ``'1'`` for pure numbers, ``''`` for text.
    description : str
    kind : str
        ``'float'``, ``'int'``, ``'text'``, ``'category'`` (one of a few texts) or ``'bool'``.
    nullable : bool
        Whether the quantity can be undefined. Undefined is null in the file and NaN (None) in the frame, never 0.
    """

    name: str
    unit: str
    description: str
    kind: str = "float"
    nullable: bool = False


@dataclass(frozen=True)
class Table:
    """A table that stages hand on.

    Attributes
    ----------
    name, description : str
    content : tuple of Column, or str
        The columns in the order of the file; or ``module:name`` of the tuple, where they stand with code that takes
        long to load.
    path : str
        Its place within the results folder of a scenario or a campaign; ``{output}`` stands for an output of a loose
        joint, ``{stage}`` for one of several stages that write it. Empty for a table whose place is given on the
        command line.
    """

    name: str
    description: str
    content: tuple[Column, ...] | str
    path: str = ""

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
