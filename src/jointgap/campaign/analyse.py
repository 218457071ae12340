"""All stages of a campaign in one process: first those required for the verdict, then the optional
ones."""

from pathlib import Path
from typing import Any

from jointgap.campaign.campaign_files import COSTS, MECHANISM, SUMMARIES, VERDICT, check_same_file
from jointgap.campaign.conclude import conclude
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.stages import CAMPAIGN_STAGES, run_stage
from jointgap.campaign.state import CampaignState
from jointgap.core.progress import with_progress
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import ADVICE, CAMPAIGN_OPTIMUM, DECISION
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings


def analyse(
    campaign: Path | str,
    folder: Path | str,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
    pictures: bool = False,
    anyway: bool = False,
) -> dict[str, Any]:
    """Run the stages of a campaign and return the content of ``verdict.json``."""
    state = CampaignState(Path(campaign), Path(folder), settings)
    required = CAMPAIGN_STAGES.needed_for("decide")
    stages = [CAMPAIGN_STAGES[name] for name in (*required, "preflight", "locate", "augment")]
    check_same_file(state.file, state.folder.path)
    written = [path for stage in stages for path in stage.outputs(part=0)]
    state.folder.check_writable(*written, *CAMPAIGN_STAGES["conclude"].files)
    _remove_conclusions(state.folder)
    options = {
        "measure": {"pictures": pictures},
        "preflight": {"advice": False},  # computed at the end if the verdict needs it
        "recalibrate": {"anyway": anyway},
    }
    for stage in with_progress(stages, "stages of the analysis"):
        run_stage(stage, state, stage.name not in required, **options.get(stage.name, {}))
    return conclude(state)


def _remove_conclusions(folder: ResultsFolder) -> None:
    """Remove the results of an earlier analysis, so that an interrupted one does not show them as
    its own."""
    paths = [folder.place(table) for table in (ADVICE, CAMPAIGN_OPTIMUM, DECISION)]
    paths += [folder.path / name for name in (VERDICT, MECHANISM, *SUMMARIES, COSTS)]
    paths += [folder.path / f"figures/{name}.png" for name in FIGURES]
    paths += (folder.path / "failed").glob("*.txt")
    for path in paths:
        path.unlink(missing_ok=True)
