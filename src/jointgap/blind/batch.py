"""Batches of trials that go on where they were stopped: a trial that the same code has finished is not done again."""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from jointgap.blind.plan import Plan, Sizes, plans
from jointgap.tables import write_text


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
