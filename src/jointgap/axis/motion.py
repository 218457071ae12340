"""Motion and forces of an axis."""

import math

import numba
import numpy as np

from jointgap.contact.friction import smooth_sign
from jointgap.core.records import Record, record
from jointgap.linkage.laws import slide_force
from jointgap.linkage.parameters import SlideLaws

_CLOSED = 1e-9  # [1] Rounding, of half a play
NEAR = 0.05  # [1] Share of a range over which derivatives of forces are differences


def laws(numbers: dict[str, float]) -> Record:
    """Force laws with `numbers` by name, see `jointgap.effects.slides.SLIDE_LAWS`."""
    return record(SlideLaws(**numbers))


@numba.njit(error_model="numpy")
def _force(law, load, x, v, time):
    return slide_force(law, smooth_sign(v / law.sign_speed), load, x, v, time)


@numba.njit(error_model="numpy")
def law_forces(laws, load, position, velocity, time):
    """Forces (n,) [N or N m] of the laws on a given motion (n,) with normal forces `load` (n,)."""
    forces = np.empty(position.size)
    for i in range(position.size):
        forces[i] = _force(laws, load[i], position[i], velocity[i], time[i])
    return forces


@numba.njit(error_model="numpy")
def played(position, play):
    """Motion (n,) behind a play: it stands still until the `position` (n,) has crossed the play.

    At the first sample the side is that of the first movement.
    """
    behind = np.empty(position.size)
    half = 0.5 * play
    least = 0.01 * (position.max() - position.min())
    side = 1.0
    for value in position:
        if abs(value - position[0]) > least:
            side = 1.0 if value > position[0] else -1.0
            break
    behind[0] = position[0] - side * half
    for i in range(1, position.size):
        behind[i] = min(max(behind[i - 1], position[i] - half), position[i] + half)
    return behind


def behind_play(position, play):
    """Motion (n,) behind a play, and where the play is open: nothing touches (n,)."""
    behind = played(position, play)
    return behind, np.abs(position - behind) < 0.5 * play * (1.0 - _CLOSED)


@numba.njit(error_model="numpy")
def _acceleration(mass, force, load, values, laws, own_load, q, v, t, inputs, drive):
    """Acceleration of the axis; dry friction opposes the sign of the velocity `v`."""
    weight = load(values, q, v, 0.0, t, inputs) if own_load else drive
    total = drive + force(values, q, v, 0.0, t, inputs)
    total += _force(laws, weight, q, v, t)
    return total / mass(values, q, v, 0.0, t, inputs)


@numba.njit(error_model="numpy")
def fastest_rate(mass, force, load, values, laws, own_load, q, v, t, inputs, drive, span, speed):
    """Fastest rate [1/s] of smooth motion near a state, from differences over the shares of the
    `span` of positions and of the typical `speed`."""
    ahead, back = q + NEAR * span, q - NEAR * span
    after = _acceleration(mass, force, load, values, laws, own_load, ahead, v, t, inputs, drive)
    before = _acceleration(mass, force, load, values, laws, own_load, back, v, t, inputs, drive)
    frequency = math.sqrt(abs(after - before) / (2.0 * NEAR * span))
    fast = abs(v) + speed
    ahead, back = (1.0 + NEAR) * fast, (1.0 - NEAR) * fast
    after = _acceleration(mass, force, load, values, laws, own_load, q, ahead, t, inputs, drive)
    before = _acceleration(mass, force, load, values, laws, own_load, q, back, t, inputs, drive)
    return max(frequency, abs(after - before) / (2.0 * NEAR * fast))


@numba.njit(error_model="numpy")
def march(mass, force, load, values, laws, own_load, time, drive, inputs, start, least_speed, step):
    """Positions and velocities (2, n) at the times (n,) [s], from `start` on.

    The `drive` (n,) and the `inputs` (k, n) are linear between samples. Steps of at most `step` [s]
    are half a drift, a kick by Heun's method, and half a drift, of second order. Dry friction is
    exact: it is that of the `least_speed` to either side, and holds the axis where it exceeds the
    other forces. NaN from where the motion is not finite.
    """
    motion = np.full((2, time.size), np.nan)
    q, v = start
    motion[0, 0], motion[1, 0] = q, v
    for k in range(1, time.size):
        span = time[k] - time[k - 1]
        steps = max(math.ceil(span / step), 1)
        h = span / steps
        x = inputs[:, k - 1]
        for i in range(steps):
            share = (i + 0.5) / steps
            t = time[k - 1] + share * span
            u = drive[k - 1] + share * (drive[k] - drive[k - 1])
            if inputs.shape[0] > 0:
                x = inputs[:, k - 1] + share * (inputs[:, k] - inputs[:, k - 1])
            q += 0.5 * h * v
            side = math.copysign(least_speed, v)
            left = h
            if v != 0.0:
                first = _acceleration(mass, force, load, values, laws, own_load, q, v, t, x, u)
                ahead = v + h * first
                if ahead * v < 0.0:
                    ahead = side
                second = _acceleration(mass, force, load, values, laws, own_load, q, ahead, t, x, u)
                change = 0.5 * h * (first + second)
                if (v + change) * v > 0.0:
                    v += change
                    left = 0.0
                else:  # stops within the step
                    left = h * (1.0 - v / (v - (v + change)))
                    v = 0.0
            if left > 0.0:
                forwards = _acceleration(
                    mass, force, load, values, laws, own_load, q, least_speed, t, x, u
                )
                backwards = _acceleration(
                    mass, force, load, values, laws, own_load, q, -least_speed, t, x, u
                )
                if forwards > 0.0 and backwards > 0.0:
                    v = left * forwards
                elif forwards < 0.0 and backwards < 0.0:
                    v = left * backwards
            q += 0.5 * h * v
        if not (math.isfinite(q) and math.isfinite(v)):
            return motion
        motion[0, k], motion[1, k] = q, v
    return motion


@numba.njit(error_model="numpy")
def accelerations(
    mass, force, load, values, laws, own_load, time, drive, inputs, motion, least_speed
):
    """Acceleration (n,) at a simulated `motion` (2, n); 0 where dry friction holds the axis."""
    result = np.empty(time.size)
    for k in range(time.size):
        q, v, t, x, u = motion[0, k], motion[1, k], time[k], inputs[:, k], drive[k]
        if v != 0.0:
            result[k] = _acceleration(mass, force, load, values, laws, own_load, q, v, t, x, u)
            continue
        forwards = _acceleration(mass, force, load, values, laws, own_load, q, least_speed, t, x, u)
        backwards = _acceleration(
            mass, force, load, values, laws, own_load, q, -least_speed, t, x, u
        )
        result[k] = max(forwards, 0.0) + min(backwards, 0.0)
    return result
