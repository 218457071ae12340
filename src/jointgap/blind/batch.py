"""Batches of trials that go on where they were stopped: a trial that the same code has finished is not done again."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jointgap.blind.plan import Plan, Sizes, plans
from jointgap.tables import write_text


def pieces(sizes: Sizes, batch: int) -> list[Plan]:
    """The trials of one batch of a set."""
    return plans(sizes)[batch * sizes.batch : (batch + 1) * sizes.batch]


def kept(place: Path, code: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What `make` gives, from the file `place` where the same code has written it, else made and written there.

    Parameters
    ----------
    place : Path
        JSON file, written whole or not at all.
    code : str
        Digest of the code.
    make : function
        Gives a mapping that JSON can hold.
    """
    try:
        found = json.loads(place.read_text(encoding="utf-8"))
        if found.get("code") == code:
            return found
    except (OSError, ValueError):
        pass  # not done yet, or not whole
    found = {**make(), "code": code}
    write_text(place, json.dumps(found, indent=1, allow_nan=False) + "\n")
    return found
