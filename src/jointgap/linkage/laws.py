"""Force laws of effects on slider and crank, and values of formulas."""

import math

from llvmlite import ir
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic

from jointgap.contact.friction import smooth_sign
from jointgap.core import formula as f
from jointgap.core.numba_cache import compiled

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
    sign = smooth_sign(v / e.slider_sign_speed)
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
    sign = smooth_sign(crank_speed / e.crank_sign_speed)
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
