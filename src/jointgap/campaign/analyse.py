"""All stages of a campaign in one process: first those from which the verdict is made, then those that add to it."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.campaign import verdict_json
from jointgap.campaign.campaign_files import MECHANISM, SUMMARIES, VERDICT, noted
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.page import conclude
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.campaign.state import CampaignState
from jointgap.core import parquet
from jointgap.core.files import write_text
from jointgap.core.progress import followed
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import ADVICE, CAMPAIGN_OPTIMUM, DECISION
from jointgap.core.stage import Stage
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings

# the optimum is no part of the verdict, which is concluded here without its figures
_LEFT_OUT = ("reoptimise", "conclude", "track-campaign")
_ENDINGS = (".svg", ".png", ".parquet")


def analyse(
    campaign: Path | str,
    folder: Path | str,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
    pictures: bool = False,
    anyway: bool = False,
) -> dict[str, Any]:
    """Find where model and measurement of a campaign disagree and what is missing."""
    state, seconds = CampaignState(Path(campaign), Path(folder), settings), {}
    made_from = [CAMPAIGN_STAGES[name] for name in CAMPAIGN_STAGES.needed_for("confirm")]
    adding = [stage for name, stage in CAMPAIGN_STAGES.items() if stage not in made_from and name not in _LEFT_OUT]
    stages = [*made_from, *adding]
    written = (path for stage in (*stages, CAMPAIGN_STAGES["conclude"]) for path in stage.outputs())
    state.folder.check_writable(*written)
    _remove_conclusions(state.folder)
    # advice is sought where the verdict needs it
    options = {"measure": {"pictures": pictures}, "preflight": {"advice": False}, "noise": {"anyway": anyway}}
    for stage in followed(stages, "stages of the analysis"):
        if stage is adding[0]:
            _conclude_early(state, adding)
        begin = time.monotonic()
        own = options.get(stage.name, {})
        _ = run_if_possible(stage, state, **own) if stage in adding else stage.function(state, **own)
        seconds[stage.name] = round(time.monotonic() - begin, 3)
    document = conclude(state) | {"seconds": seconds}
    write_text(state.folder.path / VERDICT, verdict_json.text(document))
    return document


def _conclude_early(state: CampaignState, adding: Sequence[Stage]) -> None:
    """Write the verdict as it stands before the stages that add to it, whatever becomes of these."""
    for stage in adding:
        _write_empty(stage, state)
    conclude(state, advise=False)
    for path in (path for stage in adding for path in stage.outputs()):
        (state.folder.path / path).unlink()


def run_if_possible(stage: Stage, state: CampaignState, **options: Any) -> str | None:
    """Run a stage that only adds to the verdict: if it fails that is noted, and its tables are empty."""
    with noted(state.folder, stage.name):
        return stage.function(state, **options)
    _write_empty(stage, state)
    return None


def _write_empty(stage: Stage, state: CampaignState) -> None:
    for table in stage.writes:
        parquet.write(table, pd.DataFrame(columns=table.names), state.folder.path / table.path)
    for file in stage.files:
        write_text(state.folder.path / file, f"# the stage {stage.name} could not write this\n")


def _remove_conclusions(folder: ResultsFolder) -> None:
    """Remove what an earlier analysis came to: beside the tables of one that fails half-way it would pass for its
    result.
    """
    places = [folder.place(table) for table in (ADVICE, CAMPAIGN_OPTIMUM)]
    places += [folder.place(DECISION, stage) for stage in ("decide", "regress", "verdict")]
    pages = [*(folder.path / "failed").glob("*.txt")]
    pages += [folder.path / name for name in (VERDICT, MECHANISM, *SUMMARIES)]
    figures = [folder.path / "figures" / f"{name}{ending}" for name in FIGURES for ending in _ENDINGS]
    for path in (*places, *pages, *figures):
        path.unlink(missing_ok=True)
