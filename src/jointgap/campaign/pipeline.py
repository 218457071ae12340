"""All stages of a campaign in one process."""

import time
from pathlib import Path
from typing import Any

from jointgap.campaign import stages, verdict
from jointgap.campaign.conclude import conclude
from jointgap.campaign.folder import MECHANISM, SUMMARIES, VERDICT, Folder
from jointgap.campaign.state import Case
from jointgap.figures.campaign_catalogue import CATALOGUE
from jointgap.tables import write_text

ORDER = (
    "measure",
    "preflight",
    "noise",
    "recalibrate",
    "screen",
    "fit",
    "pair",
    "decide",
    "locate",
    "regress",
    "confirm",
    "augment",
)
"""The stages, as they follow each other."""


_OPTIONS = {"measure": {"pictures": False}, "preflight": {"advice": False}}
"""Advice is sought where the verdict needs it, and who wants pictures asks for them."""

_ENDINGS = (".svg", ".png", ".parquet")


def analyse(campaign: Path | str, folder: Path | str) -> dict[str, Any]:
    """Find where model and measurement of a campaign disagree and what is missing.

    Parameters
    ----------
    campaign : Path
        A campaign file.
    folder : Path
        Where the tables of all stages, the augmented mechanism and ``verdict.json`` are written; what an earlier analysis concluded
        there is removed first.

    Returns
    -------
    dict
        The content of ``verdict.json``; with ``seconds``, the time on the clock that each stage took.

    Raises
    ------
    InputError
        Campaign or data cannot be used, or the folder cannot be written; the message says what to do.
    SimulationError
        The model as it stands cannot be simulated.
    """
    case, seconds = Case(Path(campaign), Path(folder)), {}
    case.folder.check_writable(*(f"{name}/0" if name in ("fit", "pair") else name for name in ORDER), "conclude")
    _remove_conclusions(case.folder)
    for name in ORDER:
        begin = time.monotonic()
        getattr(stages, name)(case, **_OPTIONS.get(name, {}))
        seconds[name] = round(time.monotonic() - begin, 3)
    found = conclude(case) | {"seconds": seconds}
    write_text(case.folder.path / VERDICT, verdict.text(found))
    return found


def _remove_conclusions(folder: Folder) -> None:
    """Remove what an earlier analysis came to: beside the tables of one that fails half-way it would pass for its result."""
    tables = [folder.place("advice"), folder.place("campaign_optimum")]
    tables += [folder.place("decision", stage) for stage in ("decide", "regress")]
    pages = [folder.path / name for name in (VERDICT, MECHANISM, *SUMMARIES)]
    pictures = [folder.path / "figures" / f"{name}{ending}" for name in CATALOGUE for ending in _ENDINGS]
    for path in (*tables, *pages, *pictures):
        path.unlink(missing_ok=True)
