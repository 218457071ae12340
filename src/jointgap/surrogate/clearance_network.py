"""The second surrogate: one network per joint for the clearance vector, and all outputs from it.

The paper's eight networks know nothing of each other. Here one network per joint, a wide layer of tansig neurons with
one complex output w(crank angle), gives the clearance vector as a complex number,

    z = r exp(i gamma) = s w,    s = tanh^2((angle - start) / settling),

and r, gamma and all their derivatives follow by calculus: they cannot contradict each other. The clearance vector is
as smooth as the motion even where gamma turns quickly because r is small. The factor s takes out the one point where
gamma is undefined: at the start z grows like the square of the angle, w does not, and gamma is the direction of w.
(Where a motion does not start with coincident centres, s is 1.)
"""

from dataclasses import dataclass
from math import comb

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jointgap.errors import did_you_mean
from jointgap.surrogate.crank_speed import CrankSpeed
from jointgap.surrogate.tanh_basis import DERIVATIVES, Layer

BIAS = -1
SETTLING = np.radians(6.0)  # about where the first impact comes; any width of this order does


@dataclass(frozen=True)
class ClearanceNetwork:
    """Clearance vector of one joint as a function of the crank angle."""

    joint: int  # 1 crank pivot, 2 crank pin, 3 piston pin
    layer: Layer  # Neurons over the crank angle [rad]
    weights: np.ndarray  # shape (H,); output weights of the neurons, x + i y [m]
    bias: complex
    start_angle: float  # Crank angle at the start [rad]
    settling: float  # Width of the factor s [rad]; infinite where s is 1
    speed: CrankSpeed  # Speed of the crank over its angle
    turns: int = 0  # Whole turns to add to gamma, so that it continues the simulation's

    def __post_init__(self):
        object.__setattr__(self, "_basis_weights", self.layer.from_tansig(self.weights, self.bias))
        centres = self.layer.centres
        grid = np.linspace(centres[:-1], centres[1:], 4, endpoint=False, axis=-1).ravel()
        grid = np.concatenate([[self.start_angle], grid[grid > self.start_angle]])
        gamma = np.unwrap(np.angle(self.vector(grid, 1)[0])) + 2.0 * np.pi * self.turns
        object.__setattr__(self, "_gamma", (grid, gamma))

    def vector(self, crank_angle: np.ndarray, orders: int = DERIVATIVES + 1) -> list[np.ndarray]:
        """w and its derivatives by the crank angle, complex arrays of shape (n,) for angles of shape (n,)."""
        order = np.argsort(crank_angle, kind="stable")
        derivatives = [np.empty(len(crank_angle), complex) for _ in range(orders)]
        for block in self.layer.blocks(crank_angle[order], orders):
            for result, values in zip(derivatives, block.values, strict=True):
                result[order[block.points]] = values @ self._basis_weights[block.functions]
        return derivatives

    def polar(self, crank_angle: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """r and gamma, each as [value, first, second, third derivative by the crank angle], shape (n,) each.

        Both are finite everywhere; where r is 0 gamma is its limit.
        """
        w, *derivatives = self.vector(crank_angle)
        ratios = [derivative / w for derivative in derivatives]
        q1 = ratios[0]  # derivatives of log w
        q2 = ratios[1] - q1**2
        q3 = ratios[2] - q1 * (q1**2 + 3.0 * q2)
        gamma = np.angle(w)
        expected = np.interp(crank_angle, *self._gamma)
        gamma += 2.0 * np.pi * np.round((expected - gamma) / (2.0 * np.pi))
        p1, p2, p3 = q1.real, q2.real, q3.real
        size = [factor * np.abs(w) for factor in (1.0, p1, p1**2 + p2, p1**3 + 3.0 * p1 * p2 + p3)]
        s = self._start(crank_angle)
        r = [sum(comb(n, k) * s[k] * size[n - k] for k in range(n + 1)) for n in range(4)]
        return r, [gamma, q1.imag, q2.imag, q3.imag]

    def output(self, name: str, crank_angle: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """One of the joint's four outputs and its derivative by the crank angle, in SI, of the shape of
        `crank_angle`.
        """
        names = {f"r{self.joint}": 0, **{f"gamma{self.joint}{dots}": n for n, dots in enumerate(("", "_dot", "_ddot"))}}
        if name not in names:
            raise ValueError(f"the network of joint {self.joint} has no output '{name}'; {did_you_mean(name, names)}")
        angle = np.asarray(crank_angle, dtype=float)
        r, gamma = self.polar(angle.ravel())
        n = names[name]
        value_and_slope = (r if name.startswith("r") else gamma)[:2]
        if n > 0:
            w, w1, w2 = self.speed(angle.ravel())
            value_and_slope = [gamma[1] * w, gamma[2] * w + gamma[1] * w1]
        if n > 1:
            second = gamma[3] * w**2 + 3.0 * gamma[2] * w * w1 + gamma[1] * (w1**2 + w * w2)
            value_and_slope = [gamma[2] * w**2 + gamma[1] * w * w1, second]
        return tuple(values.reshape(angle.shape) for values in value_and_slope)

    def _start(self, crank_angle: np.ndarray) -> list[np.ndarray]:
        return start_factor(crank_angle, self.start_angle, self.settling)

    def to_frame(self) -> pd.DataFrame:
        """Long form, one row per neuron and one for the bias: rows of the table clearance_fit."""
        neurons = len(self.weights)
        weights = np.append(self.weights, self.bias)
        return pd.DataFrame(
            {
                "joint": self.joint,
                "neuron": [*range(neurons), BIAS],
                "centre": np.append(self.layer.centres, np.nan),
                "width": np.append(self.layer.widths, np.nan),
                "weight_x": weights.real,
                "weight_y": weights.imag,
                "start_angle": self.start_angle,
                "settling": self.settling if np.isfinite(self.settling) else np.nan,
                "speed": np.nan if self.speed.if_constant is None else self.speed.if_constant,
                "turns": self.turns,
            }
        )

    @classmethod
    def from_frame(cls, frame: pd.DataFrame, joint: int, speed: CrankSpeed | None = None) -> "ClearanceNetwork":
        """The network of a joint from the long form; `speed` is needed where it is not constant."""
        rows = frame[frame["joint"] == joint]
        neurons, bias = rows[rows["neuron"] != BIAS].sort_values("neuron"), rows[rows["neuron"] == BIAS]
        if neurons.empty or len(bias) != 1:
            raise ValueError(f"no network of joint {joint} in the table")
        (last,) = bias.itertuples()
        return cls(
            joint,
            Layer(neurons["centre"].to_numpy(), neurons["width"].to_numpy()),
            neurons["weight_x"].to_numpy() + 1j * neurons["weight_y"].to_numpy(),
            complex(last.weight_x, last.weight_y),
            float(last.start_angle),
            np.inf if np.isnan(last.settling) else float(last.settling),
            speed if np.isnan(last.speed) else CrankSpeed.constant(float(last.speed)),
            int(last.turns),
        )


def start_factor(crank_angle: np.ndarray, start_angle: float, settling: float) -> list[np.ndarray]:
    """s = tanh^2((angle - start) / settling), its three derivatives by the angle; 1, 0, 0, 0 if settling is
    infinite.
    """
    if np.isinf(settling):
        return [np.full(len(crank_angle), value) for value in (1.0, 0.0, 0.0, 0.0)]
    t = np.tanh((crank_angle - start_angle) / settling)
    f = 1.0 - t * t
    by_u = (t * t, 2.0 * t * f, 2.0 * f * f - 4.0 * t * t * f, 8.0 * t**3 * f - 16.0 * t * f * f)
    return [values / settling**n for n, values in enumerate(by_u)]
