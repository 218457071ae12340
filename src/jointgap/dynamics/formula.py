"""The machine that evaluates formulas: see `jointgap.formula` for what they are and how their programs are made."""

import math

import numpy as np

from jointgap import formula as f
from jointgap.dynamics.compiled import compiled

NUMBER, VARIABLE, NEGATE, ADD, SUBTRACT, MULTIPLY = f.NUMBER, f.VARIABLE, f.NEGATE, f.ADD, f.SUBTRACT, f.MULTIPLY
DIVIDE, POWER, SQUARE = f.DIVIDE, f.POWER, f.SQUARE
SIN, COS, TAN, TANH, EXP, LOG, SQRT, ABS, SGN = f.SIN, f.COS, f.TAN, f.TANH, f.EXP, f.LOG, f.SQRT, f.ABS, f.SGN
DEEPEST_STACK = f.DEEPEST_STACK


@compiled
def evaluate(codes, numbers, v, x, w, theta, t):
    """Value of a program; 0 where it has no operations.

    Parameters
    ----------
    codes, numbers : arrays
        Of a `jointgap.formula.Program`.
    v, x, w, theta, t : float
        Velocity [m/s] and position [m] of the slider, speed [rad/s] and angle [rad] of the crank, time [s].

    Returns
    -------
    float
        NaN or infinity where the formula is not defined, such as the root of a negative number.
    """
    if codes.shape[0] == 0:
        return 0.0
    stack = np.empty(DEEPEST_STACK)
    top = -1  # index of the number on top
    for i in range(codes.shape[0]):
        code = codes[i, 0]
        if code <= VARIABLE:
            top += 1
            if code == NUMBER:
                stack[top] = numbers[codes[i, 1]]
            else:
                stack[top] = (v, x, w, theta, t)[codes[i, 1]]
        elif ADD <= code <= POWER:
            top -= 1
            stack[top] = _binary(code, stack[top], stack[top + 1])
        else:
            stack[top] = _unary(code, stack[top])
    return stack[0]


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
