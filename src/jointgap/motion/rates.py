"""The right-hand side: machine code of the equations of motion, and between its two parts the laws
of joints and effects."""

import ctypes
import math

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from jointgap.contact.friction import smooth_sign
from jointgap.contact.joints import (
    bristle_motion,
    corner_bristle_motion,
    corner_force,
    joint_force,
)
from jointgap.contact.normal_force import damping_factor_at
from jointgap.core.numba_cache import compiled, inlined
from jointgap.linkage.drive import crank_motion
from jointgap.linkage.laws import force_along, motor_torque, torque_at
from jointgap.linkage.parameters import CRANK, MOTOR
from jointgap.motion.events import conditions, corner_conditions
from jointgap.motion.workspace import CONDITIONS, CORNERS, HERE


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


@inlined
def set_crank(k, angle, cosine, sine, speed, acceleration) -> None:
    k.turned = angle
    k.crank[0], k.crank[1], k.crank[2], k.crank[3] = cosine, sine, speed, acceleration


@inlined
def set_damping(k, time) -> None:
    for j in range(k.contacts):
        k.damping[j] = damping_factor_at(k.joints[j], k.approaches[j], k.begins[j], time)


@inlined
def set_crank_at(p, k) -> None:
    """Set the crank's motion at the state z and the time `k.now`."""
    if k.is_free:
        angle, speed, acceleration = k.z[2 * k.loose], k.z[k.half + 2 * k.loose], 0.0
    else:
        angle, speed, acceleration = crank_motion(p, k.now)
    set_crank(k, angle, math.cos(angle), math.sin(angle), speed, acceleration)


@inlined
def slopes(p, k) -> None:
    """Rates and normal forces at the state z, with the crank's motion and the damping set."""
    # local names: compiled code would load the numbers of a record again after each store
    h, bristles, z, slope = k.half, k.bristles, k.z, k.slope
    turning, forces, place = k.turning, k.forces, k.place
    run(k.pose, place)
    for j in range(k.pins):
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
    if k.contacts > k.pins:
        _push_corners(k)
    if p.drive.kind == MOTOR:
        forces[4 * k.loose] = motor_torque(p.drive, k.crank[2]) + torque_on_crank(p, k)
    if k.pushed:
        _push(p, k)
    if k.rubs:
        _rub(p, k)
    else:
        run(k.dynamics, place)
    for i in range(h):
        slope[i] = z[h + i]


@compiled
def torque_on_crank(p, k):
    """Torque [N m] of effects on the crank; `x` and `v` of its formula are those of the first
    slide."""
    speed, x, v = k.crank[2], k.turned, k.crank[2]
    if k.slides:
        x, v = k.sites[0], k.sites[1]
    return torque_at(p, CRANK, k.turned, speed, x, v, speed, k.turned, k.now)


@compiled
def _push(p, k):
    """Forces of effects at the pushed joints."""
    for i in range(k.pushed):
        x, v = k.sites[2 * i], k.sites[2 * i + 1]
        if i < k.slides:
            k.along[i] = force_along(p, i, 0.0, x, v, k.crank[2], k.turned, k.now)
        else:
            n = i - k.slides
            k.along[i] = torque_at(p, n, x, v, x, v, k.crank[2], k.turned, k.now)


@compiled
def _push_corners(k):
    """Forces and bristles of the loose slides."""
    for n in range(k.pins, k.loose):
        first = k.pins + CORNERS * (n - k.pins)
        x, v, at, speed = 2 * n, k.half + 2 * n, 4 * n, k.turning[2 * n + 1]
        offset, tilt, offset_rate, tilt_rate = k.z[x], k.z[x + 1], k.z[v], k.z[v + 1]
        along = across = moment = 0.0
        for j in range(first, first + CORNERS):
            bristle = k.z[2 * k.half + j] if k.bristles else 0.0
            joint, mode = k.joints[j], k.modes[j]
            k.force[j], rubbing, pushing, turning = corner_force(
                joint,
                mode,
                k.damping[j],
                offset,
                tilt,
                offset_rate,
                tilt_rate,
                speed,
                bristle,
            )
            along, across, moment = along + rubbing, across + pushing, moment + turning
            if k.bristles:
                k.slope[2 * k.half + j] = corner_bristle_motion(
                    joint, mode, tilt, tilt_rate, speed, bristle
                )
        k.forces[at], k.forces[at + 1], k.forces[at + 2] = along, across, moment


_ROUNDS, _SETTLED = 200, 1e-13  # iterations; tolerance relative to reactions and inertia forces


@compiled
def _rub(p, k):
    """Dynamics with friction that depends on the reactions of ideal joints, found from the assumed
    ones; NaN where none are consistent."""
    reactions, found, width = k.reactions, k.assumed, p.pivots.laws[CRANK].sign_speed
    count = 2 * k.rubbing + k.pushed
    for i in range(k.pushed):
        k.unloaded[i], k.loaded[i] = k.along[i], 0.0
        if i < k.slides:
            law = p.slides.laws[i]
            k.loaded[i] = law.load_friction * smooth_sign(k.sites[2 * i + 1] / law.sign_speed)
    for j in range(k.rubbing):
        at = 2 * (k.loose + j)
        k.grips[j] = k.levers[j] * smooth_sign((k.turning[at] - k.turning[at + 1]) / width)
    for i in range(count):
        if not abs(found[i]) < math.inf:
            found[i] = 0.0
    share, before, inertia = 1.0, math.inf, k.inertia * k.crank[2] ** 2
    for _ in range(_ROUNDS):
        for j in range(k.rubbing):
            x, y = found[2 * j], found[2 * j + 1]
            k.moments[j] = -k.grips[j] * math.sqrt(x * x + y * y)
        for i in range(k.pushed):
            k.along[i] = k.unloaded[i] - k.loaded[i] * abs(found[2 * k.rubbing + i])
        run(k.dynamics, k.place)
        change, size = 0.0, inertia
        for i in range(count):
            change += abs(reactions[i] - found[i])
            size += abs(reactions[i])
            found[i] += share * (reactions[i] - found[i])
        if not change > _SETTLED * size:
            return
        overshot, before = change > before, change
        if overshot:  # steep friction against the load: restart with stronger damping
            share, before = 0.5 * share, math.inf
            for i in range(count):
                found[i] = 0.0
    for i in range(k.half):
        k.slope[k.half + i] = math.nan


@inlined
def assume(k, row) -> None:
    """Assume the reactions of a row: results must depend on a state and its step alone, not on
    what was evaluated before, such as samples."""
    for i in range(2 * k.rubbing + k.pushed):
        k.assumed[i] = k.settled[row, i]


@compiled
def evaluate(p, k, row):
    """Rates, normal forces and conditions at the state of a row: the first, or the end of the last
    step."""
    n, h, time = k.states, k.half, k.time[row]
    if row == HERE:
        assume(k, HERE)
    for i in range(n):
        k.z[i] = k.y[row, i]
    k.now = time
    set_crank_at(p, k)
    k.angle[row], k.cosine[row], k.sine[row] = k.turned, k.crank[0], k.crank[1]
    set_damping(k, time)
    slopes(p, k)
    for i in range(2 * k.rubbing + k.pushed):
        k.settled[row, i] = k.assumed[i]
    for i in range(n):
        k.dy[row, i] = k.slope[i]
    for j in range(k.contacts):
        k.normal[row, j] = k.force[j]
        n = j if j < k.pins else k.pins + (j - k.pins) // CORNERS
        x, v = 2 * n, h + 2 * n
        relative = (k.z[x], k.z[x + 1], k.z[v], k.z[v + 1], k.slope[v], k.slope[v + 1])
        joint, mode, approach, begin = k.joints[j], k.modes[j], k.approaches[j], k.begins[j]
        if j >= k.pins:
            c = corner_conditions(joint, mode, approach, begin, time, relative)
        else:
            c = conditions(joint, mode, approach, begin, time, relative)
        for i in range(CONDITIONS):
            k.conditions[row, j, i] = c[i]
