"""The comparison as Markdown and as a page of the report."""

import html as escape
import math

import pandas as pd

from jointgap.config import Scenario
from jointgap.paper.comparison_row import AGREES, LENGTH_AGREES
from jointgap.paper.printed import departures

HEADS = {
    "number": (
        "Printed numbers",
        ("number", "unit", "paper", "ours", "ours / paper", "verdict", "what it is, and why it differs"),
    ),
    "claim": ("Claims", ("claim", "unit", "paper", "ours", "ours / paper", "verdict", "our evidence")),
}
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem; color: #1b1f24; }
table { border-collapse: collapse; margin: 1rem 0 2rem; width: 100%; }
th, td { border-bottom: 1px solid #d8dee4; padding: .4rem .6rem; text-align: left; vertical-align: top; }
th { background: #f3f5f7; } td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
td.v { white-space: nowrap; font-weight: 600; } .good { color: #116329; } .bad { color: #a40e26; } .open { color: #6a5300; }
"""
_CLASSES = {word: "good" for word in ("agrees", "reached", "holds")}
_CLASSES |= {word: "bad" for word in ("differs", "missed", "does not hold")}


def _number(value: float | None) -> str:
    if value is None or math.isnan(value):
        return "–"
    return f"{value:.6g}" if 1e-3 <= abs(value) < 1e6 or value == 0 else f"{value:.4e}"


def _cells(row) -> tuple[str, ...]:
    return (row.item, row.unit, *map(_number, (row.paper, row.ours, row.ratio)), row.verdict, row.sentence)


def _counts(comparison: pd.DataFrame) -> str:
    """How many numbers agree and claims hold, in a sentence."""
    counts = comparison[comparison["kind"] == "number"]["verdict"].value_counts()

    def count(verdict: str) -> int:
        return int(counts.get(verdict, 0))

    return (
        f"Of the paper's training errors, put to the networks and to the second surrogate, {count('reached')} are reached and {count('missed')} missed; of its other "
        f"numbers {count('agrees')} agree and {count('differs')} differ. {_claims(comparison)}"
    )


def _claims(comparison: pd.DataFrame) -> str:
    """How many claims hold, in a sentence."""
    verdicts = comparison[comparison["kind"] == "claim"]["verdict"]
    counts = [int((verdicts == verdict).sum()) for verdict in ("holds", "does not hold", "cannot be told")]
    return f"Of {len(verdicts)} claims {counts[0]} hold, {counts[1]} do not, and {counts[2]} cannot be told."


def _introduction(scenario: Scenario, comparison: pd.DataFrame) -> list[str]:
    if found := departures(scenario.mechanism, scenario.simulate):
        return [
            scenario.description,
            f"The paper's printed numbers are not comparable with this mechanism ({'; '.join(found)}), so none is listed. "
            f"{_claims(comparison)}",
        ]
    return [
        scenario.description,
        f"{_counts(comparison)} A number agrees within {AGREES:.0%} of the paper's, an optimum length within {LENGTH_AGREES:.1%}. "
        "Nothing is tuned to match: contact parameters, bounds and window are those of the configuration.",
    ]


def markdown(comparison: pd.DataFrame, scenario: Scenario) -> str:
    """The comparison (table comparison) as Markdown."""
    lines = ["# The paper and this simulation side by side", ""]
    lines += [line for text in _introduction(scenario, comparison) if text for line in (text, "")]
    for kind, (title, heads) in HEADS.items():
        rows = comparison[comparison["kind"] == kind]
        if rows.empty:
            continue
        lines += [f"## {title}", "", f"| {' | '.join(heads)} |", f"| {' | '.join('---' for _ in heads)} |"]
        lines += [f"| {' | '.join(cell.replace('|', '/') for cell in _cells(row))} |" for row in rows.itertuples()]
        lines.append("")
    return "\n".join(lines)


def html(comparison: pd.DataFrame, scenario: Scenario) -> str:
    """The comparison (table comparison) as one self-contained page."""
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'><title>Comparison with the paper</title>",
        f"<style>{STYLE}</style></head><body><h1>The paper and this simulation side by side</h1>",
    ]
    parts += [f"<p>{escape.escape(text)}</p>" for text in _introduction(scenario, comparison) if text]
    for kind, (title, heads) in HEADS.items():
        rows = comparison[comparison["kind"] == kind]
        if rows.empty:
            continue
        parts.append(
            f"<h2>{title}</h2><table><thead><tr>{''.join(f'<th>{head}</th>' for head in heads)}</tr></thead><tbody>"
        )
        for row in rows.itertuples():
            item, unit, paper, ours, ratio, verdict, sentence = map(escape.escape, _cells(row))
            numbers = "".join(f"<td class='n'>{cell}</td>" for cell in (paper, ours, ratio))
            shown = f"<td class='v {_CLASSES.get(row.verdict, 'open')}'>{verdict}</td>"
            parts.append(f"<tr><td>{item}</td><td>{unit}</td>{numbers}{shown}<td>{sentence}</td></tr>")
        parts.append("</tbody></table>")
    parts.append("</body></html>\n")
    return "\n".join(parts)
