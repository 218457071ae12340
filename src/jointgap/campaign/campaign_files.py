"""Which campaigns a configuration asks for, which files each is made of, and the files that it comes to.

Importing this loads nothing heavy.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jointgap.errors import InputError

MECHANISM, VERDICT = "mechanism.yaml", "verdict.json"
SUMMARIES = ("summary.md", "summary.html")
"""What a campaign comes to, in its folder of results."""


@dataclass(frozen=True)
class CampaignFiles:
    """Files of one campaign."""

    campaign: str  # The campaign file
    plan: tuple[str, ...]  # It and the mechanism that it names
    data: tuple[str, ...]  # One of each run
    parts: int  # Jobs that share the fits


def campaigns(paths: Any, folders: Sequence[Path], parts: Any = None) -> dict[str, CampaignFiles]:
    """The campaigns of a configuration, by name."""
    from jointgap.config.load import load_campaign
    from jointgap.counts import MOST_PARTS

    if parts is not None and (not isinstance(parts, int) or isinstance(parts, bool) or not 1 <= parts <= MOST_PARTS):
        raise InputError(
            f"fit_parts = {parts!r} must be a whole number of jobs from 1 to {MOST_PARTS}, beyond which jobs have "
            "nothing to do; leave it out for the default"
        )
    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        raise InputError(f"campaigns = {paths!r} must be a list of campaign files, e.g. [config/campaigns/mine.yaml]")
    campaigns: dict[str, CampaignFiles] = {}
    for path in paths:
        file = _file(path, folders)
        campaign = load_campaign(file)
        if campaign.name in campaigns:
            raise InputError(
                f"campaigns: {campaigns[campaign.name].campaign} and {file} are both called '{campaign.name}'; "
                "give each its own name"
            )
        for run in campaign.runs:
            if not os.path.isfile(campaign.folder / run.file):
                raise InputError(
                    f"{file}: run {run.id}: no file '{run.file}' in {campaign.folder}; correct `file` of the run, or "
                    "`folder`"
                )
        data = tuple(str(campaign.folder / run.file) for run in campaign.runs)
        planned = (*plan(file), *campaign.mechanism.files)
        for read in (*planned, *data):
            if re.search(r"\{.*\}", read):
                raise InputError(
                    f"{file}: the path {read} holds braces, which Snakemake takes for a wildcard; rename the folder or "
                    "file, or run `jointgap analyse`, which takes any path"
                )
        shared = parts or (2 if campaign.mechanism.applied().loose else 1)
        campaigns[campaign.name] = CampaignFiles(str(file), planned, data, shared)
    return campaigns


def plan(file: Path) -> tuple[str, ...]:
    """A campaign file and the mechanism file that it names, if it names one."""
    from jointgap.config import read_yaml
    from jointgap.config.layers import mechanism_file

    mechanism = read_yaml(file).get("mechanism")
    named = [mechanism_file(mechanism, (file.parent,), f"{file}: mechanism")] if isinstance(mechanism, str) else []
    return (str(file), *map(str, named))


def _file(path: str, folders: Sequence[Path]) -> Path:
    for folder in folders:
        if os.path.isfile(folder / path):  # a Path's own is_file fails on a name that is too long
            return folder / path
        if os.path.isdir(folder / path):
            raise InputError(f"campaigns: '{path}' is a folder; name the campaign file in it")
    searched_folders = (
        "" if os.path.isabs(path) else f" in {' or '.join(dict.fromkeys(str(folder.resolve()) for folder in folders))}"
    )
    raise InputError(
        f"campaigns: no file '{path}'{searched_folders}; correct the path (CAMPAIGN=... of `make campaign`)"
    )
