"""A changed mechanism as its user writes one: their text where nothing changed, their units where it did."""

import re
from collections.abc import Mapping
from typing import Any

from jointgap.quantities import split_quantity

DIGITS = 7  # of a number that was found: far below what it is known to, and far from digits that mean nothing
EXACT = 17  # digits that every number keeps its value with

_MISSING = object()


def as_written(new: Any, old: Any, text: Any = _MISSING, digits: int = DIGITS) -> Any:
    """`new` content of a file in the words of the one that it is changed from."""
    if new == old and text is not _MISSING:
        return text
    if isinstance(new, Mapping):
        before, written = (part if isinstance(part, Mapping) else {} for part in (old, text))
        left_out = text is not _MISSING and isinstance(text, Mapping)
        return {
            key: as_written(value, before.get(key, _MISSING), written.get(key, _MISSING), digits)
            for key, value in new.items()
            if not (left_out and key not in written and key in before and before[key] == value)
        }
    if isinstance(new, list | tuple):
        before, written = (list(part) if isinstance(part, list | tuple) else [] for part in (old, text))
        return [
            as_written(
                value,
                before[place] if place < len(before) else _MISSING,
                written[place] if place < len(written) else _MISSING,
                digits,
            )
            for place, value in enumerate(new)
        ]
    if not isinstance(new, float):
        return new
    if new == old:
        return new
    return _in_its_unit(new, old, text, digits) or float(f"{new:.{digits}g}")


def _in_its_unit(new: float, old: Any, text: Any, digits: int) -> str | None:
    """A number in the unit in which the user wrote the one that it takes the place of; None where that has none."""
    if not isinstance(text, str) or not isinstance(old, float) or not old:
        return None
    number, unit = split_quantity(text)
    if not unit:
        return None
    per_unit = old / float(number)
    own = re.sub(r"^[-+\N{MINUS SIGN}0-9.eE]+\s*", "", text.strip())
    return f"{new / per_unit:.{digits}g} {own}" if own else None
