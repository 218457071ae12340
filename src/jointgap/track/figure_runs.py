"""Figures: one run that holds them all."""

from collections.abc import Sequence
from pathlib import Path

from jointgap.track.finished_tables import Given
from jointgap.track.run_record import Record


def records(given: Given, figures: Sequence[Path]) -> list[Record]:
    """One run, if there are figures."""
    if not figures:
        return []
    configuration = given.configuration("figures")
    files = configuration["files"] | {f"figures/{path.name}": path for path in figures}
    metrics = {"figures": len({path.stem for path in figures})}
    return [
        Record("figures", metrics=metrics, params=configuration["params"], files=files, costs=given.cost("figures"))
    ]
