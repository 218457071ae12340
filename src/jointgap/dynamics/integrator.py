"""One step of the 8th-order Runge-Kutta method, in time or in the square root of the time from an event.

With a force K d^(3/2) the motion is not smooth where contact begins or ends: d grows with the time from there, and its
root is a branch point. In sigma = sqrt(time from the event) it is smooth again. A step therefore has a course:

    LINEAR       t = s
    AFTER        t = origin + s^2, s growing from the event
    BEFORE       t = origin - s^2, s falling to the event
"""

import math
from typing import NamedTuple

import numpy as np

from jointgap.dynamics.compiled import compiled
from jointgap.dynamics.equations import STATES, accelerations, clearance_vectors, joint_force, turned
from jointgap.dynamics.tableau import COUNT, ERROR_3, ERROR_5, NODES, STAGES

LINEAR, AFTER, BEFORE = (np.int64(course) for course in (0, 1, -1))  # of one type, so that code is compiled once

SECOND = np.array([1, 1, *(1 + np.flatnonzero(row[1:])[0] for row in STAGES[2:])])
"""By stage, the first column after column 0 that is not zero; in the solution's row that of the error estimators too."""


class Instant(NamedTuple):
    """Where a march is: all that a step starts from.

    Attributes
    ----------
    time : float
        [s].
    y, slope : tuples of 8 floats
        State and its time derivative.
    crank_cos, crank_sin, rod_cos, rod_sin : float
        Directions of crank and rod.
    modes, approaches : tuples of 2
        Modes of crank pin and piston pin, approach speeds [m/s] of their contacts.
    """

    time: float
    y: tuple[float, ...]
    slope: tuple[float, ...]
    crank_cos: float
    crank_sin: float
    rod_cos: float
    rod_sin: float
    modes: tuple[int, int]
    approaches: tuple[float, float]


@compiled
def elapsed(course, s, ds):
    """Time [s] that passes between s and s + ds."""
    return ds if course == LINEAR else course * ds * (2.0 * s + ds)


@compiled
def pace(course, s):
    """dt/ds at s."""
    return 1.0 if course == LINEAR else 2.0 * course * s


@compiled
def stretch(course, s, duration):
    """The ds that takes `duration` [s] from s on."""
    if course == LINEAR:
        return duration
    inside = s * s + course * duration
    return course * duration / (math.sqrt(max(inside, 0.0)) + s)


@compiled
def hystereses(p, approaches):
    """chi / d'_0 [s/m] of both contacts."""
    return p.crank_pin.damping / approaches[0], p.piston_pin.damping / approaches[1]


@compiled
def accelerations_at(p, crank_cos, crank_sin, rod_cos, rod_sin, y, modes, drags):
    """Accelerations of rod (x, y, angle) and slider at a state."""
    pin, piston = clearance_vectors(p, crank_cos, crank_sin, rod_cos, rod_sin, y)
    return accelerations(
        p,
        rod_cos,
        rod_sin,
        joint_force(p.crank_pin, modes[0], drags[0], pin, y[6], p.speed),
        joint_force(p.piston_pin, modes[1], drags[1], piston, y[6], 0.0),
    )


@compiled
def instant(p, time, y, modes, approaches):
    """The instant of a state."""
    crank_angle = p.start_angle + p.speed * time
    crank_cos, crank_sin, rod_cos, rod_sin = (
        math.cos(crank_angle),
        math.sin(crank_angle),
        math.cos(y[2]),
        math.sin(y[2]),
    )
    forces = accelerations_at(p, crank_cos, crank_sin, rod_cos, rod_sin, y, modes, hystereses(p, approaches))
    slope = (y[4], y[5], y[6], y[7], forces[0], forces[1], forces[2], forces[3])
    return Instant(time, y, slope, crank_cos, crank_sin, rod_cos, rod_sin, modes, approaches)


@compiled
def step(p, here, course, s, ds, velocity_time, k):
    """Advance the state from s to s + ds with the modes frozen.

    Parameters
    ----------
    p : Parameters
    here : Instant
        Start of the step.
    course, s, ds : int, float, float
        How time runs, and where the step starts and how long it is.
    velocity_time : float
        Time [s] that turns an error in a velocity into one in a position.
    k : (12, 8) array
        Work space for the stages.

    Returns
    -------
    tuple
        State at the end (8 floats), estimated local error [m].
    """
    y, drags = here.y, hystereses(p, here.approaches)
    factor = pace(course, s)
    for i in range(STATES):
        k[0, i] = factor * here.slope[i]
    z = y
    for stage in range(1, COUNT + 1):
        a = STAGES[stage, 0]
        z0, z1, z2, z3 = a * k[0, 0], a * k[0, 1], a * k[0, 2], a * k[0, 3]
        z4, z5, z6, z7 = a * k[0, 4], a * k[0, 5], a * k[0, 6], a * k[0, 7]
        for j in range(SECOND[stage], stage):
            a = STAGES[stage, j]
            z0 += a * k[j, 0]
            z1 += a * k[j, 1]
            z2 += a * k[j, 2]
            z3 += a * k[j, 3]
            z4 += a * k[j, 4]
            z5 += a * k[j, 5]
            z6 += a * k[j, 6]
            z7 += a * k[j, 7]
        z0, z1, z2, z3 = y[0] + ds * z0, y[1] + ds * z1, y[2] + ds * z2, y[3] + ds * z3
        z4, z5, z6, z7 = y[4] + ds * z4, y[5] + ds * z5, y[6] + ds * z6, y[7] + ds * z7
        z = (z0, z1, z2, z3, z4, z5, z6, z7)
        if stage == COUNT:
            break
        advance = NODES[stage] * ds
        crank_cos, crank_sin = turned(here.crank_cos, here.crank_sin, p.speed * elapsed(course, s, advance))
        rod_cos, rod_sin = turned(here.rod_cos, here.rod_sin, z2 - y[2])
        ax, ay, alpha, ap = accelerations_at(p, crank_cos, crank_sin, rod_cos, rod_sin, z, here.modes, drags)
        factor = pace(course, s + advance)
        k[stage, 0], k[stage, 1], k[stage, 2], k[stage, 3] = factor * z4, factor * z5, factor * z6, factor * z7
        k[stage, 4], k[stage, 5], k[stage, 6], k[stage, 7] = factor * ax, factor * ay, factor * alpha, factor * ap
    rod_length = p.rod_to_crank_end + p.rod_to_piston_end
    return z, abs(ds) * relative_error(k, rod_length, velocity_time)


@compiled
def relative_error(k, rod_length, velocity_time):
    """Estimated local error [m] over ds, from a step's stages: the 5th-order estimate, damped by the 3rd-order one.

    Errors in the rod angle count by the rod's length, errors in velocities by `velocity_time`.
    """
    fifth = third = 0.0
    for i in range(STATES):
        e5, e3 = ERROR_5[0] * k[0, i], ERROR_3[0] * k[0, i]
        for j in range(SECOND[COUNT], COUNT):
            e5 += ERROR_5[j] * k[j, i]
            e3 += ERROR_3[j] * k[j, i]
        weight = (velocity_time if i > 3 else 1.0) * (rod_length if i == 2 or i == 6 else 1.0)
        fifth += (weight * e5) ** 2
        third += (weight * e3) ** 2
    size = math.sqrt(fifth + 0.01 * third)
    if size == 0.0:
        return 0.0
    return fifth / size if size < math.inf else math.inf  # an overflow or NaN must not pass for a small error
