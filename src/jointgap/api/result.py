"""What all results have in common: a summary with units, a table in a notebook, figures by name."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, ClassVar

import pandas as pd

from jointgap.errors import InputError, did_you_mean
from jointgap.report.plain_words import number

if TYPE_CHECKING:  # loads matplotlib
    from jointgap.figures.style import Drawing

_COLUMN = 24
"""Characters of a value that stands under others; what is longer is a text of its own."""

Row = tuple[str, float | int | str, str]
"""Quantity, value and unit of a line of a summary."""


class Result(ABC):
    """A result that shows itself: as text, as a table in a notebook, and in figures.

    Attributes
    ----------
    remarks : tuple of str
        What one should know before trusting it, in sentences.
    """

    remarks: tuple[str, ...]
    _HEADLINE: ClassVar[str]

    @abstractmethod
    def _rows(self) -> Sequence[Row]:
        """The lines of the summary."""

    @property
    @abstractmethod
    def figures(self) -> Mapping[str, str]:
        """Names that `plot` takes, with the titles of the figures; the first one is drawn without a name."""

    @abstractmethod
    def _draw(self, name: str) -> "Drawing":
        """The figure `name`, which is one of `figures`."""

    def plot(self, name: str | None = None) -> "Drawing":
        """Draw a figure of the result.

        Parameters
        ----------
        name : str, optional
            One of `figures`; the first of them by default.

        Returns
        -------
        Drawing
            Shows itself in a notebook; ``.save("name.png")`` writes it (``.svg`` and ``.pdf`` too), ``.figure`` is
            matplotlib's, ``.data`` the table of all that is drawn.

        Raises
        ------
        InputError
            No such figure.
        """
        name = name or next(iter(self.figures), None)
        if name is None:
            raise InputError(f"plot: there is nothing to draw; {type(self).__name__}.remarks says why")
        if name not in self.figures:
            raise InputError(
                f"plot: no figure '{name}' of this {type(self).__name__}; {did_you_mean(name, self.figures)}"
            )
        return self._draw(name)

    def summary(self) -> pd.DataFrame:
        """The result in numbers.

        Returns
        -------
        pandas.DataFrame
            Columns quantity, value and unit, a row each.
        """
        return pd.DataFrame(self._rows(), columns=["quantity", "value", "unit"])

    def _shown(self) -> pd.DataFrame:
        table = self.summary()
        return table.assign(value=[_in_digits(row.value, row.unit) for row in table.itertuples()])

    def __repr__(self) -> str:
        table = self._shown()
        names = table["quantity"].str.len().max()
        values = max((len(value) for value in table["value"] if len(value) <= _COLUMN), default=0)
        lines = [f"{row.quantity:<{names}}  {row.value:>{values}} {row.unit}".rstrip() for row in table.itertuples()]
        return "\n".join([self._HEADLINE, *lines, *(f"Remark: {remark}" for remark in self.remarks)])

    def _repr_html_(self) -> str:
        """A small table for a notebook."""
        rows = "".join(
            f"<tr><td style='text-align:left'>{escape(row.quantity)}</td>"
            f"<td style='text-align:right'>{escape(row.value)}</td>"
            f"<td style='text-align:left'>{escape(row.unit)}</td></tr>"
            for row in self._shown().itertuples()
        )
        remarks = "".join(f"<p>Remark: {escape(remark)}</p>" for remark in self.remarks)
        caption = f"<caption style='text-align:left'><b>{escape(self._HEADLINE)}</b></caption>"
        return f"<table>{caption}<tbody>{rows}</tbody></table>{remarks}"


def _in_digits(value: float | int | str, unit: str) -> str:
    """A value for the eye: lengths to the micrometre, forces in N without powers of ten, else four digits."""
    if isinstance(value, str | int):
        return str(value)
    if unit == "mm":
        return f"{value:.3f}"
    return f"{value:.0f}" if 1e4 <= abs(value) < 1e7 else number(value)
