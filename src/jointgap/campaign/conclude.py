"""Stage conclude: verdict.json, the figures and the page of a campaign."""

from collections.abc import Iterable
from typing import Any

import pandas as pd

from jointgap.campaign import plan, sentences, verdict_json
from jointgap.campaign.campaign_files import (
    SUMMARIES,
    VERDICT,
    costs,
    failures,
    recorded_costs,
    recorded_failure,
)
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.fits_on_disk import JOINED
from jointgap.campaign.page import page
from jointgap.campaign.state import CampaignState
from jointgap.core import schema
from jointgap.core.files import write_text
from jointgap.core.page import Page, Paragraph, to_html, to_markdown
from jointgap.core.results_folder import ResultsFolder


def conclude(state: CampaignState) -> dict[str, Any]:
    """Write ``verdict.json`` and return its content."""
    with recorded_costs(state.folder, "conclude"):
        folder, outcome = state.folder, state.outcome
        repeats = not any(series.statistic for series in state.model.series)
        tables = folder.read_all(verdict_json.TABLES)
        verdict = verdict_json.document(
            outcome, tables, state.campaign, state.inconsistent_channels, repeats
        )
        verdict["false_alarm_rate"] = state.false_alarm_rate
        explanations = [fit.label for fit in outcome.equivalent]
        best = verdict["best_known"]
        if best and sentences.is_near(best["rival"]):
            explanations = [outcome.best_known.label, best["rival"]["explanation"]]
        if explanations and "preflight" not in failures(folder):
            with recorded_failure(folder, "advice"):
                verdict["separated_by"] = _advice(state, explanations)
        left_out = state.model.left_out.items()
        verdict["left_out"] = [{"run": run, "because": reason} for run, reason in left_out]
        verdict["failed"] = failures(folder)
    return _written(folder, verdict)


def _advice(state: CampaignState, explanations: Iterable[str]) -> str:
    """The further measurement that separates `explanations`."""
    folder = state.folder
    if not folder.place(schema.ADVICE).is_file():
        folder.write_all(
            plan.preflight_tables(
                state.campaign, state.false_alarm_rate, state.settings, advice=True
            )
        )
    groups = plan.confusable_groups(folder.read(schema.CONFUSABILITY))
    effects = [{*label.split(JOINED)} for label in explanations]
    return plan.separated_by(folder.read(schema.ADVICE), effects, groups)


def _written(folder: ResultsFolder, verdict: dict[str, Any]) -> dict[str, Any]:
    """The content of ``verdict.json`` with the costs of all jobs, after it is written."""
    verdict |= {"costs": costs(folder)}
    write_text(folder.path / VERDICT, verdict_json.text(verdict))
    return verdict


def show(state: CampaignState) -> None:
    """Draw the figures and write the one-page summary from ``verdict.json``."""
    folder = state.folder
    with recorded_costs(folder, "figures"):
        verdict = verdict_json.read(folder.path / VERDICT)
        tables = figure_tables(folder, FIGURES.needed_tables(FIGURES))
        drawn = []
        for name in FIGURES:
            path = folder.path / f"figures/{name}.png"
            path.unlink(missing_ok=True)
            with recorded_failure(folder, name):
                drawing = FIGURES.draw(name, tables, verdict)
                if len(drawing.data):  # else a message that there is nothing to show
                    drawing.save(path)
                    drawn.append(name)
        verdict["failed"] = failures(folder)
        title = f"Campaign {verdict['campaign']}: {sentences.answer(verdict)}"
        summary = Page(title, (Paragraph(f"Details: {VERDICT}"),))
        with recorded_failure(folder, "page"):
            tables["look"] = folder.read(schema.LOOK)
            summary = page(verdict, tables, drawn, _remarks(folder), state.campaign)
        markdown, html = (folder.path / name for name in SUMMARIES)
        write_text(markdown, to_markdown(summary))
        write_text(html, to_html(summary, folder.path / "figures"))
        verdict["failed"] = failures(folder)
    _written(folder, verdict)


def _remarks(folder: ResultsFolder) -> tuple[str, ...]:
    """Remarks on the data and on their noise."""
    memory = folder.read(schema.NOISE_MEMORY).query("lag == 0 and remarks != ''")
    noise = [
        f"Run {row.run}: {remark}."
        for row in memory.itertuples()
        for remark in row.remarks.split("; ")
    ]
    return (*folder.read(schema.REMARKS)["remark"], *noise)


def figure_tables(folder: ResultsFolder, names: Iterable[str]) -> dict[str, pd.DataFrame]:
    """The tables `names` by name, as far as the `folder` of a campaign contains them."""
    return {name: folder.read(name) for name in names if folder.place(name).is_file()}
