"""Stage conclude: the verdict with all that belongs to it, in words and pictures."""

from typing import Any

from jointgap.campaign import verdict
from jointgap.campaign.clockwise import clockwise
from jointgap.campaign.folder import SUMMARIES, VERDICT
from jointgap.campaign.preflight import separated_by
from jointgap.campaign.stages import FALSE_ALARM_RATE, preflight
from jointgap.campaign.state import Case
from jointgap.campaign.tables_of_identification import confusable_groups, gap_of, held_out, undetectable
from jointgap.campaign.verdict_page import page
from jointgap.identification.fit import Fit
from jointgap.report.page import to_html, to_markdown
from jointgap.tables import write_text


def conclude(case: Case) -> dict[str, Any]:
    """Write ``verdict.json``; its content.

    Parameters
    ----------
    case : Case
        All stages up to confirm have run.
    """
    folder, outcome = case.folder, case.outcome("regress")
    separated = _separated_by(case, outcome.equivalent)
    detectable, confusability, gaps = (folder.read(name) for name in ("detectable", "confusability", "gaps"))
    found = verdict.document(
        case.campaign.name,
        outcome,
        folder.read("map_windows"),
        {role: gap_of(gaps, role) for role in ("identify", "confirm")},
        held_out(gaps, {run.id: run.role for run in case.campaign.runs}),
        {"undetectable": undetectable(detectable), "merged": confusable_groups(confusability)},
        FALSE_ALARM_RATE,
        separated,
        clockwise(case.campaign),
    )
    write_text(folder.path / VERDICT, verdict.text(found))
    return found


def show(case: Case) -> None:
    """Draw the figures and write the one-page summary of a verdict that is there."""
    from jointgap.figures import style
    from jointgap.figures.campaign_catalogue import CATALOGUE, TABLES, draw

    folder = case.folder
    found = verdict.read(folder.path / VERDICT)
    stages = {"ranking": "regress"}  # written by two stages, of which the later one counts
    frames = {
        table: folder.read(table, stages.get(table, ""))
        for table in TABLES
        if folder.place(table, stages.get(table, "")).is_file()
    }
    for name in CATALOGUE:
        style.save(draw(name, frames, found), folder.path / "figures" / name)
    summary = page(found, frames, (*folder.read("remarks")["remark"], *_noise_remarks(case)))
    markdown, html = (folder.path / name for name in SUMMARIES)
    write_text(markdown, to_markdown(summary))
    write_text(html, to_html(summary, folder.path / "figures"))


def _noise_remarks(case: Case) -> list[str]:
    memory = case.folder.read("noise_memory", "noise").query("lag == 0")
    return [f"Run {row.run}: {text}." for row in memory.itertuples() for text in row.remarks.split("; ") if text]


def _separated_by(case: Case, equivalent: list[Fit]) -> str:
    """Which experiment would tell the explanations apart, in a sentence; empty where there is but one.

    Where advice has not been sought yet, all tables of the preflight are written again.
    """
    if not equivalent:
        return ""
    if not case.folder.place("advice").is_file():
        preflight(case)
    explanations = [{candidate.label for candidate in fit.hypothesis} for fit in equivalent]
    return separated_by(case.folder.read("advice"), explanations, confusable_groups(case.folder.read("confusability")))
