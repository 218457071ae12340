"""Stage identify: from the measured data to the verdict, its tables and the new mechanism."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pandas as pd

from jointgap.campaign import augment, plan, sentences, tables, verdict_json
from jointgap.campaign.campaign_files import (
    MECHANISM,
    VERDICT,
    costs,
    failures,
    recorded_costs,
    recorded_failure,
)
from jointgap.campaign.outcome import Outcome, compressed, family_frame, outcome_of
from jointgap.campaign.state import CampaignState
from jointgap.config.load import mechanism_as_written
from jointgap.core import schema
from jointgap.core.files import write_text
from jointgap.core.results_folder import ResultsFolder
from jointgap.identification.disagreement import map_disagreement
from jointgap.identification.identification import Identification, Identified
from jointgap.identification.search import STEPS


def explain(state: CampaignState) -> tuple[Identified, Outcome]:
    """Identify the missing effects of a campaign."""
    identified = Identification(
        state.model,
        state.settings,
        STEPS if state.steps is None else state.steps,
        library=state.library,
        false_alarm_rate=state.false_alarm_rate,
        seed=state.seed,
        has_clearances=not state.inconsistent_channels,
        inconsistent_channels=state.remaining_inconsistencies,
    ).fit()
    return identified, compressed(outcome_of(identified.decision, identified.search.seconds))


def identify(state: CampaignState, optimum: bool = True) -> None:
    """Write all results of the identification, up to ``verdict.json``.

    What is not required for the verdict may fail: the error is recorded, and its tables are empty.
    """
    folder = state.folder
    with recorded_costs(folder, "identify"):
        identified, outcome = explain(state)
        write_tables(state, identified, outcome)
        with _optional(folder, "detectability", schema.DETECTABLE, schema.CONFUSABILITY):
            write_detectability(state, identified)
        with _optional(folder, "locate", schema.MAP_BINS, schema.MAP_WINDOWS, schema.MAP_STANDOUT):
            locate(state, identified, outcome)
        write_text(folder.path / MECHANISM, "# the mechanism could not be written\n")
        with _optional(folder, "augment", schema.MISSING_FORCE):
            write_mechanism(state, outcome)
        with _optional(folder, "reoptimise", schema.CAMPAIGN_OPTIMUM):
            if optimum:
                write_optimum(state, outcome)
        verdict = _verdict(state, outcome)
    verdict["costs"] = costs(folder)
    write_text(folder.path / VERDICT, verdict_json.text(verdict))


@contextmanager
def _optional(folder: ResultsFolder, step: str, *written: schema.Table) -> Iterator[None]:
    """Context of an optional step: if it fails, the tables `written` are empty."""
    for table in written:
        folder.write(table, pd.DataFrame(columns=table.names))
    with recorded_failure(folder, step):
        yield


def write_tables(state: CampaignState, identified: Identified, outcome: Outcome) -> None:
    """Write noise, ranking, families of laws, residuals and gaps."""
    folder, prediction = state.folder, identified.prediction
    residuals = tables.residuals_in_file_convention(prediction.residuals, state.clockwise)
    folder.write(schema.NOISE, tables.noise_frame(identified.noise))
    folder.write(schema.RESIDUALS, residuals)
    folder.write(schema.CHANNEL_ERRORS, tables.channel_errors(residuals, state.campaign))
    folder.write(schema.GAPS, prediction.gaps)
    folder.write(schema.LAW_FAMILIES, family_frame(identified.families))
    folder.write(schema.RANKING, outcome.placed_ranking)


def write_detectability(state: CampaignState, identified: Identified) -> None:
    """Write the smallest detectable sizes and the confusable effects."""
    frames = plan.detectability_tables(
        identified.baseline, identified.screening.sensitivities, state.false_alarm_rate
    )
    state.folder.write_all(frames)


def locate(state: CampaignState, identified: Identified, outcome: Outcome) -> None:
    """Map the residual of the re-fitted model by run, channel and crank angle."""
    problem, residual = identified.baseline.problem, outcome.base.residual
    disagreement = map_disagreement(problem, residual, state.false_alarm_rate)
    for table, spans in {
        schema.MAP_BINS: disagreement.bins,
        schema.MAP_WINDOWS: disagreement.windows,
    }.items():
        state.folder.write(table, tables.spans_in_file_convention(spans, state.clockwise))
    state.folder.write(schema.MAP_STANDOUT, disagreement.standout)


def write_mechanism(state: CampaignState, outcome: Outcome) -> None:
    """Write the mechanism file with the identified effects, and their force."""
    campaign = state.campaign
    text = augment.augmented_file(campaign, outcome, mechanism_as_written(state.file))
    force = augment.missing_force(campaign, outcome, state.loads_of_runs)
    write_text(state.folder.path / MECHANISM, text)
    state.folder.write(schema.MISSING_FORCE, force)


def write_optimum(state: CampaignState, outcome: Outcome) -> None:
    """Write the optimal link lengths without and with the effects."""
    from jointgap.campaign import reoptimise  # slow to load

    models, speed = reoptimise.models_to_optimise(state.campaign, outcome, state.loads_of_runs)
    found = reoptimise.optimal_lengths(models, speed, state.campaign.optimise_linkage)
    state.folder.write(schema.CAMPAIGN_OPTIMUM, found)


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
    if explanations:
        with recorded_failure(folder, "advice"):
            verdict["separated_by"] = plan.separated_by(
                state.campaign,
                [{*label.split(tables.JOINED)} for label in explanations],
                plan.confusable_groups(folder.read(schema.CONFUSABILITY)),
                state.false_alarm_rate,
                state.settings,
            )
    left_out = state.model.left_out.items()
    verdict["left_out"] = [{"run": run, "because": reason} for run, reason in left_out]
    verdict["failed"] = failures(folder)
    return verdict
