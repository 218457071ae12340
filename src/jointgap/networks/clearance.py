"""One network per joint for the clearance vector."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import comb

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import cho_solve_banded, cholesky_banded

from jointgap.config import Surrogate
from jointgap.core import joints
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.networks.errors import Grid, Points, error_frame, error_rows, refined
from jointgap.networks.network import BIAS, Scaling
from jointgap.paper.printed import reference_mse

KINDS = {"r": 0, "gamma": 0, "gamma_dot": 1, "gamma_ddot": 2, "r_dot": 1, "r_ddot": 2}
"""Outputs of a joint's network: order of the derivative by kind."""
PER_HELD_OUT = 2  # training samples per held-out sample, everywhere
MISSED_OF_CLEARANCE = (
    0.3  # interpolation error, over the allowed error, above which a sample is added
)


def crank_speed(trajectory: pd.DataFrame) -> CubicHermiteSpline:
    """Crank speed [rad/s] over the crank angle [rad]."""
    angle, speed, acceleration = (
        trajectory[f"crank_{name}"] for name in ("angle", "speed", "acceleration")
    )
    return CubicHermiteSpline(angle, speed, acceleration / speed)


def constant_speed(speed: float) -> CubicHermiteSpline:
    return CubicHermiteSpline([0.0, 1.0], [speed, speed], [0.0, 0.0])


def column(kind: str, joint: int) -> str:
    """Column of the trajectory: r2_dot for kind r_dot and joint 2."""
    quantity, dot, dots = kind.partition("_")
    return f"{quantity}{joint}{dot}{dots}"


@dataclass(frozen=True)
class Samples:
    """Training data of a joint's network, at n increasing crank angles."""

    crank_angle: np.ndarray  # shape (n,)
    values: dict[
        str, np.ndarray
    ]  # shape (n,); by kind: r, gamma and their derivatives by the crank angle
    simulated: dict[str, np.ndarray]  # shape (n,); the same with derivatives by time, as simulated
    scales: dict[str, float]  # Allowed errors

    @property
    def shares(self) -> np.ndarray:
        """Share of the revolution represented by each sample, (n,): samples are dense where the
        motion is fast."""
        widths = np.gradient(self.crank_angle)
        return widths / widths.sum()

    @classmethod
    def of(
        cls, trajectory: pd.DataFrame, fine: pd.DataFrame, joint: int, training_points: int
    ) -> "Samples":
        """Samples of the first revolution of `fine` that are not in `trajectory`."""
        angle = fine["crank_angle"].to_numpy()
        fine = fine[angle - angle[0] <= 2.0 * np.pi * (1.0 + 1e-9)]
        angle, speed, acceleration = (
            fine[f"crank_{name}"].to_numpy() for name in ("angle", "speed", "acceleration")
        )
        ratio = int(np.round(np.diff(trajectory["crank_angle"][:2])[0] / (angle[1] - angle[0])))
        simulated = {kind: fine[column(kind, joint)].to_numpy() for kind in KINDS}
        scales = {}
        for kind, order in KINDS.items():
            name = column(kind, joint)
            spread = Scaling.of(Grid.of(trajectory, name, training_points).training.values).range
            allowed = reference_mse(name if name in joints.outputs(JOINT_NUMBERS) else f"r{joint}")
            scales[kind] = spread * allowed**0.5 / float(speed.mean()) ** order
        values = dict(simulated)
        for quantity in ("r", "gamma"):
            rate = values[f"{quantity}_dot"] = simulated[f"{quantity}_dot"] / speed
            values[f"{quantity}_ddot"] = (
                simulated[f"{quantity}_ddot"] - rate * acceleration
            ) / speed**2
        table = np.column_stack([values[kind] / scale for kind, scale in scales.items()])
        usable = np.isfinite(table).all(axis=1)
        usable[::ratio] = False
        step = ratio // PER_HELD_OUT
        first = np.arange(step // 2, len(angle), step)
        kept = refined(angle, table, first[usable[first]], usable, MISSED_OF_CLEARANCE)
        chosen = ({kind: row[kept] for kind, row in rows.items()} for rows in (values, simulated))
        return cls(angle[kept], *chosen, scales)


REACH = 19.0  # [widths] distance beyond which tanh is 1 in double precision
# length of a block [distances of neurons]: short enough to skip zeros, long enough for fast
# products
BLOCK = 16


@dataclass(frozen=True)
class Block:
    """Points with the same nonzero basis functions."""

    points: slice
    functions: slice
    values: list[np.ndarray]


@dataclass(frozen=True)
class Layer:
    """Centres and widths of the neurons."""

    centres: np.ndarray  # shape (H,); zeros of the neurons' sums, increasing
    widths: np.ndarray  # shape (H,); inverse of each neuron's input weight

    @property
    def functions(self) -> int:
        """Number of basis functions, H + 1."""
        return len(self.centres) + 1

    def from_tansig(self, weights: np.ndarray, bias: complex) -> np.ndarray:
        """Weights of the basis functions from the neurons' output weights, shape (H,), and the
        output's bias."""
        steps = np.concatenate([[0.0], np.cumsum(2.0 * weights)])
        return bias - steps[-1] / 2.0 + steps

    @staticmethod
    def to_tansig(basis_weights: np.ndarray) -> tuple[np.ndarray, complex]:
        """The neurons' output weights, shape (H,), and the output's bias."""
        return np.diff(basis_weights) / 2.0, (basis_weights[0] + basis_weights[-1]) / 2.0

    def blocks(self, points: np.ndarray, orders: int) -> Iterator[Block]:
        """Increasing points in blocks, each with its nonzero basis functions."""
        begins = np.concatenate([[-np.inf], self.centres - REACH * self.widths])
        ends = np.concatenate([self.centres + REACH * self.widths, [np.inf]])
        begins = np.minimum.accumulate(begins[::-1])[::-1]
        ends = np.maximum.accumulate(ends)
        inner = self.centres[(self.centres > points[0]) & (self.centres < points[-1])][BLOCK::BLOCK]
        cuts = np.concatenate([[0], np.searchsorted(points, inner), [len(points)]])
        for first, last in pairwise(cuts):
            if last > first:
                low = int(np.searchsorted(ends, points[first]))
                high = int(np.searchsorted(begins, points[last - 1], side="right"))
                values = self._values(points[first:last], low, high, orders)
                yield Block(slice(first, last), slice(low, high), values)

    def _values(self, points: np.ndarray, low: int, high: int, orders: int) -> list[np.ndarray]:
        neurons = slice(max(low - 1, 0), min(high, len(self.centres)))
        inverse = 1.0 / self.widths[neurons]
        t = np.tanh((points[:, None] - self.centres[neurons]) * inverse)
        f = 1.0 - t * t
        tansig = [t, f * inverse, -2.0 * t * f * inverse**2, f * (6.0 * t * t - 2.0) * inverse**3][
            :orders
        ]
        differences = []
        for order, values in enumerate(tansig):
            end = np.full((len(points), 1), 0.0 if order else 1.0)
            sides = (
                ([end] if low == 0 else []) + [values] + ([-end] if high == self.functions else [])
            )
            values = np.concatenate(sides, axis=1)
            differences.append((values[:, :-1] - values[:, 1:]) / 2.0)
        return differences


SETTLING = np.radians(6.0)  # order of the time to the first impact; the exact value does not matter


@dataclass(frozen=True)
class ClearanceNetwork:
    """Clearance vector of one joint as a function of the crank angle."""

    joint: int  # 1 crank pivot, 2 crank pin, 3 piston pin
    layer: Layer  # Neurons over the crank angle [rad]
    weights: np.ndarray  # shape (H,); output weights of the neurons, x + i y [m]
    bias: complex
    start_angle: float  # Crank angle at the start [rad]
    settling: float  # Width of the factor s [rad]; infinite for s = 1
    speed: CubicHermiteSpline  # Speed of the crank over its angle
    turns: int = 0  # Whole turns to add to gamma, for continuity with the simulation

    @cached_property
    def _basis_weights(self) -> np.ndarray:
        return self.layer.from_tansig(self.weights, self.bias)

    @cached_property
    def _gamma(self) -> tuple[np.ndarray, np.ndarray]:
        """Gamma over the crank angle, dense enough to unwrap."""
        centres = self.layer.centres
        grid = np.linspace(centres[:-1], centres[1:], 4, endpoint=False, axis=-1).ravel()
        grid = np.concatenate([[self.start_angle], grid[grid > self.start_angle]])
        return grid, np.unwrap(np.angle(self.vector(grid, 1)[0])) + 2.0 * np.pi * self.turns

    def vector(self, crank_angle: np.ndarray, orders: int = 4) -> list[np.ndarray]:
        """w and its derivatives by the crank angle, complex arrays of shape (n,) for angles of
        shape (n,)."""
        order = np.argsort(crank_angle, kind="stable")
        derivatives = [np.empty(len(crank_angle), complex) for _ in range(orders)]
        for block in self.layer.blocks(crank_angle[order], orders):
            for result, values in zip(derivatives, block.values, strict=True):
                result[order[block.points]] = values @ self._basis_weights[block.functions]
        return derivatives

    def polar(self, crank_angle: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """r and gamma, each as [value, first, second, third derivative by the crank angle], shape
        (n,) each.

        Both are finite everywhere; at r = 0 gamma is its limit.
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
        s = start_factor(crank_angle, self.start_angle, self.settling)
        r = [sum(comb(n, k) * s[k] * size[n - k] for k in range(n + 1)) for n in range(4)]
        return r, [gamma, q1.imag, q2.imag, q3.imag]

    def output(self, name: str, crank_angle: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """An output (r, gamma, gamma_dot, gamma_ddot) and its derivative by the crank angle, in SI,
        shaped as `crank_angle`.
        """
        angle = np.asarray(crank_angle, dtype=float)
        r, gamma = self.polar(angle.ravel())
        w, w1, w2 = (self.speed(angle.ravel(), order) for order in range(3))
        by_kind = {
            "r": lambda: (r[0], r[1]),
            "gamma": lambda: (gamma[0], gamma[1]),
            "gamma_dot": lambda: (gamma[1] * w, gamma[2] * w + gamma[1] * w1),
            "gamma_ddot": lambda: (
                gamma[2] * w**2 + gamma[1] * w * w1,
                gamma[3] * w**2 + 3.0 * gamma[2] * w * w1 + gamma[1] * (w1**2 + w * w2),
            ),
        }
        return tuple(
            values.reshape(angle.shape) for values in by_kind[name.replace(str(self.joint), "")]()
        )

    def to_frame(self) -> pd.DataFrame:
        """Long form, one row per neuron and one for the bias: rows of the table clearance_fit."""
        weights, is_constant = np.append(self.weights, self.bias), not self.speed.c[:-1].any()
        return pd.DataFrame(
            {
                "joint": self.joint,
                "neuron": [*range(len(self.weights)), BIAS],
                "centre": np.append(self.layer.centres, np.nan),
                "width": np.append(self.layer.widths, np.nan),
                "weight_x": weights.real,
                "weight_y": weights.imag,
                "start_angle": self.start_angle,
                "settling": self.settling if np.isfinite(self.settling) else np.nan,
                "speed": self.speed.c[-1, 0] if is_constant else np.nan,
                "turns": self.turns,
            }
        )

    @classmethod
    def from_frame(
        cls, frame: pd.DataFrame, joint: int, speed: CubicHermiteSpline | None = None
    ) -> "ClearanceNetwork":
        """The network of a joint from the long form; `speed` is required where it is not
        constant."""
        rows = frame[frame["joint"] == joint]
        *_, last = rows.itertuples()
        neurons = rows[:-1]
        return cls(
            joint,
            Layer(neurons["centre"].to_numpy(), neurons["width"].to_numpy()),
            neurons["weight_x"].to_numpy() + 1j * neurons["weight_y"].to_numpy(),
            complex(last.weight_x, last.weight_y),
            float(last.start_angle),
            np.inf if np.isnan(last.settling) else float(last.settling),
            speed if np.isnan(last.speed) else constant_speed(float(last.speed)),
            int(last.turns),
        )


def start_factor(crank_angle: np.ndarray, start_angle: float, settling: float) -> list[np.ndarray]:
    """s = tanh^2((angle - start) / settling), its three derivatives by the angle; 1, 0, 0, 0 if
    settling is infinite.
    """
    if np.isinf(settling):
        return [np.full(len(crank_angle), value) for value in (1.0, 0.0, 0.0, 0.0)]
    t = np.tanh((crank_angle - start_angle) / settling)
    f = 1.0 - t * t
    by_u = (t * t, 2.0 * t * f, 2.0 * f * f - 4.0 * t * t * f, 8.0 * t**3 * f - 16.0 * t * f * f)
    return [values / settling**n for n, values in enumerate(by_u)]


FIRST_DISTANCE = np.radians(
    0.5
)  # of the initial neurons: half a period of the contact's oscillation
WIDTH = 2.5  # of a neuron, in distances to its neighbours
MARGIN = 8  # additional neurons beyond either end
SHARE = 0.1  # of the paper's mean square errors, at which training stops
ROUNDS = 16
RIDGE = 1e-13  # relative; compensated by iterative refinement
PASSES = 2


@dataclass(frozen=True)
class JointFit:
    """The trained network of one joint."""

    network: ClearanceNetwork
    samples: Samples
    rounds: int  # Linear problems solved
    stop: str  # Stopping criterion


@dataclass(frozen=True)
class ClearanceFit:
    """The second surrogate: networks of the loose joints, and their errors at the trajectory's
    samples."""

    joints: dict[int, JointFit]
    trajectory: pd.DataFrame
    training_points: int

    def weights(self) -> pd.DataFrame:
        """The table clearance_fit."""
        return pd.concat(
            [fit.network.to_frame() for fit in self.joints.values()], ignore_index=True
        )

    def errors(self) -> pd.DataFrame:
        """The table fit_errors; the trajectory's samples are held out, except the paper's training
        points."""
        rows = []
        for joint, fit in self.joints.items():
            network, samples = fit.network, fit.samples
            trained = {"model": "clearance", "seed": None, "weights": 2 * network.layer.functions}
            trained |= {"iterations": fit.rounds, "stop": fit.stop}
            for kind in ("r", "gamma", "gamma_dot", "gamma_ddot"):
                name = column(kind, joint)
                grid = Grid.of(self.trajectory, name, self.training_points)
                points = Points(samples.crank_angle, samples.simulated[kind])
                rows += error_rows(
                    grid, lambda at, of=network, name=name: of.output(name, at)[0], points, trained
                )
        return error_frame(rows)


def train_clearance(
    trajectory: pd.DataFrame, fine: pd.DataFrame, options: Surrogate, loose: Iterable[str]
) -> ClearanceFit:
    """Train the second surrogate."""
    start, speed, joints = float(fine["crank_angle"].iloc[0]), crank_speed(trajectory), {}
    for joint in (JOINT_NUMBERS[name] for name in loose):
        r = fine[f"r{joint}"].to_numpy()
        settling = SETTLING if r[0] < 1e-9 * r.max() else np.inf
        samples = Samples.of(trajectory, fine, joint, options.training_points)
        joints[joint] = grow(samples, joint, start, speed, settling)
    return ClearanceFit(joints, trajectory, options.training_points)


def grow(
    samples: Samples, joint: int, start_angle: float, speed: CubicHermiteSpline, settling: float
) -> JointFit:
    """Train the network of one joint, adding neurons until the errors are small."""
    angle, gamma, margin = samples.crank_angle, samples.values["gamma"], MARGIN * FIRST_DISTANCE
    centres = np.arange(angle[0] - margin, angle[-1] + margin, FIRST_DISTANCE)
    for rounds in range(1, ROUNDS + 1):
        layer = Layer(centres, WIDTH * np.gradient(centres))
        weights = _solve(layer, samples, start_factor(angle, start_angle, settling))
        network = ClearanceNetwork(
            joint, layer, *Layer.to_tansig(weights), start_angle, settling, speed
        )
        last = network.polar(angle[-1:])[1][0][0]
        network = replace(network, turns=int(np.round((gamma[-1] - last) / (2.0 * np.pi))))
        squares = _squared_errors(network, samples)
        if all(np.sum(samples.shares * square) <= SHARE for square in squares):
            return JointFit(
                network, samples, rounds, f"training errors at {SHARE:g} of the paper's or below"
            )
        finer = _finer(centres, samples, squares)
        if len(finer) == len(centres):
            return JointFit(
                network, samples, rounds, "neurons as dense as the samples; increase the sampling"
            )
        centres = finer
    return JointFit(network, samples, ROUNDS, f"{ROUNDS} rounds; training errors still decreasing")


def _solve(layer: Layer, samples: Samples, start: list[np.ndarray]) -> np.ndarray:
    """Weights of the basis functions, complex (H + 1,): banded normal equations, refined with the
    true residual."""
    blocks = list(layer.blocks(samples.crank_angle, 3))
    rows = _Rows(layer, samples, start)
    band = 2 * max(block.functions.stop - block.functions.start for block in blocks)
    normal = np.zeros((band, 2 * layer.functions))
    for block in blocks:
        matrix, _ = rows.of(block)
        product = matrix.T @ matrix
        first, size = 2 * block.functions.start, len(product)
        for offset in range(size):
            normal[: size - offset, first + offset] += product[offset:, offset]
    normal[0] *= 1.0 + RIDGE
    factor = cholesky_banded(normal, overwrite_ab=True, lower=True, check_finite=False), True
    solution = np.zeros(2 * layer.functions)
    for _ in range(PASSES):
        right = np.zeros_like(solution)
        for block in blocks:
            matrix, targets = rows.of(block)
            part = slice(2 * block.functions.start, 2 * block.functions.stop)
            right[part] += matrix.T @ (targets - matrix @ solution[part])
        solution += cho_solve_banded(factor, right, check_finite=False)
    return solution[0::2] + 1j * solution[1::2]


class _Rows:
    """Rows of the least-squares problem; unknowns: real and imaginary part of each basis function's
    weight in turn."""

    def __init__(self, layer: Layer, samples: Samples, start: list[np.ndarray]):
        self._values = values = samples.values
        s, s1, s2, _ = start
        ratio, curvature = values["r_dot"] / values["r"], values["r_ddot"] / values["r"]
        w = values["r"] / s * np.exp(1j * values["gamma"])
        q1 = ratio + 1j * values["gamma_dot"] - s1 / s
        q2 = curvature - ratio**2 + 1j * values["gamma_ddot"] - s2 / s + (s1 / s) ** 2
        self._columns = [
            each[:, None] for each in (w, q1, q2 + q1**2, values["r"], ratio, curvature)
        ]
        # Weights of position and rate are at least those implied by the second derivative between
        # two neurons; without them a common shift of the fine neurons is almost unobservable and
        # the problem ill-conditioned.
        distance = np.interp(samples.crank_angle, layer.centres, np.gradient(layer.centres))
        self._precision = {}
        for kind, scale in samples.scales.items():
            second = samples.scales["r_ddot" if kind.startswith("r") else "gamma_ddot"]
            implied = distance ** (KINDS[kind] - 2) / second
            self._precision[kind] = np.maximum(1.0 / scale, implied) * np.sqrt(samples.shares)

    def of(self, block: Block) -> tuple[np.ndarray, np.ndarray]:
        """Matrix (6 points, 2 functions) and targets (6 points,)."""
        at = block.points
        value, first, second = block.values
        w, q1, w2, r, ratio, curvature = (column[at] for column in self._columns)
        log0 = value / w  # derivatives of log w and of its derivatives by each weight
        log1 = first / w - q1 * log0
        log2 = second / w - w2 * log0 - 2.0 * q1 * log1
        parts = {
            "r": r * log0,
            "r_dot": r * (ratio * log0 + log1),
            "r_ddot": r * (curvature * log0 + 2.0 * ratio * log1 + log2),
            "gamma": log0,
            "gamma_dot": log1,
            "gamma_ddot": log2,
        }
        points, functions = value.shape
        matrix = np.empty((len(parts), points, functions, 2))
        targets = np.zeros((len(parts), points))
        for index, (kind, change) in enumerate(parts.items()):
            precision, is_real = self._precision[kind][at, None], kind.startswith("r")
            matrix[index, :, :, 0] = precision * (change.real if is_real else change.imag)
            matrix[index, :, :, 1] = precision * (-change.imag if is_real else change.real)
            if is_real:  # the imaginary parts of the derivatives of w vanish
                targets[index] = precision[:, 0] * self._values[kind][at]
        return matrix.reshape(-1, 2 * functions), targets.ravel()


def _squared_errors(network: ClearanceNetwork, samples: Samples) -> list[np.ndarray]:
    """Squared errors of r, gamma and gamma's derivatives at the samples, over the allowed squared
    errors."""
    r, gamma = network.polar(samples.crank_angle)
    outputs = {"r": r[0], "gamma": gamma[0], "gamma_dot": gamma[1], "gamma_ddot": gamma[2]}
    errors = {kind: values - samples.values[kind] for kind, values in outputs.items()}
    errors["gamma"] = (
        np.remainder(errors["gamma"] + np.pi, 2.0 * np.pi) - np.pi
    )  # a coarse network may lose a turn
    return [(error / samples.scales[kind]) ** 2 for kind, error in errors.items()]


def _finer(centres: np.ndarray, samples: Samples, squares: list[np.ndarray]) -> np.ndarray:
    """Centres with the distances halved where the error exceeds its average share.

    Intervals without two samples are not halved; neighbouring distances differ at most twofold.
    """
    intervals = len(centres) - 1
    place = np.clip(np.searchsorted(centres, samples.crank_angle) - 1, 0, intervals - 1)
    split = np.zeros(intervals, bool)
    for square in squares:
        split |= (
            np.bincount(place, samples.shares * square, minlength=intervals) > SHARE / intervals
        )
    split = (np.convolve(split, np.ones(5), "same") > 0.5) & (
        np.bincount(place, minlength=intervals) >= 2
    )
    distances = np.diff(centres)
    while True:
        after = np.where(split, distances / 2.0, distances)
        low = np.minimum(np.r_[np.inf, after[:-1]], np.r_[after[1:], np.inf])
        coarse = ~split & (after > 2.1 * low)
        if not coarse.any():
            break
        split |= coarse
    return np.sort(np.concatenate([centres, (centres[:-1] + centres[1:])[split] / 2.0]))
