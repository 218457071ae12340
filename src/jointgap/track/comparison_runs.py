"""Comparison with the paper: verdicts counted, our numbers and their ratios, the text."""

import re

import pandas as pd

from jointgap.tables.compare_tables import COMPARISON
from jointgap.track.finished_tables import Given
from jointgap.track.run_record import Record

VERDICTS = {
    "number": ("agrees", "differs", "reached", "missed", "cannot be told"),
    "claim": ("holds", "does not hold", "cannot be told"),
}


def records(given: Given) -> list[Record]:
    """One run."""
    if not given.has(COMPARISON):
        return []
    rows = given.read(COMPARISON)
    metrics = {
        f"verdicts/{kind} {verdict}": int(((rows["kind"] == kind) & (rows["verdict"] == verdict)).sum())
        for kind, verdicts in VERDICTS.items()
        for verdict in verdicts
    }
    for row in rows.to_dict("records"):
        metrics |= {
            f"{column}/{_name(row['item'])}": row[column] for column in ("ours", "ratio") if pd.notna(row[column])
        }
    configuration = given.configuration("compare")
    text = given.tables[COMPARISON.name].with_suffix(".md")  # the stage writes it beside the table
    return [
        Record(
            "compare",
            metrics=metrics,
            datasets=given.datasets([], [COMPARISON.name]),
            costs=given.cost("compare"),
            params=configuration["params"],
            files=configuration["files"] | ({text.name: text} if text.is_file() else {}),
        )
    ]


def _name(item: str) -> str:
    """`item` without the signs that MLflow does not take in a metric's name."""
    return " ".join(re.sub(r"[^\w\-. ]", "", item).split())[:200]
