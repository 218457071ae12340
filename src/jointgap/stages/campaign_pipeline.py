"""All stages of a campaign in one process."""

import time
from pathlib import Path
from typing import Any

from jointgap.campaign import verdict
from jointgap.campaign.campaign_files import MECHANISM, SUMMARIES, VERDICT
from jointgap.campaign.conclude import conclude
from jointgap.campaign.state import CampaignState
from jointgap.figures.campaign_catalogue import CATALOGUE
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from jointgap.progress import followed
from jointgap.slider_crank.settings import SliderCrankSettings
from jointgap.stages.campaign_stages import CAMPAIGN_STAGES
from jointgap.tables import ADVICE, DECISION, LOOK_ALIKES, OPTIMUM, write_text
from jointgap.tables.results_folder import ResultsFolder

# the optimum is no part of the verdict, which is concluded here without its figures
_LEFT_OUT = ("reoptimise", "conclude", "track-campaign")
_ENDINGS = (".svg", ".png", ".parquet")


def analyse(
    campaign: Path | str,
    folder: Path | str,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
    model_settings: SliderCrankSettings | None = None,
    pictures: bool = False,
    anyway: bool = False,
) -> dict[str, Any]:
    """Find where model and measurement of a campaign disagree and what is missing.

    Parameters
    ----------
    campaign : Path
        A campaign file.
    folder : Path
        Where the tables of all stages, the augmented mechanism and ``verdict.json`` are written; what an earlier
        analysis concluded there is removed first.
    settings : IdentificationSettings
        Tuned numbers of the naming.
    model_settings : SliderCrankSettings, optional
        Tuned numbers of the slider-crank model; its own defaults where absent.
    pictures : bool
        Whether the cycles of the runs are drawn too. The summary page has their numbers.
    anyway : bool
        Whether to go on where channels contradict each other.

    Returns
    -------
    dict
        The content of ``verdict.json``; with ``seconds``, the time on the clock that each stage took.

    Raises
    ------
    InputError
        Campaign or data cannot be used, channels contradict each other, or the folder cannot be written; the message
        says what to do.
    SimulationError
        The model as it stands cannot be simulated.
    """
    state, seconds = CampaignState(Path(campaign), Path(folder), settings, model_settings), {}
    stages = [stage for name, stage in CAMPAIGN_STAGES.items() if name not in _LEFT_OUT]
    written = (path for stage in (*stages, CAMPAIGN_STAGES["conclude"]) for path in stage.outputs())
    state.folder.check_writable(*written)
    _remove_conclusions(state.folder)
    # advice is sought where the verdict needs it
    options = {"measure": {"pictures": pictures}, "preflight": {"advice": False}, "noise": {"anyway": anyway}}
    for stage in followed(stages, "stages of the analysis"):
        begin = time.monotonic()
        stage.function(state, **options.get(stage.name, {}))
        seconds[stage.name] = round(time.monotonic() - begin, 3)
    document = conclude(state) | {"seconds": seconds}
    write_text(state.folder.path / VERDICT, verdict.text(document))
    return document


def _remove_conclusions(folder: ResultsFolder) -> None:
    """Remove what an earlier analysis came to: beside the tables of one that fails half-way it would pass for its
    result.
    """
    tables = [folder.place(table) for table in (ADVICE, LOOK_ALIKES, OPTIMUM)]
    tables += [folder.place(DECISION, stage) for stage in ("decide", "regress", "verdict")]
    pages = [folder.path / name for name in (VERDICT, MECHANISM, *SUMMARIES)]
    figures = [folder.path / "figures" / f"{name}{ending}" for name in CATALOGUE for ending in _ENDINGS]
    for path in (*tables, *pages, *figures):
        path.unlink(missing_ok=True)
