"""What the campaign file said when its data were read: later stages go on with the same, or with none of it."""

import json
from collections.abc import Iterator
from typing import Any

import pandas as pd

from jointgap.config.campaign_file import Campaign
from jointgap.errors import InputError

_SPARE = {"name", "date", "folder"}  # a campaign may be renamed, dated or moved without its data becoming others


def config_snapshot(campaign: Campaign) -> pd.DataFrame:
    """Table `jointgap.tables.CONFIG_SNAPSHOT`: every key of a campaign and its mechanism, with its value."""
    return pd.DataFrame(_rows(campaign), columns=["key", "value"])


def check_unchanged(campaign: Campaign, snapshot: pd.DataFrame) -> None:
    """Make sure that a campaign file says what it did when its data were read.

    Fits are kept sample by sample: with a run, a channel or a unit changed they would be taken for those of other data.
    """
    now, then = dict(_rows(campaign)), dict(zip(snapshot["key"], snapshot["value"], strict=True))
    if list(now.items()) == list(then.items()):
        return
    changed = next((key for key in {**then, **now} if now.get(key) != then.get(key)), None)
    if changed is None:
        what = "its keys stand in another order"
    elif changed not in then:
        what = f"{changed} = {now[changed]} is new"
    elif any(key.startswith(f"{changed}.") for key in now):
        what = f"{changed} is a mapping now, it was {then[changed]}"
    elif changed not in now:
        what = f"{changed} is gone, it was {then[changed]}"
    else:
        what = f"{changed} is {now[changed]} now, it was {then[changed]}"
    raise InputError(
        f"campaign {campaign.name}: the file has changed since its data were read ({what}; SI); run `jointgap measure` "
        "on it again, and the stages after it"
    )


def _rows(campaign: Campaign) -> list[tuple[str, str]]:
    content = campaign.model_dump(mode="json", exclude=_SPARE)
    content["runs"] = {run.pop("id"): run for run in content["runs"]}
    content["nuisance"] = dict(campaign.nuisance)  # to the last digit
    return list(_leaves(content, ""))


def _leaves(content: Any, place: str) -> Iterator[tuple[str, str]]:
    if isinstance(content, dict):
        for key, value in content.items():
            yield from _leaves(value, f"{place}.{key}" if place else str(key))
    else:
        yield place, json.dumps(content)
