"""The stages of a campaign in order; each takes the state of the campaign and writes its tables.

Imports are inside the stages, as compiled dynamics load slowly."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from jointgap.campaign.campaign_files import (
    COSTS,
    FIT_TABLES,
    MECHANISM,
    NOISE_TABLES,
    OUTCOME_TABLES,
    SUMMARIES,
    VERDICT,
    costs_noted,
    noted,
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
    required = {*CAMPAIGN_STAGES.needed_for("confirm"), "conclude"} if go_on else CAMPAIGN_STAGES
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

_IN_DECIDE = {"does": "see decide", "job": "decide"}
_MEASURED = (schema.MEASURED, schema.REMARKS, schema.CONTRADICTIONS, schema.CONFIG_SNAPSHOT)


def _of(place: str, written: tuple[schema.Table, ...]) -> tuple[schema.Table, ...]:
    return tuple(table.at(place) for table in written)


def _read(*stages: str) -> tuple[schema.Table, ...]:
    """The tables of the measured data and of `stages`."""
    return (*_MEASURED, *CAMPAIGN_STAGES.written_by(*stages))


@stage(writes=(*_MEASURED, schema.LOOK), does="read and check the data")
def measure(state: "CampaignState", pictures: bool = True) -> str:
    """Read the runs of CAMPAIGN into SI units, check them, and plot cycles and scatter."""
    import pandas as pd

    from jointgap.campaign.campaign_files import check_same_file, config_snapshot, write_origin
    from jointgap.config.yaml_files import plain_speeds
    from jointgap.dynamics.mechanism_warnings import odd_data
    from jointgap.rig.read_files import read_measurements
    from jointgap.rig.recording import to_frame

    folder = state.folder
    check_same_file(state.file, folder.path)
    read = read_measurements(state.campaign)
    odd = [f"mechanism, {remark}" for remark in odd_data(state.campaign.mechanism)] + plain_speeds(
        state.file
    )
    state.measurements = replace(read, remarks=(*read.remarks, *odd))
    if pictures:  # first, so that an error leaves no files
        from jointgap.core import plot
        from jointgap.rig.inspection import inspect

        numbers, drawings = inspect(state.campaign, state.measurements)
    write_origin(state.file, folder.path)
    folder.write(schema.CONFIG_SNAPSHOT, config_snapshot(state.campaign))
    folder.write(
        schema.REMARKS,
        pd.DataFrame({"remark": pd.Series(state.measurements.remarks, dtype=object)}),
    )
    contradictions = pd.DataFrame(
        state.measurements.contradictions, columns=schema.CONTRADICTIONS.names
    )
    folder.write(schema.CONTRADICTIONS, contradictions)
    folder.write(schema.MEASURED, to_frame(state.measurements))
    if pictures:
        folder.write(schema.LOOK, numbers)
        for run, drawing in drawings.items():
            plot.save(drawing, folder.path / "measure" / run)
    remarks = [f"Remark: {text}" for text in state.measurements.remarks]
    return "\n".join([*remarks, f"figures and tables: {folder.path / 'measure'}"])


@stage(
    writes=(schema.DETECTABLE, schema.CONFUSABILITY, schema.ADVICE),
    does="identifiability of effects",
)
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


@stage(
    reads=_MEASURED,
    writes=_of("noise", NOISE_TABLES),
    does="noise, uncertain parameters",
    job="recalibrate",
)
def noise(state: "CampaignState", anyway: Anyway = False) -> None:
    """Estimate channel noise from cycle-to-cycle variation."""
    from jointgap.campaign.fits_on_disk import noise_to_frames
    from jointgap.identification.noise import noise_of_model

    if not anyway:
        state.check_agreement()
    state.noise = noise_of_model(state.model, state.settings)
    state.folder.write_all(noise_to_frames(state.noise), "noise")


@stage(
    reads=_read("noise"),
    writes=(
        *_of("recalibrate", NOISE_TABLES),
        *_of("recalibrate/nominal", FIT_TABLES),
        *_of("recalibrate/base", FIT_TABLES),
    ),
    does="see noise",
)
def recalibrate(state: "CampaignState") -> None:
    """Fit the uncertain parameters within their ranges."""
    from jointgap.campaign.fits_on_disk import noise_to_frames
    from jointgap.identification.baseline import recalibrate as recalibrated

    baseline = state.baseline = recalibrated(state.model, state.noise, state.settings)
    state.noise_with_numerics = baseline.problem.noise
    state.folder.write_all(noise_to_frames(state.noise_with_numerics), "recalibrate")
    state.write_fits([baseline.nominal], "recalibrate/nominal")
    state.write_fits([baseline.base], "recalibrate/base")


@stage(
    reads=_read("noise", "recalibrate"),
    writes=(schema.SIGNATURES, schema.SIGNATURE_SHAPES, schema.SCREENED, schema.THRESHOLDS),
    does="screen the candidates",
)
def screen(state: "CampaignState") -> None:
    """Compute the sensitivity to each effect, and select candidates for the fits."""
    import pandas as pd

    from jointgap.campaign.fits_on_disk import screened_frame, sensitivities_to_frames
    from jointgap.identification.model_selection import shortlist_singles
    from jointgap.identification.noise import degrees_of_freedom
    from jointgap.identification.thresholds import screen_candidates

    dof = degrees_of_freedom(state.noise)
    sensitivities, limits = state.screening = screen_candidates(
        state.baseline, state.false_alarm_rate, dof, state.seed
    )
    state.folder.write_all(sensitivities_to_frames(sensitivities, state.baseline.base))
    state.folder.write(schema.THRESHOLDS, pd.DataFrame([vars(limits)]))
    shortlist = shortlist_singles(sensitivities, limits, state.settings)
    state.folder.write(schema.SCREENED, screened_frame(sensitivities, shortlist))


_SCREENED = _read("noise", "recalibrate", "screen")


@stage(
    reads=_SCREENED,
    writes=_of("fit/{part}", FIT_TABLES),
    does="fit candidates, part {part}",
    minutes=120,
)
def fit(state: "CampaignState", part: Part = 0, parts: Parts = 1) -> None:
    """Fit the selected effects."""
    from jointgap.identification.hypothesis_fits import fit_singles

    fits, seconds = fit_singles(state.baseline, *state.screening, part, parts)
    state.write_fits(fits, f"fit/{part}", seconds)


_FITTED = _read("noise", "recalibrate", "screen", "fit")


@stage(
    reads=_FITTED,
    writes=_of("pair/{part}", (*FIT_TABLES, schema.NOT_SEARCHED)),
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

    (alone, _), inconsistent = state.fits("fit", parts), bool(state.inconsistent_channels)
    fits, seconds = fit_pairs(state.baseline, *state.screening, alone, part, parts, inconsistent)
    state.write_fits(fits, f"pair/{part}", seconds)
    steps = pd.DataFrame({"step": pd.Series(state.baseline.problem.not_searched, dtype=object)})
    state.folder.write(schema.NOT_SEARCHED, steps, f"pair/{part}")


@stage(
    reads=_read("noise", "recalibrate", "screen", "fit", "pair"),
    writes=(*_of("decide", OUTCOME_TABLES), *_of("decide/base", FIT_TABLES), schema.LAW_FAMILIES),
    does="compare the fits, map the residual, predict held-out runs, write the augmented mechanism",
    minutes=90,
)
def decide(state: "CampaignState", parts: Parts = 1) -> None:
    """Compare the fits and decide on the missing effects; fit the shapes of law families."""
    from jointgap.campaign.fits_on_disk import family_frame, outcome_of
    from jointgap.identification.law_family import with_families
    from jointgap.identification.model_selection import select_hypothesis

    (singles, of_singles), (pairs, seconds) = (
        state.fits(stage, parts) for stage in ("fit", "pair")
    )
    seconds = {
        label: of_singles.get(label, 0.0) + seconds.get(label, 0.0)
        for label in of_singles | seconds
    }
    sensitivities, limits = state.screening
    decision = select_hypothesis(state.baseline, sensitivities, [*singles, *pairs], limits)
    decision, families = with_families(state.baseline, decision, limits)
    of_pairs = (state.folder.read("not_searched", f"pair/{part}")["step"] for part in range(parts))
    steps = [step for of_part in of_pairs for step in of_part]
    not_searched = tuple(dict.fromkeys([*steps, *state.baseline.problem.not_searched]))
    decision = replace(decision, not_searched=not_searched)
    state.folder.write(schema.LAW_FAMILIES, family_frame(families))
    state.verdict_baseline = replace(state.baseline, base=decision.base)
    state.write_fits([decision.base], "decide/base")
    state.write_outcome(outcome_of(decision, seconds), "decide")


_DECIDED = _read("noise", "recalibrate", "decide")
_MAP = ("bins", "windows", "tests", "orders", "standout", "scaling")


@stage(reads=_DECIDED, writes=tuple(schema.TABLES[f"map_{name}"] for name in _MAP), **_IN_DECIDE)
def locate(state: "CampaignState") -> None:
    """Map the residual of the re-fitted model by run, channel and crank angle."""
    from jointgap.campaign.fits_on_disk import map_as_read
    from jointgap.identification.disagreement import map_disagreement

    baseline = state.verdict_baseline
    disagreement = map_disagreement(
        baseline.problem, baseline.base.residual, state.false_alarm_rate
    )
    for name in _MAP:
        frame = getattr(disagreement, name)
        state.folder.write(
            f"map_{name}", map_as_read(frame, state.clockwise) if "start_deg" in frame else frame
        )


@stage(
    reads=(*_DECIDED, *CAMPAIGN_STAGES.written_by("screen")),
    writes=_of("regress", OUTCOME_TABLES),
    **_IN_DECIDE,
)
def regress(state: "CampaignState") -> None:
    """If no effect explains the residual, search a force law as a formula."""
    from jointgap.campaign.fits_on_disk import outcome_with_law
    from jointgap.identification import force_law
    from jointgap.identification.verdict import UNEXPLAINED

    outcome = state.outcome("decide")
    if outcome.verdict == UNEXPLAINED:
        baseline, limits = state.verdict_baseline, state.screening.limits
        found = force_law.find_force_law(
            baseline.problem, baseline.base, state.library, limits, baseline.differences
        )
        steps = (*outcome.not_searched, *baseline.problem.not_searched)
        outcome = replace(
            outcome_with_law(outcome, found), not_searched=tuple(dict.fromkeys(steps))
        )
    state.write_outcome(outcome, "regress")


@stage(
    reads=_read("noise", "recalibrate", "decide", "regress"),
    writes=(schema.RESIDUALS, schema.CHANNEL_ERRORS, schema.GAPS, *_of("verdict", OUTCOME_TABLES)),
    **_IN_DECIDE,
)
def confirm(state: "CampaignState") -> None:
    """Predict the held-out runs with and without the effects, and decide on the final verdict."""
    from jointgap.campaign.fits_on_disk import channel_errors, residuals_as_read
    from jointgap.identification.confirmation import confirm as confirmed_with
    from jointgap.identification.evidence import final_verdict

    outcome = state.outcome("regress")
    proposed = outcome.proposed
    plain = (
        outcome.base if proposed else outcome.chosen
    )  # the latter at nominal values if these suffice
    prediction = confirmed_with(
        state.model, state.noise_with_numerics, plain, proposed, state.seed, state.settings
    )
    inconsistent = state.remaining_inconsistencies(outcome.equivalent or [outcome.chosen])
    final = final_verdict(outcome, prediction, inconsistent, state.settings.decision)
    residuals = residuals_as_read(prediction.residuals, state.clockwise)
    state.folder.write(schema.RESIDUALS, residuals)
    state.folder.write(schema.CHANNEL_ERRORS, channel_errors(residuals, state.campaign))
    state.folder.write(schema.GAPS, prediction.gaps)
    state.write_outcome(final, "verdict")


_CONFIRMED = _read("noise", "recalibrate", "decide", "confirm")


@stage(reads=_CONFIRMED, writes=(schema.MISSING_FORCE,), files=(MECHANISM,), **_IN_DECIDE)
def augment(state: "CampaignState") -> None:
    """Write the mechanism file with the identified effects."""
    from jointgap.campaign.augment import augment as augmented
    from jointgap.config.load import mechanism_as_written

    written = mechanism_as_written(state.file)
    text, force = augmented(state.campaign, state.outcome("verdict"), written, state.own_loads)
    write_text(state.folder.path / MECHANISM, text)
    state.folder.write(schema.MISSING_FORCE, force)


@stage(
    reads=_CONFIRMED,
    writes=(schema.CAMPAIGN_OPTIMUM,),
    does="optimise lengths before and after",
    minutes=60,
)
def reoptimise(state: "CampaignState") -> None:
    """Optimise the link lengths for the model with and without the effects, at the speed and with
    the known loads of the fastest fitted run.

    The table is empty if no effect was added or all joints are ideal.
    """
    from jointgap.campaign.augment import mechanisms
    from jointgap.campaign.reoptimise import reoptimise as reoptimised
    from jointgap.config import load_mechanism
    from jointgap.rig.cylinder_pressure import with_loads

    models = {}
    # with ideal joints the transmission angle depends on the lengths only
    if any(
        one.applied().loose
        for one in (state.campaign.mechanism, load_mechanism(state.folder.path / MECHANISM))
    ):
        outcome = state.outcome("verdict")
        if not all(candidate.sensor for candidate in outcome.chosen.hypothesis):
            models = dict(
                zip(("base", "augmented"), mechanisms(state.campaign, outcome), strict=True)
            )
    fastest = max(
        (run for run in state.campaign.runs if run.role != "confirm"), key=lambda run: run.speed
    )
    if fastest.direction == "clockwise":
        models = {name: mechanism.applied().mirrored() for name, mechanism in models.items()}
    loads = state.own_loads.get(fastest.id, ()) if models else ()
    models = {name: with_loads(mechanism, loads) for name, mechanism in models.items()}
    state.folder.write(schema.CAMPAIGN_OPTIMUM, reoptimised(models, fastest.speed))


@stage(
    reads=(
        *_CONFIRMED,
        *CAMPAIGN_STAGES.written_by("preflight", "locate", "augment", "reoptimise"),
    ),
    files=(VERDICT, *SUMMARIES, "figures/gaps.png"),
    does="verdict, summary and figures",
)
def conclude(state: "CampaignState") -> None:
    """Write verdict.json, the one-page summary and the figures."""
    from jointgap.campaign import page as concluding

    concluding.conclude(state)
    concluding.show(state)


@stage(
    reads=(*_of("verdict", OUTCOME_TABLES), schema.GAPS, schema.RESIDUALS),
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
    """Run a stage and note its costs; if an `optional` one fails, note the error and write empty
    tables."""
    if stage.name == "conclude":  # it notes its parts itself, as verdict.json contains the costs
        return stage.function(state, **options)
    parts, part = options.get("parts", 1), ""
    if "part" in options:  # of another number of parts nothing is left
        own = {f"{stage.name}-{i}" for i in range(parts)} if parts > 1 else {stage.name}
        for place in (state.folder.path / COSTS).glob(f"{stage.name}*.json"):
            if place.stem not in own:
                place.unlink(missing_ok=True)
        part = f"-{options['part']}" if parts > 1 else ""
    with costs_noted(state.folder, f"{stage.name}{part}"):
        return (
            _run_if_possible(stage, state, **options)
            if optional
            else stage.function(state, **options)
        )


def _run_if_possible(stage: Stage, state: "CampaignState", **options: Any) -> str | None:
    import pandas as pd

    with noted(state.folder, stage.name):
        return stage.function(state, **options)
    for table in stage.writes:
        state.folder.write(table, pd.DataFrame(columns=table.names))
    for file in stage.files:
        write_text(state.folder.path / file, f"# the stage {stage.name} could not write this\n")
    return None
