"""Equations of motion with the force laws of effects."""

import math
from typing import NamedTuple

from llvmlite import ir
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic

from jointgap.core import formula as f
from jointgap.dynamics.bodies import bodies_under
from jointgap.dynamics.joints import NOTHING, bristle_motion, joint_force, under_reactions
from jointgap.dynamics.numba_cache import compiled, inlined
from jointgap.dynamics.parameters import MOTOR

NUMBER, VARIABLE, NEGATE, ADD, SUBTRACT, MULTIPLY = (
    f.NUMBER,
    f.VARIABLE,
    f.NEGATE,
    f.ADD,
    f.SUBTRACT,
    f.MULTIPLY,
)
DIVIDE, POWER, SQUARE = f.DIVIDE, f.POWER, f.SQUARE
SIN, COS, TAN, TANH, EXP, LOG, SQRT, ABS, SGN = (
    f.SIN,
    f.COS,
    f.TAN,
    f.TANH,
    f.EXP,
    f.LOG,
    f.SQRT,
    f.ABS,
    f.SGN,
)
DEEPEST_STACK = f.DEEPEST_STACK


@intrinsic
def _slots(typing_context):
    """The stack in the calling function's frame: an array on the heap would cost more than a
    formula."""

    def generate(context, builder, signature, arguments):
        return cgutils.alloca_once(builder, ir.DoubleType(), size=DEEPEST_STACK)

    return types.CPointer(types.float64)(), generate


@compiled
def evaluate(codes, numbers, v, x, w, theta, t):
    """Value of a program; 0 where it has no operations."""
    stack = carray(_slots(), (DEEPEST_STACK,))
    below, top = (
        -1,
        0.0,
    )  # index of the number below the top, in the array; the top itself is a scalar
    for i in range(codes.shape[0]):
        code, index = codes[i, 0], codes[i, 1]
        if code <= VARIABLE:
            if i > 0:
                below += 1
                stack[below] = top
            top = numbers[index] if code == NUMBER else _variable(index, v, x, w, theta, t)
        elif ADD <= code <= POWER:
            top = _binary(code, stack[below], top)
            below -= 1
        else:
            top = _unary(code, top)
    return top


@compiled
def _variable(index, v, x, w, theta, t):
    if index == 0:
        return v
    if index == 1:
        return x
    if index == 2:
        return w
    if index == 3:
        return theta
    return t


@compiled
def _binary(code, a, b):
    if code == MULTIPLY:
        return a * b
    if code == ADD:
        return a + b
    if code == SUBTRACT:
        return a - b
    if code == DIVIDE:
        return a / b
    return a**b


@compiled
def _unary(code, a):
    if code == NEGATE:
        return -a
    if code == SQUARE:
        return a * a
    if code == ABS:
        return abs(a)
    if code == SGN:
        if math.isnan(a):
            return a
        return math.copysign(1.0, a) if a != 0.0 else 0.0
    if code == SIN:
        return math.sin(a)
    if code == COS:
        return math.cos(a)
    if code == TAN:
        return math.tan(a)
    if code == TANH:
        return math.tanh(a)
    if code == EXP:
        return math.exp(a)
    if code == LOG:
        return math.log(a)
    return math.sqrt(a)


@compiled
def formula_value(program, v, x, crank_speed, crank_angle, time):
    """Value of a formula whose program is a record."""
    return evaluate(
        program.codes[: program.length], program.numbers, v, x, crank_speed, crank_angle, time
    )


@compiled
def table_value(e, table, crank_angle, time):
    """Force [N] of a periodic table."""
    place = (e.table_sign * crank_angle if e.table_over == 1 else time) - e.table_begin
    place -= math.floor(place / e.table_period) * e.table_period
    row = min(int(place / e.table_period * table.count), table.count - 1)
    while row > 0 and table.pieces[row, 0] > place:
        row -= 1
    while row + 1 < table.count and table.pieces[row + 1, 0] <= place:
        row += 1
    since, c = place - table.pieces[row, 0], table.pieces[row]
    return ((c[1] * since + c[2]) * since + c[3]) * since + c[4]


@compiled
def varying(share, phase):
    """1 at the `phase` 0 [rad], reduced by up to the `share` [1] elsewhere."""
    return 1.0 - share * (0.5 - 0.5 * math.cos(phase))


@compiled
def slider_force(p, guide_force, x, v, crank_speed, crank_angle, time):
    """Force [N] along +x on the slider."""
    e = p.effects
    sign = math.tanh(v / e.slider_sign_speed)
    force = (
        e.constant
        - (e.coulomb + e.load_friction * abs(guide_force)) * sign
        - e.viscous * v
        - e.drag * v * abs(v)
    )
    if e.stribeck != 0.0:
        falling = e.stribeck_share * math.exp(-abs(v) / e.stribeck_speed)
        force -= e.stribeck * (1.0 - e.stribeck_share + falling) * sign
    if e.position_friction != 0.0:
        phase = 2.0 * math.pi * (x - e.position_friction_tightest) / e.position_friction_length
        force -= e.position_friction * varying(e.position_friction_share, phase) * sign
    if e.power_drag != 0.0:
        force -= e.power_drag * (abs(v) / e.power_drag_speed) ** e.power_drag_exponent * sign
    force -= e.spring_stiffness * (x - e.spring_rest)
    if e.nonlinear_spring != 0.0:
        stretch, share = x - e.nonlinear_spring_rest, e.nonlinear_spring_share
        force -= (
            e.nonlinear_spring
            * stretch
            * (1.0 - share + share * (stretch / e.nonlinear_spring_length) ** 2)
        )
    if e.gas_force != 0.0:
        force -= (
            e.gas_force * (e.gas_length / (e.gas_length + e.gas_outermost - x)) ** e.gas_exponent
        )
    if e.harmonic != 0.0:
        force += e.harmonic * math.cos(e.harmonic_angular_frequency * time + e.harmonic_phase)
    if e.table_over != 0:
        force += table_value(e, p.slider_table, crank_angle, time)
    if p.slider_formula.length > 0:
        force += formula_value(p.slider_formula, v, x, crank_speed, crank_angle, time)
    return force


@compiled
def crank_losses(p, x, v, crank_speed, crank_angle, time):
    """Torque [N m] on the crank by friction, periodic torques and formulas; arguments as in
    `slider_force`."""
    e = p.effects
    sign = math.tanh(crank_speed / e.crank_sign_speed)
    torque = -e.crank_coulomb * sign - e.crank_viscous * crank_speed
    if e.angle_friction != 0.0:
        torque -= (
            e.angle_friction
            * varying(e.angle_friction_share, crank_angle - e.angle_friction_tightest)
            * sign
        )
    if e.crank_periodic != 0.0:
        torque += e.crank_periodic * math.cos(
            e.crank_periodic_order * crank_angle - e.crank_periodic_phase
        )
    if e.crank_brake != 0.0:
        torque -= (
            e.crank_brake
            * (abs(crank_speed) / e.crank_brake_speed) ** e.crank_brake_exponent
            * sign
        )
    if p.crank_formula.length > 0:
        torque += formula_value(p.crank_formula, v, x, crank_speed, crank_angle, time)
    return torque


@compiled
def motor_torque(drive, speed):
    """Torque [N m] of a motor with a linear torque-speed line."""
    return drive.stall_torque * (1.0 - speed / drive.no_load_speed)


STATES, AUXILIARY_STATES = 8, 11
"""Numbers of states and of auxiliary states."""


class Crank(NamedTuple):
    """Motion of the crank: cosine and sine of its angle, speed [rad/s], acceleration [rad/s^2]
    where prescribed."""

    cosine: float
    sine: float
    speed: float
    acceleration: float


class Pose(NamedTuple):
    """Rod and slider at an instant: direction and angular velocity of the rod, position and
    velocity of the slider."""

    rod_cos: float
    rod_sin: float
    rod_speed: float
    slider: float
    slider_speed: float


@inlined
def pose(bodies, crank, y, x) -> Pose:
    """Rod and slider from the clearance vectors."""
    length, inverse = bodies.rod_length, bodies.rod_inverse_length
    end_y = bodies.crank_length * crank.sine + y[1] + x[1]
    end_vy = bodies.crank_length * crank.speed * crank.cosine + y[5] + x[5]
    s = (bodies.slider_offset + y[3] - end_y) * inverse
    square = 1.0 - s * s
    c = math.sqrt(square)
    speed = (
        (y[7] - end_vy) * inverse * (c * (1.0 / square))
    )  # over c; this division is independent of the root
    end_x = bodies.crank_length * crank.cosine + y[0] + x[0]
    end_vx = y[4] + x[4] - bodies.crank_length * crank.speed * crank.sine
    return Pose(c, s, speed, end_x + length * c - y[2], end_vx - length * speed * s - y[6])


@inlined
def accelerations(p, time, crank_angle, crank, y, x, modes, damping) -> tuple:
    """All accelerations at a state, and the forces."""
    here = pose(p.bodies, crank, y, x)
    pin = joint_force(
        p.crank_pin, modes[0], damping[0], y[0], y[1], y[4], y[5], here.rod_speed, crank.speed, x[8]
    )
    piston = joint_force(
        p.piston_pin, modes[1], damping[1], y[2], y[3], y[6], y[7], here.rod_speed, 0.0, x[9]
    )
    pivot = NOTHING
    torque = force = 0.0
    bristles = (0.0, 0.0, 0.0)
    if p.switches.auxiliary:
        if p.crank_pivot.loose:
            pivot = joint_force(
                p.crank_pivot, modes[2], damping[2], x[0], x[1], x[4], x[5], crank.speed, 0.0, x[10]
            )
        if p.switches.bristles:
            w, turn = here.rod_speed, crank.speed
            bristles = (
                bristle_motion(p.crank_pin, modes[0], y[0], y[1], y[4], y[5], w, turn, x[8]),
                bristle_motion(p.piston_pin, modes[1], y[2], y[3], y[6], y[7], w, 0.0, x[9]),
                bristle_motion(p.crank_pivot, modes[2], x[0], x[1], x[4], x[5], turn, 0.0, x[10]),
            )
    if p.drive.kind == MOTOR:
        torque = motor_torque(p.drive, crank.speed)
        torque += crank_losses(p, here.slider, here.slider_speed, crank.speed, crank_angle, time)
    if p.effects.on_slider:
        # the guide force of an ideal piston pin is unknown here: its friction is added with the
        # reactions
        guide = piston[3] - p.bodies.slider_mass * p.bodies.gravity_y if p.piston_pin.loose else 0.0
        force = slider_force(
            p, guide, here.slider, here.slider_speed, crank.speed, crank_angle, time
        )
    if p.switches.constrained:
        found, pin, piston, force = under_reactions(
            p, crank, here, x, torque, force, pin, piston, pivot
        )
        return found, pin, piston, pivot, torque, force, bristles
    return (
        bodies_under(p, crank, here, x, torque, force, pin, piston, pivot),
        pin,
        piston,
        pivot,
        torque,
        force,
        bristles,
    )
