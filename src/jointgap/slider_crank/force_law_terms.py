"""Terms of which a force law on nobody's list may be made, as candidates for `jointgap.identification.force_law`.

The formulas are those of `jointgap.formula`: v, x of the slider, w, theta of the crank. Positions count from
mid-stroke, so that odd and even powers are told apart; the sign of v has the width that the slider's friction has. The
slider's acceleration is no variable of a formula: a force in proportion to it is the effect ``added_slider_mass``.
"""

import numpy as np

from jointgap.effects.base import SLIDER_SIGN_SPEED, MotionScale
from jointgap.identification.protocol import Candidate, Parameter
from jointgap.slider_crank.model import SliderCrankModel


def library(model: SliderCrankModel) -> tuple[Candidate, ...]:
    """One candidate for each term of a force on the slider and of a torque on the crank."""
    mean_speed = float(np.mean([plan.samples.speed for plan in model.plans.values()]))
    scale = MotionScale.of(model.campaign.mechanism, mean_speed)
    stroke, speed, turning = scale.stroke, scale.speed, scale.turning
    y = f"(x - {scale.middle!r})"
    sign = f"tanh(v/{SLIDER_SIGN_SPEED!r})"
    slider = {
        "1": 1.0,
        "v": speed,
        "|v|": speed,
        sign: 1.0,
        "v*|v|": speed**2,
        "v^3": speed**3,
        y: stroke,
        f"{y}^3": stroke**3,
        f"|{y}|": stroke,
        "cos(theta)": 1.0,
        "sin(theta)": 1.0,
        f"{y}*v": stroke * speed,
        f"{y}*|v|": stroke * speed,
        f"{y}*{sign}": stroke,
        "v*cos(theta)": speed,
        "v*sin(theta)": speed,
    }
    crank = {
        "1": 1.0,
        "w": turning,
        "w*|w|": turning**2,
        "cos(theta)": 1.0,
        "sin(theta)": 1.0,
        "cos(2*theta)": 1.0,
        "sin(2*theta)": 1.0,
    }
    torque = scale.force * stroke
    return (
        *(_term("discovered_slider_force", "slider", text, scale.force / size) for text, size in slider.items()),
        *(_term("discovered_crank_torque", "crank", text, torque / size) for text, size in crank.items()),
    )


def _term(effect: str, site: str, text: str, step: float) -> Candidate:
    coefficient = Parameter("coefficient", 0.0, step=step)
    return Candidate(f"{effect}[{text}]", site, (coefficient,), ("coefficient",))
