"""Training of the second surrogate: linear least squares, neurons added where the outputs need them.

The outputs' errors are linear in the network's weights as long as they are small: with the simulation's w, w', w'' at
a sample, d(log w) = dw/w, d(w'/w) = dw'/w - (w'/w) dw/w and so on, whose imaginary parts are the errors of gamma,
gamma' and gamma'', and whose real parts with r those of r, r' and r''. So one linear least-squares problem asks for
what counts, each error in units of what is allowed, and nothing is left to chance: no seed, no iteration to watch.

Neurons start evenly spaced. Where an output's training error is above its share the distance is halved, and the
problem is solved again, until all training errors are a given fraction of the paper's. Samples held out are not looked
at.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.linalg import cho_solve_banded, cholesky_banded

from jointgap.config import Surrogate
from jointgap.joints import JOINT_NUMBERS
from jointgap.surrogate.clearance_network import SETTLING, ClearanceNetwork, start_factor
from jointgap.surrogate.crank_speed import CrankSpeed
from jointgap.surrogate.fit_errors import Grid, Points, Trained, error_frame, error_rows
from jointgap.surrogate.tanh_basis import Block, Layer
from jointgap.surrogate.training_samples import ORDERS, Samples, column

FIRST_DISTANCE = np.radians(0.5)  # of neurons, before any is added; half a period of the contact's ringing
WIDTH = 2.5  # of a neuron, in distances to its neighbours
MARGIN = 8  # neurons past either end, so that the ends are as well covered as the middle
SHARE = 0.1  # of the paper's mean square errors, at which training stops
ROUNDS = 16
RIDGE = 1e-13  # relative; undone by the refinement of the solution
PASSES = 2


@dataclass(frozen=True)
class JointFit:
    """The network of one joint and how it came about."""

    network: ClearanceNetwork
    samples: Samples
    rounds: int  # Linear problems solved
    stop: str  # Why no more neurons were added


@dataclass(frozen=True)
class ClearanceFit:
    """The second surrogate: networks of the loose joints, and their errors over the trajectory's samples."""

    joints: dict[int, JointFit]
    trajectory: pd.DataFrame
    training_points: int

    def weights(self) -> pd.DataFrame:
        """Frame of the table clearance_fit."""
        return pd.concat([fit.network.to_frame() for fit in self.joints.values()], ignore_index=True)

    def errors(self) -> pd.DataFrame:
        """Frame of the table fit_errors: all outputs, held out at every sample of the trajectory between the paper's
        training points."""
        rows = []
        for joint, fit in self.joints.items():
            network, samples = fit.network, fit.samples
            trained = Trained("clearance", None, 2 * network.layer.functions, fit.rounds, fit.stop)
            for kind in ("r", "gamma", "gamma_dot", "gamma_ddot"):
                name = column(kind, joint)
                rows += error_rows(
                    Grid.of(self.trajectory, name, self.training_points),
                    lambda angle, name=name, network=network: network.output(name, angle)[0],
                    trained,
                    Points(samples.crank_angle, samples.simulated[kind], 0),
                )
        return error_frame(rows)


def train_clearance(
    trajectory: pd.DataFrame, fine: pd.DataFrame, options: Surrogate, loose: Iterable[str]
) -> ClearanceFit:
    """Train the second surrogate."""
    start, speed, joints = float(fine["crank_angle"].iloc[0]), CrankSpeed.of(trajectory), {}
    for joint in (JOINT_NUMBERS[name] for name in loose):
        samples = Samples.of(trajectory, fine, joint, options.training_points)
        r = fine[f"r{joint}"].to_numpy()
        settling = SETTLING if r[0] < 1e-9 * r.max() else np.inf
        joints[joint] = grow(samples, joint, start, speed, settling)
    return ClearanceFit(joints, trajectory, options.training_points)


def grow(samples: Samples, joint: int, start_angle: float, speed: CrankSpeed, settling: float) -> JointFit:
    """Train the network of one joint, adding neurons."""
    angle = samples.crank_angle
    centres = np.arange(angle[0] - MARGIN * FIRST_DISTANCE, angle[-1] + MARGIN * FIRST_DISTANCE, FIRST_DISTANCE)
    for round_ in range(1, ROUNDS + 1):
        layer = Layer(centres, WIDTH * np.gradient(centres))
        weights = _solve(layer, samples, start_factor(angle, start_angle, settling))
        network = ClearanceNetwork(joint, layer, *Layer.to_tansig(weights), start_angle, settling, speed)
        network = _on_the_same_turn(network, samples)
        squares = _squared_errors(network, samples)
        if all(np.sum(samples.shares * square) <= SHARE for square in squares):
            return JointFit(network, samples, round_, f"training errors at {SHARE:g} of the paper's or below")
        finer = _finer(centres, samples, squares)
        if len(finer) == len(centres):
            return JointFit(network, samples, round_, "neurons as close as the samples; sample more finely")
        centres = finer
    return JointFit(network, samples, ROUNDS, f"{ROUNDS} rounds done while training errors still fell")


def _solve(layer: Layer, samples: Samples, start: list[np.ndarray]) -> np.ndarray:
    """Weights of the basis functions, complex (H + 1,): banded normal equations, refined with the true residual."""
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
    """Rows of the least-squares problem; unknowns: real and imaginary part of each basis function's weight in turn."""

    def __init__(self, layer: Layer, samples: Samples, start: list[np.ndarray]):
        values = samples.values
        s, s1, s2, _ = start
        ratio = values["r_dot"] / values["r"]
        curvature = values["r_ddot"] / values["r"]
        self._w = values["r"] / s * np.exp(1j * values["gamma"])
        self._q1 = ratio + 1j * values["gamma_dot"] - s1 / s
        q2 = curvature - ratio**2 + 1j * values["gamma_ddot"] - s2 / s + (s1 / s) ** 2
        self._w2 = q2 + self._q1**2
        self._r, self._ratio, self._curvature = values["r"], ratio, curvature
        self._values = values
        # Position and rate are asked for at least as precisely as the second derivative between two neurons implies:
        # without that the fine neurons' common shift would hardly be seen, and the problem ill-conditioned.
        distance = np.interp(samples.crank_angle, layer.centres, np.gradient(layer.centres))
        self._precision = {}
        for kind, scale in samples.scales.items():
            second = samples.scales["r_ddot" if kind.startswith("r") else "gamma_ddot"]
            implied = distance ** (ORDERS[kind] - 2) / second
            self._precision[kind] = np.maximum(1.0 / scale, implied) * np.sqrt(samples.shares)

    def of(self, block: Block) -> tuple[np.ndarray, np.ndarray]:
        """Matrix (6 points, 2 functions) and targets (6 points,)."""
        at = block.points
        value, first, second = block.values
        r, ratio, curvature = (array[at, None] for array in (self._r, self._ratio, self._curvature))
        q1 = self._q1[at, None]
        log0 = value / self._w[at, None]  # changes of log w and of its derivatives by each weight
        log1 = first / self._w[at, None] - q1 * log0
        log2 = second / self._w[at, None] - self._w2[at, None] * log0 - 2.0 * q1 * log1
        parts = {
            "r": (r * log0, True),
            "r_dot": (r * (ratio * log0 + log1), True),
            "r_ddot": (r * (curvature * log0 + 2.0 * ratio * log1 + log2), True),
            "gamma": (log0, False),
            "gamma_dot": (log1, False),
            "gamma_ddot": (log2, False),
        }
        points, functions = value.shape
        matrix = np.empty((len(parts), points, functions, 2))
        targets = np.zeros((len(parts), points))
        for index, (kind, (change, is_real)) in enumerate(parts.items()):
            precision = self._precision[kind][at, None]
            matrix[index, :, :, 0] = precision * (change.real if is_real else change.imag)
            matrix[index, :, :, 1] = precision * (-change.imag if is_real else change.real)
            if is_real:  # the imaginary changes of the true w are 0
                targets[index] = precision[:, 0] * self._values[kind][at]
        return matrix.reshape(-1, 2 * functions), targets.ravel()


def _on_the_same_turn(network: ClearanceNetwork, samples: Samples) -> ClearanceNetwork:
    gamma = network.polar(samples.crank_angle[-1:])[1][0]
    turns = network.turns + int(np.round((samples.values["gamma"][-1] - gamma[0]) / (2.0 * np.pi)))
    return replace(network, turns=turns)


def _squared_errors(network: ClearanceNetwork, samples: Samples) -> list[np.ndarray]:
    """Squared errors of r, gamma and gamma's derivatives at the samples, in units of the squared error allowed."""
    r, gamma = network.polar(samples.crank_angle)
    outputs = {"r": r[0], "gamma": gamma[0], "gamma_dot": gamma[1], "gamma_ddot": gamma[2]}
    errors = {kind: values - samples.values[kind] for kind, values in outputs.items()}
    errors["gamma"] = np.remainder(errors["gamma"] + np.pi, 2.0 * np.pi) - np.pi  # a coarse network may miss a turn
    return [(error / samples.scales[kind]) ** 2 for kind, error in errors.items()]


def _finer(centres: np.ndarray, samples: Samples, squares: list[np.ndarray]) -> np.ndarray:
    """Centres with the distances halved where more than a fair part of the error is: if nowhere, the whole is small.

    None is halved that holds no two samples; neighbouring distances differ twofold at most.
    """
    intervals = len(centres) - 1
    place = np.clip(np.searchsorted(centres, samples.crank_angle) - 1, 0, intervals - 1)
    split = np.zeros(intervals, bool)
    for square in squares:
        split |= np.bincount(place, samples.shares * square, minlength=intervals) > SHARE / intervals
    split = (np.convolve(split, np.ones(5), "same") > 0.5) & (np.bincount(place, minlength=intervals) >= 2)
    distances = np.diff(centres)
    while True:
        after = np.where(split, distances / 2.0, distances)
        low = np.minimum(np.r_[np.inf, after[:-1]], np.r_[after[1:], np.inf])
        coarse = ~split & (after > 2.1 * low)
        if not coarse.any():
            break
        split |= coarse
    return np.sort(np.concatenate([centres, (centres[:-1] + centres[1:])[split] / 2.0]))
