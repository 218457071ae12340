"""What is measured of each design of a sweep: numbers of one motion, over its last revolution and over a window."""

import math

import numpy as np

from jointgap.config import Mechanism, Simulate
from jointgap.core.joints import JOINTS
from jointgap.dynamics.parallel import Outcome
from jointgap.dynamics.sampling import angle_errors, contact_sums, largest_change, slider_and_forces
from jointgap.dynamics.simulate import IntegrationResult, crank_angles
from jointgap.tables.sweep_tables import NOISE_ORDER

_SAMPLED = ("times", "states", "auxiliary_states", "modes", "approaches", "begins")
_ERRORS = tuple(f"angle_error_{size}{span}" for span in ("", "_in_window") for size in ("rms", "mean", "peak"))


def angles_to_measure(options: Simulate) -> np.ndarray:
    """Crank angles [rad] of the samples that `measures` reads: the first revolution, and the last two."""
    angles, per_turn = crank_angles(options), options.samples_per_revolution
    return np.concatenate((angles[:per_turn], angles[max(per_turn, len(angles) - 2 * per_turn - 1) :]))


def measures(outcome: Outcome, window: tuple[float, float]) -> dict[str, float]:
    """The numbers `jointgap.tables.sweep_tables.MEASURES` of a run that did not fail [SI]; NaN where undefined."""
    result, mechanism, p = outcome.result, outcome.run.mechanism, outcome.parameters
    per_turn = outcome.run.options.samples_per_revolution
    last = slice(-per_turn - 1, None)
    position, acceleration, peaks, sizes = slider_and_forces(p, *(getattr(result, name)[last] for name in _SAMPLED))
    # The last revolution's end is its beginning again.
    *errors, least = _angle_errors(outcome, slice(-per_turn - 1, -1), (-math.inf, math.inf))
    *errors_in_window, _ = _angle_errors(outcome, slice(0, per_turn), window)
    found = dict(zip(_ERRORS, (*errors, *errors_in_window), strict=True))
    found |= {"least_transmission_angle": least}
    found |= _travel(position[:-1], outcome.crank_angle[last][:-1])
    rms = math.sqrt(np.mean(acceleration[:-1] ** 2))
    noise = high_order_rms(acceleration[:-1]) / rms if rms else math.nan
    found |= {"acceleration_rms": rms, "noise_share": noise}
    found |= {"repeat_distance": _repeat_distance(result, mechanism, per_turn)}
    begin, end = float(result.times[last.start]), float(result.times[-1])
    touching, impacts, peaks_of_contacts = contact_sums(result.events, begin, end)
    loose = mechanism.loose
    for number, joint in enumerate(JOINTS):
        moves = joint in loose
        found |= {
            f"{joint}_contact_share": float(touching[number]) / (end - begin) if moves else math.nan,
            f"{joint}_impacts": float(impacts[number]) if moves else math.nan,
            # A sample may miss the peak of a short contact.
            f"{joint}_peak_force": float(max(peaks[number], peaks_of_contacts[number])),
            f"{joint}_rms_force": float(sizes[number]),
        }
    return found


def high_order_rms(values: np.ndarray) -> float:
    """RMS of what one revolution of `values` holds above order `NOISE_ORDER`."""
    spectrum = np.fft.rfft(values)
    spectrum[: NOISE_ORDER + 1] = 0.0
    squares = 2.0 * np.sum(spectrum.real**2 + spectrum.imag**2)  # Parseval: each order counts for its mirror image too
    if len(values) % 2 == 0:
        squares -= abs(spectrum[-1]) ** 2  # but the highest is its own
    return math.sqrt(squares) / len(values)


def _angle_errors(outcome: Outcome, samples: slice, counted: tuple[float, float]) -> tuple[float, ...]:
    result = outcome.result
    states, auxiliary_states = result.states[samples], result.auxiliary_states[samples]
    return angle_errors(outcome.parameters, outcome.crank_angle[samples], states, auxiliary_states, *counted)


def _travel(position: np.ndarray, angle: np.ndarray) -> dict[str, float]:
    """Stroke [m] and crank angles of the dead centres [rad], between samples by a parabola."""
    outer, outer_angle = _extreme(position, angle)
    inner, inner_angle = _extreme(-position, angle)
    # Around 0 and around pi, where they lie without an offset: so that a mean over designs means something.
    outer_angle = (outer_angle + math.pi) % (2.0 * math.pi) - math.pi
    return {
        "stroke": outer + inner,
        "outer_dead_centre_angle": outer_angle,
        "inner_dead_centre_angle": inner_angle,
    }


def _extreme(values: np.ndarray, angle: np.ndarray) -> tuple[float, float]:
    """Largest of periodic samples and the angle [0, 2 pi) where it lies."""
    top = int(np.argmax(values))
    before, here, after = values[top - 1], values[top], values[(top + 1) % len(values)]
    curvature = before - 2.0 * here + after
    shift = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
    place = angle[top] + shift * 2.0 * math.pi / len(values)
    return float(here - 0.25 * (before - after) * shift), float(place % (2.0 * math.pi))


def _repeat_distance(result: IntegrationResult, mechanism: Mechanism, per_turn: int) -> float:
    """Largest distance of the clearance vectors over the last revolution from those of the one before, as a share of
    the smallest clearance; NaN with one revolution, or without clearance.
    """
    loose = mechanism.loose
    if len(result.times) < 2 * per_turn + 1 or not loose:
        return math.nan
    two = slice(-2 * per_turn - 1, None)
    smallest = min(mechanism.clearance(joint) for joint in loose)
    return largest_change(result.states[two], result.auxiliary_states[two], per_turn) / smallest
