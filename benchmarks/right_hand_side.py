"""The package's equations of motion as general-purpose integrators call them, for a mechanism with
loose revolute joints under a prescribed drive.

State: clearance vectors and their rates, the latter times `VELOCITY_TIME`, so that one absolute
tolerance [m] fits all. Compiled code reads the records where
they lie: compiled in as constants they would be copied at every call, which takes longer than the
equations.
"""

import math

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from jointgap.core.records import Record
from jointgap.linkage.parameters import Parameters
from jointgap.motion.model import Model, Workspace
from jointgap.motion.rates import set_crank_at, set_damping, slopes
from jointgap.motion.runge_kutta import VELOCITY_TIME

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

    The first writes the rates of the scaled state `z` (4 n,) into `out`, for n loose joints; the
    second gives the penetration [m] of a joint and its rate [m/s]. Both work on `workspace`. A
    contact's damping does not depend on when it began: the published form.
    """
    _ALIVE.append((model, workspace))
    drive, knots, slides, pivots, formulas, table = map(_reader, model.p)
    here = _reader(workspace.k)
    count = len(model.loose)
    half = 2 * count
    clearances = tuple(float(joint.clearance) for joint in workspace.k.joints[:count])

    @numba.njit(error_model="numpy")
    def slope(t, z, out, modes, approaches):
        k, p = here(), Parameters(drive(), knots(), slides(), pivots(), formulas(), table())
        for j in range(count):
            k.modes[j], k.approaches[j] = modes[j], approaches[j]
        for i in range(half):
            k.z[i], k.z[half + i] = z[i], z[half + i] / VELOCITY_TIME
        k.now = t
        set_crank_at(p, k)
        set_damping(k, t)
        slopes(p, k)
        for i in range(half):
            out[i], out[half + i] = k.slope[i], VELOCITY_TIME * k.slope[half + i]

    @numba.njit(error_model="numpy")
    def gap(z, joint):
        x, y = z[2 * joint], z[2 * joint + 1]
        r = math.sqrt(x * x + y * y)
        vx, vy = z[half + 2 * joint], z[half + 2 * joint + 1]
        return r - clearances[joint], (x * vx + y * vy) / (r * VELOCITY_TIME)

    return slope, gap
