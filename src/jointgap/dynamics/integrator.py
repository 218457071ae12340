"""One step of the 8th-order Runge-Kutta method, in time or in the square root of the time from an event.

With a force K d^(3/2) the motion is not smooth where contact begins or ends: d grows with the time from there, and its
root is a branch point. In sigma = sqrt(time from the event) it is smooth again. A step therefore has a course:

    LINEAR       t = s
    AFTER        t = origin + s^2, s growing from the event
    BEFORE       t = origin - s^2, s falling to the event
"""

import math

from jointgap.dynamics import tableau
from jointgap.dynamics.compiled import compiled
from jointgap.dynamics.equations import STATES, accelerations, clearance_vectors, joint_force, turned

LINEAR, AFTER, BEFORE = 0, 1, -1

NODES, STAGES = tableau.NODES, tableau.STAGES
ERROR_5, ERROR_3, COUNT = tableau.ERROR_5, tableau.ERROR_3, tableau.COUNT


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
def rates(p, angles, turn, y0, y1, y2, y3, y4, y5, y6, y7, rod_angle, modes, approaches):
    """Accelerations at one state; `angles` = cos, sin of crank and rod at an instant from which the crank is `turn` on
    and the rod at `rod_angle`."""
    crank_cos, crank_sin = turned(angles[0], angles[1], turn)
    rod_cos, rod_sin = turned(angles[2], angles[3], y2 - rod_angle)
    pin, piston = clearance_vectors(p, crank_cos, crank_sin, rod_cos, rod_sin, y0, y1, y3, y4, y5, y6, y7)
    return accelerations(
        p,
        rod_cos,
        rod_sin,
        joint_force(p.crank_pin, modes[0], approaches[0], pin, y6, p.speed),
        joint_force(p.piston_pin, modes[1], approaches[1], piston, y6, 0.0),
    )


@compiled
def step(p, angles, modes, approaches, y, slope, course, s, ds, weights, k, new, new_slope):
    """Advance the state from s to s + ds with the modes frozen.

    Parameters
    ----------
    p : Parameters
    angles : tuple of 4 floats
        Cosine and sine of crank and rod angle at the start of the step.
    modes, approaches : tuples of 2
        Modes of crank pin and piston pin, approach speeds [m/s] of their contacts.
    y, slope : (8,) arrays
        State and its time derivative at the start.
    course, s, ds : int, float, float
        How time runs, and where the step starts and how long it is.
    weights : tuple of 3 floats
        Metres that an error of one unit counts for: in the rod angle, in linear, in angular velocity.
    k : (12, 8) array
        Work space.
    new, new_slope : (8,) arrays
        Overwritten with the state at the end and its time derivative.

    Returns
    -------
    float
        Estimated local error [m].
    """
    factor = pace(course, s)
    for i in range(STATES):
        k[0, i] = factor * slope[i]
    for stage in range(1, COUNT + 1):
        z0 = z1 = z2 = z3 = z4 = z5 = z6 = z7 = 0.0
        for j in range(stage):
            a = STAGES[stage, j]
            z0 += a * k[j, 0]
            z1 += a * k[j, 1]
            z2 += a * k[j, 2]
            z3 += a * k[j, 3]
            z4 += a * k[j, 4]
            z5 += a * k[j, 5]
            z6 += a * k[j, 6]
            z7 += a * k[j, 7]
        z0 = y[0] + ds * z0
        z1 = y[1] + ds * z1
        z2 = y[2] + ds * z2
        z3 = y[3] + ds * z3
        z4 = y[4] + ds * z4
        z5 = y[5] + ds * z5
        z6 = y[6] + ds * z6
        z7 = y[7] + ds * z7
        advance = NODES[stage] * ds
        turn = p.speed * elapsed(course, s, advance)
        ax, ay, alpha, ap = rates(p, angles, turn, z0, z1, z2, z3, z4, z5, z6, z7, y[2], modes, approaches)
        if stage < COUNT:
            factor = pace(course, s + advance)
            k[stage, 0] = factor * z4
            k[stage, 1] = factor * z5
            k[stage, 2] = factor * z6
            k[stage, 3] = factor * z7
            k[stage, 4] = factor * ax
            k[stage, 5] = factor * ay
            k[stage, 6] = factor * alpha
            k[stage, 7] = factor * ap
        else:
            new[0], new[1], new[2], new[3], new[4], new[5], new[6], new[7] = z0, z1, z2, z3, z4, z5, z6, z7
            new_slope[0], new_slope[1], new_slope[2], new_slope[3] = z4, z5, z6, z7
            new_slope[4], new_slope[5], new_slope[6], new_slope[7] = ax, ay, alpha, ap
    return ds_error(k, ds, weights)


@compiled
def ds_error(k, ds, weights):
    """Estimated local error [m] of a step from its stages: the 5th-order estimate, damped by the 3rd-order one."""
    fifth = third = 0.0
    for i in range(STATES):
        e5 = e3 = 0.0
        for j in range(COUNT):
            e5 += ERROR_5[j] * k[j, i]
            e3 += ERROR_3[j] * k[j, i]
        weight = 1.0
        if i == 2:
            weight = weights[0]
        elif i == 6:
            weight = weights[2]
        elif i > 3:
            weight = weights[1]
        fifth += (weight * e5) ** 2
        third += (weight * e3) ** 2
    if fifth == 0.0 and third == 0.0:
        return 0.0
    return abs(ds) * fifth / math.sqrt(fifth + 0.01 * third)
