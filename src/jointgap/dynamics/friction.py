"""Friction between journal and bearing: coefficient over sliding speed."""

import math

from jointgap.dynamics.compiled import compiled

_SATURATED = 20.0


@compiled
def friction_coefficient(sliding_speed, friction, friction_speed):
    """Coulomb friction made smooth through zero, mu tanh(v / v_0); has the sign of the sliding speed."""
    if friction == 0.0:
        return 0.0
    if abs(sliding_speed) > _SATURATED * friction_speed:  # the hyperbolic tangent is 1 to the last digit, and slow
        return math.copysign(friction, sliding_speed)
    return friction * math.tanh(sliding_speed / friction_speed)
