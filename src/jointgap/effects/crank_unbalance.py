"""An unbalance of the crank."""

import math

from jointgap.effects.base import (
    Candidates,
    Effect,
    FitContext,
    Records,
    TrialContext,
    TrialSize,
    amplitude,
    from_cosine_and_sine,
    page,
    parameter,
)


@page(order=130)
class CrankUnbalance(Effect):
    """A mass on the crank beyond nominal.

    It sits at the crank's length from the pivot, so that U / crank.length is its mass and U crank.length its inertia.
    Frame forces, gravity and a motor's drive show it.
    """

    GROUP = "crank"
    SITE = "crank"
    LAW = "mass U / crank.length, crank.length from the pivot"
    REFERENCE = "ISO 21940-2:2017, rotor balancing, vocabulary"
    WORDS = "an unbalance of the crank"
    PARAMETERS = {
        "unbalance_kg_m": parameter("kg*m", "U, mass times distance from the pivot", 0.005, ge=0),
        "angle_rad": parameter("rad", "its direction, from the crank's own", 1.0, default=0.0),
    }

    def compile_into(self, records: Records) -> None:
        bodies, unbalance, angle = records["bodies"], self.parameters.unbalance_kg_m, self.parameters.angle_rad
        bodies["crank_mass"] += unbalance / bodies["crank_length"]
        bodies["crank_moment_x"] += unbalance * math.cos(angle)
        bodies["crank_moment_y"] += unbalance * math.sin(angle)
        bodies["crank_inertia"] += unbalance * bodies["crank_length"]

    def mirrored(self) -> Effect:
        return self.with_parameters(angle_rad=-self.parameters.angle_rad)

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        step = context.scale.force / context.scale.turning**2
        yield cls.candidate(
            amplitude("cosine", step, "kg*m"),
            amplitude("sine", step, "kg*m"),
            parameters=lambda values: from_cosine_and_sine("unbalance_kg_m", "angle_rad", values),
        )

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        angle = float(context.rng.uniform(-math.pi, math.pi))
        return TrialSize.of("unbalance_kg_m", 0.1 * context.rig.force / context.rig.speed**2, 1.0, angle_rad=angle)
