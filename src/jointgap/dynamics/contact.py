"""Normal contact of a journal in its bearing: stiffness, dissipation, force.

The force is F = K d^n (1 + chi d'/d'_0) with the penetration d, its rate d' and the approach speed d'_0 at the start
of the contact; it never pulls. A law says which chi belongs to a coefficient of restitution e. What a body then really
rebounds with follows from the closed form of the impact, whatever K, n and the masses are:

    chi (1 + e) = ln((1 + chi) / (1 - chi e))
"""

import math
from collections.abc import Callable

from jointgap.config import LooseJoint
from jointgap.dynamics.compiled import compiled


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
    """chi of Gonthier et al., Multibody Syst. Dyn. 11 (2004) 209-233, in its approximate closed form."""
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
    """chi that delivers the restitution asked for: the root of the closed form between 0 and 1/e."""
    highest = math.nextafter(1 / restitution, 0)
    # Lankarani and Nikravesh always deliver more than is asked for, so that the root lies above their chi.
    lowest = lankarani_nikravesh(restitution)
    return _root(lambda damping: _closed_form(damping, restitution), lowest, highest)


def delivered_restitution(damping: float) -> float:
    """Coefficient of restitution that a free impact with chi = `damping` >= 0 really delivers."""
    if damping == 0:
        return 1.0
    highest = min(1.0, math.nextafter(1 / damping, 0))
    return _root(lambda restitution: _closed_form(damping, restitution), 0.0, highest)


def _closed_form(damping: float, restitution: float) -> float:
    """chi (1 + e) - ln((1 + chi) / (1 - chi e)): falls through zero at the root in either argument."""
    return _excess(damping) - _excess(-damping * restitution)


def _excess(number: float) -> float:
    """z - ln(1 + z), to full relative precision for small z too."""
    if abs(number) > 0.05:
        return number - math.log1p(number)
    return sum((-number) ** power / power for power in range(2, 14))


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where `function` falls through zero between `low` and `high`, by bisection to the last digit."""
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
"""Dissipation laws by name: restitution asked for, between 0 and 1 -> chi."""


def hertz_stiffness(joint: LooseJoint) -> float:
    """K [N/m^1.5] of a journal in a bearing of the same material; conforming contact of Hertz."""
    material = (1 - joint.contact.poisson_ratio**2) / joint.contact.youngs_modulus
    return 4 / (3 * 2 * material) * math.sqrt(joint.bearing_radius * joint.journal_radius / joint.clearance)


@compiled
def elastic_force(penetration, stiffness, exponent):
    """K d^n [N]; 0 for d <= 0."""
    if penetration <= 0.0:
        return 0.0
    if exponent == 1.5:
        return stiffness * penetration * math.sqrt(penetration)
    return stiffness * penetration**exponent


@compiled
def normal_force(penetration, rate, hysteresis, stiffness, exponent):
    """K d^n (1 + h d') [N] with h = chi / d'_0 [s/m]; that it never pulls is the caller's to see to, as an event."""
    return elastic_force(penetration, stiffness, exponent) * (1.0 + hysteresis * rate)
