"""Results as facts: one list, made once, that every output of a result shows."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import pandas as pd

from jointgap.core.page import TableBlock
from jointgap.core.words import format_range, number

_COLUMN = 24
"""Longest value in the aligned column of the terminal; longer ones stand alone."""


@dataclass(frozen=True)
class Fact:
    """One number or word of a result.

    Attributes
    ----------
    name : str
        Stable identifier, in groups separated by slashes, such as ``lengths/crank_length_mm``:
        the key in JSON and the metric in MLflow.
    value : float, int, bool, str or None
        In `unit`; None where it is unknown.
    unit : str
        Unit of `value`, `low` and `high`; empty for pure numbers and text.
    label : str
        Words for people; the name with spaces by default.
    low, high : float, optional
        Ends of the interval.
    sentence : str
        The fact as a sentence, where a table is not enough.
    before : float, optional
        Value before a change, such as an optimisation; `value` is the one after it.
    """

    name: str
    value: Any
    unit: str = ""
    label: str = ""
    low: float | None = None
    high: float | None = None
    sentence: str = ""
    before: float | None = None

    @property
    def digits(self) -> str:
        """Value and interval, or both values of a change, without the unit; lengths in mm to the
        micrometre."""
        if self.before is not None:
            return f"{self._format(self.before)} → {self._format(self.value)}"
        if self.low is None or self.high is None:
            return self._format(self.value)
        interval = format_range(self._format(self.low), self._format(self.high))
        return f"{self._format(self.value)} ({interval})"

    def _format(self, value: Any) -> str:
        if isinstance(value, str | int):
            return str(value)
        return f"{value:.3f}" if self.unit == "mm" and value is not None else number(value)

    @property
    def text(self) -> str:
        """Value, interval and unit."""
        return f"{self.digits} {self.unit}".rstrip()

    @property
    def words(self) -> str:
        """The label, or the last part of the name with spaces."""
        return self.label or self.name.rpartition("/")[2].replace("_", " ")


def document(facts: Iterable[Fact]) -> dict[str, Any]:
    """The facts as a document for JSON, nested at the slashes of the names; a change has the keys
    before and after."""
    nested: dict[str, Any] = {}
    for fact in facts:
        *groups, key = fact.name.split("/")
        place = nested
        for group in groups:
            place = place.setdefault(group, {})
        place[key] = fact.value
        if fact.before is not None:
            place[key] = {"before": fact.before, "after": fact.value}
        if fact.low is not None:
            place[f"{key}_low"], place[f"{key}_high"] = fact.low, fact.high
    return nested


def metrics(facts: Iterable[Fact]) -> dict[str, float]:
    """The finite numbers by name, for MLflow."""
    return {
        fact.name: float(fact.value)
        for fact in facts
        if isinstance(fact.value, int | float) and math.isfinite(fact.value)
    }


def frame(facts: Iterable[Fact]) -> pd.DataFrame:
    """A table with the columns quantity, value and unit, for Python and notebooks; with changes
    also the value before."""
    rows = [(fact.words, fact.value, fact.unit, fact.before) for fact in facts]
    table = pd.DataFrame(rows, columns=["quantity", "value", "unit", "before"])
    return table if table["before"].notna().any() else table.drop(columns="before")


def changes(facts: Iterable[Fact]) -> TableBlock:
    """The facts as a table of values before and after, with their changes."""
    rows = []
    for fact in facts:
        before, after = fact._format(fact.before), fact._format(fact.value)
        difference = relative = "–"
        if fact.before is not None:
            decimals = max(len(text.partition(".")[2]) for text in (before, after))
            if "e" not in before + after:  # the same decimals in both
                before, after = (f"{value:.{decimals}f}" for value in (fact.before, fact.value))
            difference = f"{fact.value - fact.before:{'+z.3f' if fact.unit == 'mm' else '+z.3g'}}"
        if fact.before and fact.unit not in ("deg", "%"):
            relative = f"{100 * (fact.value / fact.before - 1):+z.2f}"
        rows.append(
            {
                "": fact.words,
                "unit": fact.unit,
                "before": before,
                "after": after,
                "change": difference,
                "change [%]": relative,
            }
        )
    return TableBlock.of(rows, "llrrrr")


def lines(facts: Iterable[Fact]) -> list[str]:
    """The facts as lines for the terminal, in columns: label, value, unit."""
    facts = list(facts)
    label_width = max((len(fact.words) for fact in facts), default=0)
    digits_width = max((len(f.digits) for f in facts if len(f.digits) <= _COLUMN), default=0)
    return [
        f"{fact.words:<{label_width}}  {fact.digits:>{digits_width}} {fact.unit}".rstrip()
        for fact in facts
    ]


def sentences(facts: Iterable[Fact]) -> list[str]:
    """The sentences of the facts that have one."""
    return [fact.sentence for fact in facts if fact.sentence]
