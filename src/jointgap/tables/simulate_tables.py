"""Tables of the stage simulate."""

from collections.abc import Iterable

from jointgap.core.joints import JOINT_NUMBERS, PINS
from jointgap.tables.columns import Column, Table

TRAJECTORY = Table(
    "trajectory",
    "Motion of the slider-crank at samples uniform in crank angle",
    "jointgap.dynamics.sampling:COLUMNS",  # they stand with the compiled code that fills them
    path="simulate/trajectory.parquet",
)

EVENTS = Table(
    "events",
    "Beginnings and ends of contact in the joints",
    (
        Column("time", "s", "time since the start"),
        Column("crank_angle", "rad", "crank angle theta2, running on over revolutions"),
        Column("joint", "", "crank_pin, piston_pin or crank_pivot", "text"),
        Column("event", "", "impact (contact begins) or separation (contact ends)", "text"),
        Column(
            "approach_speed",
            "m/s",
            "speed of approach along the normal at an impact; null at a separation",
            nullable=True,
        ),
        Column(
            "impulse", "N*s", "impulse of the normal force over the contact that ends; null at an impact", nullable=True
        ),
        Column(
            "peak_force",
            "N",
            "largest normal force of the contact that ends, at the points of the integration (up to 0.1 % below the "
            "true peak); null at an impact",
            nullable=True,
        ),
        Column("duration", "s", "time that the contact lasted which ends; null at an impact", nullable=True),
        Column("maxima", "1", "maxima of the penetration in the contact that ends; null at an impact", nullable=True),
    ),
    path="simulate/events.parquet",
)

_LEARNED = ("r", "gamma", "gamma_dot", "gamma_ddot")


def outputs(loose: Iterable[str]) -> tuple[str, ...]:
    """What networks learn of the joints `loose`, by column of the trajectory, in the paper's order."""
    numbers = sorted(JOINT_NUMBERS[joint] for joint in loose)
    return tuple(
        f"{quantity}{number}{'_' * bool(dots)}{dots}"
        for quantity, _, dots in (kind.partition("_") for kind in _LEARNED)
        for number in numbers
    )


def number_of(output: str) -> int:
    """Number of the joint that an output belongs to: 2 for gamma2_dot."""
    return int(output.partition("_")[0][-1])


OUTPUTS = outputs(PINS)
"""The eight outputs of the paper, whose pins are loose."""
