"""The stages of a campaign up to its verdict, or its page, in one process."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointgap.campaign import verdict_json
from jointgap.campaign.campaign_files import COSTS, MECHANISM, SUMMARIES, VERDICT, check_same_file
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.campaign.state import CampaignState
from jointgap.core.progress import with_progress
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import CAMPAIGN_OPTIMUM
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings

if TYPE_CHECKING:
    from jointgap.identification.search import Step


def analyse(
    campaign: Path | str,
    folder: Path | str,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
    pictures: bool = False,
    anyway: bool = False,
    steps: "Sequence[Step] | None" = None,
) -> dict[str, Any]:
    """Run the stages of a campaign and return the content of ``verdict.json``; `pictures`: with
    figures and page."""
    state = CampaignState(Path(campaign), Path(folder), settings, steps)
    options: dict[str, dict[str, Any]] = {
        "measure": {"pictures": pictures},
        "identify": {"anyway": anyway, "optimum": False},  # not required for the verdict
    }
    if pictures:
        options["show"] = {}
    check_same_file(state.file, state.folder.path)
    stages = [CAMPAIGN_STAGES[name] for name in options]
    state.folder.check_writable(*(path for stage in stages for path in stage.outputs()))
    _remove_conclusions(state.folder)
    for stage in with_progress(stages, "stages of the analysis"):
        stage.function(state, **options[stage.name])
    return verdict_json.read(state.folder.path / VERDICT)


def _remove_conclusions(folder: ResultsFolder) -> None:
    """Remove the results of an earlier analysis, so that an interrupted one does not show them as
    its own."""
    paths = [folder.place(CAMPAIGN_OPTIMUM)]
    paths += [folder.path / name for name in (VERDICT, MECHANISM, *SUMMARIES, COSTS)]
    paths += [folder.path / f"figures/{name}.png" for name in FIGURES]
    paths += (folder.path / "failed").glob("*.txt")
    for path in paths:
        path.unlink(missing_ok=True)
