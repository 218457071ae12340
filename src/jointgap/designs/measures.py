"""What is measured of each design of a sweep: numbers of one motion, over its last revolution and over a window."""

import math
from dataclasses import replace

import numpy as np

from jointgap.config import Mechanism, Simulate
from jointgap.dynamics.parallel_runs import Outcome, rod_and_slider
from jointgap.dynamics.simulation import IntegrationResult, crank_angles
from jointgap.dynamics.solver.contact_episodes import EVENT
from jointgap.ensembles.orders import high_order_rms
from jointgap.joints import JOINTS
from jointgap.link_lengths.objective import measure
from jointgap.mechanism import transmission_angle

_SAMPLED = ("times", "states", "auxiliary_states", "modes", "approaches", "begins", "directions")
_ROUNDING = 1e-9  # [rad] of crank angles
_COLUMN = {name: number for number, name in enumerate(EVENT)}


def angles_to_measure(options: Simulate) -> np.ndarray:
    """Crank angles [rad] of the samples that `measures` reads: the first revolution, and the last two."""
    angles, per_turn = crank_angles(options), options.samples_per_revolution
    return np.concatenate((angles[:per_turn], angles[max(per_turn, len(angles) - 2 * per_turn - 1) :]))


def measures(outcome: Outcome, window: tuple[float, float]) -> dict[str, float]:
    """The numbers `jointgap.tables.sweep_tables.MEASURES` of a run that did not fail [SI]; NaN where undefined.

    Parameters
    ----------
    outcome : Outcome
        Sampled at `angles_to_measure`.
    window : (float, float)
        Crank angles of the first revolution over which the error of the transmission angle is measured [rad].
    """
    options, mechanism, angle = outcome.run.options, outcome.run.mechanism, outcome.crank_angle
    per_turn = options.samples_per_revolution
    last = slice(-per_turn - 1, None)
    signals = replace(outcome.result, **{name: getattr(outcome.result, name)[last] for name in _SAMPLED}).observed(
        outcome.parameters
    )
    found = _transmission(outcome, signals["rod_angle"], window)
    found |= _travel(signals["slider_position"], angle[last])
    acceleration = signals["slider_acceleration"][:-1]
    rms = math.sqrt(np.mean(acceleration**2))
    found |= {"acceleration_rms": rms, "noise_share": high_order_rms(acceleration, 1) / rms if rms else math.nan}
    found |= {"repeat_distance": _repeat_distance(outcome.result, mechanism, per_turn)}
    for number, joint in enumerate(JOINTS):
        force = signals[f"{joint}_normal_force"]
        loose = joint in mechanism.loose
        found |= _contacts(outcome.result.events, number, joint, signals["time"], force, loose)
    return found


def _transmission(outcome: Outcome, rod_angle: np.ndarray, window: tuple[float, float]) -> dict[str, float]:
    """Errors of the transmission angle [rad], and its smallest value."""
    mechanism, angle, per_turn = outcome.run.mechanism, outcome.crank_angle, outcome.run.options.samples_per_revolution
    actual = math.pi / 2 + rod_angle
    turn = angle[-per_turn - 1 : -1]  # the revolution's end is its beginning again
    ideal = transmission_angle(mechanism.crank.length, mechanism.rod.length, turn, 0.0, mechanism.slider.offset)
    found = _sizes("", ideal - actual[:-1])
    found["least_transmission_angle"] = float(np.min(np.minimum(actual, math.pi - actual)))
    first = slice(0, per_turn)
    rod, _ = rod_and_slider(
        outcome.parameters, angle[first], outcome.result.states[first], outcome.result.auxiliary_states[first]
    )
    place = angle[first] % (2 * math.pi)
    inside = (place >= window[0] - _ROUNDING) & (place <= window[1] + _ROUNDING)
    return found | _sizes("_in_window", (ideal - math.pi / 2 - rod)[inside])


def _sizes(suffix: str, error: np.ndarray) -> dict[str, float]:
    found = measure(error) if len(error) else None
    return {
        f"angle_error_rms{suffix}": found.rms if found else math.nan,
        f"angle_error_mean{suffix}": found.mean_absolute if found else math.nan,
        f"angle_error_peak{suffix}": found.peak if found else math.nan,
    }


def _travel(position: np.ndarray, angle: np.ndarray) -> dict[str, float]:
    """Stroke [m] and crank angles of the dead centres [rad], between samples by a parabola."""
    outer, outer_angle = _extreme(position[:-1], angle[:-1])
    inner, inner_angle = _extreme(-position[:-1], angle[:-1])
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
    if len(result.times) < 2 * per_turn + 1 or not mechanism.loose:
        return math.nan
    last, before = slice(-per_turn - 1, None), slice(-2 * per_turn - 1, -per_turn)
    squares = 0.0
    for states, columns in ((result.states, 4), (result.auxiliary_states, 2)):
        change = states[last, :columns] - states[before, :columns]
        squares = squares + np.einsum("ij,ij->i", change, change)
    smallest = min(mechanism.clearance(joint) for joint in mechanism.loose)
    return math.sqrt(squares.max()) / smallest


def _contacts(
    events: np.ndarray, number: int, joint: str, times: np.ndarray, force: np.ndarray, loose: bool
) -> dict[str, float]:
    """Forces [N], share of time in contact and impacts of one joint between the ends of `times`."""
    found = {f"{joint}_peak_force": float(force.max()), f"{joint}_rms_force": math.sqrt(np.mean(force[:-1] ** 2))}
    if not loose:
        return found | {f"{joint}_contact_share": math.nan, f"{joint}_impacts": math.nan}
    begin, end = times[0], times[-1]
    own = events[events[:, _COLUMN["joint"]] == number]
    begins = own[own[:, _COLUMN["begins"]] == 1.0][:, _COLUMN["time"]]
    separations = own[own[:, _COLUMN["begins"]] == 0.0]
    ends = np.full(len(begins), np.inf)
    ends[: len(separations)] = separations[:, _COLUMN["time"]]
    touching = np.clip(np.minimum(ends, end) - np.maximum(begins, begin), 0.0, None).sum() / (end - begin)
    whole = (begins[: len(separations)] >= begin) & (separations[:, _COLUMN["time"]] <= end)
    if whole.any():
        peak = float(separations[whole, _COLUMN["peak_force"]].max())
        found[f"{joint}_peak_force"] = max(found[f"{joint}_peak_force"], peak)
    impacts = np.count_nonzero((begins >= begin) & (begins <= end))
    return found | {f"{joint}_contact_share": float(touching), f"{joint}_impacts": float(impacts)}
