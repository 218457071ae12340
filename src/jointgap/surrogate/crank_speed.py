"""The crank's speed over its angle: what turns derivatives by the angle into time derivatives."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import CubicHermiteSpline


@dataclass(frozen=True)
class CrankSpeed:
    """Speed of the crank as a smooth function of its angle."""

    angle: np.ndarray  # shape (n,); crank angles [rad], rising
    speed: np.ndarray  # shape (n,); speed there [rad/s] and its derivative by the angle [1/s]
    slope: np.ndarray  # shape (n,); speed there [rad/s] and its derivative by the angle [1/s]

    @classmethod
    def constant(cls, speed: float) -> "CrankSpeed":
        """One speed [rad/s] at every angle."""
        return cls(np.array([0.0, 1.0]), np.full(2, speed), np.zeros(2))

    @classmethod
    def of(cls, trajectory: pd.DataFrame) -> "CrankSpeed":
        """The speed that the columns crank_speed and crank_acceleration of a trajectory give."""
        angle, speed, acceleration = (
            trajectory[f"crank_{name}"].to_numpy(dtype=float) for name in ("angle", "speed", "acceleration")
        )
        if np.all(speed == speed[0]) and not acceleration.any():
            return cls.constant(float(speed[0]))
        return cls(angle, speed, acceleration / speed)

    @property
    def if_constant(self) -> float | None:
        """The one speed [rad/s]; None where it changes."""
        same = np.all(self.speed == self.speed[0]) and not self.slope.any()
        return float(self.speed[0]) if same else None

    @property
    def mean(self) -> float:
        """Mean over the angle [rad/s]."""
        return float(np.trapezoid(self.speed, self.angle) / (self.angle[-1] - self.angle[0]))

    def __call__(self, crank_angle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Speed and its first two derivatives by the angle, shape (n,) each, at crank angles (n,) [rad]."""
        spline = CubicHermiteSpline(self.angle, self.speed, self.slope)
        return spline(crank_angle), spline(crank_angle, 1), spline(crank_angle, 2)
