"""Stage conclude: from the fits to the verdict, its tables, the new mechanism and the page."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pandas as pd

from jointgap.campaign import augment, plan, reoptimise, sentences, verdict_json
from jointgap.campaign import fits_on_disk as disk
from jointgap.campaign.campaign_files import (
    MECHANISM,
    SUMMARIES,
    VERDICT,
    costs,
    failures,
    recorded_costs,
    recorded_failure,
)
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.outcome import (
    Outcome,
    compressed,
    family_frame,
    outcome_of,
    with_force_law,
)
from jointgap.campaign.page import page
from jointgap.campaign.state import CampaignState
from jointgap.config.load import mechanism_as_written
from jointgap.core import schema
from jointgap.core.files import write_text
from jointgap.core.page import Page, Paragraph, to_html, to_markdown
from jointgap.core.results_folder import ResultsFolder
from jointgap.identification import force_law, model_selection
from jointgap.identification.confirmation import confirm
from jointgap.identification.disagreement import map_disagreement
from jointgap.identification.evidence import final_verdict
from jointgap.identification.law_family import with_families
from jointgap.identification.verdict import UNEXPLAINED

_SHOWN = ("campaign_optimum", "look")  # tables of the page, besides those of the figures


def conclude(
    state: CampaignState, parts: int = 1, optimum: bool = True, pictures: bool = True
) -> dict[str, Any]:
    """Write all results of the fits, and return the content of ``verdict.json``.

    What is not required for the verdict may fail: the error is recorded, and its tables are empty.
    """
    folder = state.folder
    with recorded_costs(folder, "conclude"):
        outcome = decide(state, parts)
        with _optional(folder, "locate", schema.MAP_BINS, schema.MAP_WINDOWS, schema.MAP_STANDOUT):
            locate(state, outcome)
        write_text(folder.path / MECHANISM, "# the mechanism could not be written\n")
        with _optional(folder, "augment", schema.MISSING_FORCE):
            write_mechanism(state, outcome)
        if optimum:
            with _optional(folder, "reoptimise", schema.CAMPAIGN_OPTIMUM):
                campaign, loads = state.campaign, state.loads_of_runs
                models, speed = reoptimise.models_to_optimise(campaign, outcome, loads)
                folder.write(schema.CAMPAIGN_OPTIMUM, reoptimise.optimal_lengths(models, speed))
        verdict = _verdict(state, outcome)
        if pictures:
            _show(state, verdict)
        verdict["failed"] = failures(folder)
    verdict["costs"] = costs(folder)
    write_text(folder.path / VERDICT, verdict_json.text(verdict))
    return verdict


def decide(state: CampaignState, parts: int = 1) -> Outcome:
    """Compare the fits, search a force law if no effect explains the residual, and decide on the
    missing effects by the prediction of the held-out runs."""
    folder, baseline = state.folder, state.baseline
    sensitivities, limits = state.screening
    singles, seconds = state.fits("fit", parts)
    pairs, seconds_of_pairs = state.fits("pair", parts)
    for label, duration in seconds_of_pairs.items():
        seconds[label] = seconds.get(label, 0.0) + duration
    fits = [*singles, *pairs]
    decision = model_selection.select_hypothesis(baseline, sensitivities, fits, limits)
    decision, families = with_families(baseline, decision, limits)
    outcome = outcome_of(decision, seconds)
    if outcome.verdict == UNEXPLAINED:
        law = force_law.find_force_law(
            baseline.problem, outcome.base, state.library, limits, baseline.differences
        )
        outcome = with_force_law(outcome, law)
    frames = [folder.read(schema.NOT_SEARCHED, str(part)) for part in range(parts)]
    steps = [step for frame in frames for step in frame["step"]]
    steps = dict.fromkeys([*steps, *baseline.problem.not_searched])
    outcome = replace(outcome, not_searched=tuple(steps))

    # nominal values are kept if these suffice
    plain = outcome.base if outcome.proposed else outcome.chosen
    prediction = confirm(
        state.model, state.noise, plain, outcome.proposed, state.seed, state.settings
    )
    inconsistent = state.remaining_inconsistencies(outcome.equivalent or [outcome.chosen])
    outcome = final_verdict(outcome, prediction, inconsistent, state.settings.decision)
    outcome = compressed(outcome)
    residuals = disk.residuals_in_file_convention(prediction.residuals, state.clockwise)
    folder.write(schema.RESIDUALS, residuals)
    folder.write(schema.CHANNEL_ERRORS, disk.channel_errors(residuals, state.campaign))
    folder.write(schema.GAPS, prediction.gaps)
    folder.write(schema.LAW_FAMILIES, family_frame(families))
    folder.write(schema.RANKING, outcome.placed_ranking)
    state.write_fits([outcome.base, *outcome.explanations], "verdict")
    return outcome


@contextmanager
def _optional(folder: ResultsFolder, step: str, *tables: schema.Table) -> Iterator[None]:
    """Context of an optional step: if it fails, its `tables` are empty."""
    for table in tables:
        folder.write(table, pd.DataFrame(columns=table.names))
    with recorded_failure(folder, step):
        yield


def locate(state: CampaignState, outcome: Outcome) -> None:
    """Map the residual of the re-fitted model by run, channel and crank angle."""
    problem, residual = state.baseline.problem, outcome.base.residual
    disagreement = map_disagreement(problem, residual, state.false_alarm_rate)
    for table, spans in {
        schema.MAP_BINS: disagreement.bins,
        schema.MAP_WINDOWS: disagreement.windows,
    }.items():
        state.folder.write(table, disk.spans_in_file_convention(spans, state.clockwise))
    state.folder.write(schema.MAP_STANDOUT, disagreement.standout)


def write_mechanism(state: CampaignState, outcome: Outcome) -> None:
    """Write the mechanism file with the identified effects, and their force."""
    campaign = state.campaign
    text = augment.augmented_file(campaign, outcome, mechanism_as_written(state.file))
    force = augment.missing_force(campaign, outcome, state.loads_of_runs)
    write_text(state.folder.path / MECHANISM, text)
    state.folder.write(schema.MISSING_FORCE, force)


def _verdict(state: CampaignState, outcome: Outcome) -> dict[str, Any]:
    """The content of ``verdict.json`` without the costs."""
    folder = state.folder
    verdict = verdict_json.document(
        outcome,
        folder.read_all(verdict_json.TABLES),
        state.campaign,
        state.inconsistent_channels,
        repeats=not any(series.statistic for series in state.model.series),
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
    return verdict


def _advice(state: CampaignState, explanations: Iterable[str]) -> str:
    """The further measurement that separates `explanations`."""
    folder, rate = state.folder, state.false_alarm_rate
    if not folder.place(schema.ADVICE).is_file():
        frames = plan.preflight_tables(state.campaign, rate, state.settings, advice=True)
        folder.write_all(frames)
    groups = plan.confusable_groups(folder.read(schema.CONFUSABILITY))
    effects = [{*label.split(disk.JOINED)} for label in explanations]
    return plan.separated_by(folder.read(schema.ADVICE), effects, groups)


def _show(state: CampaignState, verdict: dict[str, Any]) -> None:
    """Draw the figures and write the one-page summary."""
    folder, drawn = state.folder, []
    tables = figure_tables(folder, (*FIGURES.needed_tables(FIGURES), *_SHOWN))
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
        summary = page(verdict, tables, drawn, _remarks(folder), state.campaign)
    markdown, html = (folder.path / name for name in SUMMARIES)
    write_text(markdown, to_markdown(summary))
    write_text(html, to_html(summary, folder.path / "figures"))


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
