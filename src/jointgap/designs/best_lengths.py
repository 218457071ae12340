"""The best lengths of a design by the paper's method: the motion in the joints is frozen while lengths are changed.

With it frozen, optima lie in a valley of one ratio of crank to rod; where along it depends on bounds. So the rod keeps
its length here, and the crank alone is sought.
"""

import math

import numpy as np
from scipy.optimize import newton

from jointgap.designs.paper_optima import ErrorCounting
from jointgap.dynamics.parallel import Outcome, rod_and_slider
from jointgap.dynamics.sampling import ROUNDING
from jointgap.lengths.objective import Objective, objective_of_motion

_NO_ERROR = 1e-12
"""RMS [rad] below which an error is rounding, of which no share is told."""

_NEAR = 1e-4
"""Share of the crank's length between the first two lengths that are tried: less than what clearances ask for."""

_CLOSE = 1e-9
"""Share of the crank's length to which the best one is found: a tenth of a nanometre."""


def best_lengths(outcome: Outcome, counted: Objective | None) -> dict[str, float]:
    """The numbers `jointgap.tables.sweep_tables.BEST_LENGTHS` of a run that did not fail; NaN where undefined."""
    per_turn = outcome.run.options.samples_per_revolution
    last = _objective(outcome, slice(-per_turn - 1, -1))  # the revolution's end is its beginning again
    return _best("", last) | _best("_in_window", counted)


def counted_objective(outcome: Outcome, counting: ErrorCounting) -> Objective | None:
    """The error of a run as a function of the lengths, in the window that counts; None where no sample lies in it."""
    per_turn = outcome.run.options.samples_per_revolution
    turn = slice((counting.revolution - 1) * per_turn, counting.revolution * per_turn)
    return _objective(outcome, turn, counting.window)


def _objective(outcome: Outcome, turn: slice, window: tuple[float, float] = (0.0, 2.0 * math.pi)) -> Objective | None:
    angle, result = outcome.crank_angle[turn], outcome.result
    # A sample at the beginning of a later revolution may lie short of it by rounding.
    place = (angle + ROUNDING) % (2.0 * math.pi)
    inside = (place >= window[0]) & (place <= window[1] + 2.0 * ROUNDING)
    if not inside.any():
        return None
    rod, _ = rod_and_slider(outcome.parameters, angle, result.states[turn], result.auxiliary_states[turn])
    return objective_of_motion(outcome.run.mechanism, angle[inside], rod[inside])


def _best(suffix: str, objective: Objective | None) -> dict[str, float]:
    crank = reduction = ratio = math.nan
    if objective is not None:
        rod = objective.original[1]
        crank = best_crank_length(objective, rod)
        ratio = crank / rod
        before, after = objective.value(objective.original), objective.value((crank, rod))
        if before > len(objective.sine) * _NO_ERROR**2:
            reduction = 1.0 - math.sqrt(after / before)  # of the RMS, for as many samples
    return {
        f"best_crank_length{suffix}": crank,
        f"best_ratio{suffix}": ratio,
        f"reduction_at_best{suffix}": reduction,
    }


def best_crank_length(objective: Objective, rod_length: float) -> float:
    """Crank length [m] of the least sum of squares, equation (12), on a rod of one length; NaN where none is found.

    The error is nearly affine in it, and so the derivative of the sum of squares too: secants find where it is zero.
    """
    crank = objective.original[0]
    with np.errstate(invalid="ignore"):  # lengths at which the rod does not reach the slide have no error
        found, state = newton(
            lambda length: objective.gradient((length, rod_length))[0],
            crank,
            x1=(1.0 + _NEAR) * crank,
            tol=_CLOSE * crank,
            full_output=True,
            disp=False,
        )
    return float(found) if state.converged else math.nan
