"""A nonlinear spring on the slider, the family of the linear one."""

from collections.abc import Callable

from jointgap.core.candidates import LawFamily, Parameter
from jointgap.effects.base import Effect, FitContext, Values, page, parameter

_LEAST_SHARE, _LARGEST_SHARE = -0.5, 1.0
"""Of the cubic part: at -1/2 the stiffness falls to nothing at the distance h from rest, at 1 it does so at rest."""

_SHARES_IN_USE = (-0.5, 0.0, 0.5, 1.0)


@page(order=75)
class SliderNonlinearSpring(Effect):
    """A spring between frame and slider that softens or hardens with its stretch: the family of the linear spring.

    No candidate by itself: the share of its cubic part is fitted once a linear spring is found.
    """

    GROUP = "slider"
    SITE = "slider"
    LAW = "F = -k [(1 - c) (x - x0) + c (x - x0)^3 / h^2]"
    REFERENCE = "Duffing, Erzwungene Schwingungen bei veränderlicher Eigenfrequenz (1918)"
    WORDS = "a spring on the slider"
    COMPILED = {
        "nonlinear_spring": "stiffness_N_m",
        "nonlinear_spring_rest": "rest_position_m",
        "nonlinear_spring_length": "length_m",
        "nonlinear_spring_share": "cubic_share",
    }
    MEMBERS = {"slider_spring": 0.0}
    PARAMETERS = {
        "stiffness_N_m": parameter("N/m", "k, force per length at the distance h from x0", 2000.0, ge=0),
        "rest_position_m": parameter("m", "x0, position of the slider without force", 0.56),
        "length_m": parameter("m", "h, distance from x0 at which the force is k h", 0.15, gt=0),
        "cubic_share": parameter(
            "", "c, share of the cubic part, below 0 softening", 1.0, ge=_LEAST_SHARE, le=_LARGEST_SHARE
        ),
    }

    @classmethod
    def family_of(
        cls, coordinates: tuple[Parameter, ...], linear: Callable[[Values], dict[str, float]], context: FitContext
    ) -> LawFamily:
        """The family of a linear spring in the `context` of a fit.

        It is varied by the same `coordinates`, of which `linear` makes stiffness and rest position.
        """
        own, half_stroke = cls.MEMBERS["slider_spring"], context.scale.stroke
        law = cls.candidate(
            *coordinates,
            Parameter("cubic_share", own, _LEAST_SHARE, _LARGEST_SHARE, 0.1),
            amplitudes=tuple(coordinate.key for coordinate in coordinates),
            parameters=lambda values: {**linear(values), "length_m": half_stroke, "cubic_share": values["cubic_share"]},
        )
        return LawFamily(law, "cubic_share", own, _SHARES_IN_USE, dict)
