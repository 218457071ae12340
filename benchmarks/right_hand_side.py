"""The package's equations of motion as general-purpose integrators call them, for a mechanism whose
pins are loose.

State: clearance vectors of crank pin and piston pin and their rates, the latter times
`VELOCITY_TIME`, so that one absolute tolerance [m] fits all. Compiled code reads the parameters
where they lie: compiled in as constants they would be copied at every call, which takes longer than
the equations.
"""

import math

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from jointgap.dynamics.parameters import Parameters, Record
from jointgap.dynamics.runge_kutta import VELOCITY_TIME, instant

_NO_FURTHER = (0.0,) * 11
# the published form: a contact's damping does not depend on when it began
_NO_MEMORY = (math.inf,) * 3


@intrinsic
def _pointer(typing_context, address):
    """Pointer to an address."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.intp), generate


def _reader(record: Record):
    """A compiled function that gives a record where it lies."""
    address = np.frombuffer(record.data, np.uint8).ctypes.data
    kind = np.dtype([(name, record.dtype[name]) for name in record.dtype.names])

    @numba.njit
    def read():
        return numba.carray(_pointer(address), 1, kind)[0]

    return read


def right_hand_side(p: Parameters):
    """Two compiled functions: `slope(t, z, out, modes, approaches)` and `gap(z, joint)`.

    The first writes the rates of the scaled state `z` (8,) into `out`; the second gives the
    penetration [m] of crank pin (0) or piston pin (1) and its rate [m/s]. Both live no longer than
    `p`.
    """
    (
        bodies,
        crank_pin,
        piston_pin,
        crank_pivot,
        drive,
        effects,
        switches,
        slider,
        crank,
        knots,
        table,
    ) = map(_reader, p)
    clearances = (float(p.crank_pin.clearance), float(p.piston_pin.clearance))

    @numba.njit(error_model="numpy")
    def slope(t, z, out, modes, approaches):
        state = (
            z[0],
            z[1],
            z[2],
            z[3],
            z[4] / VELOCITY_TIME,
            z[5] / VELOCITY_TIME,
            z[6] / VELOCITY_TIME,
            z[7] / VELOCITY_TIME,
        )
        numbers = Parameters(
            bodies(),
            crank_pin(),
            piston_pin(),
            crank_pivot(),
            drive(),
            effects(),
            switches(),
            slider(),
            crank(),
            knots(),
            table(),
        )
        rates = instant(
            numbers, t, state, _NO_FURTHER, modes, approaches, _NO_MEMORY
        ).clearance_rates
        for i in range(4):
            out[i], out[4 + i] = rates[i], VELOCITY_TIME * rates[4 + i]

    @numba.njit(error_model="numpy")
    def gap(z, joint):
        x, y = z[2 * joint], z[2 * joint + 1]
        r = math.sqrt(x * x + y * y)
        return r - clearances[joint], (x * z[4 + 2 * joint] + y * z[5 + 2 * joint]) / (
            r * VELOCITY_TIME
        )

    return slope, gap
