"""The stages of a campaign in order; each takes the state of the campaign and writes its tables.

Imports are inside the stages, as compiled dynamics load slowly.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from jointgap.campaign.campaign_files import MECHANISM, SUMMARIES, VERDICT, recorded_costs
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


def run_campaign_stages(stage: Stage, state: "CampaignState", **options: Any) -> str:
    """Run a stage; exit code 3 if an optional step of it failed, unless `go_on`."""
    from jointgap.campaign.campaign_files import end_after_failures

    go_on = options.pop("go_on", True)
    state.folder.check_writable(*stage.outputs())
    text = stage.function(state, **options)
    if not go_on:
        end_after_failures(state.folder)
    return text or ""


CAMPAIGN_STAGES = Stages(open_campaign, run_campaign_stages)
stage = CAMPAIGN_STAGES.stage

Anyway = Annotated[
    bool, Option("--anyway", is_flag=True, help="Continue even if channels are inconsistent.")
]
GoOn = Annotated[
    bool, Option("--go-on", is_flag=True, help="Exit without error even if an optional step fails.")
]

PUBLISHED = "track/published.json"

_MEASURED = (schema.MEASURED, schema.REMARKS, schema.CONTRADICTIONS, schema.CONFIG_SNAPSHOT)
_IDENTIFIED = (
    schema.NOISE,
    schema.RANKING,
    schema.LAW_FAMILIES,
    schema.RESIDUALS,
    schema.CHANNEL_ERRORS,
    schema.GAPS,
    schema.DETECTABLE,
    schema.CONFUSABILITY,
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
    from jointgap.motion.mechanism_warnings import odd_data
    from jointgap.rig.read_files import read_measurements
    from jointgap.rig.recording import to_frame

    folder, campaign = state.folder, state.campaign
    check_same_file(state.file, folder.path)
    if campaign.optimise_linkage:  # before hours of identification
        from jointgap.campaign.reoptimise import check_lengths  # slow to load

        check_lengths(campaign)
    with recorded_costs(folder, "measure"):
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


@stage(
    reads=_MEASURED,
    writes=_IDENTIFIED,
    files=(MECHANISM, VERDICT),
    does="identify missing effects",
    minutes=240,
)
def identify(
    state: "CampaignState", anyway: Anyway = False, go_on: GoOn = False, optimum: bool = True
) -> None:
    """Identify the effects that the model lacks, and write verdict.json, the augmented mechanism
    and the optimal link lengths before and after.

    The noise is estimated, the model fitted to the data, and effects are fitted one by one and in
    pairs. The prediction of the held-out runs decides. The lengths are optimised at the speed and
    with the known loads of the fastest fitted run.
    """
    from jointgap.campaign import identify as identification

    if not anyway:
        state.check_agreement()
    identification.identify(state, optimum)


@stage(reads=(schema.LOOK,), files=SUMMARIES, does="figures and page", after=("identify",))
def show(state: "CampaignState", go_on: GoOn = False) -> None:
    """Draw the figures of the verdict and write the one-page summary."""
    from jointgap.campaign import show as pages

    pages.show(state.folder, state.campaign)


@stage(
    reads=(schema.RANKING, schema.GAPS, schema.RESIDUALS),
    files=(PUBLISHED,),
    does="publish to MLflow",
    after=("identify", "show"),
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
