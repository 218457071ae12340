"""Candidate effects of the pendulum; their laws are in the step of `examples.pendulum.model`.

Three faults of the torque reading are indistinguishable from other effects and no candidates: a
gain scales inertia, gravity torque and all friction; a zero error is a constant torque; a lag is a
negative delay.
"""

import math

from jointgap.core.candidates import Candidate, Parameter

GEAR_RATIO = 6  # so the rotor turns six times as fast as the pendulum


def _one(
    name: str, coordinate: str, step: float, unit: str, low: float = 0.0, high=math.inf, **more
) -> Candidate:
    return Candidate(
        name, "pivot", (Parameter(coordinate, 0.0, low, high, step, unit),), (coordinate,), **more
    )


CANDIDATES = (
    _one("coulomb_friction", "torque_Nm", 0.005, "N*m"),
    # Share of the motor torque, as friction in the gear.
    _one("load_friction", "share", 0.005, "1", high=0.9),
    # Friction that decays with speed. Above 1 rad/s it would be the same as Coulomb friction.
    Candidate(
        "starting_friction",
        "pivot",
        (
            Parameter("torque_Nm", 0.0, 0.0, step=0.01, unit="N*m"),
            Parameter("speed_rad_s", 0.3, 0.05, 1.0, step=0.05, unit="rad/s"),
        ),
        ("torque_Nm",),
        ({"speed_rad_s": 0.1}, {"speed_rad_s": 0.5}),
    ),
    _one("quadratic_drag", "drag_Nm_s2", 1e-3, "N*m*s**2"),
    _one("constant_torque", "torque_Nm", 0.005, "N*m", low=-math.inf),
    Candidate(
        "rotor_torque",
        "pivot",
        tuple(Parameter(part, 0.0, step=0.01, unit="N*m") for part in ("cosine_Nm", "sine_Nm")),
        ("cosine_Nm", "sine_Nm"),
    ),
    _one("encoder_offset", "angle_rad", 2e-3, "rad", low=-0.2, high=0.2, sensor=True),
    _one("torque_delay", "delay_s", 5e-4, "s", low=-0.02, high=0.02, sensor=True),
)
