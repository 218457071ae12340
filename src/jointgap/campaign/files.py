"""Which campaigns a configuration asks for, and which files each of them is made of. Imports nothing heavy."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jointgap.config import read_yaml
from jointgap.config.campaign import load_campaign
from jointgap.errors import InputError


@dataclass(frozen=True)
class CampaignFiles:
    """Files of one campaign.

    Attributes
    ----------
    campaign : str
        The campaign file.
    plan : tuple of str
        It and the mechanism that it names.
    data : tuple of str
        One of each run.
    parts : int
        Jobs that share the fits: one where all joints are ideal, as fits without contact are over sooner than a process starts.
    """

    campaign: str
    plan: tuple[str, ...]
    data: tuple[str, ...]
    parts: int


def campaigns(paths: Any, folders: Sequence[Path]) -> dict[str, CampaignFiles]:
    """The campaigns of a configuration, by name.

    Parameters
    ----------
    paths : list of str
        Value of the key ``campaigns``.
    folders : sequence of Path
        Where the files are looked for, first found wins.

    Raises
    ------
    InputError
        Not a list of paths, no such file, not a campaign, or two of one name.
    """
    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        raise InputError(f"campaigns = {paths!r} must be a list of campaign files, e.g. [config/campaigns/mine.yaml]")
    found: dict[str, CampaignFiles] = {}
    for path in paths:
        file = next((folder / path for folder in folders if (folder / path).is_file()), None)
        if file is None:
            looked = ", ".join(map(str, folders))
            raise InputError(f"campaigns: no file '{path}' (looked in {looked}); give a path relative to one of these")
        campaign = load_campaign(file)
        if campaign.name in found:
            raise InputError(
                f"campaigns: {found[campaign.name].campaign} and {file} are both called '{campaign.name}'; give each its own name"
            )
        mechanism = read_yaml(file).get("mechanism")
        plan = (str(file), *([str(file.parent / mechanism)] if isinstance(mechanism, str) else []))
        data = tuple(str(campaign.folder / run.file) for run in campaign.runs)
        found[campaign.name] = CampaignFiles(str(file), plan, data, 2 if campaign.mechanism.applied().loose else 1)
    return found
