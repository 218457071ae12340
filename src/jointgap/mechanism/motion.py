"""A quantity with its first two time derivatives, and the vector that two such quantities make."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Motion:
    """A quantity over time."""

    position: np.ndarray  # The quantity and its first two time derivatives, of shapes that broadcast
    velocity: np.ndarray  # The quantity and its first two time derivatives, of shapes that broadcast
    acceleration: np.ndarray  # The quantity and its first two time derivatives, of shapes that broadcast

    @classmethod
    def of(cls, position: ArrayLike, velocity: ArrayLike = 0.0, acceleration: ArrayLike = 0.0) -> "Motion":
        """Make arrays of what is given; what is left out stands still."""
        return cls(np.asarray(position), np.asarray(velocity), np.asarray(acceleration))

    def __add__(self, other: "Motion") -> "Motion":
        return Motion(
            self.position + other.position,
            self.velocity + other.velocity,
            self.acceleration + other.acceleration,
        )

    def __sub__(self, other: "Motion") -> "Motion":
        return self + other * -1.0

    def __mul__(self, factor: float) -> "Motion":
        return Motion(self.position * factor, self.velocity * factor, self.acceleration * factor)

    def standing_still(self) -> "Motion":
        """The same positions with both derivatives set to zero."""
        still = np.zeros(np.shape(self.position))
        return Motion(self.position, still, still)


def rotating_vector(length: Motion, direction: Motion) -> tuple[Motion, Motion]:
    """Components of a vector that turns and changes its length.

    A vector of length zero is the zero vector, whatever its direction; its derivatives are undefined (nan) where the
    direction is.
    """
    cosine, sine = np.cos(direction.position), np.sin(direction.position)
    vanishes = length.position == 0.0
    radial_velocity = length.velocity
    tangential_velocity = length.position * direction.velocity
    radial_acceleration = length.acceleration - length.position * direction.velocity**2
    tangential_acceleration = length.position * direction.acceleration + 2.0 * length.velocity * direction.velocity
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
