"""Channels of a slider-crank at given crank angles, in as few operations as a fit's thousands of simulations need."""

import math

import numpy as np

from jointgap.config import Mechanism, Simulate
from jointgap.config.scenario import TOLERANCE_SHARE
from jointgap.dynamics.compilation import compiled
from jointgap.dynamics.model.equations import AUXILIARY_STATES, STATES
from jointgap.dynamics.model.parameters import CONSTANT, FLUCTUATING, MOTOR, Parameters
from jointgap.dynamics.model.prescribed_drive import crank_motion, crank_times
from jointgap.dynamics.simulation import VELOCITY_TIME, IntegrationResult, integrate_to_angles
from jointgap.dynamics.solver.initial_state import start_state
from jointgap.joints import JOINTS
from jointgap.slider_crank.sample_grid import TURN

TOLERANCE, TOLERANCE_FILM = 1e-10, 1e-11
"""Local error of positions [m] in fits, and where a joint is lubricated. Whitened channels of loose pins with friction are then
rough by some hundredths in length, over all samples: 1e-9 saves a sixth of the time and is ten to thirty times as rough, so that
fits come to no end. Films are stiff, so that their steps are short anyway, and thin: 1e-11 costs no more."""

_LEAST = 1e-5  # [m] instead of a clearance where none is as large
_WATCHED = 1.5  # revolutions from the start within which who looks wants to see how the motion settles
DROPPED = 2
"""Revolutions that a motion is given to settle: simulated before the first sample."""

_REPEATS = 2e-3
"""Share of the least clearance by which the ends of a revolution may differ, for it to stand for all that follow.
Whitened channels are off by about 1 in length then, over all samples; a record that begins after as many revolutions is not nearer
to the settled motion."""


def tolerance_for(mechanism: Mechanism) -> float:
    """`TOLERANCE` or `TOLERANCE_FILM`, or less where a clearance is so small that steps would jump over contacts."""
    clearances = [mechanism.clearance(joint) for joint in mechanism.loose]
    usual = TOLERANCE_FILM if any(mechanism.effect("lubricated_joint", pin) for pin in mechanism.loose) else TOLERANCE
    return min([usual, *(TOLERANCE_SHARE * clearance for clearance in clearances)])


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
    """What is to be seen at crank angles, by column of `jointgap.dynamics.solver.sampling`, and their ``time`` since the start [s].

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
    if _is_posed(p):
        return _seen(p, angles, lambda places: _posed(p, places))
    start = start_state(p, perturbation)

    def integrated(places):
        return integrate_to_angles(p, start, places, tolerance)

    if perturbation is None and _may_repeat(p) and angles.min() > p.drive.start_angle + _WATCHED * TURN:
        begin = p.drive.start_angle + DROPPED * TURN
        folded = begin + np.mod(angles - begin, TURN)
        seen = _seen(p, np.append(folded, [begin, begin + TURN]), integrated, _REPEATS)
        if seen is not None:
            kept = {name: values[:-2] for name, values in seen.items()}
            return kept | {"crank_angle": angles, "time": _times(p, angles)}
    return _seen(p, angles, integrated)


def _seen(p: Parameters, angles: np.ndarray, integrated, share: float | None = None) -> dict[str, np.ndarray] | None:
    """What is to be seen at `angles`; with a `share`, None where the states at the last two differ by more than that."""
    places, back = np.unique(np.append(p.drive.start_angle, angles), return_inverse=True)
    result = integrated(places)
    if share is not None and _apart(p, result, *back[-2:]) > share:
        return None
    columns = result.observed(p) | {"time": result.times}
    return {name: values[back[1:]] for name, values in columns.items()}


def _times(p: Parameters, angles: np.ndarray) -> np.ndarray:
    """Times [s] at which a prescribed crank passes `angles`, in any order."""
    places, back = np.unique(np.append(p.drive.start_angle, angles), return_inverse=True)
    return crank_times(p, places)[back[1:]]


def _may_repeat(p: Parameters) -> bool:
    """Whether nothing but the state tells one revolution from the next."""
    fluctuating = p.drive.kind == FLUCTUATING and p.drive.order == round(p.drive.order)
    steady = p.drive.kind == CONSTANT or fluctuating
    return bool(steady and not p.effects.harmonic and not p.slider_formula.length and not p.crank_formula.length)


def _apart(p: Parameters, result: IntegrationResult, one: int, other: int) -> float:
    """How far two states differ, over the least clearance; of velocities, what `VELOCITY_TIME` makes of them."""
    state = result.states[one] - result.states[other]
    auxiliary_states = result.auxiliary_states[one] - result.auxiliary_states[other]
    places = np.concatenate([state[:4], auxiliary_states[[0, 1, 3]]])
    rates = np.concatenate([state[4:], auxiliary_states[[4, 5, 7]]])
    clearances = [getattr(p, joint).clearance for joint in JOINTS if getattr(p, joint).loose]
    away = max(np.abs(places).max(), VELOCITY_TIME * np.abs(rates).max())
    return float(away / max(min(clearances, default=0.0), _LEAST))


def _is_posed(p: Parameters) -> bool:
    """Whether the motion is that of the ideal mechanism under a prescribed crank: nothing is left to integrate."""
    return not (p.switches.auxiliary or any(getattr(p, joint).loose for joint in JOINTS)) and p.drive.kind != MOTOR


def _posed(p: Parameters, angles: np.ndarray) -> IntegrationResult:
    start_state(p)  # refuses a rod that does not reach the slide
    count = angles.size
    return IntegrationResult(
        times=crank_times(p, angles),
        states=np.zeros((count, STATES)),
        auxiliary_states=np.zeros((count, AUXILIARY_STATES)),
        modes=np.zeros((count, 3), np.int64),
        approaches=np.full((count, 3), math.inf),
        directions=np.full((count, 3), math.nan),
        events=np.empty((0, 0)),
        steps=0,
    )
