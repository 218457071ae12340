"""Channels of a slider-crank at given crank angles, in as few operations as a fit's thousands of simulations need."""

import math

import numpy as np

from jointgap.config import Mechanism, Simulate
from jointgap.config.checks import TOLERANCE_SHARE
from jointgap.dynamics.compiled import compiled
from jointgap.dynamics.drive import crank_motion, crank_times
from jointgap.dynamics.equations import FURTHER, STATES
from jointgap.dynamics.parameters import JOINTS, MOTOR, Parameters
from jointgap.dynamics.simulate import March, run_march
from jointgap.dynamics.start import start_state

TOLERANCE = 1e-9
"""Local error of positions [m] in fits: accelerations of loose pins with friction are then exact to 2e-4 of their standard
deviation RMS; 1e-8 saves a tenth of the time and is twenty times as rough."""


def tolerance_for(mechanism: Mechanism) -> float:
    """`TOLERANCE`, or less where a clearance is so small that steps would jump over contacts."""
    clearances = [mechanism.clearance(joint) for joint in mechanism.loose]
    return min([TOLERANCE, *(TOLERANCE_SHARE * clearance for clearance in clearances)])


def options_of(speed: float, start_angle: float, tolerance: float, **drive) -> Simulate:
    """Options of a simulation, of values that are known to be valid: checking them again takes longer than some motions."""
    return Simulate.model_construct(speed=speed, start_angle=start_angle, tolerance=tolerance, **drive)


@compiled
def prescribed_angles(p, times):
    """Angles [rad] of a prescribed crank at `times` (n,) [s]."""
    angles = np.empty(times.size)
    for i in range(times.size):
        angles[i] = crank_motion(p, times[i])[0]
    return angles


def observed(
    p: Parameters, angles: np.ndarray, tolerance: float, perturbation: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """What is to be seen at crank angles, by column of `jointgap.dynamics.observe`, and their ``time`` since the start [s].

    Parameters
    ----------
    p : Parameters
    angles : (n,) array
        [rad], in any order, none before the start angle.
    tolerance : float
        Local error of a step [m].
    perturbation : (6,) array, optional
        Clearance vectors at the start [m]; zero by default.
    """
    places, back = np.unique(np.append(p.drive.start_angle, angles), return_inverse=True)
    march = _posed(p, places) if _is_posed(p) else run_march(p, start_state(p, perturbation), places, tolerance)
    columns = march.observed(p) | {"time": march.times}
    return {name: values[back[1:]] for name, values in columns.items()}


def _is_posed(p: Parameters) -> bool:
    """Whether the motion is that of the ideal mechanism under a prescribed crank: nothing is left to integrate."""
    return not (p.switches.further or any(getattr(p, joint).loose for joint in JOINTS)) and p.drive.kind != MOTOR


def _posed(p: Parameters, angles: np.ndarray) -> March:
    start_state(p)  # refuses a rod that does not reach the slide
    count = angles.size
    return March(
        times=crank_times(p, angles),
        states=np.zeros((count, STATES)),
        further=np.zeros((count, FURTHER)),
        modes=np.zeros((count, 3), np.int64),
        approaches=np.full((count, 3), math.inf),
        directions=np.full((count, 3), math.nan),
        events=np.empty((0, 0)),
        steps=0,
    )
