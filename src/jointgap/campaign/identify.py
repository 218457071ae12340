"""Stage identify: from the measured data to the verdict, its tables and the new mechanism."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
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
from jointgap.campaign.outcome import (
    Outcome,
    compressed,
    family_frame,
    outcome_of,
    with_force_law,
)
from jointgap.campaign.state import CampaignState
from jointgap.config.load import mechanism_as_written
from jointgap.core import schema
from jointgap.core.files import write_text
from jointgap.core.results_folder import ResultsFolder
from jointgap.identification.baseline import Baseline, recalibrate
from jointgap.identification.confirmation import Confirmed, confirm
from jointgap.identification.disagreement import map_disagreement
from jointgap.identification.evidence import final_verdict
from jointgap.identification.force_law import find_force_law
from jointgap.identification.hypothesis_fits import fit_pairs, fit_singles
from jointgap.identification.law_family import FamilyInterval, with_families
from jointgap.identification.model_selection import select_hypothesis
from jointgap.identification.noise import degrees_of_freedom, noise_of_model
from jointgap.identification.screening import Sensitivities
from jointgap.identification.thresholds import screen_candidates
from jointgap.identification.verdict import UNEXPLAINED


@dataclass(frozen=True)
class Identified:
    """Result of the identification."""

    baseline: Baseline  # Its problem contains the noise
    sensitivities: Sensitivities  # Of all candidates, about the base
    outcome: Outcome
    families: tuple[FamilyInterval, ...]
    prediction: Confirmed


def explain(state: CampaignState) -> Identified:
    """Identify the missing effects of a campaign.

    The noise is estimated and the model is fitted; effects and pairs are fitted, then the families
    of their laws; a force law is searched if no effect explains the residual; the prediction of the
    held-out runs decides.
    """
    model, settings = state.model, state.settings
    baseline = recalibrate(model, noise_of_model(model, settings), settings)
    problem, noise = baseline.problem, baseline.problem.noise  # with solver error
    sensitivities, limits = screen_candidates(
        baseline, state.false_alarm_rate, degrees_of_freedom(noise), state.seed
    )
    singles, seconds = fit_singles(baseline, sensitivities, limits)
    inconsistent = bool(state.inconsistent_channels)
    pairs, seconds_of_pairs = fit_pairs(
        baseline, sensitivities, limits, singles, inconsistent=inconsistent
    )
    fits = [*singles, *pairs]
    durations: dict[str, float] = {}
    for fit, duration in zip(fits, [*seconds, *seconds_of_pairs], strict=True):
        durations[fit.label] = durations.get(fit.label, 0.0) + duration
    decision = select_hypothesis(baseline, sensitivities, fits, limits)
    decision, families = with_families(baseline, decision, limits)
    outcome = outcome_of(decision, durations)
    if outcome.verdict == UNEXPLAINED:
        law = find_force_law(problem, outcome.base, state.library, limits, baseline.differences)
        outcome = with_force_law(outcome, law)
    outcome = replace(outcome, not_searched=tuple(dict.fromkeys(problem.not_searched)))

    # nominal values are kept if these suffice
    plain = outcome.base if outcome.proposed else outcome.chosen
    prediction = confirm(model, noise, plain, outcome.proposed, state.seed, settings)
    remaining = state.remaining_inconsistencies(outcome.equivalent or [outcome.chosen])
    outcome = final_verdict(outcome, prediction, remaining, settings.decision)
    return Identified(baseline, sensitivities, compressed(outcome), families, prediction)


def identify(state: CampaignState, optimum: bool = True) -> None:
    """Write all results of the identification, up to ``verdict.json``.

    What is not required for the verdict may fail: the error is recorded, and its tables are empty.
    """
    folder = state.folder
    with recorded_costs(folder, "identify"):
        identified = explain(state)
        write_tables(state, identified)
        with _optional(folder, "detectability", schema.DETECTABLE, schema.CONFUSABILITY):
            write_detectability(state, identified)
        with _optional(folder, "locate", schema.MAP_BINS, schema.MAP_WINDOWS, schema.MAP_STANDOUT):
            locate(state, identified)
        write_text(folder.path / MECHANISM, "# the mechanism could not be written\n")
        with _optional(folder, "augment", schema.MISSING_FORCE):
            write_mechanism(state, identified.outcome)
        with _optional(folder, "reoptimise", schema.CAMPAIGN_OPTIMUM):
            if optimum:
                write_optimum(state, identified.outcome)
        verdict = _verdict(state, identified.outcome)
    verdict["costs"] = costs(folder)
    write_text(folder.path / VERDICT, verdict_json.text(verdict))


@contextmanager
def _optional(folder: ResultsFolder, step: str, *written: schema.Table) -> Iterator[None]:
    """Context of an optional step: if it fails, the tables `written` are empty."""
    for table in written:
        folder.write(table, pd.DataFrame(columns=table.names))
    with recorded_failure(folder, step):
        yield


def write_tables(state: CampaignState, identified: Identified) -> None:
    """Write noise, ranking, families of laws, residuals and gaps."""
    folder, prediction = state.folder, identified.prediction
    residuals = tables.residuals_in_file_convention(prediction.residuals, state.clockwise)
    folder.write(schema.NOISE, tables.noise_frame(identified.baseline.problem.noise))
    folder.write(schema.RESIDUALS, residuals)
    folder.write(schema.CHANNEL_ERRORS, tables.channel_errors(residuals, state.campaign))
    folder.write(schema.GAPS, prediction.gaps)
    folder.write(schema.LAW_FAMILIES, family_frame(identified.families))
    folder.write(schema.RANKING, identified.outcome.placed_ranking)


def write_detectability(state: CampaignState, identified: Identified) -> None:
    """Write the smallest detectable sizes and the confusable effects."""
    frames = plan.detectability_tables(
        identified.baseline, identified.sensitivities, state.false_alarm_rate
    )
    state.folder.write_all(frames)


def locate(state: CampaignState, identified: Identified) -> None:
    """Map the residual of the re-fitted model by run, channel and crank angle."""
    problem, residual = identified.baseline.problem, identified.outcome.base.residual
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
    state.folder.write(schema.CAMPAIGN_OPTIMUM, reoptimise.optimal_lengths(models, speed))


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
