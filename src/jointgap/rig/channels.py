"""Channels of a slider-crank at given crank angles, in as few operations as a fit's thousands of simulations need."""

import math
from collections.abc import Callable, Mapping
from math import tau

import numpy as np

from jointgap.config import Mechanism, Simulate
from jointgap.config.scenario import TOLERANCE_SHARE
from jointgap.core.joints import JOINTS
from jointgap.dynamics.drive import crank_motion, crank_times
from jointgap.dynamics.equations import AUXILIARY_STATES, STATES
from jointgap.dynamics.integrate import beginning
from jointgap.dynamics.numba_cache import compiled
from jointgap.dynamics.parameters import CONSTANT, FLUCTUATING, MOTOR, Parameters
from jointgap.dynamics.simulation import IntegrationResult, integrate_on, start_state

Columns = Mapping[str, np.ndarray]
"""Channels of a motion (n,), by column."""

# [m] Local error of a step. Whitened channels of loose pins with friction are then rough by some hundredths in length,
# over all samples; 1e-9 saves a sixth of the time and is ten to thirty times as rough, so that fits do not converge
TOLERANCE = 1e-10
FAST_TOLERANCE = 1e-8  # [m] The same for a search, which needs the energy of impacts, not their phase
FILM_TOLERANCE = 1e-11  # [m] The same where a joint is lubricated: films are stiff, steps are short anyway
# Limit of a search: plain motions take 1000 to 4000, whirling journals ten times as many. With 6000 the truth itself
# was given up in trials with a hidden clearance
FAST_STEPS_PER_REVOLUTION = 12_000
# [1] A revolution stands for all later ones if what is read changed by less than this, over the noise and all samples
SETTLED_LENGTH = 1.0
SETTLED_AFTER = (3, 12)  # Least and most revolutions dropped before the one that is kept
FAST_SETTLED_AFTER = (3, 6)  # The same for a search: of the points that settle 87 to 92 % do so with six
COMPARED_SAMPLES = 120  # Samples of a revolution that are compared: each costs about as much as a step
TRANSIENT_REVOLUTIONS = 1.5  # A record that begins earlier than this after the start is simulated in full


def tolerance_for(mechanism: Mechanism, usual: float = TOLERANCE) -> float:
    """Local error of a step [m] for a fit: smaller where steps would jump over the contacts of a small clearance."""
    film = any(mechanism.effect("lubricated_joint", joint) for joint in mechanism.loose)
    shares = [TOLERANCE_SHARE * mechanism.clearance(joint) for joint in mechanism.loose]
    return min([FILM_TOLERANCE if film else usual, *shares])


def options_of(speed: float, start_angle: float, tolerance: float, **drive) -> Simulate:
    """Options of a simulation, not validated: that takes longer than some motions, and the values are known to be
    good.
    """
    return Simulate.model_construct(speed=speed, start_angle=start_angle, tolerance=tolerance, **drive)


@compiled
def prescribed_angles(p, times):
    """Angles (n,) [rad] of the prescribed crank of parameters `p` at `times` (n,) [s]."""
    angles = np.empty(times.size)
    for i in range(times.size):
        angles[i] = crank_motion(p, times[i])[0]
    return angles


def has_settled(earlier: Columns, before: Columns, last: Columns, change: Callable[[Columns, Columns], float]) -> bool:
    """Whether the last of three revolutions is near the one before it, and near to where they go.

    Where each change is z times the one before it, and z turns its phase too, as a mode that rings does, the last
    revolution is |z / (1 - z)| of the last change away from its limit: the last change squared over the change of the
    changes. Many small changes in one direction then count as what they add up to, and the scatter of the integration,
    which has no direction, as itself.
    """
    changed = change(before, last)
    if changed >= SETTLED_LENGTH:
        return False
    continued = {name: 2.0 * before[name] - earlier[name] for name in last}
    return changed**2 <= SETTLED_LENGTH * change(continued, last)


def channels_at(
    p: Parameters,
    angles: np.ndarray,
    tolerance: float,
    perturbation: np.ndarray | None = None,
    change: Callable[[Columns, Columns], float] | None = None,
    read: int | None = None,
    fast: bool = False,
) -> dict[str, np.ndarray]:
    """All channels at crank angles, by column of `jointgap.dynamics.sampling`, with the ``time`` [s]."""
    if _is_kinematic(p):
        return _sampled(p, angles, lambda sorted_angles: _kinematic_motion(p, sorted_angles))
    most_steps = FAST_STEPS_PER_REVOLUTION if fast else None
    progress = beginning(p, *start_state(p, perturbation), 0.0)

    def integrate(sorted_angles: np.ndarray) -> IntegrationResult:
        nonlocal progress
        motion, progress = integrate_on(p, progress, sorted_angles, tolerance, most_steps)
        return motion

    back = (angles.min() - p.drive.start_angle) / tau
    if change is None or perturbation is not None or not _may_repeat(p) or back <= TRANSIENT_REVOLUTIONS:
        return _sampled(p, angles, integrate)
    # One settled revolution stands for all of them, if what is read no longer changes from one to the next.
    within = p.drive.start_angle + np.mod(angles - p.drive.start_angle, tau)
    whole_record = {"crank_angle": angles, "time": _times(p, angles)}
    dropped_revolutions = FAST_SETTLED_AFTER if fast else SETTLED_AFTER
    first, last = (max(dropped, round(back)) for dropped in dropped_revolutions)
    compared = _spread(within[:read], COMPARED_SAMPLES)
    earlier = _sampled(p, within[compared] + (first - 2) * tau, integrate)
    before = _sampled(p, within[compared] + (first - 1) * tau, integrate)
    for dropped in range(first, last + 1):
        motion = _sampled(p, within + dropped * tau, integrate)
        now = {name: values[compared] for name, values in motion.items()}
        if has_settled(earlier, before, now, change):
            return motion | whole_record
        earlier, before = before, now
    later = (last + 1 - math.floor(back)) * tau  # so much later it has settled at least this far
    return _sampled(p, angles + later, integrate) | whole_record


def _spread(angles: np.ndarray, count: int) -> np.ndarray:
    """Places of `count` of the `angles`, or of all if they are fewer, evenly in their order."""
    order = np.argsort(angles, kind="stable")
    return order[np.linspace(0, order.size - 1, min(count, order.size)).round().astype(int)]


def _sampled(
    p: Parameters, angles: np.ndarray, integrate: Callable[[np.ndarray], IntegrationResult]
) -> dict[str, np.ndarray]:
    """Channels at `angles`, in any order."""
    sorted_angles, places = np.unique(angles, return_inverse=True)
    motion = integrate(sorted_angles)
    columns = motion.observed(p) | {"time": motion.times}
    return {name: values[places] for name, values in columns.items()}


def _times(p: Parameters, angles: np.ndarray) -> np.ndarray:
    """Times (n,) [s] at which a prescribed crank passes `angles` (n,) [rad], in any order."""
    sorted_angles, places = np.unique(np.append(p.drive.start_angle, angles), return_inverse=True)
    return crank_times(p, sorted_angles)[places[1:]]


def _may_repeat(p: Parameters) -> bool:
    """Whether nothing but the state tells one revolution from the next."""
    e, drive = p.effects, p.drive
    steady = drive.kind == CONSTANT or (drive.kind == FLUCTUATING and drive.order == round(drive.order))
    over_turns = e.table_over == 2 or (e.table_over == 1 and e.table_period > 1.5 * tau)
    over_turns = over_turns or bool(e.crank_periodic and e.crank_periodic_order % 1)  # a half order
    formulas = p.slider_formula.length or p.crank_formula.length
    return bool(steady and not e.harmonic and not over_turns and not formulas)


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
