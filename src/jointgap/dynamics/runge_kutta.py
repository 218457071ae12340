"""The Runge-Kutta method: tableau, stages, steps and error estimate."""

import math
from typing import NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from scipy.integrate import DOP853

from jointgap.dynamics.contact import damping_factor_at
from jointgap.dynamics.drive import crank_motion
from jointgap.dynamics.equations import AUXILIARY_STATES, STATES, Crank, accelerations
from jointgap.dynamics.numba_cache import compiled, inlined
from jointgap.dynamics.parameters import CONSTANT, MOTOR

COUNT = DOP853.n_stages

NODES = np.append(DOP853.C, 1.0)
"""Fraction of the step at each stage, and at its end."""

STAGES = np.vstack([DOP853.A, DOP853.B])
"""Weights of the earlier stages in each stage; the last row is the solution, order 8."""

ERROR_5, ERROR_3 = DOP853.E5[:COUNT].copy(), DOP853.E3[:COUNT].copy()
"""Weights of the stages in the differences to the solutions of 5th and 3rd order."""

KEPT = 16
"""Number of stages of a step: its own, the rates at its end, and three for the interpolant."""

MORE_STAGES, MORE_NODES, INTERPOLANT = (
    np.array(each) for each in (DOP853.A_EXTRA, DOP853.C_EXTRA, DOP853.D)
)
"""Weights (3, 16) and nodes (3,) of the three additional stages; weights (4, 16) of all stages in
the interpolant's upper terms. Columns 1 to 4 are zero."""


_JOINTS, _TERMS = 3, 4 + len(INTERPOLANT)
_LANES = 4  # vector width; a width of eight slows down some processors
AUXILIARY_WIDTH = -(-AUXILIARY_STATES // _LANES) * _LANES
"""Length of a row of auxiliary rates, padded to whole vectors."""

STAGES_KEPT = np.dtype(
    (
        np.record,
        [
            ("rates", "f8", (KEPT, STATES)),
            ("auxiliary_rates", "f8", (KEPT, AUXILIARY_WIDTH)),
            ("normals", "f8", (_JOINTS, COUNT)),
            ("terms", "f8", (_TERMS, STATES)),
            ("auxiliary_terms", "f8", (_TERMS, AUXILIARY_STATES)),
            ("state", "f8", (STATES,)),
            ("auxiliary_state", "f8", (AUXILIARY_STATES,)),
        ],
    )
)
"""Rates of the states and of the auxiliary states over s, by stage; normal forces [N], by joint and
stage; coefficients and results of the interpolant."""


def room_for_stages() -> np.record:
    """An empty record of `STAGES_KEPT`, one per integration."""
    return np.zeros(1, STAGES_KEPT)[0]


def _weighted_rows(count: int, width: int):
    """`weighted_rows` over the first `count` of `width` numbers a row, in vectors; numba itself
    sums number by number.
    """

    @intrinsic
    def compiled_sums(typing_context, rows, weights, row, first, last):
        numbers, place = types.UniTuple(types.float64, count), types.intp

        def generate(context, builder, signature, arguments):
            rows, weights = (
                context.make_array(kind)(context, builder, value=value)
                for kind, value in zip(signature.args[:2], arguments[:2], strict=True)
            )
            row, first, last = arguments[2:]
            vector, index = ir.VectorType(ir.DoubleType(), _LANES), ir.IntType(64)
            start = builder.bitcast(rows.data, vector.as_pointer())
            columns = cgutils.unpack_tuple(builder, weights.shape)[1]
            factors = builder.gep(weights.data, [builder.mul(row, columns)])
            zeros = ir.Constant(vector, [0.0] * _LANES)
            totals = [cgutils.alloca_once_value(builder, zeros) for _ in range(count // _LANES)]
            lanes = ir.Constant(ir.VectorType(ir.IntType(32), _LANES), [0] * _LANES)

            def add(place):
                factor = builder.load(builder.gep(factors, [place]))
                factor = builder.insert_element(vector(ir.Undefined), factor, index(0))
                factor = builder.shuffle_vector(factor, vector(ir.Undefined), lanes)
                for i, total in enumerate(totals):
                    at = builder.gep(
                        start, [builder.add(builder.mul(place, index(width // _LANES)), index(i))]
                    )
                    product = builder.fmul(factor, builder.load(at, align=8), flags=("contract",))
                    builder.store(
                        builder.fadd(builder.load(total), product, flags=("contract",)), total
                    )

            with builder.if_then(builder.icmp_signed(">", last, index(0))):
                add(index(0))
            with cgutils.for_range_slice(builder, first, last, index(1), index) as (place, _):
                add(place)
            each = [
                builder.extract_element(builder.load(total), index(i))
                for total in totals
                for i in range(_LANES)
            ]
            return context.make_tuple(builder, signature.return_type, each)

        return numbers(rows, weights, place, place, place), generate

    def in_python(rows, weights, row, first, last):
        places = [0, *range(first, last)] if last > 0 else []
        return tuple(
            sum(
                (weights[row, place] * rows[place, :count] for place in places), np.zeros(count)
            ).tolist()
        )

    return in_python if numba.config.DISABLE_JIT else compiled_sums


weighted_rows = _weighted_rows(STATES, STATES)
"""weighted_rows(rows, weights, row, first, last): weights[row, 0] rows[0] + weights[row, first]
rows[first] + ... to `last` - 1, a tuple of 8 numbers; zeros if `last` is 0."""

weighted_motion = _weighted_rows(8, AUXILIARY_WIDTH)
"""The same for auxiliary rates without those of bristles; `weighted_auxiliary` for all of them."""

weighted_auxiliary = _weighted_rows(AUXILIARY_WIDTH, AUXILIARY_WIDTH)


VELOCITY_TIME = 3e-5
"""Time [s] that converts an error in a velocity to one in a position: about a period of the contact
over 2 pi."""

LINEAR, AFTER, BEFORE = (
    np.int64(time_map) for time_map in (0, 1, -1)
)  # of one type: code is compiled once

SECOND = np.array([1, 1, *(1 + np.flatnonzero(row[1:])[0] for row in STAGES[2:])])
"""By stage, the first nonzero column after column 0; for the solution's row including the error
estimators."""


_ERRORS = np.array([ERROR_5, ERROR_3])
_LAST = COUNT - 1

SIN_3, SIN_5, SIN_7, SIN_9 = (1 / math.factorial(n) for n in (3, 5, 7, 9))
COS_4, COS_6, COS_8, COS_10 = (1 / math.factorial(n) for n in (4, 6, 8, 10))


class Instant(NamedTuple):
    """State of the integration at one time, complete for the next step."""

    time: float  # [s]
    clearance_state: tuple[float, ...]  # Clearance vectors with their rates
    auxiliary_state: tuple[float, ...]  # Auxiliary states
    clearance_rates: tuple[float, ...]  # Their time derivatives
    auxiliary_rates: tuple[float, ...]
    crank_angle: float  # [rad]
    crank: Crank
    modes: tuple[int, int, int]
    approaches: tuple[float, float, float]
    begins: tuple[float, float, float]
    normals: tuple[float, float, float]


@inlined
def turned(cosine, sine, angle) -> tuple:
    """Cosine and sine of the angle with the given `cosine` and `sine`, increased by `angle`
    [rad]."""
    if abs(angle) > 0.1:
        c, s = math.cos(angle), math.sin(angle)
    # Taylor polynomials: exact in double precision here, and many times faster than library
    # functions
    else:
        q = angle * angle
        q2 = q * q
        s = angle + angle * q * ((q * SIN_5 - SIN_3) + q2 * (q * SIN_9 - SIN_7))
        c = 1.0 + q * ((q * COS_4 - 0.5) + q2 * ((q * COS_8 - COS_6) - q2 * COS_10))
    return cosine * c - sine * s, sine * c + cosine * s


@inlined
def elapsed_time(time_map, s, ds) -> float:
    """Time [s] between s and s + ds."""
    return ds if time_map == LINEAR else time_map * ds * (2.0 * s + ds)


@inlined
def dt_ds(time_map, s) -> float:
    """dt/ds at s."""
    return 1.0 if time_map == LINEAR else 2.0 * time_map * s


@inlined
def ds_for(time_map, s, duration) -> float:
    """The ds for a `duration` [s] from s."""
    if time_map == LINEAR:
        return duration
    inside = s * s + time_map * duration
    return time_map * duration / (math.sqrt(max(inside, 0.0)) + s)


@inlined
def damping_factors(p, approaches, begins, time) -> tuple:
    """`damping_factor_at` of all contacts."""
    return (
        damping_factor_at(p.crank_pin, approaches[0], begins[0], time),
        damping_factor_at(p.piston_pin, approaches[1], begins[1], time),
        damping_factor_at(p.crank_pivot, approaches[2], begins[2], time),
    )


@inlined
def _fades(joint, begin, time, later) -> bool:
    """Whether the memory of a contact fades between two times."""
    faded_from = begin + joint.memory_time
    return faded_from < later and time < faded_from + joint.fading_time


@inlined
def next_knot(joint, begin, time, resolution) -> float:
    """Next time [s] at which the memory of a contact begins or ends to fade, or infinity."""
    knot = begin + joint.memory_time
    if knot > time + resolution:
        return knot
    knot += joint.fading_time
    return knot if knot > time + resolution else math.inf


@inlined
def crank_at(p, time, x) -> tuple:
    """Angle [rad] of the crank and its `Crank`, from the time or, with a motor, from the auxiliary
    states."""
    if p.drive.kind == MOTOR:
        return x[2], Crank(math.cos(x[2]), math.sin(x[2]), x[6], 0.0)
    angle, speed, acceleration = crank_motion(p, time)
    return angle, Crank(math.cos(angle), math.sin(angle), speed, acceleration)


@inlined
def rates_of_auxiliary(x, found, bristles) -> tuple:
    """Time derivatives of the auxiliary states; `found` are `accelerations`."""
    return (
        x[4],
        x[5],
        x[6],
        x[7],
        found[4],
        found[5],
        found[6],
        found[7],
        bristles[0],
        bristles[1],
        bristles[2],
    )


@compiled
def instant(p, time, y, x, modes, approaches, begins):
    """The instant of a state."""
    angle, crank = crank_at(p, time, x)
    damping = damping_factors(p, approaches, begins, time)
    a, pin, piston, pivot, _, _, bristles = accelerations(
        p, time, angle, crank, y, x, modes, damping
    )
    slope = (y[4], y[5], y[6], y[7], a[0], a[1], a[2], a[3])
    normals = (pin[0], piston[0], pivot[0])
    rates = rates_of_auxiliary(x, a, bristles)
    return Instant(time, y, x, slope, rates, angle, crank, modes, approaches, begins, normals)


instant_in_place = inlined(getattr(instant, "py_func", instant))
"""`instant`, inlined: for the call in every step of the integration."""


@inlined
def auxiliary_rows(p, weights, row, first, last, k) -> tuple:
    """Weighted sums of the auxiliary states' rates; those of bristles only where a joint has
    some."""
    if p.switches.bristles:
        return weighted_auxiliary(k.auxiliary_rates, weights, row, first, last)[:AUXILIARY_STATES]
    return (*weighted_motion(k.auxiliary_rates, weights, row, first, last), 0.0, 0.0, 0.0)


@inlined
def auxiliary_after(p, x, ds, sums, weight, newest) -> tuple:
    """Auxiliary states after `ds` from `x`; `sums` contain all rates except the newest one."""
    motion = (
        x[0] + ds * (sums[0] + weight * newest[0]),
        x[1] + ds * (sums[1] + weight * newest[1]),
        x[2] + ds * (sums[2] + weight * newest[2]),
        x[3] + ds * (sums[3] + weight * newest[3]),
        x[4] + ds * (sums[4] + weight * newest[4]),
        x[5] + ds * (sums[5] + weight * newest[5]),
        x[6] + ds * (sums[6] + weight * newest[6]),
        x[7] + ds * (sums[7] + weight * newest[7]),
    )
    if not p.switches.bristles:
        return (*motion, x[8], x[9], x[10])
    return (
        *motion,
        x[8] + ds * (sums[8] + weight * newest[8]),
        x[9] + ds * (sums[9] + weight * newest[9]),
        x[10] + ds * (sums[10] + weight * newest[10]),
    )


@inlined
def _scaled(factor, rates) -> tuple:
    """Rates of the auxiliary states times a factor."""
    return (
        factor * rates[0],
        factor * rates[1],
        factor * rates[2],
        factor * rates[3],
        factor * rates[4],
        factor * rates[5],
        factor * rates[6],
        factor * rates[7],
        factor * rates[8],
        factor * rates[9],
        factor * rates[10],
    )


@inlined
def rates_over_s(k, row, here, factor, auxiliary) -> None:
    """Store the rates at an instant."""
    for i in range(STATES):
        k.rates[row, i] = factor * here.clearance_rates[i]
    if auxiliary:
        for i in range(AUXILIARY_STATES):
            k.auxiliary_rates[row, i] = factor * here.auxiliary_rates[i]


@compiled
def step(p, here, time_map, s, ds, k):
    """Advance the state from s to s + ds with constant modes."""
    y, x, begins = here.clearance_state, here.auxiliary_state, here.begins
    damping, later = (
        damping_factors(p, here.approaches, begins, here.time),
        here.time + elapsed_time(time_map, s, ds),
    )
    fades = (
        _fades(p.crank_pin, begins[0], here.time, later)
        or _fades(p.piston_pin, begins[1], here.time, later)
        or _fades(p.crank_pivot, begins[2], here.time, later)
    )
    # The newest stage's rates are kept in registers: the slow sums over the earlier ones do not
    # depend on them.
    auxiliary, factor, v = p.switches.auxiliary, dt_ds(time_map, s), here.clearance_rates
    newest = (
        factor * v[0],
        factor * v[1],
        factor * v[2],
        factor * v[3],
        factor * v[4],
        factor * v[5],
        factor * v[6],
        factor * v[7],
    )
    rates_over_s(k, 0, here, factor, auxiliary)
    for i in range(3):
        k.normals[i, 0] = here.normals[i]
    z_auxiliary, newest_auxiliary, crank, angle = (
        x,
        _scaled(factor, here.auxiliary_rates),
        here.crank,
        here.crank_angle,
    )
    for stage in range(1, COUNT):
        earlier = weighted_rows(k.rates, STAGES, stage, SECOND[stage], stage - 1)
        w = ds * STAGES[stage, stage - 1]
        z = (
            y[0] + ds * earlier[0] + w * newest[0],
            y[1] + ds * earlier[1] + w * newest[1],
            y[2] + ds * earlier[2] + w * newest[2],
            y[3] + ds * earlier[3] + w * newest[3],
            y[4] + ds * earlier[4] + w * newest[4],
            y[5] + ds * earlier[5] + w * newest[5],
            y[6] + ds * earlier[6] + w * newest[6],
            y[7] + ds * earlier[7] + w * newest[7],
        )
        if auxiliary:
            sums = auxiliary_rows(p, STAGES, stage, SECOND[stage], stage - 1, k)
            z_auxiliary = auxiliary_after(
                p, x, ds, sums, STAGES[stage, stage - 1], newest_auxiliary
            )
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
        newest = (
            factor * z[4],
            factor * z[5],
            factor * z[6],
            factor * z[7],
            factor * a4[0],
            factor * a4[1],
            factor * a4[2],
            factor * a4[3],
        )
        for i in range(STATES):
            k.rates[stage, i] = newest[i]
        if auxiliary:
            newest_auxiliary = _scaled(factor, rates_of_auxiliary(z_auxiliary, a4, bristles))
            for i in range(AUXILIARY_STATES):
                k.auxiliary_rates[stage, i] = newest_auxiliary[i]
        k.normals[0, stage], k.normals[1, stage], k.normals[2, stage] = pin[0], piston[0], pivot[0]
    e, w = weighted_rows(k.rates, STAGES, COUNT, SECOND[COUNT], _LAST), STAGES[COUNT, _LAST]
    # Sum up before adding to the state: one rounding error of the state instead of several.
    z = (
        y[0] + ds * (e[0] + w * newest[0]),
        y[1] + ds * (e[1] + w * newest[1]),
        y[2] + ds * (e[2] + w * newest[2]),
        y[3] + ds * (e[3] + w * newest[3]),
        y[4] + ds * (e[4] + w * newest[4]),
        y[5] + ds * (e[5] + w * newest[5]),
        y[6] + ds * (e[6] + w * newest[6]),
        y[7] + ds * (e[7] + w * newest[7]),
    )
    if auxiliary:
        sums = auxiliary_rows(p, STAGES, COUNT, SECOND[COUNT], _LAST, k)
        z_auxiliary = auxiliary_after(p, x, ds, sums, STAGES[COUNT, _LAST], newest_auxiliary)
    return z, z_auxiliary, abs(ds) * relative_error(p, k, newest)


@inlined
def _squares(values) -> float:
    """Sum of the squares of eight errors, those of the velocities times `VELOCITY_TIME`."""
    places = (values[0] * values[0] + values[1] * values[1]) + (
        values[2] * values[2] + values[3] * values[3]
    )
    speeds = (values[4] * values[4] + values[5] * values[5]) + (
        values[6] * values[6] + values[7] * values[7]
    )
    return places + VELOCITY_TIME * VELOCITY_TIME * speeds


@inlined
def _with_newest(k, row, newest) -> tuple:
    """Error estimate in the states with the weights of row `row` of `_ERRORS`."""
    e, w = weighted_rows(k.rates, _ERRORS, row, SECOND[COUNT], _LAST), _ERRORS[row, _LAST]
    return (
        e[0] + w * newest[0],
        e[1] + w * newest[1],
        e[2] + w * newest[2],
        e[3] + w * newest[3],
        e[4] + w * newest[4],
        e[5] + w * newest[5],
        e[6] + w * newest[6],
        e[7] + w * newest[7],
    )


@inlined
def relative_error(p, k, newest) -> float:
    """Estimated local error [m] over ds, from a step's stages: the 5th-order estimate, damped by
    the 3rd-order one.

    Errors in velocities are multiplied by `VELOCITY_TIME`, those of the crank angle by the crank's
    length.
    """
    fifth = _squares(_with_newest(k, 0, newest))
    third = _squares(_with_newest(k, 1, newest))
    if p.switches.auxiliary:
        more_fifth, more_third = _auxiliary_squares(p, k)
        fifth += more_fifth
        third += more_third
    size = math.sqrt(fifth + 0.01 * third)
    if size == 0.0:
        return 0.0
    return fifth / size if size < math.inf else math.inf  # an overflow or NaN is not a small error


@inlined
def auxiliary_weight(p, i) -> float:
    """Weight of an error in auxiliary state `i`."""
    weight = VELOCITY_TIME if 4 <= i < 8 else 1.0
    return weight * p.bodies.crank_length if i == 2 or i == 6 else weight


@compiled
def _auxiliary_squares(p, k):
    """Sums of the squares of both estimated errors in the auxiliary states."""
    fifth = third = 0.0
    for i in range(AUXILIARY_STATES):
        e5, e3 = ERROR_5[0] * k.auxiliary_rates[0, i], ERROR_3[0] * k.auxiliary_rates[0, i]
        for j in range(SECOND[COUNT], COUNT):
            e5 += ERROR_5[j] * k.auxiliary_rates[j, i]
            e3 += ERROR_3[j] * k.auxiliary_rates[j, i]
        weight = auxiliary_weight(p, i)
        fifth += (weight * e5) ** 2
        third += (weight * e3) ** 2
    return fifth, third
