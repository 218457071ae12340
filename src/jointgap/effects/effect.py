"""What all effects have in common."""

from typing import ClassVar

from jointgap.section import Section

SLIDER_SIGN_SPEED = 0.01
"""Width [m/s] of the sign of the slider's velocity in its friction: sgn v = tanh(v / 0.01 m/s)."""

CRANK_SIGN_SPEED = 0.1
"""Width [rad/s] of the sign of a speed of rotation in friction: sgn w = tanh(w / 0.1 rad/s)."""

SLIDER_SIGN = f"sgn v = tanh(v / {SLIDER_SIGN_SPEED:g} m/s)"
CRANK_SIGN = f"sgn w = tanh(w / {CRANK_SIGN_SPEED:g} rad/s)"

FRICTION_SURVEY = "Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083-1138"


class Effect(Section):
    """A physical effect beyond contact and friction in the joints; off unless it is listed.

    In the laws v and x are the slider's velocity and position, w is the crank's speed and theta its angle, t is time.

    Attributes
    ----------
    SITE : str
        Where it acts; a choice is in the effect's own key ``site``.
    LAW, REFERENCE : str
        Its equation in the symbols that the parameters' descriptions name, and where that stands, or ``definition``.
    """

    SITE: ClassVar[str]
    LAW: ClassVar[str]
    REFERENCE: ClassVar[str]

    @property
    def place(self) -> str:
        """The one place at which it acts here: its site, or the one chosen where there is a choice."""
        return getattr(self, "site", self.SITE)
