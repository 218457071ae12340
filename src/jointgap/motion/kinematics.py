"""Kinematics of the slider-crank: linkage, clearance vectors, transmission angle, cycle."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jointgap.config import Mechanism
from jointgap.core.errors import InputError
from jointgap.core.joints import JOINT_NUMBERS

__all__ = [
    "ClearanceMotion",
    "Fit",
    "IdealCycle",
    "LinkageMotion",
    "Motion",
    "clearance_lift",
    "ideal_cycle",
    "linkage_motion",
    "rotating_vector",
    "transmission_angle",
]


@dataclass(frozen=True)
class Motion:
    """A quantity with its first two time derivatives, of shapes that broadcast."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    @classmethod
    def of(
        cls, position: ArrayLike, velocity: ArrayLike = 0.0, acceleration: ArrayLike = 0.0
    ) -> "Motion":
        """From array-likes; derivatives are zero by default."""
        return cls(np.asarray(position), np.asarray(velocity), np.asarray(acceleration))

    def __add__(self, other: "Motion") -> "Motion":
        position, velocity = self.position + other.position, self.velocity + other.velocity
        return Motion(position, velocity, self.acceleration + other.acceleration)

    def __sub__(self, other: "Motion") -> "Motion":
        return self + other * -1.0

    def __mul__(self, factor: float) -> "Motion":
        return Motion(self.position * factor, self.velocity * factor, self.acceleration * factor)

    def standing_still(self) -> "Motion":
        """The same positions with zero derivatives."""
        still = np.zeros(np.shape(self.position))
        return Motion(self.position, still, still)


def rotating_vector(length: Motion, direction: Motion) -> tuple[Motion, Motion]:
    """Components of a vector of variable length and direction.

    A vector of length zero is the zero vector; its derivatives are undefined (nan) where the
    direction is.
    """
    cosine, sine = np.cos(direction.position), np.sin(direction.position)
    vanishes = length.position == 0.0
    radial_velocity = length.velocity
    tangential_velocity = length.position * direction.velocity
    radial_acceleration = length.acceleration - length.position * direction.velocity**2
    tangential_acceleration = (
        length.position * direction.acceleration + 2.0 * length.velocity * direction.velocity
    )
    x = Motion(
        np.where(vanishes, 0.0, length.position * cosine),
        radial_velocity * cosine - tangential_velocity * sine,
        radial_acceleration * cosine - tangential_acceleration * sine,
    )
    y = Motion(
        np.where(vanishes, 0.0, length.position * sine),
        radial_velocity * sine + tangential_velocity * cosine,
        radial_acceleration * sine + tangential_acceleration * cosine,
    )
    return x, y


_SIGNS = {1: 1.0, 2: 1.0, 3: -1.0}


def clearance_lift(vectors: Mapping[str, ArrayLike]) -> np.ndarray:
    """Contribution of the clearances to the height that the rod spans."""
    lift = np.zeros(())
    for number, sign in _SIGNS.items():
        if (name := f"r{number}") in vectors:
            length = np.asarray(vectors[name])
            lift = lift + sign * np.where(
                length == 0.0, 0.0, length * np.sin(vectors[f"gamma{number}"])
            )
    return lift


def transmission_angle(
    crank_length: ArrayLike,
    rod_length: ArrayLike,
    crank_angle: ArrayLike,
    lift: ArrayLike = 0.0,
    offset: float = 0.0,
) -> np.ndarray:
    """Angle between the rod and the direction across the slide."""
    cosine = (crank_length * np.sin(crank_angle) + lift - offset) / rod_length
    check_reach(cosine, crank_angle, rod_length)
    return np.arccos(cosine)


def check_reach(cosine: np.ndarray, crank_angle: ArrayLike, rod_length: ArrayLike) -> None:
    """InputError where the height to span is at least one rod length; undefined samples are
    accepted."""
    span = np.abs(cosine)
    if not np.any(span >= 1.0):
        return
    worst = np.unravel_index(np.nanargmax(span), span.shape)
    angle = np.real(np.broadcast_to(crank_angle, span.shape)[worst])
    length = np.broadcast_to(rod_length, span.shape)[worst]
    raise InputError(
        f"the rod of {1e3 * length:g} mm does not reach the slide at crank angle"
        f" {np.degrees(angle):.4g} deg: its crank end is {1e3 * length * span[worst]:.6g} mm from"
        " the slide's line; shorten the crank or lengthen the rod"
    )


Fit = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""A surrogate: from crank angles (n,) [rad] to values (n,) in SI and their derivative by the crank
angle (n,)."""


_NOTHING = Motion.of(0.0)


@dataclass(frozen=True)
class ClearanceMotion:
    """The virtual links of the loose joints: lengths [m] and directions from +x [rad], shape (n,);
    zero for ideal joints.

    r1 at gamma1 points from the frame's centre of the crank pivot to the crank's, r2 at gamma2 from
    the crank's pin centre A to the rod's end A', r3 at gamma3 from the slider's pin centre B to the
    rod's end B'. Directions are nan where the length is zero.
    """

    r2: Motion = _NOTHING
    gamma2: Motion = _NOTHING
    r3: Motion = _NOTHING
    gamma3: Motion = _NOTHING
    r1: Motion = _NOTHING
    gamma1: Motion = _NOTHING

    @classmethod
    def from_table(cls, table: pd.DataFrame, loose: Iterable[str]) -> "ClearanceMotion":
        """From the columns ``r2, r2_dot, r2_ddot, gamma2, ... gamma2_ddot`` etc. for the joints
        `loose`."""

        def motion(name: str) -> Motion:
            return Motion.of(
                *(
                    table[f"{name}{suffix}"].to_numpy(dtype=float)
                    for suffix in ("", "_dot", "_ddot")
                )
            )

        names = [
            f"{quantity}{JOINT_NUMBERS[joint]}" for joint in loose for quantity in ("r", "gamma")
        ]
        return cls(**{name: motion(name) for name in names})

    def paper_form(self) -> "ClearanceMotion":
        """The motion in equations (6)-(9): constant lengths, variable directions."""
        return replace(
            self, **{name: getattr(self, name).standing_still() for name in ("r1", "r2", "r3")}
        )

    def crank_pivot_vector(self) -> tuple[Motion, Motion]:
        """Components of the vector from the frame's centre of the crank pivot to the crank's, shape
        (n,) each [m]."""
        return rotating_vector(self.r1, self.gamma1)

    def crank_pin_vector(self) -> tuple[Motion, Motion]:
        """Components of A -> A', shape (n,) each [m]."""
        return rotating_vector(self.r2, self.gamma2)

    def piston_pin_vector(self) -> tuple[Motion, Motion]:
        """Components of B -> B', shape (n,) each [m]."""
        return rotating_vector(self.r3, self.gamma3)


@dataclass(frozen=True)
class LinkageMotion:
    """Motion of the three moving links; all arrays have the shape (n,) of the crank angles."""

    crank_x: (
        Motion  # Crank's mass centre G2 [m], equation (2), with the clearance of the crank pivot
    )
    crank_y: Motion
    rod_x: Motion  # Rod's mass centre G3 [m], equations (3), (14)
    rod_y: Motion
    slider_x: Motion  # Slider's pin centre G4 [m], equations (4), (15)
    slider_y: Motion  # The slide's offset up to rounding
    rod_angle: Motion  # theta3 [rad], equations (5), (8), (9)
    transmission_angle: Motion  # mu [rad], equation (10)


def linkage_motion(
    mechanism: Mechanism, crank_angle: Motion, clearance: ClearanceMotion | None = None
) -> LinkageMotion:
    """Motion of the slider-crank from that of its crank and its clearances."""
    crank, rod = mechanism.crank, mechanism.rod
    pin_x, pin_y = rotating_vector(Motion.of(crank.length), crank_angle)
    crank_x, crank_y = rotating_vector(Motion.of(crank.mass_centre), crank_angle)
    beside_x, beside_y = rotating_vector(
        Motion.of(crank.mass_centre_across), crank_angle
    )  # turned by 90 deg
    clearance = ClearanceMotion() if clearance is None else clearance
    pivot_x, pivot_y = clearance.crank_pivot_vector()
    step_x, step_y = clearance.crank_pin_vector()
    head_x, head_y = clearance.piston_pin_vector()
    foot_x, foot_y = pivot_x + pin_x + step_x, pivot_y + pin_y + step_y

    # The slider stays on its line: the height of the rod's foot minus the vector B -> B' determines
    # the rod's angle.
    height = foot_y - head_y - Motion.of(mechanism.slider.offset)
    rod_angle = _falling_rod(height, rod.length, crank_angle.position)
    rod_length = Motion.of(rod.length)
    along_x, along_y = rotating_vector(rod_length, rod_angle)
    centre_x, centre_y = rotating_vector(Motion.of(rod.mass_centre), rod_angle)
    return LinkageMotion(
        crank_x=pivot_x + crank_x - beside_y,
        crank_y=pivot_y + crank_y + beside_x,
        rod_x=foot_x + centre_x,
        rod_y=foot_y + centre_y,
        slider_x=foot_x + along_x - head_x,
        slider_y=foot_y + along_y - head_y,
        rod_angle=rod_angle,
        transmission_angle=Motion(
            np.arccos(height.position / rod.length), rod_angle.velocity, rod_angle.acceleration
        ),
    )


def _falling_rod(height: Motion, rod_length: float, crank_angle: np.ndarray) -> Motion:
    """Angle of a rod that spans a negative height: L3 sin theta3 = -height, differentiated
    twice."""
    check_reach(height.position / rod_length, crank_angle, rod_length)
    angle = np.arcsin(-height.position / rod_length)
    lever = rod_length * np.cos(angle)
    velocity = -height.velocity / lever
    return Motion(angle, velocity, -height.acceleration / lever + velocity**2 * np.tan(angle))


@dataclass(frozen=True)
class IdealCycle:
    """Extremes over one turn of the crank, without clearance."""

    smallest_transmission_angle: float  # Of mu and its supplement [rad]
    largest_departure: float  # Of mu from 90 deg [rad]
    outer_dead_centre: float  # Largest slider position [m]
    inner_dead_centre: float  # Smallest slider position [m]
    outer_dead_centre_angle: float  # Crank angle [rad]
    inner_dead_centre_angle: float  # Crank angle [rad]

    @property
    def stroke(self) -> float:
        """Distance of the dead centres [m]."""
        return self.outer_dead_centre - self.inner_dead_centre


def ideal_cycle(crank_length: float, rod_length: float, offset: float = 0.0) -> IdealCycle:
    """Extremes of transmission angle and slider position in closed form, from equations (15) and
    (17)."""
    span = crank_length + abs(offset)
    if span >= rod_length:
        raise InputError(
            f"a crank of {1e3 * crank_length:g} mm with offset {1e3 * offset:g} mm cannot turn with"
            f" a rod of {1e3 * rod_length:g} mm; shorten the crank or lengthen the rod"
        )
    departure = float(np.arcsin(span / rod_length))
    return IdealCycle(
        smallest_transmission_angle=np.pi / 2 - departure,
        largest_departure=departure,
        outer_dead_centre=float(np.sqrt((rod_length + crank_length) ** 2 - offset**2)),
        inner_dead_centre=float(np.sqrt((rod_length - crank_length) ** 2 - offset**2)),
        outer_dead_centre_angle=float(np.arcsin(offset / (rod_length + crank_length))),
        inner_dead_centre_angle=float(np.pi + np.arcsin(offset / (rod_length - crank_length))),
    )
