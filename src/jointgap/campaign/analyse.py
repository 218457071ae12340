"""All stages of a campaign in one process: first those required for the verdict, then the optional
ones."""

from pathlib import Path
from typing import Any

from jointgap.campaign.campaign_files import COSTS, MECHANISM, SUMMARIES, VERDICT, check_same_file
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.page import conclude
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
    made_from = CAMPAIGN_STAGES.needed_for("confirm")
    # the optimum and the figures are no part of the verdict
    names = [
        *made_from,
        *(name for name in ("preflight", "locate", "augment") if name not in made_from),
    ]
    stages = [CAMPAIGN_STAGES[name] for name in names]
    check_same_file(state.file, state.folder.path)
    state.folder.check_writable(
        *(path for name in (*names, "conclude") for path in CAMPAIGN_STAGES[name].outputs(part=0))
    )
    _remove_conclusions(state.folder)
    # advice only if the verdict needs it
    options = {
        "measure": {"pictures": pictures},
        "preflight": {"advice": False},
        "noise": {"anyway": anyway},
    }
    for stage in with_progress(stages, "stages of the analysis"):
        run_stage(stage, state, stage.name not in made_from, **options.get(stage.name, {}))
    return conclude(state)


def _remove_conclusions(folder: ResultsFolder) -> None:
    """Remove the results of an earlier analysis, so that an interrupted one does not show them as
    its own."""
    places = [folder.place(table) for table in (ADVICE, CAMPAIGN_OPTIMUM)]
    places += [folder.place(DECISION, stage) for stage in ("decide", "regress", "verdict")]
    places += [*(folder.path / "failed").glob("*.txt"), *(folder.path / COSTS).glob("*.json")]
    places += [folder.path / name for name in (VERDICT, MECHANISM, *SUMMARIES)]
    places += [
        folder.path / f"figures/{name}{end}"
        for name in FIGURES
        for end in (".svg", ".png", ".parquet")
    ]
    for path in places:
        path.unlink(missing_ok=True)
