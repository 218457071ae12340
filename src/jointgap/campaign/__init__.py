"""A campaign: measured runs of a rig against its model, from the files to a verdict.

`stages` holds one function for each stage, on files; `analyse` runs them all.
"""

from pathlib import Path
from typing import Any


def analyse(campaign: Path | str, folder: Path | str) -> dict[str, Any]:
    """As `jointgap.campaign.pipeline.analyse`, which is imported when it is called."""
    from jointgap.campaign.pipeline import analyse as run

    return run(campaign, folder)
