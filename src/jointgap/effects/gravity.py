"""Weight of the bodies."""

from jointgap.effects.base import Candidates, Effect, FitContext, TrialContext, TrialSize, amplitude, page, parameter


@page(order=10)
class Gravity(Effect):
    """Weight of all bodies along the mechanism's gravity_direction."""

    GROUP = "bodies"
    SITE = "all bodies"
    LAW = "F = m g along gravity_direction, each body"
    REFERENCE = "3rd Conférence générale des poids et mesures (1901)"
    WORDS = "the weight of the bodies"
    OPTIONAL = True
    PARAMETERS = {
        "acceleration_m_s2": parameter("m/s^2", "g, acceleration of free fall", 9.80665, default=9.80665, ge=0, le=15),
    }

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        yield cls.candidate(amplitude("acceleration_m_s2", 0.5, "m/s^2", 0.0, 15.0))

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        return TrialSize.of("acceleration_m_s2", 5.0, 15.0)
