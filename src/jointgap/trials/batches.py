"""Batches of trials that go on where they were stopped: a trial that the same code has finished is not done again."""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from jointgap.errors import InputError
from jointgap.tables import write_text
from jointgap.trials.trial_plan import Plan, Sizes, plans


def pieces(sizes: Sizes, batch: int) -> list[Plan]:
    """The trials of one batch of a set."""
    return plans(sizes)[batch * sizes.batch : (batch + 1) * sizes.batch]


def of_files(folder: Path) -> str:
    """Digest of the names and bytes of the files in a folder; of one that is not there, that of none."""
    found = hashlib.sha256()
    for path in sorted(folder.glob("*")):
        content = path.read_bytes()
        found.update(f"{path.name} {len(content)} ".encode() + content)
    return found.hexdigest()[:16]


def trials_in(path: Path, campaigns: Path) -> list[str]:
    """The identifiers in a batch's list, of campaigns that are there.

    Parameters
    ----------
    path : Path
        Text file that ``jointgap blind-conceal`` wrote.
    campaigns : Path
        Folder with a folder for each campaign.

    Raises
    ------
    InputError
        No such file, or a campaign has no folder.
    """
    found = _text(path, "--listed", "blind-conceal").split()
    for trial in found:
        if not (campaigns / trial).is_dir():
            raise InputError(
                f"{path}: lists the campaign {trial}, which is not in {campaigns}; correct --campaigns, or run "
                "`jointgap blind-conceal` again"
            )
    return found


def records(path: Path, option: str, command: str) -> list[dict[str, Any]]:
    """The trials in a JSON file, each with its ``id``.

    Parameters
    ----------
    path : Path
    option, command : str
        Of the command line: what names the file, and what writes it.

    Raises
    ------
    InputError
        No such file, or it holds something else.
    """
    text = _text(path, option, command)
    try:
        found = json.loads(text)
    except ValueError as error:
        raise InputError(f"{path}: is not JSON ({error}); run `jointgap {command}` again, which writes it") from error
    if not isinstance(found, list) or not all(isinstance(one, dict) and "id" in one for one in found):
        raise InputError(f"{path}: is no list of trials; give {option} a file that `jointgap {command}` wrote")
    return found


def _text(path: Path, option: str, command: str) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); correct {option}, or run `jointgap {command}`, which writes it"
        ) from error
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is not text in UTF-8 (byte {error.start}); give {option} a file that `jointgap {command}` wrote"
        ) from error


def kept(
    place: Path, code: str, make: Callable[[], dict[str, Any]], same: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """What `make` gives, from the file `place` where the same code has written it, else made and written there.

    What ended in an ``error`` is made again: another machine, or the same with more memory, may do better.

    Parameters
    ----------
    place : Path
        JSON file, written whole or not at all.
    code : str
        Digest of the code, and of what it was given.
    make : function
        Gives a mapping that JSON can hold.
    same : mapping, optional
        What else has to stand in the file.
    """
    try:
        found = json.loads(place.read_text(encoding="utf-8"))
        asked = {"code": code, **(same or {})}
        if "error" not in found and all(found.get(key) == value for key, value in asked.items()):
            return found
    except (OSError, ValueError):
        pass  # not done yet, or not whole
    found = {**make(), "code": code}
    write_text(place, json.dumps(found, indent=1, allow_nan=False) + "\n")
    return found
