"""A study of many designs: sweep, sensitivity, settings of the paper, or robust lengths. Facts,
tables and figures of each are shown on the same kind of page."""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from jointgap.core import parquet, plot
from jointgap.core.facts import Fact, metrics, sentences
from jointgap.core.files import write_text
from jointgap.core.page import (
    Block,
    FigureBlock,
    Heading,
    Page,
    Paragraph,
    TableBlock,
    write_page,
    written_today,
)
from jointgap.core.plot import Drawing
from jointgap.core.publish import name_and_factor
from jointgap.core.schema import Column, Table
from jointgap.core.words import format_name, format_range, format_unit, number, reading_unit

SUMMARY = "summary.json"
"""File with the numbers of a study, which are published to MLflow."""


Figures = Mapping[FigureBlock, Callable[[], Drawing]]
"""The figures of a study, with the functions that draw them."""


@dataclass(frozen=True)
class Study:
    """Results of a study."""

    title: str
    facts: list[Fact]  # Numbers; their sentences are the main result
    introduction: str
    tables: tuple[TableBlock, ...]
    method: str
    figures: Figures = field(default_factory=dict)
    frames: Mapping[Table, pd.DataFrame] = field(default_factory=dict)  # Tables to write
    subject: str = ""

    @property
    def page(self) -> Page:
        """Main result, tables, figures, method."""
        blocks: tuple[Block, ...] = (
            *(Paragraph(sentence, strong=True) for sentence in sentences(self.facts)),
            Paragraph(self.introduction),
            *self.tables,
            *self.figures,
            Heading("Method"),
            Paragraph(self.method),
        )
        return Page(self.title, blocks, self.subject, written_today())

    def write(self, folder: Path) -> str:
        """Write tables, figures, numbers and page to a `folder`; returns the page as Markdown."""
        for figure, draw in self.figures.items():
            with plot.matplotlib_style():
                plot.save(draw(), folder / figure.stem)
        for table, frame in self.frames.items():
            parquet.write(table, frame, folder / Path(table.path).name)
        write_text(folder / SUMMARY, json.dumps(metrics(self.facts), indent=2) + "\n")
        return write_page(folder / "summary", self.page, ".")


def format_interval(fact: Fact, digits: int = 2) -> str:
    """``6.4 (4.9 to 7.4)``: the value of a fact and its interval."""
    value, low, high = (number(value, digits) for value in (fact.value, fact.low, fact.high))
    return value if fact.low is None else f"{value} ({format_range(low, high)})"


def fact_table(
    cells: Iterable[tuple[str, str, Fact | str]], caption: str = "", digits: int | None = None
) -> TableBlock:
    """A table of facts, which are given with the labels of their row and column."""
    rows: dict[str, dict[str, str]] = {}
    for row, column, content in cells:
        if isinstance(content, Fact):
            content = format_interval(content, digits) if digits else content.digits
        rows.setdefault(row, {})[column] = content
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))
    texts = ((label, *(row.get(column, "") for column in columns)) for label, row in rows.items())
    return TableBlock(("", *columns), tuple(texts), "l" + "r" * len(columns), caption)


def metric(column: Column) -> tuple[str, float, str]:
    """Name of a metric of a column, its number of display units per SI unit, and that unit; shares
    in percent."""
    if column.kind == "float" and column.unit == "1":
        return f"{column.name}_percent", 100.0, "%"
    name, factor = name_and_factor(column)
    unit = "mdeg" if name.endswith("_mdeg") else reading_unit(column.unit)[0]
    return name, factor, "" if unit == "1" else format_unit(unit)


def facts_of_rows(table: Table, frame: pd.DataFrame, section: str) -> dict[str, Fact]:
    """A fact for each number of a table, by section and column.

    `section` begins the names; columns in braces are replaced by the values of the row.
    """
    facts = {}
    for row in frame.to_dict("records"):
        prefix = section.format(**row)
        for column in table.columns:
            if column.kind not in ("int", "float") or pd.isna(row[column.name]):
                continue
            name, factor, unit = metric(column)
            value, low, high = (
                factor * row[key] if key in row else None
                for key in (column.name, f"{column.name}_low", f"{column.name}_high")
            )
            label = format_name(column.name)
            facts[prefix + column.name] = Fact(prefix + name, value, unit, label, low, high)
    return facts
