"""The base of the results of the Python interface."""

from collections.abc import Mapping
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import pandas as pd

from jointgap.core import facts
from jointgap.core import page as pages
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.facts import Fact
from jointgap.core.files import write_text
from jointgap.core.plot import matplotlib_style

if TYPE_CHECKING:
    from jointgap.core.plot import Drawing


class Result:
    """A result with a text form, a table for notebooks, and figures.

    Attributes
    ----------
    remarks : tuple of str
        Warnings and limitations.
    figures : mapping of str to str
        Names for `plot`, with the titles of the figures; the first is the default.
    """

    remarks: tuple[str, ...]
    figures: Mapping[str, str]
    _HEADLINE: str

    @property
    def facts(self) -> list[Fact]:
        """The result in numbers and words, in display units."""
        raise NotImplementedError

    def _draw(self, name: str) -> "Drawing":
        """The figure `name`, which is one of `figures`."""
        raise NotImplementedError

    def plot(self, name: str | None = None) -> "Drawing":
        """Draw a figure of the result.

        Parameters
        ----------
        name : str, optional
            One of `figures`; the first by default.

        Returns
        -------
        Drawing
            Displayed in a notebook; ``.save("name.png")`` writes it (also ``.svg``), ``.figure`` is
            the matplotlib figure, ``.data`` the table of the plotted data.

        Raises
        ------
        InputError
            No such figure.
        """
        name = name or next(iter(self.figures), None)
        if name is None:
            raise InputError(f"plot: there are no figures; see {type(self).__name__}.remarks")
        if name not in self.figures:
            raise InputError(
                f"plot: no figure '{name}' of this {type(self).__name__};"
                f" {did_you_mean(name, self.figures)}"
            )
        return self._draw(name)

    def write_page(self, path: Path | str) -> Path:
        """Write the result with its remarks and figures to one HTML file.

        Parameters
        ----------
        path : Path or str
            Suffix ``.html``.

        Returns
        -------
        Path
            The file.
        """
        remarks = [pages.Bullets(self.remarks)] if self.remarks else []
        blocks: list[pages.Block] = [pages.TableBlock.of(map(_row, self.facts), "lrl"), *remarks]
        with TemporaryDirectory() as folder, matplotlib_style():
            for name, title in self.figures.items():
                drawing = self.plot(name)
                suffix = ".gif" if drawing.frames else ".png"
                drawing.save(Path(folder, f"{name}{suffix}"))
                blocks.append(pages.FigureBlock(name, title, moving=suffix == ".gif"))
            page = pages.Page(self._HEADLINE, tuple(blocks), footer=pages.written_today())
            write_text(Path(path), pages.to_html(page, folder))
        return Path(path)

    def summary(self) -> pd.DataFrame:
        """The result in numbers.

        Returns
        -------
        pandas.DataFrame
            Columns quantity, value and unit.
        """
        return facts.frame(self.facts)

    def __repr__(self) -> str:
        remarks = [f"Remark: {remark}" for remark in self.remarks]
        return "\n".join([self._HEADLINE, *facts.lines(self.facts), *remarks])

    def _repr_html_(self) -> str:
        """A small table for a notebook."""
        rows = "".join(
            f"<tr><td style='text-align:left'>{escape(fact.words)}</td>"
            f"<td style='text-align:right'>{escape(fact.digits)}</td>"
            f"<td>{escape(fact.unit)}</td></tr>"
            for fact in self.facts
        )
        remarks = "".join(f"<p>Remark: {escape(remark)}</p>" for remark in self.remarks)
        caption = f"<caption><b>{escape(self._HEADLINE)}</b></caption>"
        return f"<table>{caption}<tbody>{rows}</tbody></table>{remarks}"


def _row(fact: Fact) -> dict[str, str]:
    return {"quantity": fact.words, "value": fact.digits, "unit": fact.unit}
