"""One step of the 8th-order Runge-Kutta method, in time or in the square root of the time from an event.

With a force K d^(3/2) the motion is not smooth where contact begins or ends: d grows with the time from there, and its
root is a branch point. In sigma = sqrt(time from the event) it is smooth again. A step therefore has a time_map:

    LINEAR       t = s
    AFTER        t = origin + s^2, s growing from the event
    BEFORE       t = origin - s^2, s falling to the event
"""

import math
from typing import NamedTuple

import numpy as np

from jointgap.dynamics.compilation import compiled, inlined
from jointgap.dynamics.model.equations import AUXILIARY_STATES, STATES, Crank, accelerations
from jointgap.dynamics.model.normal_contact import damping_factor_at
from jointgap.dynamics.model.parameters import CONSTANT, MOTOR
from jointgap.dynamics.model.prescribed_drive import crank_motion
from jointgap.dynamics.solver.tableau import COUNT, ERROR_3, ERROR_5, NODES, STAGES

LINEAR, AFTER, BEFORE = (np.int64(time_map) for time_map in (0, 1, -1))  # of one type, so that code is compiled once

SECOND = np.array([1, 1, *(1 + np.flatnonzero(row[1:])[0] for row in STAGES[2:])])
"""By stage, the first column after column 0 that is not zero; in the solution's row the error estimators' too."""


NORMAL, COLUMNS = STATES + AUXILIARY_STATES, STATES + AUXILIARY_STATES + 3
"""Where in the work space for stages the normal forces begin, and how wide it is."""

SIN_3, SIN_5, SIN_7, SIN_9 = (1 / math.factorial(n) for n in (3, 5, 7, 9))
COS_4, COS_6, COS_8, COS_10 = (1 / math.factorial(n) for n in (4, 6, 8, 10))


class Instant(NamedTuple):
    """State of the integration at one time: all that a step starts from.

    Attributes
    ----------
    time : float
        [s].
    clearance_state, auxiliary_state : tuples of 8 and 11 floats
        Clearance vectors with their rates, and auxiliary states: see `jointgap.dynamics.model.equations`.
    clearance_rates, auxiliary_rates : tuples of 8 and 11 floats
        Their time derivatives.
    crank_angle : float
        [rad].
    crank : Crank
    modes, approaches, begins, normals : tuples of 3
        Modes of crank pin, piston pin and crank pivot, approach speeds [m/s] and begins [s] of their contacts (no
        contact: infinite), normal forces [N].
    """

    time: float
    clearance_state: tuple[float, ...]
    auxiliary_state: tuple[float, ...]
    clearance_rates: tuple[float, ...]
    auxiliary_rates: tuple[float, ...]
    crank_angle: float
    crank: Crank
    modes: tuple[int, int, int]
    approaches: tuple[float, float, float]
    begins: tuple[float, float, float]
    normals: tuple[float, float, float]


@inlined
def turned(cosine, sine, angle) -> tuple:
    """Cosine and sine of an angle further on by `angle` [rad] than the one with the given `cosine` and `sine`."""
    if abs(angle) > 0.1:
        c, s = math.cos(angle), math.sin(angle)
    else:  # Taylor polynomials, exact to the last digit here and many times faster than the library's functions
        q = angle * angle
        q2 = q * q
        s = angle + angle * q * ((q * SIN_5 - SIN_3) + q2 * (q * SIN_9 - SIN_7))
        c = 1.0 + q * ((q * COS_4 - 0.5) + q2 * ((q * COS_8 - COS_6) - q2 * COS_10))
    return cosine * c - sine * s, sine * c + cosine * s


@inlined
def elapsed_time(time_map, s, ds) -> float:
    """Time [s] that passes between s and s + ds.

    Parameters
    ----------
    time_map : int
    s, ds : float
    """
    return ds if time_map == LINEAR else time_map * ds * (2.0 * s + ds)


@inlined
def dt_ds(time_map, s) -> float:
    """dt/ds at s.

    Parameters
    ----------
    time_map : int
    s : float
    """
    return 1.0 if time_map == LINEAR else 2.0 * time_map * s


@inlined
def ds_for(time_map, s, duration) -> float:
    """The ds that takes `duration` [s] from s on.

    Parameters
    ----------
    time_map : int
    s : float
    duration : float
        [s].
    """
    if time_map == LINEAR:
        return duration
    inside = s * s + time_map * duration
    return time_map * duration / (math.sqrt(max(inside, 0.0)) + s)


@inlined
def damping_factors(p, approaches, begins, time) -> tuple:
    """`damping_factor_at` of all contacts.

    Parameters
    ----------
    p : Parameters
    approaches, begins : tuples of 3 floats
        Approach speeds [m/s] and begins [s].
    time : float
        [s].
    """
    return (
        damping_factor_at(p.crank_pin, approaches[0], begins[0], time),
        damping_factor_at(p.piston_pin, approaches[1], begins[1], time),
        damping_factor_at(p.crank_pivot, approaches[2], begins[2], time),
    )


@inlined
def _fades(joint, begin, time, later) -> bool:
    """Whether the memory of a contact fades between two times.

    Parameters
    ----------
    joint : JointParameters
    begin, time, later : float
        [s].
    """
    faded_from = begin + joint.memory_time
    return faded_from < later and time < faded_from + joint.fading_time


@inlined
def next_knot(joint, begin, time, resolution) -> float:
    """Next time [s] at which the memory of a contact begins or ends to fade, infinite if there is none.

    Parameters
    ----------
    joint : JointParameters
    begin, time, resolution : float
        Begin of the contact, time from which on, and how near to it a knot counts as passed [s].
    """
    knot = begin + joint.memory_time
    if knot > time + resolution:
        return knot
    knot += joint.fading_time
    return knot if knot > time + resolution else math.inf


@inlined
def crank_at(p, time, x) -> tuple:
    """Angle [rad] of the crank and its `Crank`, from the time or, where a motor turns it, from the auxiliary states.

    Parameters
    ----------
    p : Parameters
    time : float
        [s].
    x : tuple of 11 floats
        Auxiliary state.
    """
    if p.drive.kind == MOTOR:
        return x[2], Crank(math.cos(x[2]), math.sin(x[2]), x[6], 0.0)
    angle, speed, acceleration = crank_motion(p, time)
    return angle, Crank(math.cos(angle), math.sin(angle), speed, acceleration)


@inlined
def rates_of_auxiliary(x, found, bristles) -> tuple:
    """Time derivatives of the auxiliary states; `found` are `accelerations`.

    Parameters
    ----------
    x : tuple of 11 floats
        Auxiliary state.
    found, bristles : tuples of 8 and 3 floats
        Accelerations, rates of the bristles [m/s].
    """
    return (x[4], x[5], x[6], x[7], found[4], found[5], found[6], found[7], bristles[0], bristles[1], bristles[2])


@compiled
def instant(p, time, y, x, modes, approaches, begins):
    """The instant of a state.

    Parameters
    ----------
    p : Parameters
    time : float
        [s].
    y, x : tuples of 8 and 11 floats
        Clearance state and auxiliary state.
    modes, approaches, begins : tuples of 3
        Modes of the joints, approach speeds [m/s] and begins [s] of their contacts.
    """
    angle, crank = crank_at(p, time, x)
    damping = damping_factors(p, approaches, begins, time)
    a, pin, piston, pivot, _, _, bristles = accelerations(p, time, angle, crank, y, x, modes, damping)
    slope = (y[4], y[5], y[6], y[7], a[0], a[1], a[2], a[3])
    normals = (pin[0], piston[0], pivot[0])
    rates = rates_of_auxiliary(x, a, bristles)
    return Instant(time, y, x, slope, rates, angle, crank, modes, approaches, begins, normals)


instant_in_place = inlined(getattr(instant, "py_func", instant))
"""`instant`, put in where it is called: for the one place that the integration passes at every step."""


@compiled
def auxiliary_at(x, ds, stage, k):
    """Auxiliary states at a stage of a step from `x`, whose earlier stages are in `k`.

    Parameters
    ----------
    x : tuple of 11 floats
    ds : float
        Length of the step in s.
    stage : int
    k : (12, 22) array
    """
    moved = np.zeros(AUXILIARY_STATES)
    for j in range(stage):
        a = STAGES[stage, j]
        if a != 0.0:
            for i in range(AUXILIARY_STATES):
                moved[i] += a * k[j, STATES + i]
    for i in range(AUXILIARY_STATES):
        moved[i] = x[i] + ds * moved[i]
    return (
        moved[0], moved[1], moved[2], moved[3], moved[4], moved[5], moved[6], moved[7], moved[8], moved[9], moved[10],
    )  # fmt: skip


@compiled
def step(p, here, time_map, s, ds, velocity_time, k):
    """Advance the state from s to s + ds with the modes frozen.

    Parameters
    ----------
    p : Parameters
    here : Instant
        Start of the step.
    time_map, s, ds : int, float, float
        How time runs, and where the step starts and how long it is.
    velocity_time : float
        Time [s] that turns an error in a velocity into one in a position.
    k : (12, 22) array
        Work space for the stages: rates of the states and of the auxiliary states over s, normal forces [N].

    Returns
    -------
    tuple
        State and auxiliary states at the end, estimated local error [m].
    """
    y, x, begins = here.clearance_state, here.auxiliary_state, here.begins
    damping, later = damping_factors(p, here.approaches, begins, here.time), here.time + elapsed_time(time_map, s, ds)
    fades = (
        _fades(p.crank_pin, begins[0], here.time, later)
        or _fades(p.piston_pin, begins[1], here.time, later)
        or _fades(p.crank_pivot, begins[2], here.time, later)
    )
    factor = dt_ds(time_map, s)
    for i in range(STATES):
        k[0, i] = factor * here.clearance_rates[i]
    for i in range(3):
        k[0, NORMAL + i] = here.normals[i]
    auxiliary = p.switches.auxiliary
    if auxiliary:
        for i in range(AUXILIARY_STATES):
            k[0, STATES + i] = factor * here.auxiliary_rates[i]
    z, z_auxiliary, crank, angle = y, x, here.crank, here.crank_angle
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
        if auxiliary:
            z_auxiliary = auxiliary_at(x, ds, stage, k)
        if stage == COUNT:
            break
        advance = NODES[stage] * ds
        passed = elapsed_time(time_map, s, advance)
        if p.drive.kind == CONSTANT:
            turn = p.drive.speed * passed
            cosine, sine = turned(here.crank.cosine, here.crank.sine, turn)
            angle, crank = here.crank_angle + turn, Crank(cosine, sine, p.drive.speed, 0.0)
        else:
            angle, crank = crank_at(p, here.time + passed, z_auxiliary)
        if fades:
            damping = damping_factors(p, here.approaches, begins, here.time + passed)
        a4, pin, piston, pivot, _, _, bristles = accelerations(
            p, here.time + passed, angle, crank, z, z_auxiliary, here.modes, damping
        )
        factor = dt_ds(time_map, s + advance)
        k[stage, 0], k[stage, 1], k[stage, 2], k[stage, 3] = factor * z4, factor * z5, factor * z6, factor * z7
        k[stage, 4], k[stage, 5], k[stage, 6], k[stage, 7] = (
            factor * a4[0], factor * a4[1], factor * a4[2], factor * a4[3],
        )  # fmt: skip
        if auxiliary:
            rates = rates_of_auxiliary(z_auxiliary, a4, bristles)
            for i in range(AUXILIARY_STATES):
                k[stage, STATES + i] = factor * rates[i]
        k[stage, NORMAL], k[stage, NORMAL + 1], k[stage, NORMAL + 2] = pin[0], piston[0], pivot[0]
    return z, z_auxiliary, abs(ds) * relative_error(p, k, velocity_time)


@compiled
def relative_error(p, k, velocity_time):
    """Estimated local error [m] over ds, from a step's stages: the 5th-order estimate, damped by the 3rd-order one.

    Errors in velocities count by `velocity_time`, those of the crank angle by the crank's length.

    Parameters
    ----------
    p : Parameters
    k : (12, 22) array
    velocity_time : float
        [s].
    """
    fifth = third = 0.0
    for i in range(STATES + AUXILIARY_STATES if p.switches.auxiliary else STATES):
        e5, e3 = ERROR_5[0] * k[0, i], ERROR_3[0] * k[0, i]
        for j in range(SECOND[COUNT], COUNT):
            e5 += ERROR_5[j] * k[j, i]
            e3 += ERROR_3[j] * k[j, i]
        weight = velocity_time if 4 <= i < 8 or 12 <= i < 16 else 1.0
        if i == STATES + 2 or i == STATES + 6:
            weight *= p.bodies.crank_length
        fifth += (weight * e5) ** 2
        third += (weight * e3) ** 2
    size = math.sqrt(fifth + 0.01 * third)
    if size == 0.0:
        return 0.0
    return fifth / size if size < math.inf else math.inf  # an overflow or NaN must not pass for a small error
