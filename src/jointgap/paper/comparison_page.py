"""The comparison on one page."""

import math

import pandas as pd

from jointgap.config import Scenario
from jointgap.paper.printed import AGREES, LENGTH_AGREES, departures
from jointgap.report.page import Block, Cell, Heading, Page, Paragraph, TableBlock

_SECTIONS = {
    "number": (
        "Printed numbers",
        ("number", "unit", "paper", "ours", "ours / paper", "verdict", "what it is, and why it differs"),
    ),
    "claim": ("Claims", ("claim", "unit", "paper", "ours", "ours / paper", "verdict", "our evidence")),
}
_ALIGN = "llrrrll"
_TONES = {word: "good" for word in ("agrees", "reached", "holds")}
_TONES |= {word: "bad" for word in ("differs", "missed", "does not hold")}


def _number(value: float | None) -> str:
    if value is None or math.isnan(value):
        return "–"
    return f"{value:.6g}" if 1e-3 <= abs(value) < 1e6 or value == 0 else f"{value:.4e}"


def _counts(comparison: pd.DataFrame) -> str:
    """How many numbers agree and claims hold, in a sentence."""
    counts = comparison[comparison["kind"] == "number"]["verdict"].value_counts()

    def count(verdict: str) -> int:
        return int(counts.get(verdict, 0))

    return (
        f"Of the paper's training errors, put to the networks and to the second surrogate, {count('reached')} are "
        f"reached and {count('missed')} missed; of its other numbers {count('agrees')} agree and {count('differs')} "
        f"differ. {_claims(comparison)}"
    )


def _claims(comparison: pd.DataFrame) -> str:
    """How many claims hold, in a sentence."""
    verdicts = comparison[comparison["kind"] == "claim"]["verdict"]
    counts = [int((verdicts == verdict).sum()) for verdict in ("holds", "does not hold", "cannot be told")]
    return f"Of {len(verdicts)} claims {counts[0]} hold, {counts[1]} do not, and {counts[2]} cannot be told."


def _introduction(scenario: Scenario, comparison: pd.DataFrame) -> list[str]:
    if differences := departures(scenario.mechanism, scenario.simulate):
        return [
            scenario.description,
            f"This mechanism is not the paper's ({'; '.join(differences)}). So none of its numbers stands here, and of "
            "its claims those alone that have no size and no speed in them. What came out for this mechanism: "
            f"`summary.html`. {_claims(comparison)}",
        ]
    return [
        scenario.description,
        f"{_counts(comparison)} A number agrees within {AGREES:.0%} of the paper's, an optimum length within "
        f"{LENGTH_AGREES:.1%}. Nothing is tuned to match: contact parameters, bounds and window are those of the "
        "configuration.",
    ]


def page(comparison: pd.DataFrame, scenario: Scenario) -> Page:
    """The `comparison` (table `COMPARISON`) of a `scenario` on one page."""
    blocks: list[Block] = [Paragraph(text) for text in _introduction(scenario, comparison) if text]
    for kind, (title, heads) in _SECTIONS.items():
        rows = comparison[comparison["kind"] == kind]
        if len(rows):
            cells = tuple(_cells(row) for row in rows.itertuples())
            blocks += [Heading(title), TableBlock(heads, cells, _ALIGN)]
    return Page("The paper and this simulation side by side", tuple(blocks))


def _cells(row) -> tuple[str | Cell, ...]:
    numbers = map(_number, (row.paper, row.ours, row.ratio))
    return (row.item, row.unit, *numbers, Cell(row.verdict, _TONES.get(row.verdict, "open")), row.sentence)
