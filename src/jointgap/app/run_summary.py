"""The lines that the terminal shows at the end of a run."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.campaign import labels, verdict_json
from jointgap.campaign import sentences as say
from jointgap.campaign.campaign_files import SUMMARIES, VERDICT
from jointgap.core.words import format_range

Summary = Mapping[str, Any]
"""Content of the ``summary.json`` of a scenario."""

_MOST_PAGES = 3  # listed singly
_HEADS = ("scenario", "crank [mm]", "rod [mm]", "error [deg]", "change [%]")
_LEGEND = (
    "error: RMS error of the transmission angle at the original and the new lengths, simulated"
    " again, over a settled",
    "revolution, or over the configured window; change: median (5 to 95 % of an ensemble)",
)
_BASIS = {
    "samples": "compared sample by sample",
    "statistics": "compared by statistics over cycles",
}


def has_optimum(summary: Summary) -> bool:
    """Whether a scenario has lengths that satisfy all constraints."""
    return summary.get("status") != "infeasible"


def other_objective(summary: Summary) -> str:
    """The objective of a scenario if it is not the transmission angle, else ''."""
    objective = summary.get("objective", "transmission_angle")
    return "" if objective == "transmission_angle" else objective


def verdict_lines(folder: Path) -> list[str]:
    """The verdict of a campaign: answer, sizes with intervals, gap on held-out data, page."""
    verdict = verdict_json.read(folder / VERDICT)
    lines = [f"{say.subject(verdict)}: {say.answer(verdict)}"]
    lines += say.left_out_summary(verdict)
    for effect in verdict["effects"]:
        for estimate in labels.estimates([effect]):
            label = labels.format_effect(effect)
            lines.append(f"{label}: {estimate.label} {estimate.text}")
    gap = say.held_out_summary(verdict)
    lines.append(f"{gap} (1 is noise; {_BASIS[verdict['basis']]})")
    lines.append(f"page: {folder / SUMMARIES[1]}")
    return "\n  ".join(lines).split("\n")


def scenarios_without_optimum(names: Sequence[str], results: Path) -> list[str]:
    """Scenarios in which no lengths satisfy all constraints."""
    return [name for name, summary in _summaries(names, results) if not has_optimum(summary)]


def _summaries(names: Sequence[str], results: Path) -> list[tuple[str, Summary]]:
    """The scenarios that have a summary, with its content."""
    files = {name: results / name / "summary.json" for name in names}
    return [
        (name, json.loads(file.read_text(encoding="utf-8")))
        for name, file in files.items()
        if file.is_file()
    ]


def optimum_lines(names: Sequence[str], results: Path) -> list[str]:
    """Headlines of scenarios without an optimum or with another objective than the transmission
    angle; a table of the others; then remarks and pages. Empty without summaries."""
    summaries = dict(_summaries(names, results))
    if not summaries:
        return []
    infeasible = [name for name, summary in summaries.items() if not has_optimum(summary)]
    optima = {name: summaries[name] for name in summaries if name not in infeasible}
    forces = [name for name, summary in optima.items() if other_objective(summary)]
    lines = [f"{name}: {summaries[name]['headline']}" for name in (*infeasible, *forces)]
    rows = [_row(name, summary) for name, summary in optima.items() if name not in forces]
    if rows:
        lines += pd.DataFrame(rows, columns=_HEADS).to_string(index=False).splitlines()
        lines += _LEGEND
    scenarios_by_remark: dict[str, list[str]] = {}
    for name, summary in summaries.items():
        for remark in summary["remarks"]:
            scenarios_by_remark.setdefault(remark, []).append(name)
    for remark, scenarios in scenarios_by_remark.items():
        is_shared = len(scenarios) == len(summaries) > 1
        owners = "all scenarios" if is_shared else ", ".join(scenarios)
        lines.append(f"remark on {owners}: {remark}")
    if len(summaries) > _MOST_PAGES:
        return [*lines, f"pages: {results}/*/summary.html"]
    return [*lines, *(f"page of {name}: {results / name / 'summary.html'}" for name in summaries)]


def _row(name: str, summary: Summary) -> tuple[str, ...]:
    """A scenario in the table of the terminal."""
    error, reduction = summary["rms_error_deg"], summary["reduction_percent"]
    median, *quantiles = (-reduction[key] for key in ("median", "5_percent", "95_percent"))
    interval = format_range(f"{min(quantiles):+.2f}", f"{max(quantiles):+.2f}")
    return (
        name,
        f"{summary['crank_length_mm']['after']:.3f}",
        f"{summary['rod_length_mm']['after']:.3f}",
        f"{error['before']:.4f} to {error['after']:.4f}",
        f"{median:+.2f} ({interval})",
    )
