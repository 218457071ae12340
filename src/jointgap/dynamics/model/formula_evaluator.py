"""The machine that evaluates formulas: see `jointgap.formula` for what they are and how their programs are made."""

import math

from llvmlite import ir
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic

from jointgap import formula as f
from jointgap.dynamics.compilation import compiled

NUMBER, VARIABLE, NEGATE, ADD, SUBTRACT, MULTIPLY = f.NUMBER, f.VARIABLE, f.NEGATE, f.ADD, f.SUBTRACT, f.MULTIPLY
DIVIDE, POWER, SQUARE = f.DIVIDE, f.POWER, f.SQUARE
SIN, COS, TAN, TANH, EXP, LOG, SQRT, ABS, SGN = f.SIN, f.COS, f.TAN, f.TANH, f.EXP, f.LOG, f.SQRT, f.ABS, f.SGN
DEEPEST_STACK = f.DEEPEST_STACK


@intrinsic
def _slots(typing_context):
    """Room for the stack in the calling function's own frame: an array on the heap would cost more than a formula."""

    def generate(context, builder, signature, arguments):
        return cgutils.alloca_once(builder, ir.DoubleType(), size=DEEPEST_STACK)

    return types.CPointer(types.float64)(), generate


@compiled
def evaluate(codes, numbers, v, x, w, theta, t):
    """Value of a program; 0 where it has no operations."""
    stack = carray(_slots(), (DEEPEST_STACK,))
    below, top = -1, 0.0  # numbers in the stack's array, less one; the number on top, which is not in it
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
