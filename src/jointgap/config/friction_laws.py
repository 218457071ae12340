"""The friction laws by name and the parameters they read: the one list that configuration and simulation share.

The laws themselves, as functions of the sliding speed, stand in `jointgap.dynamics.friction`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

BRISTLE_ACCELERATION = 1e4
"""[m/s^2] Default bristle_damping is critical for a body pressed on with this force per mass (1 kN on 0.1 kg)."""


@dataclass(frozen=True)
class FrictionLaw:
    """A friction law.

    Attributes
    ----------
    code : int
        What `JointParameters.friction_law` holds in the compiled equations.
    reads : tuple of str
        Keys of `FRICTION_PARAMETERS` that it reads beyond friction and friction_speed.
    slope_at_zero : float or None
        Of the coefficient over friction and of the speed over friction_speed; two laws with the same friction and with
        friction_speed proportional to this rise alike at the start. None where static friction, a dead band or
        bristles set the rise.
    """

    code: int
    reads: tuple[str, ...] = ()
    slope_at_zero: float | None = None


FRICTION_LAWS: Mapping[str, FrictionLaw] = MappingProxyType(
    {
        "coulomb": FrictionLaw(0, slope_at_zero=1.0),
        "threlfall": FrictionLaw(1, slope_at_zero=3.0),
        "ambrosio": FrictionLaw(2, ("dead_band_speed",)),
        "bengisu_akay": FrictionLaw(3, ("static_friction", "stribeck_speed")),
        "lugre": FrictionLaw(
            4, ("static_friction", "stribeck_speed", "viscous_friction", "bristle_stiffness", "bristle_damping")
        ),
    }
)


@dataclass(frozen=True)
class FrictionParameter:
    """A parameter that not every law reads.

    Attributes
    ----------
    meaning : str
        With its unit where that is no speed.
    default : callable
        Its default [SI] from the parameters before it in `FRICTION_PARAMETERS`, friction and friction_speed.
    default_in_words : str
    """

    meaning: str
    default: Callable[[Mapping[str, float]], float]
    default_in_words: str


FRICTION_PARAMETERS: Mapping[str, FrictionParameter] = MappingProxyType(
    {
        "dead_band_speed": FrictionParameter(
            "no friction below it, full friction above friction_speed",
            lambda before: 0.1 * before["friction_speed"],
            "a tenth of friction_speed",
        ),
        "static_friction": FrictionParameter(
            "coefficient of static friction", lambda before: before["friction"], "as friction"
        ),
        # Friction has fallen from its static to its kinetic value some times above 0.01 m/s.
        "stribeck_speed": FrictionParameter(
            "speed over which static friction falls to kinetic", lambda _: 0.01, "0.01 m/s"
        ),
        "viscous_friction": FrictionParameter(
            "sigma_2 in s/m, coefficient of friction per sliding speed", lambda _: 0.0, "0"
        ),
        # Friction 0.1 is reached after a micrometre, the size of asperities.
        "bristle_stiffness": FrictionParameter("sigma_0 in 1/m, per normal force", lambda _: 1e5, "1e5 1/m"),
        "bristle_damping": FrictionParameter(
            "sigma_1 in s/m, per normal force",
            lambda before: 2 * math.sqrt(before["bristle_stiffness"] / BRISTLE_ACCELERATION),
            "critical, 2 sqrt(bristle_stiffness / 1e4 m/s^2)",
        ),
    }
)


def laws_reading(parameter: str) -> tuple[str, ...]:
    """Names of the laws that read a key of `FRICTION_PARAMETERS`."""
    return tuple(name for name, law in FRICTION_LAWS.items() if parameter in law.reads)


def described(parameter: str) -> str:
    """What a key of `FRICTION_PARAMETERS` means, for which laws, and its default."""
    entry = FRICTION_PARAMETERS[parameter]
    return f"{', '.join(laws_reading(parameter))}: {entry.meaning}; null: {entry.default_in_words}"
