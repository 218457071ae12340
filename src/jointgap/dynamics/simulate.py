"""From a mechanism to its motion."""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Simulate
from jointgap.dynamics import march as marching
from jointgap.dynamics.observe import COLUMNS, observe
from jointgap.dynamics.parameters import Parameters, parameters
from jointgap.dynamics.start import start_state
from jointgap.errors import SimulationError
from jointgap.tables import TRAJECTORY

STEPS_PER_REVOLUTION = 5_000_000
"""Most integration steps that a revolution may take on average; a usual one takes some thousands."""

VELOCITY_TIME = 3e-5
"""Time [s] that turns an error in a velocity into one in a position: a contact's ringing over 2 pi, near enough."""

_JOINTS = np.array(["crank_pin", "piston_pin"], dtype=object)
_EVENTS = np.array(["separation", "impact"], dtype=object)
_STATES = (
    "rod_position_x",
    "rod_position_y",
    "rod_angle",
    "slider_position",
    "rod_velocity_x",
    "rod_velocity_y",
    "rod_angular_velocity",
    "slider_velocity",
)
_FAILURES = {
    marching.TOO_MANY_STEPS: "needs more than {limit} steps",
    marching.STEP_TOO_SMALL: "would need a step below the resolution of time",
    marching.NOT_FINITE: "meets a number that is not finite",
}


@dataclass(frozen=True)
class Trajectory:
    """One simulated motion.

    Attributes
    ----------
    samples : pandas.DataFrame
        One row a sample, columns of the table ``trajectory``; NaN where undefined.
    events : pandas.DataFrame
        One row a beginning or end of contact, columns of the table ``events``.
    steps : int
        Integration steps taken, rejected ones included.
    """

    samples: pd.DataFrame
    events: pd.DataFrame
    steps: int


@dataclass(frozen=True)
class Ensemble:
    """Many simulated motions of one mechanism that differ in their starts.

    Attributes
    ----------
    time, crank_angle : (samples,) arrays
        Common to all runs [s, rad].
    states : (runs, samples, 8) array
        Rod's mass centre x, y [m], rod angle [rad], slider position [m], and their rates.
    """

    time: np.ndarray
    crank_angle: np.ndarray
    states: np.ndarray

    @property
    def transmission_angle(self) -> np.ndarray:
        """mu [rad], equation (10), shape (runs, samples)."""
        return math.pi / 2 + self.states[:, :, 2]


@dataclass(frozen=True)
class March:
    """Samples and events of one march, as `jointgap.dynamics.march.march` leaves them."""

    states: np.ndarray
    modes: np.ndarray
    approaches: np.ndarray
    directions: np.ndarray
    events: np.ndarray
    steps: int


def simulate(mechanism: Mechanism, options: Simulate, perturbation=None) -> Trajectory:
    """Simulate a slider-crank with loose crank pin and piston pin, driven at constant speed.

    It starts with coincident joint centres and the velocities of the ideal mechanism.

    Parameters
    ----------
    mechanism : Mechanism
    options : Simulate
        Drive, start, samples, and the tolerance: the local error of one step [m]. Before chaos sets in, the error of
        positions a quarter turn on is some 1 to 50 times as large.
    perturbation : (4,) array_like, optional
        Clearance vectors at the start instead of zero: r2 x, r2 y, r3 x, r3 y [m].

    Returns
    -------
    Trajectory

    Raises
    ------
    InputError
        A perturbation as large as a clearance, a rod that does not reach the slide.
    SimulationError
        The integration cannot go on; the message holds time, crank angle and state.
    """
    p = parameters(mechanism, options.speed, options.start_angle)
    times, crank_angle = _samples(options)
    run = run_march(p, start_state(p, perturbation), times, options.tolerance)
    seen = observe(p, times, run.states, run.modes, run.approaches, run.directions)
    columns = {"time": times, "crank_angle": crank_angle}
    columns |= {name: seen[:, i] for i, name in enumerate(COLUMNS)}
    columns |= {name: run.states[:, i] for i, name in enumerate(_STATES)}
    columns["transmission_angle"] = math.pi / 2 + run.states[:, 2]
    frame = pd.DataFrame({column.name: columns[column.name] for column in TRAJECTORY.columns})
    return Trajectory(samples=frame, events=_event_frame(p, run.events), steps=run.steps)


def simulate_ensemble(mechanism: Mechanism, options: Simulate, perturbations) -> Ensemble:
    """Simulate one mechanism from many starts, and keep the states alone.

    Parameters
    ----------
    mechanism, options
        As in `simulate`.
    perturbations : (runs, 4) array_like
        The perturbation of each run [m].

    Returns
    -------
    Ensemble

    Raises
    ------
    InputError, SimulationError
        As in `simulate`.
    """
    p = parameters(mechanism, options.speed, options.start_angle)
    times, crank_angle = _samples(options)
    runs = [run_march(p, start_state(p, one), times, options.tolerance).states for one in perturbations]
    return Ensemble(time=times, crank_angle=crank_angle, states=np.array(runs).reshape(len(runs), times.size, 8))


def run_march(p: Parameters, start: np.ndarray, times: np.ndarray, tolerance: float) -> March:
    """March from `start` (8,) and sample at `times` (n,) [s]; both joints must start out of contact.

    Raises
    ------
    SimulationError
        See `simulate`.
    """
    n = times.size
    states, modes = np.empty((n, 8)), np.empty((n, 2), np.int64)
    approaches, directions = np.empty((n, 2)), np.empty((n, 2))
    revolutions = (times[-1] - times[0]) * abs(p.speed) / (2 * math.pi)
    limit = math.ceil(STEPS_PER_REVOLUTION * max(revolutions, 1.0))
    status, time, state, events, steps = marching.march(
        p, start, times, tolerance, VELOCITY_TIME, limit, states, modes, approaches, directions
    )
    if status != marching.DONE:
        degrees = math.degrees(p.start_angle + p.speed * time)
        values = ", ".join(f"{name} {value:.9g}" for name, value in zip(_STATES, state, strict=True))
        raise SimulationError(
            f"the simulation {_FAILURES[status].format(limit=limit)} at time {time:.9g} s, crank angle {degrees:.6g} deg "
            f"(state in SI: {values}); ask for a larger tolerance than {tolerance:g} m, or check stiffness, restitution "
            "and friction of the contacts"
        )
    return March(states, modes, approaches, directions, events, steps)


def _samples(options: Simulate) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and crank angles [rad] of the samples, both ends included."""
    turned = np.arange(options.revolutions * options.samples_per_revolution + 1) * (
        2 * math.pi / options.samples_per_revolution
    )
    return turned / options.speed, options.start_angle + turned


def _event_frame(p: Parameters, events: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "time": events[:, 0],
            "crank_angle": p.start_angle + p.speed * events[:, 0],
            "joint": _JOINTS[events[:, 1].astype(int)],
            "event": _EVENTS[events[:, 2].astype(int)],
            "approach_speed": events[:, 3],
        }
    )
