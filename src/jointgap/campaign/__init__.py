"""A campaign: measured runs of a rig against its model, from the files to a verdict.

Its stages stand in `jointgap.stages.campaign_stages`; `analyse` runs them all.
"""

from pathlib import Path
from typing import Any


def analyse(campaign: Path | str, folder: Path | str, **settings: Any) -> dict[str, Any]:
    """As `jointgap.stages.campaign_pipeline.analyse`, which is imported when it is called: the same `campaign`,
    `folder` and, by name, ``settings`` and ``model_settings``.
    """
    from jointgap.stages.campaign_pipeline import analyse as run

    return run(campaign, folder, **settings)
