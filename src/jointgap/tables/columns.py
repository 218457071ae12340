"""What a table is: named columns with unit, description and type."""

from dataclasses import dataclass

import pyarrow as pa

TYPES = {
    "float": pa.float64(),
    "int": pa.int64(),
    "text": pa.string(),
    "category": pa.dictionary(pa.int8(), pa.string()),
    "bool": pa.bool_(),
}


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

    def field(self) -> pa.Field:
        """The column as an Arrow field that carries unit and description."""
        return pa.field(
            self.name, TYPES[self.kind], self.nullable, {"unit": self.unit, "description": self.description}
        )


@dataclass(frozen=True)
class Table:
    """A table that stages hand on: name, meaning, columns in order."""

    name: str
    description: str
    columns: tuple[Column, ...]

    def schema(self) -> pa.Schema:
        """The Arrow schema, with the table's name and description as metadata."""
        return pa.schema(
            [column.field() for column in self.columns],
            {"jointgap_table": self.name, "description": self.description},
        )
