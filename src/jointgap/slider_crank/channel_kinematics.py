"""Channels of a slider-crank at given crank angles, in as few operations as a fit's thousands of simulations need."""

import math
from collections.abc import Callable
from math import tau

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
from jointgap.slider_crank.settings import DEFAULT_SETTINGS, SimulationSettings


def tolerance_for(mechanism: Mechanism, settings: SimulationSettings = DEFAULT_SETTINGS.simulation) -> float:
    """Local error of a step [m] for a fit: smaller where steps would jump over the contacts of a small clearance.

    Parameters
    ----------
    mechanism : Mechanism
    settings : SimulationSettings
    """
    film = any(mechanism.effect("lubricated_joint", joint) for joint in mechanism.loose)
    usual = settings.film_tolerance_m if film else settings.tolerance_m
    return min([usual, *(TOLERANCE_SHARE * mechanism.clearance(joint) for joint in mechanism.loose)])


def options_of(speed: float, start_angle: float, tolerance: float, **drive) -> Simulate:
    """Options of a simulation, not validated: that takes longer than some motions, and the values are known to be good.

    Parameters
    ----------
    speed, start_angle, tolerance : float
        [rad/s], [rad], [m].
    **drive
        The section of another drive than constant speed.
    """
    return Simulate.model_construct(speed=speed, start_angle=start_angle, tolerance=tolerance, **drive)


@compiled
def prescribed_angles(p, times):
    """Angles (n,) [rad] of the prescribed crank of parameters `p` at `times` (n,) [s]."""
    angles = np.empty(times.size)
    for i in range(times.size):
        angles[i] = crank_motion(p, times[i])[0]
    return angles


def channels_at(
    p: Parameters,
    angles: np.ndarray,
    tolerance: float,
    perturbation: np.ndarray | None = None,
    settings: SimulationSettings = DEFAULT_SETTINGS.simulation,
) -> dict[str, np.ndarray]:
    """All channels at crank angles, by column of `jointgap.dynamics.solver.sampling`, with the ``time`` [s].

    Parameters
    ----------
    p : Parameters
    angles : (n,) array
        [rad], in any order, none before the start angle.
    tolerance : float
        Local error of a step [m].
    perturbation : (6,) array, optional
        Clearance vectors at the start [m]; zero by default.
    settings : SimulationSettings
    """
    if _is_kinematic(p):
        return _sampled(p, angles, lambda sorted_angles: _kinematic_motion(p, sorted_angles))
    start = start_state(p, perturbation)

    def integrate(sorted_angles: np.ndarray) -> IntegrationResult:
        return integrate_to_angles(p, start, sorted_angles, tolerance)

    settled = angles.min() > p.drive.start_angle + settings.transient_revolutions * tau
    if perturbation is None and _may_repeat(p) and settled:
        # One settled revolution stands for all of them, if its ends agree.
        begin = p.drive.start_angle + settings.settling_revolutions * tau
        within = begin + np.mod(angles - begin, tau)
        ends_agree = settings.repeats_share_of_clearance, settings.min_clearance_m
        sampled = _sampled(p, np.append(within, [begin, begin + tau]), integrate, ends_agree)
        if sampled is not None:
            kept = {name: values[:-2] for name, values in sampled.items()}
            return kept | {"crank_angle": angles, "time": _times(p, angles)}
    return _sampled(p, angles, integrate)


def _sampled(
    p: Parameters,
    angles: np.ndarray,
    integrate: Callable[[np.ndarray], IntegrationResult],
    ends_agree: tuple[float, float] | None = None,
) -> dict[str, np.ndarray] | None:
    """Channels at `angles`; None where the states at the last two differ by more than `ends_agree`, if given.

    `ends_agree` is a share [1] of the least clearance, and what stands for that clearance at least [m].
    """
    sorted_angles, places = np.unique(np.append(p.drive.start_angle, angles), return_inverse=True)
    motion = integrate(sorted_angles)
    if ends_agree is not None and _state_distance(p, motion, *places[-2:], ends_agree[1]) > ends_agree[0]:
        return None
    columns = motion.observed(p) | {"time": motion.times}
    return {name: values[places[1:]] for name, values in columns.items()}


def _times(p: Parameters, angles: np.ndarray) -> np.ndarray:
    """Times (n,) [s] at which a prescribed crank passes `angles` (n,) [rad], in any order."""
    sorted_angles, places = np.unique(np.append(p.drive.start_angle, angles), return_inverse=True)
    return crank_times(p, sorted_angles)[places[1:]]


def _may_repeat(p: Parameters) -> bool:
    """Whether nothing but the state tells one revolution from the next."""
    fluctuating = p.drive.kind == FLUCTUATING and p.drive.order == round(p.drive.order)
    steady = p.drive.kind == CONSTANT or fluctuating
    return bool(steady and not p.effects.harmonic and not p.slider_formula.length and not p.crank_formula.length)


def _state_distance(p: Parameters, motion: IntegrationResult, sample: int, other: int, min_clearance: float) -> float:
    """Distance of two states over the least clearance [1]; velocities count as lengths over `VELOCITY_TIME`."""
    state = motion.states[sample] - motion.states[other]
    auxiliary = motion.auxiliary_states[sample] - motion.auxiliary_states[other]
    lengths = np.concatenate([state[:4], auxiliary[[0, 1, 3]]])
    rates = np.concatenate([state[4:], auxiliary[[4, 5, 7]]])
    clearances = [getattr(p, joint).clearance for joint in JOINTS if getattr(p, joint).loose]
    distance = max(np.abs(lengths).max(), VELOCITY_TIME * np.abs(rates).max())
    return float(distance / max(min(clearances, default=0.0), min_clearance))


def _is_kinematic(p: Parameters) -> bool:
    """Whether the motion is that of the ideal mechanism under a prescribed crank: nothing is left to integrate."""
    return not (p.switches.auxiliary or any(getattr(p, joint).loose for joint in JOINTS)) and p.drive.kind != MOTOR


def _kinematic_motion(p: Parameters, angles: np.ndarray) -> IntegrationResult:
    start_state(p)  # refuses a rod that does not reach the slide
    count = angles.size
    return IntegrationResult(
        times=crank_times(p, angles),
        states=np.zeros((count, STATES)),
        auxiliary_states=np.zeros((count, AUXILIARY_STATES)),
        modes=np.zeros((count, 3), np.int64),
        approaches=np.full((count, 3), math.inf),
        begins=np.full((count, 3), math.inf),
        directions=np.full((count, 3), math.nan),
        events=np.empty((0, 0)),
        steps=0,
    )
