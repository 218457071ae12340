"""Friction between journal and bearing: coefficient over sliding speed.

The coefficient mu(v) has the sign of the sliding speed v and is an odd, continuous function. The
friction force is mu(v) times the normal force, opposite to the sliding. LuGre's law has an
additional state, the mean bristle deflection z.
"""

import math

import numpy as np

from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.core.numba_cache import compiled

_COULOMB, _THRELFALL, _AMBROSIO, _BENGISU_AKAY, LUGRE = (
    np.int64(FRICTION_LAWS[name].code)
    for name in ("coulomb", "threlfall", "ambrosio", "bengisu_akay", "lugre")
)
_THRELFALL_SLOPE = FRICTION_LAWS["threlfall"].slope_at_zero

_TANH_IS_ONE = 20.0  # in double precision
_THRELFALL_IS_ONE = 13.0


@compiled
def smooth_sign(x):
    """tanh x, to rounding of 1, in half of the library function's time."""
    size = abs(x)
    if size > _TANH_IS_ONE:
        return math.copysign(1.0, x)
    return math.copysign(1.0 - 2.0 / (math.exp(2.0 * size) + 1.0), x)


@compiled
def coulomb(speed, friction, friction_speed):
    """Coulomb friction (C. A. Coulomb, Théorie des machines simples, 1785), smoothed: mu tanh(v /
    v_0), 76 % at v_0."""
    if abs(speed) > _TANH_IS_ONE * friction_speed:  # without a division, for which the force waits
        return math.copysign(friction, speed)
    return friction * smooth_sign(speed / friction_speed)


@compiled
def threlfall(speed, friction, friction_speed):
    """mu (1 - exp(-3 |v| / v_0)), 95 % of mu at v_0: D. C. Threlfall, Mech. Mach. Theory 13 (1978)
    475-483.

    The exponential continues beyond v_0, so the coefficient tends to mu; some quote the law with a
    plateau of 95 % of mu from v_0 on.
    """
    ratio = abs(speed) / friction_speed
    if ratio > _THRELFALL_IS_ONE:
        return math.copysign(friction, speed)
    return -math.copysign(friction, speed) * math.expm1(-_THRELFALL_SLOPE * ratio)


@compiled
def ambrosio(speed, friction, dead_band_speed, friction_speed):
    """Zero below the dead band's speed, mu above v_0, linear between.

    J. A. C. Ambrósio, Impact of rigid and flexible multibody systems: deformation description and
    contact models, in: Virtual Nonlinear Multibody Systems, NATO Science Series 103 (2003) 57-81.
    """
    size = abs(speed)
    if size >= friction_speed:
        return math.copysign(friction, speed)
    if size <= dead_band_speed:
        return 0.0
    return (
        math.copysign(friction, speed)
        * (size - dead_band_speed)
        / (friction_speed - dead_band_speed)
    )


@compiled
def bengisu_akay(speed, friction, static_friction, friction_speed, stribeck_speed):
    """A parabola up to mu_s at v_0, then mu + (mu_s - mu) exp(-(|v| - v_0) / v_s), decreasing with
    speed.

    M. T. Bengisu and A. Akay, J. Sound Vib. 171 (1994) 557-570; their rate of decay is 1 / v_s with
    the Stribeck speed.
    """
    beyond = abs(speed) - friction_speed
    if beyond >= 0.0:
        return math.copysign(
            friction + (static_friction - friction) * math.exp(-beyond / stribeck_speed), speed
        )
    return math.copysign(static_friction * (1.0 - (beyond / friction_speed) ** 2), speed)


@compiled
def lugre_bristle_rate(speed, bristle, friction, static_friction, stribeck_speed, stiffness):
    """dz/dt = v - sigma_0 |v| z / (mu + (mu_s - mu) exp(-(v / v_s)^2)) [m/s]; see `lugre`."""
    stribeck = friction + (static_friction - friction) * math.exp(-((speed / stribeck_speed) ** 2))
    return speed - stiffness * abs(speed) * bristle / stribeck


@compiled
def lugre(speed, bristle, bristle_rate, stiffness, damping, viscous_friction):
    """sigma_0 z + sigma_1 dz/dt + sigma_2 v, each per unit of normal force: bristles that bend by z
    before they slip.

    C. Canudas de Wit, H. Olsson, K. J. Åström and P. Lischinsky, IEEE Trans. Autom. Control 40
    (1995) 419-425. In steady sliding this is sign(v) (mu + (mu_s - mu) exp(-(v / v_s)^2)) + sigma_2
    v. The law is passive (dissipative over every motion) if sigma_1 (mu_s - mu) <= sigma_2 mu: N.
    Barahanov and R. Ortega, IEEE Trans. Autom. Control 45 (2000).
    """
    return stiffness * bristle + damping * bristle_rate + viscous_friction * speed


@compiled
def bristle_rate(joint, sliding_speed, bristle):
    """Rate [m/s] of the bristles' deflection; zero for laws without bristles."""
    if joint.friction == 0.0 or joint.friction_law != LUGRE:
        return 0.0
    return lugre_bristle_rate(
        sliding_speed,
        bristle,
        joint.friction,
        joint.static_friction,
        joint.stribeck_speed,
        joint.bristle_stiffness,
    )


@compiled
def friction_coefficient(joint, sliding_speed, bristle):
    """Friction force over normal force, with the sign of the sliding speed (for LuGre, of the bent
    bristles)."""
    mu, law = joint.friction, joint.friction_law
    if mu == 0.0:
        return 0.0
    if law == _COULOMB:
        return coulomb(sliding_speed, mu, joint.friction_speed)
    if law == _THRELFALL:
        return threlfall(sliding_speed, mu, joint.friction_speed)
    if law == _AMBROSIO:
        return ambrosio(sliding_speed, mu, joint.dead_band_speed, joint.friction_speed)
    if law == _BENGISU_AKAY:
        return bengisu_akay(
            sliding_speed, mu, joint.static_friction, joint.friction_speed, joint.stribeck_speed
        )
    rate = bristle_rate(joint, sliding_speed, bristle)
    return lugre(
        sliding_speed,
        bristle,
        rate,
        joint.bristle_stiffness,
        joint.bristle_damping,
        joint.viscous_friction,
    )
