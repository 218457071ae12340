"""All stages of a campaign in one process."""

import time
from pathlib import Path
from typing import Any

from jointgap.campaign import stages, verdict
from jointgap.campaign.case import Case
from jointgap.campaign.conclude import conclude
from jointgap.campaign.folder import VERDICT
from jointgap.tables import write_text

ORDER = (
    "measure",
    "preflight",
    "noise",
    "recalibrate",
    "locate",
    "screen",
    "fit",
    "pair",
    "decide",
    "regress",
    "confirm",
    "augment",
)
"""The stages, as they follow each other."""


_OPTIONS = {"measure": {"pictures": False}, "preflight": {"advice": False}}
"""Advice is sought where the verdict needs it, and who wants pictures asks for them."""


def analyse(campaign: Path | str, folder: Path | str) -> dict[str, Any]:
    """Find where model and measurement of a campaign disagree and what is missing.

    Parameters
    ----------
    campaign : Path
        A campaign file.
    folder : Path
        Where the tables of all stages, the augmented mechanism and ``verdict.json`` are written.

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
    for name in ("advice", "campaign_optimum"):  # of earlier data, in a folder that is used again
        case.folder.place(name).unlink(missing_ok=True)
    for name in ORDER:
        begin = time.monotonic()
        getattr(stages, name)(case, **_OPTIONS.get(name, {}))
        seconds[name] = round(time.monotonic() - begin, 3)
    found = conclude(case) | {"seconds": seconds}
    write_text(case.folder.path / VERDICT, verdict.text(found))
    return found
