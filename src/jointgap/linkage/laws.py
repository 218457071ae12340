"""Forces of effects at slides and pivots, and values of formulas."""

import math

from llvmlite import ir
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic

from jointgap.contact.friction import smooth_sign
from jointgap.core import formula as f
from jointgap.core.numba_cache import compiled
from jointgap.effects import pivots, slides

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
def _formula_value(p, number, x, v, crank_speed, crank_angle, time):
    """Value of a formula, 0 for the number 0."""
    if number == 0:
        return 0.0
    program = p.formulas.programs[number - 1]
    return evaluate(
        program.codes[: program.length], program.numbers, v, x, crank_speed, crank_angle, time
    )


@compiled
def _table_value(law, table, crank_angle, time):
    """Force [N] of a periodic table."""
    place = (law.table_sign * crank_angle if law.table_over == 1 else time) - law.table_begin
    place -= math.floor(place / law.table_period) * law.table_period
    row = min(int(place / law.table_period * table.count), table.count - 1)
    while row > 0 and table.pieces[row, 0] > place:
        row -= 1
    while row + 1 < table.count and table.pieces[row + 1, 0] <= place:
        row += 1
    since, c = place - table.pieces[row, 0], table.pieces[row]
    return ((c[1] * since + c[2]) * since + c[3]) * since + c[4]


slide_force = compiled(slides.slide_force)
pivot_torque = compiled(pivots.pivot_torque)


@compiled
def force_along(p, number, guide_force, x, v, crank_speed, crank_angle, time):
    """Force [N] of all effects on the body of a slide, at the place `x` [m] with the speed `v`."""
    law = p.slides.laws[number]
    force = slide_force(law, smooth_sign(v / law.sign_speed), guide_force, x, v, time)
    if law.table_over != 0:
        force += _table_value(law, p.table, crank_angle, time)
    return force + _formula_value(p, law.formula, x, v, crank_speed, crank_angle, time)


@compiled
def torque_at(p, number, angle, speed, x, v, crank_speed, crank_angle, time):
    """Torque [N m] of all effects on the body of a pivot, at an `angle` [rad], whole turns aside,
    with a `speed`; the variables of its formula are those, or `x` and `v` of the first slide."""
    law = p.pivots.laws[number]
    usual = law.middle + law.turns * crank_angle
    angle -= math.tau * math.floor((angle - usual) / math.tau + 0.5)
    torque = pivot_torque(law, smooth_sign(speed / law.sign_speed), angle, speed)
    if law.follows_slide == 0:
        x, v = angle, speed
    return torque + _formula_value(p, law.formula, x, v, crank_speed, crank_angle, time)


@compiled
def motor_torque(drive, speed):
    """Torque [N m] of a motor with a linear torque-speed line."""
    return drive.stall_torque * (1.0 - speed / drive.no_load_speed)
