"""Stage conclude: the verdict with all that belongs to it, in words and pictures."""

from collections.abc import Iterable
from typing import Any

import pandas as pd

from jointgap.campaign import verdict
from jointgap.campaign.campaign_files import SUMMARIES, VERDICT
from jointgap.campaign.failures import failures, noted
from jointgap.campaign.preflight import preflight_tables_with_advice, separated_by
from jointgap.campaign.state import CampaignState
from jointgap.campaign.tables_of_identification import confusable_groups, gap_of, held_out, undetectable
from jointgap.campaign.verdict_page import page
from jointgap.campaign.verdict_sentences import answer
from jointgap.identification.fit import Fit
from jointgap.report.page import Page, Paragraph, to_html, to_markdown
from jointgap.tables import write_text
from jointgap.tables.results_folder import ResultsFolder


def conclude(state: CampaignState, advise: bool = True) -> dict[str, Any]:
    """Write ``verdict.json``; its content."""
    folder, outcome, separated = state.folder, state.outcome("verdict"), ""
    if advise and "preflight" not in failures(folder):
        with noted(folder, "advice"):
            separated = _separated_by(state, outcome.equivalent)
    detectable, confusability, gaps = (folder.read(name) for name in ("detectable", "confusability", "gaps"))
    added = outcome.named is not None
    content = verdict.document(
        state.campaign.name,
        outcome,
        folder.read("map_windows"),
        gaps,
        {role: gap_of(gaps, role, added=added) for role in ("identify", "confirm")},
        held_out(gaps, {run.id: run.role for run in state.campaign.runs}, added),
        {"undetectable": undetectable(detectable), "merged": confusable_groups(confusability)},
        state.false_alarm_rate,
        separated,
        state.clockwise,
        folder.read("map_standout"),
        state.doubted_channels,
        folder.read("law_families"),
        not any(series.statistic for series in state.model.series),
    )
    content["left_out"] = [{"run": run, "because": why} for run, why in state.model.left_out.items()]
    content["failed"] = failures(folder)
    write_text(folder.path / VERDICT, verdict.text(content))
    return content


def show(state: CampaignState) -> None:
    """Draw the figures and write the one-page summary of a verdict that is there."""
    from jointgap.figures import style
    from jointgap.figures.campaign_catalogue import CATALOGUE, TABLES, draw
    from jointgap.figures.campaign_figures import message_sheet

    folder = state.folder
    content = verdict.read(folder.path / VERDICT)
    frames = figure_tables(folder, TABLES)
    for name, spec in CATALOGUE.items():
        with noted(folder, name):
            style.save(draw(name, frames, content), folder.path / "figures" / name)
        if why := failures(folder).get(name):
            with style.matplotlib_style():
                style.save(message_sheet(spec.title, f"could not be drawn: {why}"), folder.path / "figures" / name)
    content["failed"] = failures(folder)
    summary = Page(f"Campaign {content['campaign']}: {answer(content)}", (Paragraph(f"All else: {VERDICT}"),))
    with noted(folder, "page"):
        remarks = (*folder.read("remarks")["remark"], *_noise_remarks(state))
        summary = page(content, frames | {"look": folder.read("look")}, remarks, state.campaign)
    markdown, html = (folder.path / name for name in SUMMARIES)
    write_text(markdown, to_markdown(summary))
    write_text(html, to_html(summary, folder.path / "figures"))
    if (failed := failures(folder)) != verdict.read(folder.path / VERDICT).get("failed", {}):
        write_text(folder.path / VERDICT, verdict.text(content | {"failed": failed}))


def figure_tables(folder: ResultsFolder, names: Iterable[str]) -> dict[str, pd.DataFrame]:
    """Those of the tables `names`, which figures need, that are in the `folder` of a campaign; by name."""
    stages = {"ranking": "verdict"}  # written by several stages, of which the last one counts
    places = {name: (name, stages.get(name, "")) for name in names}
    return {name: folder.read(*place) for name, place in places.items() if folder.place(*place).is_file()}


def _noise_remarks(state: CampaignState) -> list[str]:
    memory = state.folder.read("noise_memory", "noise").query("lag == 0")
    return [f"Run {row.run}: {text}." for row in memory.itertuples() for text in row.remarks.split("; ") if text]


def _separated_by(state: CampaignState, equivalent: list[Fit]) -> str:
    """Which experiment would tell the explanations apart, in a sentence; empty where there is but one.

    Where advice has not been sought yet, all tables of the preflight are written again.
    """
    if not equivalent:
        return ""
    folder = state.folder
    if not folder.place("advice").is_file():
        of_preflight = state.campaign, state.false_alarm_rate, state.settings, state.model_settings
        folder.write_all(preflight_tables_with_advice(*of_preflight))
    explanations = [{candidate.label for candidate in fit.hypothesis} for fit in equivalent]
    return separated_by(folder.read("advice"), explanations, confusable_groups(folder.read("confusability")))
