"""All stages of a campaign in one process: first those required for the verdict, then the optional ones."""

import time
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.campaign import verdict_json
from jointgap.campaign.campaign_files import MECHANISM, SUMMARIES, VERDICT, check_same_file, noted
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.page import conclude
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.campaign.state import CampaignState
from jointgap.core.files import write_text
from jointgap.core.progress import with_progress
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import ADVICE, CAMPAIGN_OPTIMUM, DECISION
from jointgap.core.stage import Stage
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings


def analyse(
    campaign: Path | str,
    folder: Path | str,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
    pictures: bool = False,
    anyway: bool = False,
) -> dict[str, Any]:
    """Run the stages of a campaign and return the content of ``verdict.json``."""
    state, seconds = CampaignState(Path(campaign), Path(folder), settings), {}
    made_from = CAMPAIGN_STAGES.needed_for("confirm")
    # the optimum and the figures are no part of the verdict
    names = [*made_from, *(name for name in ("preflight", "locate", "augment") if name not in made_from)]
    stages = [CAMPAIGN_STAGES[name] for name in names]
    check_same_file(state.file, state.folder.path)
    state.folder.check_writable(*(path for name in (*names, "conclude") for path in CAMPAIGN_STAGES[name].outputs()))
    _remove_conclusions(state.folder)
    # advice only if the verdict needs it
    options = {"measure": {"pictures": pictures}, "preflight": {"advice": False}, "noise": {"anyway": anyway}}
    for stage in with_progress(stages, "stages of the analysis"):
        begin, own = time.monotonic(), options.get(stage.name, {})
        _ = stage.function(state, **own) if stage.name in made_from else run_if_possible(stage, state, **own)
        seconds[stage.name] = round(time.monotonic() - begin, 3)
    document = conclude(state) | {"seconds": seconds}
    write_text(state.folder.path / VERDICT, verdict_json.text(document))
    return document


def run_if_possible(stage: Stage, state: CampaignState, **options: Any) -> str | None:
    """Run an optional stage; if it fails, note the error and write empty tables."""
    with noted(state.folder, stage.name):
        return stage.function(state, **options)
    for table in stage.writes:
        state.folder.write(table, pd.DataFrame(columns=table.names))
    for file in stage.files:
        write_text(state.folder.path / file, f"# the stage {stage.name} could not write this\n")
    return None


def _remove_conclusions(folder: ResultsFolder) -> None:
    """Remove the results of an earlier analysis, so that an interrupted one does not show them as its own."""
    places = [folder.place(table) for table in (ADVICE, CAMPAIGN_OPTIMUM)]
    places += [folder.place(DECISION, stage) for stage in ("decide", "regress", "verdict")]
    places += [*(folder.path / "failed").glob("*.txt")]
    places += [folder.path / name for name in (VERDICT, MECHANISM, *SUMMARIES)]
    places += [folder.path / f"figures/{name}{end}" for name in FIGURES for end in (".svg", ".png", ".parquet")]
    for path in places:
        path.unlink(missing_ok=True)
