"""The Runge-Kutta method: tableau, time maps, steps with their error, and the state within a step.

The interpolant within a step is the method's own, of seventh order, from three additional stages:
section II.10 of Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, 2nd edition.
They are computed once per step with samples. Where time is a function of the root of the time from
an event, so is the interpolant. In nonsmooth motion its error exceeds that of the step. The size of
its highest term detects this: each sample of such a step is the end of a shorter step. So samples
are as accurate as the steps.
"""

import math

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from scipy.integrate import DOP853

from jointgap.core.numba_cache import compiled, inlined
from jointgap.linkage.parameters import CONSTANT
from jointgap.motion.rates import assume, set_crank, set_crank_at, set_damping, slopes
from jointgap.motion.workspace import BLOCK, HERE, INSIDE, KEPT, MOST_STATES, TERMS

COUNT = DOP853.n_stages

NODES = np.append(DOP853.C, 1.0)
"""Fraction of the step at each stage, and at its end."""

STAGES = np.vstack([DOP853.A, DOP853.B])
"""Weights of the earlier stages in each stage; the last row is the solution, order 8."""

ERROR_5, ERROR_3 = DOP853.E5[:COUNT].copy(), DOP853.E3[:COUNT].copy()
"""Weights of the stages in the differences to the solutions of 5th and 3rd order."""

MORE_STAGES, MORE_NODES, INTERPOLANT = (
    np.array(each) for each in (DOP853.A_EXTRA, DOP853.C_EXTRA, DOP853.D)
)
"""Weights (3, 16) and nodes (3,) of the three additional stages; weights (4, 16) of all stages in
the interpolant's upper terms. Columns 1 to 4 are zero."""


_ERRORS = np.array([ERROR_5, ERROR_3])
VELOCITY_TIME = 3e-5
"""Time [s] that converts an error in a velocity to one in a position: about a period of the contact
over 2 pi."""

LINEAR, AFTER, BEFORE = (
    np.int64(time_map) for time_map in (0, 1, -1)
)  # of one type: code is compiled once

SECOND = np.array([1, 1, *(1 + np.flatnonzero(row[1:])[0] for row in STAGES[2:])])
"""By stage, the first nonzero column after column 0; for the solution's row including the error
estimators."""


SIN_3, SIN_5, SIN_7, SIN_9 = (1 / math.factorial(n) for n in (3, 5, 7, 9))
COS_4, COS_6, COS_8, COS_10 = (1 / math.factorial(n) for n in (4, 6, 8, 10))


_LANES = 4  # vector width; a width of eight slows down some processors


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
            totals = [cgutils.alloca_once_value(builder, zeros) for _ in range(BLOCK // _LANES)]
            lanes = ir.Constant(ir.VectorType(ir.IntType(32), _LANES), [0] * _LANES)

            def add(place):
                factor = builder.load(builder.gep(factors, [place]))
                factor = builder.insert_element(vector(ir.Undefined), factor, index(0))
                factor = builder.shuffle_vector(factor, vector(ir.Undefined), lanes)
                offset = builder.mul(place, index(MOST_STATES // _LANES))
                offset = builder.add(offset, builder.mul(block, index(BLOCK // _LANES)))
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

        numbers = types.UniTuple(types.float64, BLOCK)
        return numbers(rows, weights, place, place, place, place), generate

    def in_python(rows, weights, row, first, last, block):
        columns = slice(BLOCK * block, BLOCK * (block + 1))
        total = np.zeros(BLOCK)
        for place in [0, *range(first, last)] if last > 0 else []:
            total = total + weights[row, place] * rows[place, columns]
        return tuple(total.tolist())

    return in_python if numba.config.DISABLE_JIT else in_compiled_code


block_sum = _block_sums()


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


# ---- steps


@inlined
def _turn_steadily(p, k, nodes, time_map, s, ds) -> None:
    """Cosines and sines of a steadily turning crank at the nodes of a step: together, as each stage
    would have to wait for its own."""
    if p.drive.kind == CONSTANT:
        for i in range(nodes.size):
            turn = p.drive.speed * elapsed_time(time_map, s, nodes[i] * ds)
            k.cosines[i], k.sines[i] = turned(k.cosine[HERE], k.sine[HERE], turn)


@inlined
def _crank_within(p, k, passed, node) -> None:
    """Set the crank's motion at a node, a time [s] after the start of the step."""
    k.now = k.time[HERE] + passed
    if p.drive.kind == CONSTANT:
        speed = p.drive.speed
        set_crank(k, k.angle[HERE] + speed * passed, k.cosines[node], k.sines[node], speed, 0.0)
    else:
        set_crank_at(p, k)


@inlined
def _take_stage(p, k, weights, row, first, time_map, s, ds, nodes, fades, stage) -> None:
    """Rates over s at a stage, from those of the earlier ones."""
    y, z, rates = k.y, k.z, k.rates
    newest, w, blocks = stage - 1, ds * weights[row, stage - 1], k.blocks
    for block in range(blocks):
        # the newest rates number by number: a vector would wait for its four stores
        total = block_sum(rates, weights, row, first, newest, block)
        i = BLOCK * block
        z[i] = y[HERE, i] + ds * total[0] + w * rates[newest, i]
        z[i + 1] = y[HERE, i + 1] + ds * total[1] + w * rates[newest, i + 1]
        z[i + 2] = y[HERE, i + 2] + ds * total[2] + w * rates[newest, i + 2]
        z[i + 3] = y[HERE, i + 3] + ds * total[3] + w * rates[newest, i + 3]
        z[i + 4] = y[HERE, i + 4] + ds * total[4] + w * rates[newest, i + 4]
        z[i + 5] = y[HERE, i + 5] + ds * total[5] + w * rates[newest, i + 5]
        z[i + 6] = y[HERE, i + 6] + ds * total[6] + w * rates[newest, i + 6]
        z[i + 7] = y[HERE, i + 7] + ds * total[7] + w * rates[newest, i + 7]
    node = nodes[row]
    passed = elapsed_time(time_map, s, node * ds)
    _crank_within(p, k, passed, row)
    if fades:
        set_damping(k, k.time[HERE] + passed)
    slopes(p, k)
    factor, slope = dt_ds(time_map, s + node * ds), k.slope
    for block in range(blocks):
        i = BLOCK * block
        rates[stage, i], rates[stage, i + 1] = factor * slope[i], factor * slope[i + 1]
        rates[stage, i + 2], rates[stage, i + 3] = factor * slope[i + 2], factor * slope[i + 3]
        rates[stage, i + 4], rates[stage, i + 5] = factor * slope[i + 4], factor * slope[i + 5]
        rates[stage, i + 6], rates[stage, i + 7] = factor * slope[i + 6], factor * slope[i + 7]


@inlined
def _set_damping_of_step(k, later) -> bool:
    """Set the damping at the start of a step; whether a contact's memory fades until `later`."""
    time, fades = k.time[HERE], False
    set_damping(k, time)
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
    assume(k, HERE)
    for i in range(k.states):
        k.rates[0, i] = factor * k.dy[HERE, i]
    for j in range(k.contacts):
        k.normals[j, 0] = k.normal[HERE, j]
    _turn_steadily(p, k, NODES[:COUNT], time_map, s, ds)
    for stage in range(1, COUNT):
        _take_stage(p, k, STAGES, stage, SECOND[stage], time_map, s, ds, NODES, fades, stage)
        for j in range(k.contacts):
            k.normals[j, stage] = k.force[j]
    fifth = third = 0.0
    for block in range(k.blocks):
        total = block_sum(k.rates, STAGES, COUNT, SECOND[COUNT], COUNT, block)
        e5 = block_sum(k.rates, _ERRORS, 0, SECOND[COUNT], COUNT, block)
        e3 = block_sum(k.rates, _ERRORS, 1, SECOND[COUNT], COUNT, block)
        for i in range(BLOCK):
            at = BLOCK * block + i
            k.y[to, at] = k.y[HERE, at] + ds * total[i]
            fifth += (k.weights[at] * e5[i]) ** 2
            third += (k.weights[at] * e3[i]) ** 2
    k.time[to] = later
    size = math.sqrt(fifth + 0.01 * third)
    if size == 0.0:
        return 0.0
    # an overflow or NaN is not a small error
    return abs(ds) * (fifth / size if size < math.inf else math.inf)


# ---- within a step

_FIRST = 5  # column after the zero ones of the interpolant's weights
_ROUGHEST = 10.0
"""Size of the highest term, in tolerances, above which the interpolant is not used.

Over two revolutions of the paper's mechanism, with and without friction, at tolerances of 1e-8 to
1e-14 m, the error is then at most 1.4 tolerances (about 1 in 99 % of the samples); without this
limit up to 178. With friction 2 to 16 % of the steps exceed it.
"""


@compiled
def prepare_inside(p, k, row, time_map, s, ds, tolerance):
    """Compute the additional stages of a step and the coefficients of its interpolant; whether it
    is as accurate as the step."""
    fades = _set_damping_of_step(k, k.time[row])
    factor = dt_ds(time_map, s + ds)
    assume(k, HERE)
    for i in range(k.states):
        k.rates[COUNT, i] = factor * k.dy[row, i]
    _turn_steadily(p, k, MORE_NODES, time_map, s, ds)
    for i in range(KEPT - COUNT - 1):
        at = COUNT + 1 + i
        _take_stage(p, k, MORE_STAGES, i, _FIRST, time_map, s, ds, MORE_NODES, fades, at)
    for i in range(k.states):
        rise = k.y[row, i] - k.y[HERE, i]
        k.terms[0, i], k.terms[1, i] = k.y[HERE, i], rise
        k.terms[2, i] = ds * k.rates[0, i] - rise
        k.terms[3, i] = rise - ds * k.rates[COUNT, i] - k.terms[2, i]
    total = 0.0
    for block in range(k.blocks):
        for n in range(4, TERMS):
            sums = block_sum(k.rates, INTERPOLANT, n - 4, _FIRST, KEPT, block)
            for i in range(BLOCK):
                k.terms[n, BLOCK * block + i] = ds * sums[i]
        for i in range(BLOCK * block, BLOCK * (block + 1)):
            total += (k.weights[i] * k.terms[TERMS - 1, i]) ** 2
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
        value = k.terms[TERMS - 1, i] * share
        for n in range(TERMS - 2, 0, -1):
            value = (k.terms[n, i] + value) * (share if n % 2 == 1 else rest)
        k.z[i] = k.terms[0, i] + value
