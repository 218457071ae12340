"""What the paper's printed optima come out as on a design's motion, its error counted in one of the ways left open.

The motion in the joints is frozen, as in the paper: other lengths are tried with the clearance vectors of the original
ones. Which crank angles, which revolution and which measure of the error its reductions speak of the paper does not
say; so a sweep may vary them as it varies the contact.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from jointgap.config import Simulate
from jointgap.config.sweep_config import Sweep
from jointgap.core.errors import InputError, did_you_mean
from jointgap.lengths.objective import MEASURES, Objective
from jointgap.paper.printed import OPTIMA

COUNTING = {"window_start": "rad", "window_end": "rad", "error_measure": "", "revolution": ""}
"""Parameters that say how the error is counted, with their units; '' for words and whole numbers, which are listed."""

_ROUNDING = 1e-9  # [rad]


@dataclass(frozen=True)
class ErrorCounting:
    """How the error of the transmission angle is counted."""

    window: tuple[float, float]  # First and last crank angle of the revolution [rad]
    measure: str = "rms"  # One of `jointgap.lengths.objective.MEASURES`, of which the reduction is told
    revolution: int = 1  # From 1 on, the transient

    @classmethod
    def of(
        cls, values: Mapping[str, Any], window: tuple[float, float], simulate: Simulate, source: str
    ) -> "ErrorCounting":
        """Of a design."""
        start, end = values.get("window_start", window[0]), values.get("window_end", window[1])
        measure, revolution = values.get("error_measure", "rms"), values.get("revolution", 1)
        if not 0.0 <= start < end <= 2.0 * math.pi + _ROUNDING:
            raise InputError(
                f"{source}, window_start = {start:g}, window_end = {end:g}: the window must grow and lie in a "
                "revolution, 0 to 360 deg"
            )
        if measure not in MEASURES:
            raise InputError(
                f"{source}.error_measure = {measure!r}: no such measure; {did_you_mean(str(measure), MEASURES)}"
            )
        if revolution not in range(1, simulate.revolutions + 1):
            raise InputError(
                f"{source}.revolution = {revolution!r}: must be a whole number from 1 to simulate.revolutions, "
                f"{simulate.revolutions}"
            )
        return cls((float(start), float(end)), measure, int(revolution))


def check_counting(sweep: Sweep, simulate: Simulate, source: str) -> None:
    """Whether the parameters of a `sweep` that say how the error is counted can be drawn; InputError where not."""
    for key in COUNTING.keys() & sweep.parameters.keys():
        if not sweep.printed_numbers:
            raise InputError(
                f"{source}.{key}: says how the paper's printed numbers are counted; set sweep.printed_numbers to true, "
                "or leave it out"
            )
        if COUNTING[key]:
            continue
        values = getattr(sweep.parameters[key], "values", None)
        if values is None:
            raise InputError(f"{source}.{key}: has no range; list its values, such as {key}: [...]")
        for value in values:
            ErrorCounting.of({key: value}, sweep.window, simulate, source)


def printed_optima(counted: Objective | None, measure: str) -> dict[str, float]:
    """The numbers `jointgap.tables.sweep_tables.PRINTED_OPTIMA` of a run that did not fail; NaN without samples."""
    names = [f"reduction_at_{printed.key}" for printed in OPTIMA]
    if counted is None:
        return dict.fromkeys(names, math.nan)
    lengths = np.array([(printed.crank_length, printed.rod_length) for printed in OPTIMA])
    return dict(zip(names, getattr(counted.reductions(lengths), measure), strict=True))
