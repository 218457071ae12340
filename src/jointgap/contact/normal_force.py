"""Normal force in a joint: contact laws and oil films."""

import math
from collections.abc import Callable

from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from jointgap.core.numba_cache import compiled, inlined

MEMORY_DURATIONS, FADING_DURATIONS = 2.5, 2.5
"""Memory and fading time of a contact, over the duration of the slowest elastic impact, at
`least_approach_speed`.

With n = 3/2 a free impact at that speed lasts 2.0 times as long as an elastic one for a restitution
of 0.1, 2.4 times for 0.07 and 2.9 times for 0.05. Slower impacts have the same damping parameter
and last as long as elastic ones, with the speed to the power of -1/5: 2.2 durations at a fiftieth
of the speed, 2.5 at a hundredth. So for a restitution of at least 0.1, impacts above that speed end
before the memory fades. Larger exponents give longer impacts: with n = 2 this holds from a tenth of
the speed on, with n = 3 not for a restitution of 0.1."""

PULL_FAR_OFF = 1e3
"""Parting speed [m/s] at zero force above which a contact is not checked for pulling: no mechanism
is that fast."""


def hunt_crossley(restitution: float) -> float:
    """chi of Hunt and Crossley, J. Appl. Mech. 42 (1975) 440-445."""
    return 3 * (1 - restitution) / 2


def lankarani_nikravesh(restitution: float) -> float:
    """chi of Lankarani and Nikravesh, J. Mech. Des. 112 (1990) 369-376."""
    return 3 * (1 - restitution**2) / 4


def lee_wang(restitution: float) -> float:
    """chi of Lee and Wang, J. Mech. Transm. Autom. Des. 105 (1983) 534-543."""
    return 3 * (1 - restitution) / 4


def herbert_mcwhannell(restitution: float) -> float:
    """chi of Herbert and McWhannell, J. Eng. Ind. 99 (1977) 792-798."""
    return 6 * (1 - restitution) / ((2 * restitution - 1) ** 2 + 3)


def gonthier(restitution: float) -> float:
    """chi of Gonthier et al., Multibody Syst. Dyn. 11 (2004) 209-233, in its approximate closed
    form."""
    return (1 - restitution**2) / restitution


def zhiying_qishao(restitution: float) -> float:
    """chi of Qin and Lu (Zhiying and Qishao), J. Dyn. Control 4 (2006) 294-298."""
    return 3 / 4 * (1 - restitution**2) * math.exp(2 * (1 - restitution))


def flores(restitution: float) -> float:
    """chi of Flores, Machado, Silva and Martins, Multibody Syst. Dyn. 25 (2011) 357-375."""
    return 8 * (1 - restitution) / (5 * restitution)


def hu_guo(restitution: float) -> float:
    """chi of Hu and Guo, Int. J. Mech. Sci. 103 (2015) 107-113."""
    return 3 * (1 - restitution) / (2 * restitution)


def carvalho_martins(restitution: float) -> float:
    """chi of Carvalho and Martins, Mech. Mach. Theory 137 (2019) 359-371."""
    return 1.5 * (1 - restitution) * (11 - restitution) / (1 + 9 * restitution)


def exact_restitution(restitution: float) -> float:
    """chi that gives exactly the configured restitution: the root of the closed form between 0 and
    1/e."""
    highest = math.nextafter(1 / restitution, 0)
    # the law of Lankarani and Nikravesh always gives a larger restitution, so the root lies above
    # its chi
    lowest = lankarani_nikravesh(restitution)
    return _root(lambda damping: _closed_form(damping, restitution), lowest, highest)


def delivered_restitution(damping: float) -> float:
    """Effective coefficient of restitution of a free impact with chi = `damping` >= 0."""
    if damping == 0:
        return 1.0
    highest = min(1.0, math.nextafter(1 / damping, 0))
    return _root(lambda restitution: _closed_form(damping, restitution), 0.0, highest)


def _closed_form(damping: float, restitution: float) -> float:
    """chi (1 + e) - ln((1 + chi) / (1 - chi e)): decreasing through zero at the root in either
    argument."""
    return _excess(damping) - _excess(-damping * restitution)


def _excess(number: float) -> float:
    """z - ln(1 + z), to full relative precision for small z too."""
    if abs(number) > 0.05:
        return number - math.log1p(number)
    return sum((-number) ** power / power for power in range(2, 14))


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Zero of a decreasing `function` between `low` and `high`, by bisection to machine
    precision."""
    while low < (middle := (low + high) / 2) < high:
        low, high = (middle, high) if function(middle) > 0 else (low, middle)
    return low


LAWS: dict[str, Callable[[float], float]] = {
    law.__name__: law
    for law in (
        hunt_crossley,
        lankarani_nikravesh,
        lee_wang,
        herbert_mcwhannell,
        gonthier,
        zhiying_qishao,
        flores,
        hu_guo,
        carvalho_martins,
        exact_restitution,
    )
}
"""Dissipation laws by name: configured restitution, between 0 and 1 -> chi."""


def penalty_restitution(
    stiffness: float,
    exponent: float,
    penalty_damping: float,
    penalty_depth: float,
    mass: float,
    speed: float,
) -> float:
    """Coefficient of restitution of a free impact with the penalty form."""
    # dimensionless: depth over that of the elastic impact, speed over approach speed
    scale = ((exponent + 1) * mass * speed**2 / (2 * stiffness)) ** (1 / (exponent + 1))
    damping, step_depth = penalty_damping * scale / (mass * speed), penalty_depth / scale

    def force(depth, rate):
        inside = max(depth, 0.0)
        return (exponent + 1) / 2 * inside**exponent + smooth_step(
            inside, 0.0, 0.0, step_depth, damping
        ) * rate

    def surface(_, state):
        return state[0]

    def pull(_, state):
        return force(*state)

    surface.terminal = pull.terminal = True
    surface.direction = pull.direction = -1

    def pushed(start, *ends):
        """Integrate from `start` to the first of `ends`; strong damping makes this stiff."""

        def slope(_, state):
            return state[1], -force(*state)

        return solve_ivp(
            slope, (0.0, math.inf), start, "Radau", events=ends, rtol=1e-10, atol=1e-12
        )

    impact = pushed((0.0, 1.0), surface, pull)
    depth, rate = impact.y[:, -1]
    if depth < 1e-9 or exponent >= 2:
        return float(-rate)
    # At zero force the mass leaves the surface. For n < 2 the spring exceeds the damping, which is
    # proportional to d^2, again near the surface: at a depth between the one where c(d) <= 3 c_max
    # (d / d_max)^2 makes the spring larger, and the one where K d^n / c(d) is smallest.
    low = 0.5 * ((exponent + 1) / 2 * step_depth**2 / (3 * damping * -rate)) ** (1 / (2 - exponent))
    high = min(depth, step_depth * 3 * (2 - exponent) / (6 - 2 * exponent))
    back = brentq(force, low, high, args=(rate,), xtol=1e-15)
    return float(-pushed((back, rate), surface).y[1, -1])


def elastic_duration(stiffness: float, exponent: float, mass: float, speed: float) -> float:
    """Duration [s] of an elastic impact."""
    power = 1 / (exponent + 1)
    depth = ((exponent + 1) * mass * speed**2 / (2 * stiffness)) ** power
    return 2 * math.sqrt(math.pi) * math.gamma(1 + power) / math.gamma(0.5 + power) * depth / speed


@compiled
def smooth_step(x, x0, y0, x1, y1):
    """Cubic step with zero slope at both ends: y0 below x0, y1 above x1 > x0."""
    if x <= x0:
        return y0
    if x >= x1:
        return y1
    share = (x - x0) / (x1 - x0)
    return y0 + (y1 - y0) * share * share * (3.0 - 2.0 * share)


@compiled
def elastic_force(penetration, stiffness, exponent):
    """K d^n [N]; 0 for d <= 0."""
    if penetration <= 0.0:
        return 0.0
    if exponent == 1.5:
        return stiffness * penetration * math.sqrt(penetration)
    return stiffness * penetration**exponent


@inlined
def damping_factor_at(joint, approach, begin, time) -> float:
    """chi / d'_0 [s/m] of a contact, faded after its memory."""
    fading = time - begin - joint.memory_time
    if fading >= joint.fading_time:
        return joint.steady_contact_damping
    published = joint.damping / approach
    if not fading > 0.0:
        return published
    # Ninth order: four continuous derivatives at both ends, enough for steps of a fifth-order
    # method.
    share = fading / joint.fading_time
    bend = 126.0 - share * (420.0 - share * (540.0 - share * (315.0 - share * 70.0)))
    return published + (joint.steady_contact_damping - published) * share**5 * bend


@inlined
def force_free_speed(joint, approach, begin, time) -> tuple:
    """Parting speed at zero contact force, 1 / `damping_factor_at`, and its time derivative.

    Arguments as in `damping_factor_at`.
    """
    fading = time - begin - joint.memory_time
    if not fading > 0.0:
        return approach / joint.damping, 0.0
    if fading >= joint.fading_time:
        return 1.0 / joint.steady_contact_damping, 0.0
    share = fading / joint.fading_time
    change = joint.steady_contact_damping - joint.damping / approach
    rate = change * 630.0 * (share * (1.0 - share)) ** 4 / joint.fading_time
    speed = 1.0 / damping_factor_at(joint, approach, begin, time)
    return speed, -rate * speed * speed


@compiled
def normal_force(joint, penetration, rate, damping_factor):
    """Contact force [N]; the caller ends a contact, by an event, before the force becomes
    attractive."""
    elastic = elastic_force(penetration, joint.stiffness, joint.exponent)
    if joint.penalty_damping > 0.0:
        return (
            elastic
            + smooth_step(penetration, 0.0, 0.0, joint.penalty_depth, joint.penalty_damping) * rate
        )
    return elastic * (1.0 + damping_factor * rate)


@compiled
def pushing_margin(joint, penetration, rate, curvature, free_speed, free_rate):
    """Distance of a contact from pulling: positive for a repulsive force, zero at zero force."""
    if joint.penalty_damping > 0.0:
        if penetration <= 0.0:
            return PULL_FAR_OFF, 0.0
        elastic = elastic_force(penetration, joint.stiffness, joint.exponent)
        balance = elastic / smooth_step(
            penetration, 0.0, 0.0, joint.penalty_depth, joint.penalty_damping
        )
        if (
            not balance < PULL_FAR_OFF
        ):  # c(d) ~ d^2: for n < 2 the quotient diverges as d goes to zero
            return PULL_FAR_OFF, 0.0
        power = joint.exponent  # reduced by d/c dc/dd in this branch
        share = penetration / joint.penalty_depth
        if share < 1.0:
            power -= 6.0 * (1.0 - share) / (3.0 - 2.0 * share)
        return rate + balance, curvature + rate * balance * power / penetration
    if joint.damping == 0.0:
        return 1.0, 0.0
    return rate + free_speed, curvature + free_rate


_SMALL = 0.3
_TERMS = range(2, 18)
_ALONG = tuple((-1) ** k * (4 * k - 4) / (4 * k * k - 1) for k in _TERMS)
_ACROSS = tuple((-1) ** k * (2 * k - 2) / (2 * k + 1) for k in _TERMS)


@compiled
def film_integrals(a, b, s):
    """I_w and I_n of the module's text for an eccentricity (a, b) of length < 1, s = sqrt(1 - a^2 -
    b^2)."""
    if a < -s / _SMALL:
        # for small eccentricities almost equal terms cancel: use the power series of the difference
        inverse = -1.0 / a
        square = (s * inverse) ** 2
        along = across = 0.0
        for i in range(len(_ALONG) - 1, -1, -1):
            along = along * square + _ALONG[i]
            across = across * square + _ACROSS[i]
        cube = inverse * inverse * inverse
        return along * cube, across * cube * inverse * b
    inverse = 1.0 / (s * s)
    angle = math.atan2(s, -a) / s
    along = inverse * (3.0 * a * inverse + angle * (1.0 + 3.0 * a * a * inverse))
    across = b * inverse * inverse * (2.0 + a * a / (1.0 - b * b) + 3.0 * a * angle)
    return along, across


@compiled
def film_force(joint, ex, ey, vx, vy, body_rate, partner_rate):
    """Force and moments of the oil film on the two bodies of a joint.

    The pair of forces acts halfway between the centres, which conserves angular momentum. In
    addition the couple of the shear in the whole film acts, 2 pi mu R^3 L / (c sqrt(1 - eps^2))
    times the difference of the rates. Beyond the eccentricity of dry contact the film thickness is
    constant.
    """
    if joint.film_viscosity == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    radius = joint.partner_radius if joint.side < 0.0 else joint.body_radius
    c = joint.film_clearance
    scale = 1.0 / c
    square = (ex * ex + ey * ey) * scale * scale
    widest = 1.0 - joint.film_least * scale
    if square > widest * widest:
        scale *= widest / math.sqrt(square)
        square = widest * widest
    s = math.sqrt(1.0 - square)

    mean_rate = 0.5 * (body_rate + partner_rate)
    wx, wy = vx + mean_rate * ey, vy - mean_rate * ex
    speed = math.sqrt(wx * wx + wy * wy)
    fx, fy = 0.0, 0.0
    if speed > 0.0:
        nx, ny = wx / speed, wy / speed
        along, across = film_integrals((ex * nx + ey * ny) * scale, (ey * nx - ex * ny) * scale, s)
        strength = -joint.film_viscosity * radius * joint.film_length**3 / (c * c * c) * speed
        fx = strength * (along * nx - across * ny)
        fy = strength * (along * ny + across * nx)

    couple = 0.5 * (ey * fx - ex * fy)
    shear = (
        2.0
        * math.pi
        * joint.film_viscosity
        * radius**3
        * joint.film_length
        / (c * s)
        * (body_rate - partner_rate)
    )
    return fx, fy, couple - shear, couple + shear
