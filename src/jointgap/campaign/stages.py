"""The stages of a campaign in order; each takes the state of the campaign and writes its tables.

Imports are inside the stages, as compiled dynamics load slowly.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from jointgap.campaign.campaign_files import (
    FIT_TABLES,
    MECHANISM,
    NOISE_TABLES,
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
    stage: Stage,
    state: "CampaignState",
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
    """Run a stage."""
    from jointgap.campaign.campaign_files import end_after_failures
    from jointgap.core.errors import InputError

    part, parts = options.get("part", 0), options.get("parts", 1)
    if part >= parts:
        raise InputError(
            f"--part {part}: must be 0 to {parts - 1} with --parts {parts}; give a smaller part, or"
            " more --parts"
        )
    state.folder.check_writable(*stage.outputs(part=part))
    text = run_stage(stage, state, go_on and stage.name in OPTIONAL, **options)
    if stage.name == "conclude" and not go_on:
        end_after_failures(state.folder)
    return text or ""


OPTIONAL = ("preflight",)
"""Stages that the verdict does not require."""

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
_SINGLES = _fits_of("fit/{part}")
_PAIRS = (*_fits_of("pair/{part}"), schema.NOT_SEARCHED)
_PREFLIGHT = (schema.DETECTABLE, schema.CONFUSABILITY, schema.ADVICE)
_CONCLUDED = (
    *_fits_of("verdict"),
    schema.RANKING,
    schema.LAW_FAMILIES,
    schema.RESIDUALS,
    schema.CHANNEL_ERRORS,
    schema.GAPS,
    schema.MAP_BINS,
    schema.MAP_WINDOWS,
    schema.MAP_STANDOUT,
    schema.MISSING_FORCE,
    schema.CAMPAIGN_OPTIMUM,
)


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


@stage(reads=_MEASURED, writes=_RECALIBRATED, does="estimate noise, fit the model")
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


@stage(
    reads=(*_MEASURED, *_RECALIBRATED),
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
    reads=(*_MEASURED, *_RECALIBRATED, *_SINGLES),
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
    reads=(*_MEASURED, schema.LOOK, *_PREFLIGHT, *_RECALIBRATED, *_SINGLES, *_PAIRS),
    writes=_CONCLUDED,
    files=(MECHANISM, VERDICT, *SUMMARIES),
    does="verdict, augmented mechanism, optimal lengths, page",
    minutes=120,
)
def conclude(
    state: "CampaignState", parts: Parts = 1, optimum: bool = True, pictures: bool = True
) -> None:
    """Decide on the missing effects, and write verdict.json, the augmented mechanism, the optimal
    link lengths before and after, the figures and the one-page summary.

    The best hypothesis is searched by comparison of the fits, and by a force law if no effect
    explains the residual. The prediction of the held-out runs decides. The lengths are optimised at
    the speed and with the known loads of the fastest fitted run.
    """
    from jointgap.campaign import conclude as conclusion

    conclusion.conclude(state, parts, optimum, pictures)


@stage(
    reads=(schema.RANKING, schema.GAPS, schema.RESIDUALS),
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
        import pandas as pd

        for table in stage.writes:
            state.folder.write(table, pd.DataFrame(columns=table.names))
    return None
