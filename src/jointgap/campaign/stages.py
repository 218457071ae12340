"""The stages of a campaign in order; each takes the state of the campaign and writes its tables.

Imports are inside the stages, as compiled dynamics load slowly.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from jointgap.campaign.campaign_files import (
    FIT_TABLES,
    MECHANISM,
    NOISE_TABLES,
    OUTCOME_TABLES,
    SUMMARIES,
    VERDICT,
    recorded_costs,
    recorded_failure,
)
from jointgap.core import schema
from jointgap.core.files import write_text
from jointgap.core.stage import Option, Stage, Stages

if TYPE_CHECKING:
    from jointgap.campaign.state import CampaignState


def open_campaign(
    campaign: Annotated[Path, Option("campaign", type="file")],
    folder: Annotated[
        Path | None,
        Option(
            "--folder",
            type="folder",
            help="Folder of the campaign's results; default: results/campaigns/NAME.",
        ),
    ],
) -> "CampaignState":
    """The state of a campaign."""
    from jointgap.campaign.state import CampaignState

    return CampaignState(campaign, folder)


def run_campaign_stages(
    first: Stage,
    state: "CampaignState",
    then: Annotated[
        Sequence[str],
        Option(
            "--then",
            metavar="STAGE",
            multiple=True,
            help=(
                "Further stage to run in the same process, without options of its own; repeatable."
            ),
        ),
    ] = (),
    go_on: Annotated[
        bool,
        Option(
            "--go-on",
            is_flag=True,
            help="Continue if an optional stage fails; the verdict lists what is missing.",
        ),
    ] = False,
    **options: Any,
) -> str:
    """Run a stage and further ones."""
    from jointgap.campaign.campaign_files import end_after_failures
    from jointgap.core.errors import InputError, did_you_mean

    part, parts = options.get("part", 0), options.get("parts", 1)
    if part >= parts:
        raise InputError(
            f"--part {part}: must be 0 to {parts - 1} with --parts {parts}; give a smaller part, or"
            " more --parts"
        )
    if unknown := [name for name in then if name not in CAMPAIGN_STAGES]:
        hint = did_you_mean(unknown[0], CAMPAIGN_STAGES)
        raise InputError(f"--then {unknown[0]}: no such stage; {hint}")
    stages = {first: options} | {CAMPAIGN_STAGES[name]: {} for name in then}
    state.folder.check_writable(*(path for stage in stages for path in stage.outputs(part=part)))
    required = {*CAMPAIGN_STAGES.needed_for("decide"), "conclude"} if go_on else CAMPAIGN_STAGES
    texts = [
        run_stage(stage, state, stage.name not in required, **arguments)
        for stage, arguments in stages.items()
    ]
    if first.name == "conclude" and not go_on:
        end_after_failures(state.folder)
    return "\n".join(filter(None, texts))


CAMPAIGN_STAGES = Stages(open_campaign, run_campaign_stages)
stage = CAMPAIGN_STAGES.stage

Anyway = Annotated[
    bool, Option("--anyway", is_flag=True, help="Continue even if channels are inconsistent.")
]
Parts = Annotated[
    int,
    Option("--parts", type=1, default=1, show_default=True, help="Number of parts of the fits."),
]
Part = Annotated[
    int, Option("--part", type=0, default=0, show_default=True, help="Part to fit, counted from 0.")
]

PUBLISHED = "track/published.json"


def _fits_of(stage: str) -> tuple[schema.Table, ...]:
    return tuple(table.at(stage) for table in FIT_TABLES)


_MEASURED = (schema.MEASURED, schema.REMARKS, schema.CONTRADICTIONS, schema.CONFIG_SNAPSHOT)
_RECALIBRATED = (*NOISE_TABLES, *_fits_of("recalibrate"))
_SCREENED = (schema.SIGNATURES, schema.SIGNATURE_SHAPES, schema.SCREENED, schema.THRESHOLDS)
_SINGLES = _fits_of("fit/{part}")
_PAIRS = (*_fits_of("pair/{part}"), schema.NOT_SEARCHED)
_MAP = (schema.MAP_BINS, schema.MAP_WINDOWS, schema.MAP_STANDOUT)
_CONFIRMED = (schema.RESIDUALS, schema.CHANNEL_ERRORS, schema.GAPS)
_DECIDED = (*_MEASURED, *_RECALIBRATED, *OUTCOME_TABLES)
_PREFLIGHT = (schema.DETECTABLE, schema.CONFUSABILITY, schema.ADVICE)
_IN_RECALIBRATE = {"does": "see recalibrate", "job": "recalibrate"}
_IN_DECIDE = {"does": "see decide", "job": "decide"}


@stage(writes=(*_MEASURED, schema.LOOK), does="read and check the data")
def measure(state: "CampaignState", pictures: bool = True) -> str:
    """Read the runs of CAMPAIGN into SI units, check them, and plot cycles and scatter."""
    import pandas as pd

    from jointgap.campaign.campaign_files import check_same_file, config_snapshot, write_origin
    from jointgap.config.yaml_files import plain_speeds
    from jointgap.dynamics.mechanism_warnings import odd_data
    from jointgap.rig.read_files import read_measurements
    from jointgap.rig.recording import to_frame

    folder, campaign = state.folder, state.campaign
    check_same_file(state.file, folder.path)
    measurements = read_measurements(campaign)
    warnings = [f"mechanism, {warning}" for warning in odd_data(campaign.mechanism)]
    remarks = (*measurements.remarks, *warnings, *plain_speeds(state.file))
    state.measurements = replace(measurements, remarks=remarks)
    drawings = {}
    if pictures:  # before anything is written, so that an error leaves no files
        from jointgap.rig.inspection import inspect

        numbers, drawings = inspect(campaign, state.measurements)
        folder.write(schema.LOOK, numbers)
    write_origin(state.file, folder.path)
    folder.write(schema.CONFIG_SNAPSHOT, config_snapshot(campaign))
    folder.write(schema.REMARKS, pd.DataFrame({"remark": pd.Series(remarks, dtype=object)}))
    contradictions = pd.DataFrame(
        state.measurements.contradictions, columns=schema.CONTRADICTIONS.names
    )
    folder.write(schema.CONTRADICTIONS, contradictions)
    folder.write(schema.MEASURED, to_frame(state.measurements))
    for run, drawing in drawings.items():
        drawing.save(folder.path / f"measure/{run}.png")
    lines = [f"Remark: {remark}" for remark in remarks]
    return "\n".join([*lines, f"figures and tables: {folder.path / 'measure'}"])


@stage(writes=_PREFLIGHT, does="identifiability of effects")
def preflight(state: "CampaignState", advice: bool = True) -> str:
    """Analyse identifiability of the planned CAMPAIGN.

    Reports the smallest detectable size of each effect, indistinguishable effects, and the most
    useful further speed or channel. Data files are not required; if they exist, their number of
    samples is used.
    """
    from jointgap.campaign.campaign_files import check_same_file, write_origin
    from jointgap.campaign.plan import preflight_summary, preflight_tables

    check_same_file(state.file, state.folder.path)
    frames = preflight_tables(state.campaign, state.false_alarm_rate, state.settings, advice)
    write_origin(state.file, state.folder.path)
    state.folder.write_all(frames)
    return preflight_summary(**frames) if advice else ""


@stage(reads=_MEASURED, writes=_RECALIBRATED, does="estimate noise, fit the model, screen effects")
def recalibrate(state: "CampaignState", anyway: Anyway = False) -> None:
    """Estimate channel noise from cycle-to-cycle variation, and fit the uncertain parameters within
    their ranges."""
    from jointgap.campaign.fits_on_disk import noise_to_frames
    from jointgap.identification import baseline
    from jointgap.identification.noise import noise_of_model

    if not anyway:
        state.check_agreement()
    noise = noise_of_model(state.model, state.settings)
    state.baseline = baseline.recalibrate(state.model, noise, state.settings)
    state.noise = state.baseline.problem.noise  # with solver error
    state.folder.write_all(noise_to_frames(state.noise))
    state.write_fits([state.baseline.nominal, state.baseline.base], "recalibrate")


@stage(reads=(*_MEASURED, *_RECALIBRATED), writes=_SCREENED, **_IN_RECALIBRATE)
def screen(state: "CampaignState") -> None:
    """Compute the sensitivity to each effect, and select candidates for the fits."""
    import pandas as pd

    from jointgap.campaign.fits_on_disk import screened_frame, sensitivities_to_frames
    from jointgap.identification.model_selection import shortlist_singles
    from jointgap.identification.noise import degrees_of_freedom
    from jointgap.identification.thresholds import screen_candidates

    baseline, dof = state.baseline, degrees_of_freedom(state.noise)
    state.screening = screen_candidates(baseline, state.false_alarm_rate, dof, state.seed)
    sensitivities, limits = state.screening
    state.folder.write_all(sensitivities_to_frames(sensitivities, baseline.base))
    state.folder.write(schema.THRESHOLDS, pd.DataFrame([vars(limits)]))
    shortlist = shortlist_singles(sensitivities, limits, state.settings)
    state.folder.write(schema.SCREENED, screened_frame(sensitivities, shortlist))


@stage(
    reads=(*_MEASURED, *_RECALIBRATED, *_SCREENED),
    writes=_SINGLES,
    does="fit candidates, part {part}",
    minutes=120,
)
def fit(state: "CampaignState", part: Part = 0, parts: Parts = 1) -> None:
    """Fit the selected effects."""
    from jointgap.identification.hypothesis_fits import fit_singles

    fits, seconds = fit_singles(state.baseline, *state.screening, part, parts)
    state.write_fits(fits, f"fit/{part}", seconds)


@stage(
    reads=(*_MEASURED, *_RECALIBRATED, *_SCREENED, *_SINGLES),
    writes=_PAIRS,
    does="fit pairs, part {part}",
    minutes=120,
)
def pair(state: "CampaignState", part: Part = 0, parts: Parts = 1) -> None:
    """Fit selected pairs of effects by forward simulation.

    Requires the same number of parts as the stage fit. If no single effect suffices, the first part
    repeats the search over all of them.
    """
    import pandas as pd

    from jointgap.identification.hypothesis_fits import fit_pairs

    (singles, _), inconsistent = state.fits("fit", parts), bool(state.inconsistent_channels)
    fits, seconds = fit_pairs(state.baseline, *state.screening, singles, part, parts, inconsistent)
    state.write_fits(fits, f"pair/{part}", seconds)
    steps = pd.DataFrame({"step": pd.Series(state.baseline.problem.not_searched, dtype=object)})
    state.folder.write(schema.NOT_SEARCHED, steps, str(part))


@stage(
    reads=(*_MEASURED, *_RECALIBRATED, *_SCREENED, *_SINGLES, *_PAIRS),
    writes=(*OUTCOME_TABLES, schema.LAW_FAMILIES, *_CONFIRMED),
    does="compare the fits, predict held-out runs, write the augmented mechanism, optimise lengths",
    minutes=120,
)
def decide(state: "CampaignState", parts: Parts = 1) -> None:
    """Compare the fits, search a force law if no effect explains the residual, and decide on the
    missing effects by the prediction of the held-out runs."""
    from jointgap.campaign.fits_on_disk import channel_errors, residuals_in_file_convention
    from jointgap.campaign.outcome import family_frame, outcome_of, with_force_law
    from jointgap.identification import force_law
    from jointgap.identification.confirmation import confirm
    from jointgap.identification.evidence import final_verdict
    from jointgap.identification.law_family import with_families
    from jointgap.identification.model_selection import select_hypothesis
    from jointgap.identification.verdict import UNEXPLAINED

    singles, seconds = state.fits("fit", parts)
    pairs, seconds_of_pairs = state.fits("pair", parts)
    for label, duration in seconds_of_pairs.items():
        seconds[label] = seconds.get(label, 0.0) + duration
    folder, (sensitivities, limits) = state.folder, state.screening
    decision = select_hypothesis(state.baseline, sensitivities, [*singles, *pairs], limits)
    decision, families = with_families(state.baseline, decision, limits)
    outcome = outcome_of(decision, seconds)
    if outcome.verdict == UNEXPLAINED:
        law = force_law.find_force_law(
            state.baseline.problem, outcome.base, state.library, limits, state.baseline.differences
        )
        outcome = with_force_law(outcome, law)
    frames = [folder.read(schema.NOT_SEARCHED, str(part)) for part in range(parts)]
    steps = [step for frame in frames for step in frame["step"]]
    steps = dict.fromkeys([*steps, *state.baseline.problem.not_searched])
    outcome = replace(outcome, not_searched=tuple(steps))

    # nominal values are kept if these suffice
    plain = outcome.base if outcome.proposed else outcome.chosen
    prediction = confirm(
        state.model, state.noise, plain, outcome.proposed, state.seed, state.settings
    )
    inconsistent = state.remaining_inconsistencies(outcome.equivalent or [outcome.chosen])
    outcome = final_verdict(outcome, prediction, inconsistent, state.settings.decision)
    residuals = residuals_in_file_convention(prediction.residuals, state.clockwise)
    folder.write(schema.RESIDUALS, residuals)
    folder.write(schema.CHANNEL_ERRORS, channel_errors(residuals, state.campaign))
    folder.write(schema.GAPS, prediction.gaps)
    folder.write(schema.LAW_FAMILIES, family_frame(families))
    state.write_outcome(outcome)


@stage(reads=_DECIDED, writes=_MAP, **_IN_DECIDE)
def locate(state: "CampaignState") -> None:
    """Map the residual of the re-fitted model by run, channel and crank angle."""
    from jointgap.campaign.fits_on_disk import spans_in_file_convention
    from jointgap.identification.disagreement import map_disagreement

    problem, base = state.baseline.problem, state.outcome.base
    disagreement = map_disagreement(problem, base.residual, state.false_alarm_rate)
    for table in (schema.MAP_BINS, schema.MAP_WINDOWS):
        spans = getattr(disagreement, table.name.removeprefix("map_"))
        state.folder.write(table, spans_in_file_convention(spans, state.clockwise))
    state.folder.write(schema.MAP_STANDOUT, disagreement.standout)


@stage(reads=_DECIDED, writes=(schema.MISSING_FORCE,), files=(MECHANISM,), **_IN_DECIDE)
def augment(state: "CampaignState") -> None:
    """Write the mechanism file with the identified effects."""
    from jointgap.campaign.augment import augmented_file, missing_force
    from jointgap.config.load import mechanism_as_written

    campaign, outcome = state.campaign, state.outcome
    text = augmented_file(campaign, outcome, mechanism_as_written(state.file))
    force = missing_force(campaign, outcome, state.loads_of_runs)
    write_text(state.folder.path / MECHANISM, text)
    state.folder.write(schema.MISSING_FORCE, force)


@stage(reads=_DECIDED, writes=(schema.CAMPAIGN_OPTIMUM,), **_IN_DECIDE)
def reoptimise(state: "CampaignState") -> None:
    """Optimise the link lengths for the model with and without the effects, at the speed and with
    the known loads of the fastest fitted run.

    The table is empty if no effect was added or all joints are ideal.
    """
    from jointgap.campaign.reoptimise import models_to_optimise, optimal_lengths

    models, speed = models_to_optimise(state.campaign, state.outcome, state.loads_of_runs)
    state.folder.write(schema.CAMPAIGN_OPTIMUM, optimal_lengths(models, speed))


@stage(
    reads=(
        *_DECIDED,
        *_CONFIRMED,
        *_PREFLIGHT,
        *_MAP,
        schema.LAW_FAMILIES,
        schema.MISSING_FORCE,
        schema.CAMPAIGN_OPTIMUM,
        schema.LOOK,
    ),
    files=(VERDICT, *SUMMARIES),
    does="verdict, summary and figures",
)
def conclude(state: "CampaignState") -> None:
    """Write verdict.json, the one-page summary and the figures."""
    from jointgap.campaign import conclude as conclusion

    conclusion.conclude(state)
    conclusion.show(state)


@stage(
    reads=(*OUTCOME_TABLES, schema.GAPS, schema.RESIDUALS),
    files=(PUBLISHED,),
    does="publish to MLflow",
    after=("conclude",),
    publishes=True,
)
def track_campaign(state: "CampaignState") -> None:
    """Publish a campaign's verdict, fits and figures to MLflow; publishing is idempotent."""
    from jointgap.campaign.mlflow_runs import DESCRIPTION, records
    from jointgap.core.publish import publish_records

    folder = state.folder.path
    summary = publish_records(
        state.campaign.name, DESCRIPTION, records(folder), None, folder.resolve().parents[1]
    )
    write_text(folder / PUBLISHED, json.dumps(summary, indent=2) + "\n")


def run_stage(
    stage: Stage, state: "CampaignState", optional: bool = False, **options: Any
) -> str | None:
    """Run a stage and record its costs; if an `optional` one fails, record the error and write
    empty tables."""
    if stage.name == "conclude":  # records its steps itself, as verdict.json contains the costs
        return stage.function(state, **options)
    part, parts = options.get("part", 0), options.get("parts", 1) if "part" in options else 1
    with recorded_costs(state.folder, stage.name, part, parts):
        if not optional:
            return stage.function(state, **options)
        with recorded_failure(state.folder, stage.name):
            return stage.function(state, **options)
        _write_nothing(stage, state)
    return None


def _write_nothing(stage: Stage, state: "CampaignState") -> None:
    """Write empty outputs of a stage, which the workflow requires."""
    import pandas as pd

    for table in stage.writes:
        state.folder.write(table, pd.DataFrame(columns=table.names))
    for file in stage.files:
        write_text(state.folder.path / file, f"# the stage {stage.name} could not write this\n")
