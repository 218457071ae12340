"""The package's equations of motion as general-purpose integrators call them, for a mechanism whose
pins are loose.

State: clearance vectors of crank pin and piston pin and their rates, the latter times
`VELOCITY_TIME`, so that one absolute tolerance [m] fits all. Compiled code reads the records where
they lie: compiled in as constants they would be copied at every call, which takes longer than the
equations.
"""

import math

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from jointgap.dynamics.model import Model, Workspace
from jointgap.dynamics.parameters import Parameters, Record
from jointgap.dynamics.rates import set_crank_at, set_damping, slopes
from jointgap.dynamics.runge_kutta import VELOCITY_TIME

_ALIVE: list[tuple[Model, Workspace]] = []  # compiled functions point into them


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


def right_hand_side(model: Model, workspace: Workspace):
    """Two compiled functions: `slope(t, z, out, modes, approaches)` and `gap(z, joint)`.

    The first writes the rates of the scaled state `z` (8,) into `out`; the second gives the
    penetration [m] of crank pin (0) or piston pin (1) and its rate [m/s]. Both work on `workspace`.
    A contact's damping does not depend on when it began: the published form.
    """
    _ALIVE.append((model, workspace))
    drive, knots, effects, slider, crank, table = map(_reader, model.p)
    here = _reader(workspace.k)
    clearances = tuple(float(joint.clearance) for joint in workspace.k.joints[:2])

    @numba.njit(error_model="numpy")
    def slope(t, z, out, modes, approaches):
        k, p = here(), Parameters(drive(), knots(), effects(), slider(), crank(), table())
        for j in range(2):
            k.modes[j], k.approaches[j] = modes[j], approaches[j]
        for i in range(4):
            k.z[i], k.z[4 + i] = z[i], z[4 + i] / VELOCITY_TIME
        k.now = t
        set_crank_at(p, k)
        set_damping(k, t)
        slopes(p, k)
        for i in range(4):
            out[i], out[4 + i] = k.slope[i], VELOCITY_TIME * k.slope[4 + i]

    @numba.njit(error_model="numpy")
    def gap(z, joint):
        x, y = z[2 * joint], z[2 * joint + 1]
        r = math.sqrt(x * x + y * y)
        return r - clearances[joint], (x * z[4 + 2 * joint] + y * z[5 + 2 * joint]) / (
            r * VELOCITY_TIME
        )

    return slope, gap
