"""The stages of a Runge-Kutta step: where they are kept, and their weighted sums, many states in one operation.

They are kept in a record, which compiled code receives as a pointer. As an array they would cost more than their sums:
compiled code would count a reference at every call, and look up a stride at every access.
"""

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from jointgap.dynamics.model.equations import AUXILIARY_STATES, STATES
from jointgap.dynamics.solver.tableau import COUNT, INTERPOLANT, KEPT

_JOINTS, _TERMS = 3, 4 + len(INTERPOLANT)
_LANES = 4  # numbers that one operation takes: with eight, processors that can do so slow down all else
AUXILIARY_WIDTH = -(-AUXILIARY_STATES // _LANES) * _LANES
"""How many numbers a row of auxiliary rates has: those beyond the auxiliary states fill up the last vector."""

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
"""Rates of the states and of the auxiliary states over s, by stage; normal forces [N], by joint and stage; coefficients
of the interpolant and what it gives."""


def room_for_stages() -> np.record:
    """An empty record of `STAGES_KEPT`; each integration needs one of its own."""
    return np.zeros(1, STAGES_KEPT)[0]


def _weighted_rows(count: int, width: int):
    """`weighted_rows` over the first `count` of `width` numbers a row, in vectors; numba itself sums number by
    number.
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
                    at = builder.gep(start, [builder.add(builder.mul(place, index(width // _LANES)), index(i))])
                    product = builder.fmul(factor, builder.load(at, align=8), flags=("contract",))
                    builder.store(builder.fadd(builder.load(total), product, flags=("contract",)), total)

            with builder.if_then(builder.icmp_signed(">", last, index(0))):
                add(index(0))
            with cgutils.for_range_slice(builder, first, last, index(1), index) as (place, _):
                add(place)
            each = [builder.extract_element(builder.load(total), index(i)) for total in totals for i in range(_LANES)]
            return context.make_tuple(builder, signature.return_type, each)

        return numbers(rows, weights, place, place, place), generate

    def in_python(rows, weights, row, first, last):
        places = [0, *range(first, last)] if last > 0 else []
        return tuple(sum((weights[row, place] * rows[place, :count] for place in places), np.zeros(count)).tolist())

    return in_python if numba.config.DISABLE_JIT else compiled_sums


weighted_rows = _weighted_rows(STATES, STATES)
"""weighted_rows(rows, weights, row, first, last): sums over row 0 and rows `first` ... `last` - 1, none if `last` is 0.

Parameters
----------
rows : (m, 8) array
weights : (n, m) array
row : int
    Which row of the weights.
first, last : int

Returns
-------
tuple of 8 floats
    weights[row, 0] rows[0] + weights[row, first] rows[first] + ...
"""

weighted_motion = _weighted_rows(8, AUXILIARY_WIDTH)
"""The same of auxiliary rates, over those states that are no bristles; `weighted_auxiliary` over all of them."""

weighted_auxiliary = _weighted_rows(AUXILIARY_WIDTH, AUXILIARY_WIDTH)
