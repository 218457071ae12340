"""Measures of one motion of a design, and its best lengths."""

import math

import numpy as np
from scipy.optimize import newton

from jointgap.config import Simulate
from jointgap.core.joints import JOINTS
from jointgap.core.schema import BEST_LENGTHS
from jointgap.designs.sampling import ErrorDefinition
from jointgap.lengths.objective import Objective, objective_of_motion
from jointgap.motion.parallel import Outcome
from jointgap.motion.sampling import ROUNDING, angle_errors, contact_sums, largest_change
from jointgap.motion.simulation import crank_angles, observed
from jointgap.motion.slider_crank import (
    clearance_vectors,
    lengths_of,
    rod_and_slider,
    rod_sine,
)
from jointgap.paper.printed import OPTIMA

NOISE_ORDER = 10  # order of the crank above which acceleration counts as noise
_NO_ERROR = 1e-12  # [rad] RMS of rounding errors, without a relative reduction
# [crank length] distance of the first two trial lengths: less than the correction for clearances
_FIRST_STEP = 1e-4
_LENGTH_TOLERANCE = 1e-9  # [crank length] of the best crank length: 0.1 nm
_WHOLE_TURN = (0.0, 2.0 * math.pi)
_ERRORS = tuple(
    f"angle_error_{size}{span}" for span in ("", "_in_window") for size in ("rms", "mean", "peak")
)


def angles_to_measure(options: Simulate) -> np.ndarray:
    """Crank angles [rad] that `measures` reads: the first revolution, and the last two."""
    angles, per_turn = crank_angles(options), options.samples_per_revolution
    second_last = max(per_turn, len(angles) - 2 * per_turn - 1)
    return np.concatenate((angles[:per_turn], angles[second_last:]))


def measures(outcome: Outcome, window: tuple[float, float]) -> dict[str, float]:
    """The numbers `MEASURES` of a successful run [SI]; NaN where undefined."""
    result, model = outcome.result, outcome.model
    per_turn = outcome.run.options.samples_per_revolution
    last_turn = slice(-per_turn - 1, None)
    seen = observed(model, result.part(last_turn))
    # the end repeats the beginning
    position, acceleration = seen["slider_position"][:-1], seen["slider_acceleration"][:-1]
    crank, rod, offset = lengths_of(model)

    def errors_of(samples: slice, angles: tuple[float, float]) -> tuple[float, ...]:
        angle = outcome.crank_angle[samples]
        ideal = (offset - crank * np.sin(angle)) / rod
        return angle_errors(rod_sine(model, angle, result.states[samples]), ideal, angle, *angles)

    *errors, least_angle = errors_of(slice(-per_turn - 1, -1), (-math.inf, math.inf))
    *errors_in_window, _ = errors_of(slice(0, per_turn), window)
    angle = outcome.crank_angle[last_turn][:-1]
    outer, outer_angle = _extreme(position, angle)
    inner, inner_angle = _extreme(-position, angle)
    rms = math.sqrt(np.mean(acceleration**2))
    row = dict(zip(_ERRORS, (*errors, *errors_in_window), strict=True)) | {
        "least_transmission_angle": least_angle,
        "stroke": outer + inner,
        # without offset at 0 and pi: ranges around these have meaningful means over designs
        "outer_dead_centre_angle": (outer_angle + math.pi) % (2.0 * math.pi) - math.pi,
        "inner_dead_centre_angle": inner_angle,
        "acceleration_rms": rms,
        "noise_share": high_order_rms(acceleration) / rms if rms else math.nan,
        "repeat_distance": _repeat_distance(outcome, per_turn),
    }
    begin, end = float(result.times[last_turn.start]), float(result.times[-1])
    contact_time, impacts, contact_peaks = contact_sums(result.events, len(model.loose), begin, end)
    for joint in JOINTS:
        share = count = math.nan
        normal = seen[f"{joint}_normal_force"]
        peak = normal.max()
        if joint in model.loose:
            number = model.loose.index(joint)
            share, count = contact_time[number] / (end - begin), impacts[number]
            peak = max(peak, contact_peaks[number])  # samples may miss that of a short contact
        row |= {
            f"{joint}_contact_share": float(share),
            f"{joint}_impacts": float(count),
            f"{joint}_peak_force": float(peak),
            f"{joint}_rms_force": math.sqrt(np.mean(normal[:-1] ** 2)),
        }
    return row


def high_order_rms(values: np.ndarray) -> float:
    """RMS of one revolution of `values` above order `NOISE_ORDER`."""
    spectrum = np.fft.rfft(values)
    spectrum[: NOISE_ORDER + 1] = 0.0
    return math.sqrt(np.mean(np.fft.irfft(spectrum, len(values)) ** 2))


def _extreme(values: np.ndarray, angle: np.ndarray) -> tuple[float, float]:
    """Maximum of periodic samples, by parabolic interpolation, and its angle in [0, 2 pi)."""
    top = int(np.argmax(values))
    previous, peak, following = values[top - 1], values[top], values[(top + 1) % len(values)]
    curvature = previous - 2.0 * peak + following
    shift = 0.5 * (previous - following) / curvature if curvature < 0.0 else 0.0
    top_angle = angle[top] + shift * 2.0 * math.pi / len(values)
    return float(peak - 0.25 * (previous - following) * shift), float(top_angle % (2.0 * math.pi))


def _repeat_distance(outcome: Outcome, per_turn: int) -> float:
    """Largest distance of the clearance vectors between the last two revolutions, over the smallest
    clearance; NaN with one revolution, or without clearance."""
    result, mechanism = outcome.result, outcome.run.mechanism
    if len(result.times) < 2 * per_turn + 1 or not mechanism.loose:
        return math.nan
    two_turns = slice(-2 * per_turn - 1, None)
    smallest = min(map(mechanism.clearance, mechanism.loose))
    vectors = clearance_vectors(outcome.model, result.states[two_turns])
    return largest_change(vectors, per_turn) / smallest


def best_lengths(outcome: Outcome, definition: ErrorDefinition) -> dict[str, float]:
    """The numbers `BEST_LENGTHS` of a successful run; NaN where undefined."""
    per_turn = outcome.run.options.samples_per_revolution
    last_turn = _objective(outcome, slice(-per_turn - 1, -1), _WHOLE_TURN)
    in_window = _objective_of(outcome, definition)
    return dict(zip(BEST_LENGTHS.names, (*_best(last_turn), *_best(in_window)), strict=True))


def printed_reductions(outcome: Outcome, definition: ErrorDefinition) -> dict[str, float]:
    """The numbers `PRINTED_OPTIMA` of a successful run; NaN where undefined."""
    objective, reductions = _objective_of(outcome, definition), [math.nan] * len(OPTIMA)
    if objective:
        lengths = np.array([(optimum.crank_length, optimum.rod_length) for optimum in OPTIMA])
        reductions = getattr(objective.reductions(lengths), definition.measure)
    keys = (f"reduction_at_{optimum.key}" for optimum in OPTIMA)
    return dict(zip(keys, reductions, strict=True))


def _objective_of(outcome: Outcome, definition: ErrorDefinition) -> Objective | None:
    per_turn, number = outcome.run.options.samples_per_revolution, definition.revolution
    return _objective(outcome, slice((number - 1) * per_turn, number * per_turn), definition.window)


def _objective(outcome: Outcome, turn: slice, window: tuple[float, float]) -> Objective | None:
    """The error of a revolution as a function of the lengths, in a window; None where the window
    has no samples."""
    angle, result = outcome.crank_angle[turn], outcome.result
    # rounding may put the first sample of a later revolution before its beginning
    turned = (angle + ROUNDING) % (2.0 * math.pi)
    inside = (turned >= window[0]) & (turned <= window[1] + 2.0 * ROUNDING)
    if not inside.any():
        return None
    rod, _ = rod_and_slider(outcome.model, angle, result.states[turn])
    return objective_of_motion(outcome.run.mechanism, angle[inside], rod[inside])


def _best(objective: Objective | None) -> tuple[float, float, float]:
    """Best crank length [m] for the original rod, the ratio of the lengths, and the relative
    reduction of the RMS."""
    if objective is None:
        return math.nan, math.nan, math.nan
    rod = objective.original[1]
    crank, original = best_crank_length(objective, rod), objective.value(objective.original)
    has_error = original > len(objective.sine) * _NO_ERROR**2
    relative = objective.value((crank, rod)) / original if has_error else math.nan
    return crank, crank / rod, 1.0 - math.sqrt(relative)


def best_crank_length(objective: Objective, rod_length: float) -> float:
    """Crank length [m] of the smallest sum of squares, equation (12), for a given rod length; NaN
    where none is found.

    The error is almost affine in the crank length, so the secant method converges on the
    derivative's zero.
    """
    crank = objective.original[0]
    with np.errstate(invalid="ignore"):  # undefined where the rod does not reach the slide
        length, state = newton(
            lambda length: objective.gradient((length, rod_length))[0],
            crank,
            x1=(1.0 + _FIRST_STEP) * crank,
            tol=_LENGTH_TOLERANCE * crank,
            full_output=True,
            disp=False,
        )
    return float(length) if state.converged else math.nan
