"""A campaign: measured runs of a rig against its model, from the files to a verdict.

Its stages stand in `jointgap.stages.campaign_stages`; `analyse` runs them all.
"""

from pathlib import Path
from typing import Any


def analyse(campaign: Path | str, folder: Path | str) -> dict[str, Any]:
    """As `jointgap.stages.campaign_pipeline.analyse`, with the same `campaign` and `folder`; it is imported when it is
    called.
    """
    from jointgap.stages.campaign_pipeline import analyse as run

    return run(campaign, folder)
