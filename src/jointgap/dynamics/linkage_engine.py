"""Integration of any linkage from event to event: numbers of states and contacts are values.

The steps, time maps and events are those of `jointgap.dynamics.runge_kutta` and `events`; the
kinematics and the accelerations are machine code (`jointgap.linkage.compiled`), between which the
laws of the joints are evaluated. State, rates and conditions are rows of one record: at the start
of a step, at its end, and at an event in it.
"""

import ctypes
import math
from typing import NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from jointgap.dynamics.contact import damping_factor_at
from jointgap.dynamics.drive import crank_motion
from jointgap.dynamics.equations import motor_torque
from jointgap.dynamics.events import DISTANCE, FORCE, NOWHERE, conditions, first_crossing, switched
from jointgap.dynamics.integrate import (
    DONE,
    EPISODE,
    EVENT_WIDTH,
    NOT_FINITE,
    STALLED,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
    begin_episode,
    contact_duration,
)
from jointgap.dynamics.joints import (
    CONTACT,
    FLIGHT,
    bristle_motion,
    direction,
    joint_force,
    turns_after,
)
from jointgap.dynamics.numba_cache import compiled, inlined
from jointgap.dynamics.parameters import CONSTANT, MOTOR, JointParameters, Record, record
from jointgap.dynamics.runge_kutta import (
    AFTER,
    BEFORE,
    COUNT,
    ERROR_3,
    ERROR_5,
    INTERPOLANT,
    KEPT,
    LINEAR,
    MORE_NODES,
    MORE_STAGES,
    NODES,
    SECOND,
    STAGES,
    ds_for,
    dt_ds,
    elapsed_time,
    next_knot,
    turned,
)

MOST_STATES, MOST_CONTACTS = 48, 16
"""Largest numbers of states and of contacts."""

HERE, THERE, EVENT, INSIDE = range(4)
"""Rows: start of the step, its end, an event in it, another instant in it."""

_ROWS, _CONDITIONS, _TERMS = 4, 5, 4 + len(INTERPOLANT)
_ERRORS = np.array([ERROR_5, ERROR_3])

WORKSPACE = np.dtype(
    (
        Record,
        [
            ("rates", "f8", (KEPT, MOST_STATES)),  # Over s, by stage
            ("y", "f8", (_ROWS, MOST_STATES)),
            ("dy", "f8", (_ROWS, MOST_STATES)),
            ("z", "f8", (MOST_STATES,)),  # State at which rates are evaluated
            ("slope", "f8", (MOST_STATES,)),  # Its rates
            ("weights", "f8", (MOST_STATES,)),  # Of errors
            ("terms", "f8", (_TERMS, MOST_STATES)),  # Of the interpolant
            ("crank", "f8", (4,)),  # As the machine code reads and writes it, see `Variant`
            ("turning", "f8", (2 * MOST_CONTACTS,)),
            ("forces", "f8", (4 * MOST_CONTACTS + 1,)),
            ("parameters", "f8", (512,)),
            ("kept", "f8", (1024,)),
            ("conditions", "f8", (_ROWS, MOST_CONTACTS, _CONDITIONS)),
            ("normal", "f8", (_ROWS, MOST_CONTACTS)),  # Normal forces [N]
            ("normals", "f8", (MOST_CONTACTS, COUNT)),
            ("force", "f8", (MOST_CONTACTS,)),  # Normal forces at the state z
            ("damping", "f8", (MOST_CONTACTS,)),
            ("approaches", "f8", (MOST_CONTACTS,)),
            ("begins", "f8", (MOST_CONTACTS,)),
            ("masses", "f8", (MOST_CONTACTS,)),  # Typical mass of an impact [kg]
            ("turns", "f8", (MOST_CONTACTS,)),  # Of the clearance vectors
            ("seen", "f8", (MOST_CONTACTS, 4)),  # Those and their rates, when last counted
            ("joints", record(JointParameters()).dtype, (MOST_CONTACTS,)),
            ("episodes", "f8", (MOST_CONTACTS, EPISODE)),
            ("modes", "i8", (MOST_CONTACTS,)),
            ("time", "f8", (_ROWS,)),
            ("angle", "f8", (_ROWS,)),
            ("cosine", "f8", (_ROWS,)),
            ("sine", "f8", (_ROWS,)),
            ("seen_time", "f8"),
            ("states", "i8"),
            ("half", "i8"),  # Positions, and velocities
            ("blocks", "i8"),
            ("contacts", "i8"),
            ("is_free", "i8"),
            ("bristles", "i8"),
            ("pose", "i8"),  # Addresses of machine code and of this record
            ("dynamics", "i8"),
            ("place", "i8"),
        ],
    )
)
"""What the integration of one motion works on."""


class LinkageParameters(NamedTuple):
    """Drive of a linkage: `DriveParameters` and the pieces of a measured angle."""

    drive: Record
    knots: Record


class Samples(NamedTuple):
    """Arrays that the integration fills; n samples, c contacts."""

    times: np.ndarray  # (n,) [s]
    states: np.ndarray  # (n, states)
    modes: np.ndarray  # (n, c)
    approaches: np.ndarray  # (n, c)
    begins: np.ndarray  # (n, c)
    directions: np.ndarray  # (n, c) [rad]


def _call():
    """run(address, memory): call a function of machine code."""

    @intrinsic
    def in_compiled_code(typing_context, address, memory):
        def generate(context, builder, signature, arguments):
            word = ir.IntType(64)
            kind = ir.FunctionType(ir.VoidType(), [word]).as_pointer()
            builder.call(builder.inttoptr(arguments[0], kind), [arguments[1]])
            return context.get_dummy_value()

        return types.void(types.int64, types.int64), generate

    def in_python(address, memory):
        ctypes.CFUNCTYPE(None, ctypes.c_int64)(int(address))(int(memory))

    return in_python if numba.config.DISABLE_JIT else in_compiled_code


run = _call()

_LANES, _BLOCK = 4, 8  # vector width; numbers that are summed together, two vectors


def _block_sums():
    """block_sum(rows, weights, row, first, last, block): weights[row, 0] rows[0] + weights[row,
    first] rows[first] + ... to `last` - 1 of eight numbers, a tuple; zeros if `last` is 0."""

    @intrinsic
    def in_compiled_code(typing_context, rows, weights, row, first, last, block):
        place = types.intp

        def generate(context, builder, signature, arguments):
            rows, weights = (
                context.make_array(kind)(context, builder, value=value)
                for kind, value in zip(signature.args[:2], arguments[:2], strict=True)
            )
            row, first, last, block = arguments[2:]
            vector, index = ir.VectorType(ir.DoubleType(), _LANES), ir.IntType(64)
            start = builder.bitcast(rows.data, vector.as_pointer())
            columns = cgutils.unpack_tuple(builder, weights.shape)[1]
            factors = builder.gep(weights.data, [builder.mul(row, columns)])
            zeros = ir.Constant(vector, [0.0] * _LANES)
            totals = [cgutils.alloca_once_value(builder, zeros) for _ in range(_BLOCK // _LANES)]
            lanes = ir.Constant(ir.VectorType(ir.IntType(32), _LANES), [0] * _LANES)

            def add(place):
                factor = builder.load(builder.gep(factors, [place]))
                factor = builder.insert_element(vector(ir.Undefined), factor, index(0))
                factor = builder.shuffle_vector(factor, vector(ir.Undefined), lanes)
                offset = builder.mul(place, index(MOST_STATES // _LANES))
                offset = builder.add(offset, builder.mul(block, index(_BLOCK // _LANES)))
                for i, total in enumerate(totals):
                    at = builder.gep(start, [builder.add(offset, index(i))])
                    product = builder.fmul(factor, builder.load(at, align=8), flags=("contract",))
                    more = builder.fadd(builder.load(total), product, flags=("contract",))
                    builder.store(more, total)

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

        numbers = types.UniTuple(types.float64, _BLOCK)
        return numbers(rows, weights, place, place, place, place), generate

    def in_python(rows, weights, row, first, last, block):
        columns = slice(_BLOCK * block, _BLOCK * (block + 1))
        total = np.zeros(_BLOCK)
        for place in [0, *range(first, last)] if last > 0 else []:
            total = total + weights[row, place] * rows[place, columns]
        return tuple(total.tolist())

    return in_python if numba.config.DISABLE_JIT else in_compiled_code


block_sum = _block_sums()


# ---- right-hand side


@inlined
def _set_crank(k, cosine, sine, speed, acceleration) -> None:
    k.crank[0], k.crank[1], k.crank[2], k.crank[3] = cosine, sine, speed, acceleration


@inlined
def _set_damping(k, time) -> None:
    for j in range(k.contacts):
        k.damping[j] = damping_factor_at(k.joints[j], k.approaches[j], k.begins[j], time)


@inlined
def _slopes(p, k) -> None:
    """Rates and normal forces at the state z, with the crank's motion set."""
    # local names: compiled code would load the numbers of a record again after each store
    h, contacts, bristles, z, slope = k.half, k.contacts, k.bristles, k.z, k.slope
    turning, forces, place = k.turning, k.forces, k.place
    run(k.pose, place)
    for j in range(contacts):
        x, v, at = 2 * j, h + 2 * j, 4 * j
        body, partner = turning[x], turning[x + 1]
        bristle = z[2 * h + j] if bristles else 0.0
        normal, _, fx, fy, on_body, on_partner = joint_force(
            k.joints[j],
            k.modes[j],
            k.damping[j],
            z[x],
            z[x + 1],
            z[v],
            z[v + 1],
            body,
            partner,
            bristle,
        )
        k.force[j] = normal
        forces[at], forces[at + 1], forces[at + 2], forces[at + 3] = fx, fy, on_body, on_partner
        if bristles:
            slope[2 * h + j] = bristle_motion(
                k.joints[j], k.modes[j], z[x], z[x + 1], z[v], z[v + 1], body, partner, bristle
            )
    if p.drive.kind == MOTOR:
        forces[4 * contacts] = motor_torque(p.drive, k.crank[2])
    run(k.dynamics, place)
    for i in range(h):
        slope[i] = z[h + i]


@compiled
def evaluate(p, k, row):
    """Rates, normal forces and conditions at the state of a row."""
    n, h, time = k.states, k.half, k.time[row]
    for i in range(n):
        k.z[i] = k.y[row, i]
    if k.is_free:
        angle, speed, acceleration = k.z[h - 1], k.z[2 * h - 1], 0.0
    else:
        angle, speed, acceleration = crank_motion(p, time)
    k.angle[row], k.cosine[row], k.sine[row] = angle, math.cos(angle), math.sin(angle)
    _set_crank(k, k.cosine[row], k.sine[row], speed, acceleration)
    _set_damping(k, time)
    _slopes(p, k)
    for i in range(n):
        k.dy[row, i] = k.slope[i]
    for j in range(k.contacts):
        k.normal[row, j] = k.force[j]
        x, v = 2 * j, h + 2 * j
        relative = (k.z[x], k.z[x + 1], k.z[v], k.z[v + 1], k.slope[v], k.slope[v + 1])
        c = conditions(k.joints[j], k.modes[j], k.approaches[j], k.begins[j], time, relative)
        for i in range(_CONDITIONS):
            k.conditions[row, j, i] = c[i]


# ---- steps


@inlined
def _crank_within(p, k, passed) -> None:
    """Set the crank's motion at a time [s] after the start of the step."""
    if k.is_free:
        angle = k.z[k.half - 1]
        _set_crank(k, math.cos(angle), math.sin(angle), k.z[2 * k.half - 1], 0.0)
    elif p.drive.kind == CONSTANT:
        c, s = turned(k.cosine[HERE], k.sine[HERE], p.drive.speed * passed)
        _set_crank(k, c, s, p.drive.speed, 0.0)
    else:
        angle, speed, acceleration = crank_motion(p, k.time[HERE] + passed)
        _set_crank(k, math.cos(angle), math.sin(angle), speed, acceleration)


@inlined
def _take_stage(p, k, weights, row, first, time_map, s, ds, node, fades, stage) -> None:
    """Rates over s at a stage, from those of the earlier ones."""
    y, z, rates = k.y, k.z, k.rates
    newest, w, blocks = stage - 1, ds * weights[row, stage - 1], k.blocks
    for block in range(blocks):
        # the newest rates number by number: a vector would wait for its four stores
        total = block_sum(rates, weights, row, first, newest, block)
        i = _BLOCK * block
        z[i] = y[HERE, i] + ds * total[0] + w * rates[newest, i]
        z[i + 1] = y[HERE, i + 1] + ds * total[1] + w * rates[newest, i + 1]
        z[i + 2] = y[HERE, i + 2] + ds * total[2] + w * rates[newest, i + 2]
        z[i + 3] = y[HERE, i + 3] + ds * total[3] + w * rates[newest, i + 3]
        z[i + 4] = y[HERE, i + 4] + ds * total[4] + w * rates[newest, i + 4]
        z[i + 5] = y[HERE, i + 5] + ds * total[5] + w * rates[newest, i + 5]
        z[i + 6] = y[HERE, i + 6] + ds * total[6] + w * rates[newest, i + 6]
        z[i + 7] = y[HERE, i + 7] + ds * total[7] + w * rates[newest, i + 7]
    passed = elapsed_time(time_map, s, node * ds)
    _crank_within(p, k, passed)
    if fades:
        _set_damping(k, k.time[HERE] + passed)
    _slopes(p, k)
    factor, slope = dt_ds(time_map, s + node * ds), k.slope
    for block in range(blocks):
        i = _BLOCK * block
        rates[stage, i], rates[stage, i + 1] = factor * slope[i], factor * slope[i + 1]
        rates[stage, i + 2], rates[stage, i + 3] = factor * slope[i + 2], factor * slope[i + 3]
        rates[stage, i + 4], rates[stage, i + 5] = factor * slope[i + 4], factor * slope[i + 5]
        rates[stage, i + 6], rates[stage, i + 7] = factor * slope[i + 6], factor * slope[i + 7]


@inlined
def _set_damping_of_step(k, later) -> bool:
    """Set the damping at the start of a step; whether a contact's memory fades until `later`."""
    time, fades = k.time[HERE], False
    _set_damping(k, time)
    for j in range(k.contacts):
        faded_from = k.begins[j] + k.joints[j].memory_time
        fades = fades or (faded_from < later and time < faded_from + k.joints[j].fading_time)
    return fades


@compiled
def step(p, k, to, time_map, s, ds):
    """Advance the state from s to s + ds with constant modes, into the row `to`; the error [m]."""
    later = k.time[HERE] + elapsed_time(time_map, s, ds)
    fades = _set_damping_of_step(k, later)
    factor = dt_ds(time_map, s)
    for i in range(k.states):
        k.rates[0, i] = factor * k.dy[HERE, i]
    for j in range(k.contacts):
        k.normals[j, 0] = k.normal[HERE, j]
    for stage in range(1, COUNT):
        _take_stage(p, k, STAGES, stage, SECOND[stage], time_map, s, ds, NODES[stage], fades, stage)
        for j in range(k.contacts):
            k.normals[j, stage] = k.force[j]
    fifth = third = 0.0
    for block in range(k.blocks):
        total = block_sum(k.rates, STAGES, COUNT, SECOND[COUNT], COUNT, block)
        e5 = block_sum(k.rates, _ERRORS, 0, SECOND[COUNT], COUNT, block)
        e3 = block_sum(k.rates, _ERRORS, 1, SECOND[COUNT], COUNT, block)
        for i in range(_BLOCK):
            at = _BLOCK * block + i
            k.y[to, at] = k.y[HERE, at] + ds * total[i]
            fifth += (k.weights[at] * e5[i]) ** 2
            third += (k.weights[at] * e3[i]) ** 2
    k.time[to] = later
    size = math.sqrt(fifth + 0.01 * third)
    if size == 0.0:
        return 0.0
    # an overflow or NaN is not a small error
    return abs(ds) * (fifth / size if size < math.inf else math.inf)


# ---- events


@inlined
def _condition(k, row, j) -> tuple:
    c = k.conditions
    return c[row, j, 0], c[row, j, 1], c[row, j, 2], c[row, j, 3], c[row, j, 4]


@compiled
def next_event(k, row, duration, margin):
    """The first event between the start of the step and a row: fraction (or `NOWHERE`), contact,
    index of its condition."""
    first, which, kind = NOWHERE, 0, DISTANCE
    for j in range(k.contacts):
        g0, v0, a0, h0, w0 = _condition(k, HERE, j)
        g1, v1, a1, h1, w1 = _condition(k, row, j)
        x = first_crossing(g0, v0, a0, g1, v1, a1, duration, margin)
        if x < first:
            first, which, kind = x, j, DISTANCE
        if h0 > 0.0 and h1 >= 0.0 and not w0 < 0.0 < w1:
            continue
        # only a first derivative: with the cubic's curvatures the quintic equals that cubic
        slope = (h1 - h0) / duration
        bend0 = (6.0 * slope - 4.0 * w0 - 2.0 * w1) / duration
        bend1 = (2.0 * w0 + 4.0 * w1 - 6.0 * slope) / duration
        x = first_crossing(h0, w0, bend0, h1, w1, bend1, duration, 0.0)
        if x < first:
            first, which, kind = x, j, FORCE
    return first, which, kind


@compiled
def locate(p, k, time_map, s, limit, crossed, contact, kind, guess, close, tolerance):
    """Repeat the step, into the row `EVENT`, so that it ends where a condition decreases through
    zero: as `jointgap.dynamics.events.locate`."""
    to_separation = (
        kind == DISTANCE and k.modes[contact] == CONTACT and not (time_map == AFTER and s == 0.0)
    )
    low, high = 0.0, limit if crossed else math.inf
    for count in range(1, 60):
        if to_separation:
            step_map, step_start = BEFORE, math.sqrt(guess)
            ds = -step_start
        else:
            step_map, step_start, ds = time_map, s, ds_for(time_map, s, guess)
        error = step(p, k, EVENT, step_map, step_start, ds)
        if not error <= tolerance:
            return False, step_map, step_start, ds, error, count
        k.time[EVENT] = k.time[HERE] + guess
        evaluate(p, k, EVENT)
        g, v = k.conditions[EVENT, contact, 0], k.conditions[EVENT, contact, 1]
        if kind == FORCE:
            g, v = k.conditions[EVENT, contact, 3], k.conditions[EVENT, contact, 4]
        if abs(g) <= close:
            return True, step_map, step_start, ds, error, count
        if g < 0.0:
            high = guess
        elif v >= 0.0 and high == math.inf:
            break  # beyond an inner minimum above zero
        else:
            low = guess
        guess -= g / v
        if not low < guess < high:
            guess = 0.5 * (low + high)
        if high - low <= 1e-14 * limit or low == guess or guess == high:
            return True, step_map, step_start, ds, error, count
        if guess > limit:
            break
    return False, step_map, step_start, ds, 0.0, count


_HOPELESS, _CLOSE, _MARGIN = 100.0, 0.01, 100.0  # as in `jointgap.dynamics.events`


@inlined
def _separation_ahead(k) -> tuple:
    """Time [s] until a contact ends, by a parabola, and which; infinite if none."""
    first, which = math.inf, 0
    for j in range(k.contacts):
        depth, rate, curvature, _, _ = _condition(k, HERE, j)
        square = rate * rate - 2.0 * curvature * depth
        if k.modes[j] == CONTACT and depth > 0.0 and rate < 0.0 and square >= 0.0:
            time = 2.0 * depth / (math.sqrt(square) - rate)
            if time < first:
                first, which = time, j
    return first, which


@inlined
def _holds(k, row) -> bool:
    """Whether all modes last."""
    for j in range(k.contacts):
        if k.conditions[row, j, 0] < 0.0 or k.conditions[row, j, 3] < 0.0:
            return False
    return True


@compiled
def advance(p, k, time_map, s, duration, tolerance):
    """Take a step of `duration` [s], or a shorter one to the first event in it.

    Returns whether an event ends it, its contact and condition, the time map of the step, its start
    and length, its error, the number of attempts, and the row of its end.
    """
    steps = 0
    # The force has a kink at a separation, which a step must not cross: aim at it where one is
    # near.
    ahead, contact = _separation_ahead(k)
    if ahead < duration:
        close = max(_CLOSE * tolerance, 1e-18)
        found, step_map, start, ds, error, steps = locate(
            p,
            k,
            time_map,
            s,
            2.0 * ahead,
            np.bool_(False),
            contact,
            DISTANCE,
            ahead,
            close,
            tolerance,
        )
        if found:
            fraction, other, kind = next_event(
                k, EVENT, k.time[EVENT] - k.time[HERE], _MARGIN * tolerance
            )
            if fraction == NOWHERE or (other == contact and kind == DISTANCE):
                return True, contact, DISTANCE, step_map, start, ds, error, steps, EVENT
        else:
            duration = 0.5 * ahead
    ds = ds_for(time_map, s, duration)
    duration = elapsed_time(time_map, s, ds)
    error = step(p, k, THERE, time_map, s, ds)
    steps += 1
    if not error <= _HOPELESS * tolerance:
        return False, 0, DISTANCE, time_map, s, ds, error, steps, HERE
    k.time[THERE] = k.time[HERE] + duration
    evaluate(p, k, THERE)
    fraction, contact, kind = next_event(k, THERE, duration, _MARGIN * tolerance)
    if fraction == 0.0:
        return True, contact, kind, time_map, s, 0.0, 0.0, steps, HERE
    if fraction < NOWHERE:
        close = max(_CLOSE * tolerance, 1e-18) if kind == DISTANCE else 1e-9 * k.approaches[contact]
        crossed = k.conditions[THERE, contact, 0 if kind == DISTANCE else 3] < 0.0
        found, step_map, start, event_ds, event_error, made = locate(
            p,
            k,
            time_map,
            s,
            duration,
            crossed,
            contact,
            kind,
            fraction * duration,
            close,
            tolerance,
        )
        steps += made
        if found:
            return True, contact, kind, step_map, start, event_ds, event_error, steps, EVENT
        if not event_error <= tolerance:
            return False, 0, DISTANCE, step_map, start, event_ds, event_error, steps, HERE
        if not _holds(k, THERE):  # an event behind a near miss: go to the near miss first
            error = _HOPELESS * tolerance
        else:  # restore the stages of the accepted step
            later = k.time[THERE]
            step(p, k, THERE, time_map, s, ds)
            k.time[THERE] = later
            steps += 1
    return False, 0, DISTANCE, time_map, s, ds, error, steps, THERE


# ---- within a step

_FIRST = 5  # column after the zero ones of the interpolant's weights
_ROUGHEST = 10.0  # as in `jointgap.dynamics.dense_output`


@compiled
def prepare_inside(p, k, row, time_map, s, ds, tolerance):
    """Compute the additional stages of a step and the coefficients of its interpolant; whether it
    is as accurate as the step."""
    fades = _set_damping_of_step(k, k.time[row])
    factor = dt_ds(time_map, s + ds)
    for i in range(k.states):
        k.rates[COUNT, i] = factor * k.dy[row, i]
    for i in range(KEPT - COUNT - 1):
        at = COUNT + 1 + i
        _take_stage(p, k, MORE_STAGES, i, _FIRST, time_map, s, ds, MORE_NODES[i], fades, at)
    for i in range(k.states):
        rise = k.y[row, i] - k.y[HERE, i]
        k.terms[0, i], k.terms[1, i] = k.y[HERE, i], rise
        k.terms[2, i] = ds * k.rates[0, i] - rise
        k.terms[3, i] = rise - ds * k.rates[COUNT, i] - k.terms[2, i]
    total = 0.0
    for block in range(k.blocks):
        for n in range(4, _TERMS):
            sums = block_sum(k.rates, INTERPOLANT, n - 4, _FIRST, KEPT, block)
            for i in range(_BLOCK):
                k.terms[n, _BLOCK * block + i] = ds * sums[i]
        for i in range(_BLOCK * block, _BLOCK * (block + 1)):
            total += (k.weights[i] * k.terms[_TERMS - 1, i]) ** 2
    return (4.0 / 7.0) ** 4 * (3.0 / 7.0) ** 3 * math.sqrt(total) <= _ROUGHEST * tolerance


@compiled
def state_inside(p, k, time_map, s, ds, time, smooth):
    """Write the state at the `time` [s] within a step to z, after `prepare_inside`."""
    part = ds_for(time_map, s, time - k.time[HERE])
    if not smooth:
        step(p, k, INSIDE, time_map, s, part)
        for i in range(k.states):
            k.z[i] = k.y[INSIDE, i]
        return
    share = part / ds
    rest = 1.0 - share
    for i in range(k.states):
        value = k.terms[_TERMS - 1, i] * share
        for n in range(_TERMS - 2, 0, -1):
            value = (k.terms[n, i] + value) * (share if n % 2 == 1 else rest)
        k.z[i] = k.terms[0, i] + value


@compiled
def time_at_angle(p, k, row, time_map, s, ds, angle, smooth):
    """Time [s] within a step at which a free crank passes `angle` [rad], by Newton's method."""
    low, high = k.time[HERE], k.time[row]
    time = low + (angle - k.angle[HERE]) / (k.angle[row] - k.angle[HERE]) * (high - low)
    for _ in range(50):
        state_inside(p, k, time_map, s, ds, time, smooth)
        reached, speed = k.z[k.half - 1], k.z[2 * k.half - 1]
        following = time - (reached - angle) / speed
        if reached < angle:
            low = time
        else:
            high = time
        if abs(following - time) <= 1e-15 * (k.time[row] - k.time[HERE]) + 4e-16 * abs(time):
            break
        time = following if low <= following <= high else 0.5 * (low + high)
    return time


# ---- integration

_LONGEST_TURN, _AFTER_IMPACT, _FAR = 0.1, 0.1, 20.0  # as in `jointgap.dynamics.integrate`


@inlined
def _follow(k, time) -> None:
    """Count the turns of the clearance vectors up to the state z."""
    h = k.half
    for j in range(k.contacts):
        seen = (k.seen[j, 0], k.seen[j, 1], k.seen[j, 2], k.seen[j, 3])
        now = (k.z[2 * j], k.z[2 * j + 1], k.z[h + 2 * j], k.z[h + 2 * j + 1])
        k.turns[j] = turns_after(k.turns[j], seen, now, time - k.seen_time)
        for i in range(4):
            k.seen[j, i] = now[i]
    k.seen_time = time


@inlined
def _update_episodes(k, row, time_map, s, ds) -> None:
    """Update the episodes over an accepted step whose stages are in `k`."""
    if ds == 0.0:
        return
    for j in range(k.contacts):
        if k.modes[j] == FLIGHT:
            continue
        impulse, peak = 0.0, k.episodes[j, 1]
        for stage in range(COUNT):
            normal = max(k.normals[j, stage], 0.0)
            impulse += STAGES[COUNT, stage] * dt_ds(time_map, s + NODES[stage] * ds) * normal
            peak = max(peak, normal)
        k.episodes[j, 0] += ds * impulse
        k.episodes[j, 1] = peak
        if _opening(k, HERE, j) > 0.0 >= _opening(k, row, j):
            k.episodes[j, 2] += 1.0


@inlined
def _opening(k, row, j) -> float:
    """Length of a clearance vector times its rate."""
    x, v = 2 * j, k.half + 2 * j
    return k.y[row, x] * k.y[row, v] + k.y[row, x + 1] * k.y[row, v + 1]


@inlined
def _record_event(event, k, j, begins, approach) -> None:
    """Write a row of events: see `jointgap.dynamics.integrate.EVENT`."""
    event[0], event[1], event[2] = k.time[HERE], j, 1.0 if begins else 0.0
    event[3] = approach if begins else math.nan
    for i in range(3):
        event[4 + i] = math.nan if begins else k.episodes[j, i]
    event[7] = k.angle[HERE]
    event[8] = math.nan if begins else k.time[HERE] - k.episodes[j, 3]


@inlined
def _take(k, row) -> None:
    """Let the next step start at a row."""
    k.time[HERE], k.angle[HERE] = k.time[row], k.angle[row]
    k.cosine[HERE], k.sine[HERE] = k.cosine[row], k.sine[row]
    for i in range(k.states):
        k.y[HERE, i], k.dy[HERE, i] = k.y[row, i], k.dy[row, i]
    for j in range(k.contacts):
        k.normal[HERE, j] = k.normal[row, j]
        for i in range(_CONDITIONS):
            k.conditions[HERE, j, i] = k.conditions[row, j, i]


@compiled
def integrate(p, k, found, angles, tolerance, step_limit):
    """Integrate from the state in the first row, all joints in flight, to the last of the crank
    `angles` (n,) [rad], with samples in the arrays of `found`.

    Returns status, events and steps.
    """
    events, event_count, steps, sample = np.empty((64, EVENT_WIDTH)), 0, 0, 0
    fastest = abs(p.drive.speed)
    if k.is_free and p.drive.stall_torque > 0.0:
        fastest = max(fastest, p.drive.no_load_speed)
    longest = _LONGEST_TURN / fastest
    proposal, time_map, s = 0.1 * longest, LINEAR, 0.0
    evaluate(p, k, HERE)
    k.seen_time = k.time[HERE]
    _follow(k, k.time[HERE])
    times = found.times
    while True:
        if steps >= step_limit:
            return TOO_MANY_STEPS, events[:event_count], steps
        proposal = unhindered = min(proposal, longest)
        resolution = 1e-15 * (abs(k.time[HERE]) + longest)
        for j in range(k.contacts):
            knot = next_knot(k.joints[j], k.begins[j], k.time[HERE], resolution)
            proposal = min(proposal, knot - k.time[HERE])
        if time_map == AFTER and s * s > _FAR * proposal:
            time_map, s = LINEAR, 0.0
        allowed = tolerance * (_AFTER_IMPACT if time_map == AFTER else 1.0)
        happens, contact, kind, step_map, start, ds, error, made, row = advance(
            p, k, time_map, s, proposal, allowed
        )
        steps += made
        factor = 5.0
        if error > 0.0:
            factor = min(5.0, max(0.2, 0.9 * math.sqrt(math.sqrt(math.sqrt(allowed / error)))))
        if not error <= allowed:
            factor = min(factor, 0.9) if error < math.inf else 0.1
            proposal = (
                0.5 * elapsed_time(step_map, start, ds)
                if step_map == BEFORE
                else elapsed_time(step_map, start, ds * factor)
            )
            if not proposal >= resolution:
                status = STEP_TOO_SMALL if error < math.inf else NOT_FINITE
                return status, events[:event_count], steps
            continue
        if k.is_free and k.y[row, 2 * k.half - 1] <= 0.0:
            return STALLED, events[:event_count], steps
        _update_episodes(k, row, step_map, start, ds)

        prepared = smooth = False
        while sample < times.size:
            if (angles[sample] > k.angle[row]) if k.is_free else (times[sample] > k.time[row]):
                break
            inside = row != HERE and (k.is_free or times[sample] < k.time[row])
            if inside and not prepared:
                smooth = prepare_inside(p, k, row, step_map, start, ds, tolerance)
                prepared = True
            if k.is_free and row != HERE:
                times[sample] = time_at_angle(
                    p, k, row, step_map, start, ds, angles[sample], smooth
                )
            elif k.is_free:
                times[sample] = k.time[HERE]
            if inside:
                state_inside(p, k, step_map, start, ds, times[sample], smooth)
            else:
                for i in range(k.states):
                    k.z[i] = k.y[row, i]
            _follow(k, times[sample])
            for i in range(k.states):
                found.states[sample, i] = k.z[i]
            for j in range(k.contacts):
                vector = (k.z[2 * j], k.z[2 * j + 1])
                found.modes[sample, j] = k.modes[j]
                found.directions[sample, j] = direction(k.turns[j], vector)
                found.approaches[sample, j] = k.approaches[j]
                found.begins[sample, j] = k.begins[j]
            sample += 1
        if sample == times.size:
            return DONE, events[:event_count], steps
        before_time = k.time[HERE]
        if row != HERE:
            for i in range(k.states):
                k.z[i] = k.y[row, i]
            _follow(k, k.time[row])
            _take(k, row)
        if time_map == AFTER:
            s = math.sqrt(s * s + k.time[HERE] - before_time)
        if not happens:
            following = elapsed_time(step_map, start + ds, ds * factor)
            if step_map == AFTER:
                # between equal steps in s (suitable near the impact) and in time (far from it)
                following = math.sqrt(following * factor * elapsed_time(step_map, start, ds))
            proposal = max(following, unhindered) if proposal < unhindered else following
            continue

        # the event: the contact's mode changes
        before = k.modes[contact]
        closing = max(-k.conditions[HERE, contact, 1], 0.0)
        mode, approach = switched(
            before, k.approaches[contact], kind, closing, k.joints[contact].least_approach
        )
        k.modes[contact], k.approaches[contact] = mode, approach
        if before == FLIGHT or mode == FLIGHT:
            if event_count == events.shape[0]:
                events = np.concatenate((events, np.empty_like(events)))
            _record_event(events[event_count], k, contact, before == FLIGHT, closing)
            event_count += 1
        if before == FLIGHT:
            begin_episode(k.episodes, contact, k.time[HERE])
            k.begins[contact] = k.time[HERE]
            time_map, s = AFTER, 0.0
            impact = contact_duration(k.joints[contact], k.masses[contact], approach)
            proposal = min(proposal, 0.1 * impact)
        elif mode == FLIGHT:
            k.begins[contact] = math.inf
            if k.bristles:  # bristles without contact are straight
                k.y[HERE, 2 * k.half + contact] = 0.0
            flying = True
            for j in range(k.contacts):
                flying = flying and k.modes[j] == FLIGHT
            if flying:
                time_map, s, proposal = LINEAR, 0.0, max(proposal, 0.2 * longest)
        evaluate(p, k, HERE)
