"""Other numerics than the simulation's: the embedded Runge-Kutta pair of orders 5 and 4, from event to event.

Method, step control and search for events are not those of `jointgap.dynamics.integrate`, so that no simulator
is fitted to its own output: the duplication is on purpose. Equations of motion, contact laws, the conditions of an
event, the start and what is computed from a sampled state are the same.

J. R. Dormand and P. J. Prince, J. Comput. Appl. Math. 6 (1980) 19-26.
"""

import math

import numpy as np
from scipy.integrate import RK45

from jointgap.core.errors import SimulationError
from jointgap.dynamics.equations import AUXILIARY_STATES, STATES
from jointgap.dynamics.events import DISTANCE, FORCE, all_conditions, switched
from jointgap.dynamics.integrate import least_approach, replaced
from jointgap.dynamics.joints import FLIGHT, relative_motion
from jointgap.dynamics.numba_cache import compiled
from jointgap.dynamics.parameters import Parameters
from jointgap.dynamics.runge_kutta import VELOCITY_TIME, instant
from jointgap.dynamics.simulation import IntegrationResult, start_state

_SIZE = STATES + AUXILIARY_STATES
_NODES = np.append(RK45.C, 1.0)
_STAGES = np.vstack((np.hstack((RK45.A, np.zeros((6, 1)))), RK45.B))
_ERROR = RK45.E

_LONGEST_TURN = 0.03  # [rad] of crank angle in one step, so that no contact is jumped over
_BISECTIONS = 50  # of a step until its end lies just past an event: from 1e-4 s down to the last digit
_MOST_STEPS = 20_000_000  # of one integration, before it counts as stuck
DONE, TOO_MANY, TOO_SHORT = range(3)


@compiled
def _rates(p, time, z, modes, approaches, begins, out):
    y = (z[0], z[1], z[2], z[3], z[4], z[5], z[6], z[7])
    x = (z[8], z[9], z[10], z[11], z[12], z[13], z[14], z[15], z[16], z[17], z[18])
    here = instant(p, time, y, x, modes, approaches, begins)
    for i in range(STATES):
        out[i] = here.clearance_rates[i]
    for i in range(AUXILIARY_STATES):
        out[STATES + i] = here.auxiliary_rates[i]
    return here


@compiled
def _step(p, time, z, modes, approaches, begins, h, k, work, end):
    """One step of `h` [s] from `z`, whose rates are in `k[0]`, to `end`: estimated local error [m]."""
    for stage in range(1, 7):
        for i in range(_SIZE):
            total = 0.0
            for j in range(stage):
                total += _STAGES[stage, j] * k[j, i]
            work[i] = z[i] + h * total
        if stage == 6:
            for i in range(_SIZE):
                end[i] = work[i]
        _rates(p, time + _NODES[stage] * h, work, modes, approaches, begins, k[stage])
    square = 0.0
    for i in range(_SIZE):
        error = 0.0
        for j in range(7):
            error += _ERROR[j] * k[j, i]
        weight = VELOCITY_TIME if 4 <= i < 8 or 12 <= i < 16 else 1.0
        square += (weight * h * error) ** 2
    return math.sqrt(square)


@compiled
def _ended(p, time, z, modes, approaches, begins, work):
    """First joint whose mode has ended at a state, and which of its conditions; joint -1 where none has."""
    here = _rates(p, time, z, modes, approaches, begins, work)
    holding = all_conditions(p, here, relative_motion(here))
    worst, joint, kind, speed = 0.0, -1, DISTANCE, 0.0
    for number in range(3):
        g, rate, _, h, _ = holding[number]
        if g < worst:
            worst, joint, kind, speed = g, number, DISTANCE, max(-rate, 0.0)
        if h < 0.0 and joint < 0:
            joint, kind = number, FORCE
    return joint, kind, speed


@compiled
def _integrate(p, z, times, tolerance, states, auxiliary_states, modes_at, approaches_at, begins_at):
    k, work, end, trial = np.zeros((7, _SIZE)), np.zeros(_SIZE), np.zeros(_SIZE), np.zeros(_SIZE)
    rates = np.zeros(_SIZE)
    modes = (FLIGHT, FLIGHT, FLIGHT)
    approaches = begins = (math.inf, math.inf, math.inf)
    longest = _LONGEST_TURN / p.drive.speed
    time, h, sample = 0.0, 1e-3 * longest, 0
    for _ in range(_MOST_STEPS):
        _rates(p, time, z, modes, approaches, begins, k[0])
        h = min(h, longest)
        error = _step(p, time, z, modes, approaches, begins, h, k, work, end)
        if not error <= tolerance:
            h *= max(0.2, 0.9 * (tolerance / error) ** 0.2) if error < math.inf else 0.1
            if h < 1e-16:
                return TOO_SHORT, time
            continue
        growth = 5.0 if error == 0.0 else min(5.0, 0.9 * (tolerance / error) ** 0.2)
        joint, kind, speed = _ended(p, time + h, end, modes, approaches, begins, rates)
        taken = h
        if joint >= 0:  # shorten the step until it ends just past the first event in it
            low, high = 0.0, h
            for _ in range(_BISECTIONS):
                middle = 0.5 * (low + high)
                _step(p, time, z, modes, approaches, begins, middle, k, work, trial)
                ended, ended_kind, ended_speed = _ended(p, time + middle, trial, modes, approaches, begins, rates)
                if ended >= 0:
                    high, joint, kind, speed = middle, ended, ended_kind, ended_speed
                else:
                    low = middle
                if high - low <= 1e-16 + 1e-15 * time:
                    break
            taken = high
        while sample < times.size and times[sample] <= time + taken:
            _step(p, time, z, modes, approaches, begins, times[sample] - time, k, work, trial)
            for i in range(STATES):
                states[sample, i] = trial[i]
            for i in range(AUXILIARY_STATES):
                auxiliary_states[sample, i] = trial[STATES + i]
            for i in range(3):
                modes_at[sample, i], approaches_at[sample, i] = modes[i], approaches[i]
                begins_at[sample, i] = begins[i]
            sample += 1
        if sample == times.size:
            return DONE, time
        if joint < 0:
            time += h
            for i in range(_SIZE):
                z[i] = end[i]
            h *= growth
            continue
        _step(p, time, z, modes, approaches, begins, taken, k, work, end)
        time += taken
        for i in range(_SIZE):
            z[i] = end[i]
        in_flight = modes[joint] == FLIGHT
        mode, approach = switched(modes[joint], approaches[joint], kind, speed, least_approach(p, joint))
        if mode == FLIGHT and joint < 3:
            z[STATES + 8 + joint] = 0.0  # bristles that touch nothing are straight
        modes, approaches = replaced(modes, joint, mode), replaced(approaches, joint, approach)
        if in_flight or mode == FLIGHT:
            begins = replaced(begins, joint, time if in_flight else math.inf)
        h = min(h, 1e-6)
    return TOO_MANY, time


def integrate(p: Parameters, times: np.ndarray, tolerance: float, perturbation=None) -> dict[str, np.ndarray]:
    """All signals of a motion at `times`, from the start of `jointgap.dynamics.simulation` on."""
    y, x = start_state(p, perturbation)
    n = times.size
    states, auxiliary_states = np.empty((n, STATES)), np.empty((n, AUXILIARY_STATES))
    modes, approaches, begins = np.empty((n, 3), np.int64), np.empty((n, 3)), np.empty((n, 3))
    status, time = _integrate(
        p, np.concatenate((y, x)), times, tolerance, states, auxiliary_states, modes, approaches, begins
    )
    if status != DONE:
        raise SimulationError(f"the orders 5 and 4 cannot go on at time {time:.9g} s; give a larger tolerance")
    sampled = (times, states, auxiliary_states, modes, approaches, begins, np.zeros((n, 3)))
    return IntegrationResult(*sampled, events=np.empty((0, 0)), steps=0).observed(p)
