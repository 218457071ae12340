"""Levenberg-Marquardt training of many networks at once."""

import itertools
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from scipy.linalg.blas import dsyrk
from scipy.linalg.lapack import dpotrf, dpotrs

from jointgap.core.errors import needs
from jointgap.core.progress import tell
from jointgap.networks.network import Layout, activations_and_outputs, tansig_slope

with needs("training networks", "learn"):
    import torch


class Evaluation(Protocol):
    """A model at parameters of shape (B, P): what Levenberg-Marquardt asks of it."""

    outputs: torch.Tensor

    def select(self, members: torch.Tensor) -> "Evaluation":
        """The same of some `members` (indices or mask of B)."""

    def replaced(self, other: "Evaluation", members: torch.Tensor) -> "Evaluation":
        """The same with those of `other` in the place of `members` (indices or mask of B)."""

    def pull_back(self, weights: torch.Tensor) -> torch.Tensor:
        """Transposed Jacobian times `weights` (B, N), shape (B, P)."""

    def jacobian(self) -> torch.Tensor:
        """Derivatives of the outputs by the parameters, shape (B, N, P)."""

    def products_of_rows(self, member: int, out: np.ndarray, work: tuple[np.ndarray, np.ndarray]) -> None:
        """Inner products of the Jacobian's rows of one `member`, into `out` (N, N); `work`: two such arrays."""

    def along(self, step: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """First and second derivative of the outputs along `step` (B, P), each (B, N)."""


class Model(Protocol):
    """Outputs at N points as a function of P parameters."""

    @property
    def points(self) -> int: ...
    @property
    def size(self) -> int: ...
    def evaluate(self, parameters: torch.Tensor) -> Evaluation: ...


class NetworkModel:
    """The outputs of networks as a function of their parameters."""

    def __init__(self, layout: Layout, inputs: np.ndarray):
        self.layout = layout
        row = torch.as_tensor(np.asarray(inputs, dtype=float))
        self._inputs = torch.stack([row, torch.ones_like(row)])[None]  # activations of layer 0, (1, 2, N)

    @property
    def points(self) -> int:
        return self._inputs.shape[-1]

    @property
    def size(self) -> int:
        """Number P of parameters."""
        return self.layout.size

    def evaluate(self, parameters: torch.Tensor) -> "NetworkEvaluation":
        """The networks with parameters of shape (B, P)."""
        return NetworkEvaluation(self.layout, parameters, self._inputs)


class NetworkEvaluation:
    """Networks at one point of their parameter space: outputs, and derivatives on demand."""

    def __init__(self, layout: Layout, parameters: torch.Tensor, inputs: torch.Tensor):
        self._layout = layout
        self._matrices = layout.split(parameters)
        shared = inputs.expand(len(parameters), -1, -1)
        activations, outputs = activations_and_outputs(
            self._matrices, shared, lambda matrix, layer: torch.bmm(matrix, torch.from_numpy(layer))
        )
        self._activations = [shared, *(torch.from_numpy(layer) for layer in activations[1:])]
        self.outputs = torch.from_numpy(outputs)
        self._sensitivities: list[torch.Tensor] = []

    def select(self, members: torch.Tensor) -> "NetworkEvaluation":
        """The evaluation of some members, picked by index or mask."""
        chosen = object.__new__(NetworkEvaluation)
        chosen._layout = self._layout
        chosen._matrices = [matrix[members] for matrix in self._matrices]
        chosen._activations = [layer[members] for layer in self._activations]
        chosen.outputs = self.outputs[members]
        chosen._sensitivities = [layer[members] for layer in self._sensitivities]
        return chosen

    def replaced(self, other: "NetworkEvaluation", members: torch.Tensor) -> "NetworkEvaluation":
        """This evaluation with the members of a mask (B,) taken from another one."""
        if members.all():
            return other
        merged = object.__new__(NetworkEvaluation)
        merged._layout = self._layout
        pairs = zip(self._matrices, other._matrices, strict=True)
        merged._matrices = [torch.where(members[:, None, None], new, old) for old, new in pairs]
        pairs = zip(self._activations, other._activations, strict=True)
        merged._activations = [torch.where(members[:, None, None], new, old) for old, new in pairs]
        merged.outputs = torch.where(members[:, None], other.outputs, self.outputs)
        merged._sensitivities = []
        return merged

    def sensitivities(self) -> list[torch.Tensor]:
        """d(output)/d(weighted sum) of every hidden neuron, one tensor (B, neurons, N) per hidden layer."""
        if not self._sensitivities:
            backward = self._matrices[-1][:, 0, :-1, None]
            from_last = [backward * tansig_slope(self._activations[-1])]
            for matrix, layer in zip(self._matrices[-2:0:-1], self._activations[-2:0:-1], strict=True):
                backward = torch.bmm(matrix[:, :, :-1].transpose(1, 2), from_last[-1])
                from_last.append(backward.mul_(tansig_slope(layer)))
            self._sensitivities = from_last[::-1]
        return self._sensitivities

    def pull_back(self, weights: torch.Tensor) -> torch.Tensor:
        """J^T w for w of shape (B, N); shape (B, P)."""
        result = torch.empty(len(weights), self._layout.size, dtype=torch.float64)
        *hidden, last = self._layout.split(result)
        for sensitivity, layer, part in zip(self.sensitivities(), self._activations, hidden, strict=False):
            part.copy_(torch.bmm(sensitivity * weights[:, None], layer.transpose(1, 2)))
        last.copy_(_row_times(weights[:, None], self._activations[-1].transpose(1, 2))[:, None])
        return result

    def jacobian(self) -> torch.Tensor:
        """d(outputs)/d(parameters), shape (B, N, P)."""
        parts = [
            torch.einsum("bin,bjn->bnij", sensitivity, layer).flatten(2)
            for sensitivity, layer in zip(self.sensitivities(), self._activations, strict=False)
        ]
        return torch.cat([*parts, self._activations[-1].transpose(1, 2)], dim=2)

    def products_of_rows(self, member: int, out: np.ndarray, work: tuple[np.ndarray, np.ndarray]) -> None:
        """J J^T of one member without forming J.

        A row of J is, layer by layer, the outer product of sensitivities and activations, so the scalar product of
        two rows is the sum over layers of (product of the sensitivities) times (product of the activations):
        Hadamard products of matrices of rank 10 and 11. That costs a third of multiplying J by its transpose.
        """
        total = torch.from_numpy(out.T)  # the same memory, row by row
        left, right = work
        for depth, sensitivity in enumerate(self.sensitivities()):
            _symmetric_product(sensitivity[member], left)
            _symmetric_product(self._activations[depth][member], right)
            factors = torch.from_numpy(left.T), torch.from_numpy(right.T)
            torch.mul(*factors, out=total) if depth == 0 else total.addcmul_(*factors)
        _symmetric_product(self._activations[-1][member], out, keep=1.0)

    def along(self, step: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """First and second derivative of the outputs along a step (B, P) in parameter space; each (B, N).

        Exact, by propagating the Taylor expansion of outputs(parameters + t step) in t through the layers.
        """
        steps = self._layout.split(step)
        first = second = None
        for depth, (matrix, change, layer) in enumerate(zip(self._matrices, steps, self._activations, strict=True)):
            is_output = depth == len(steps) - 1
            multiply = _row_times if is_output else torch.bmm
            velocity = multiply(change, layer)
            if first is None:
                acceleration = torch.zeros_like(velocity)
            else:
                velocity += multiply(matrix[..., :-1], first)
                acceleration = multiply(matrix[..., :-1], second) + 2.0 * multiply(change[..., :-1], first)
            if is_output:
                return velocity, acceleration
            above = self._activations[depth + 1]
            slope = tansig_slope(above)
            first = slope * velocity
            second = slope * acceleration - 2.0 * above[:, :-1] * first * velocity
        raise AssertionError("a layout has an output layer")


def _row_times(rows: torch.Tensor, columns: torch.Tensor) -> torch.Tensor:
    """(B, 1, K) times (B, K, N), shape (B, N)."""
    return torch.from_numpy(np.matmul(rows.numpy(), columns.numpy())[:, 0])


def _symmetric_product(factor: torch.Tensor, out: np.ndarray, keep: float = 0.0) -> None:
    """`out` = keep out + factor^T factor in its lower triangle; factor (K, N), out (N, N) in Fortran order."""
    result = dsyrk(1.0, factor.numpy().T, beta=keep, c=out, lower=1, overwrite_c=1)
    if result is not out and not np.shares_memory(result, out):
        raise AssertionError("the product was written elsewhere; `out` must be in Fortran order")


class Status(Enum):
    """Why a member stopped; the text says what to do."""

    BUDGET = "iterations used up while the error still fell; allow more iterations if it has to be smaller"
    GRADIENT = "gradient at its limit: a stationary point; try another seed if the error is too large"
    DAMPING = "no step lowers the error any more, however short; try another seed if the error is too large"
    STALLED = "no progress worth the time; try another seed or more neurons if the error is too large"
    EXACT = "residual at the rounding errors of the data; nothing is left to do"

    @property
    def sentence(self) -> str:
        """Name and text, as tables show it."""
        return f"{self.name.lower()}: {self.value}"


@dataclass(frozen=True)
class Settings:
    """When to stop, and the start of the damping."""

    iterations: int = 20_000  # Solutions of the damped system at most, refused steps included
    minimum_gradient: float = 1e-7
    largest_damping: float = 1e10  # Stop when the damping exceeds this
    stall_iterations: int = 1000  # Stop when this many iterations lowered the mean square error by less than this share
    stall_gain: float = 1e-3  # Stop when this many iterations lowered the mean square error by less than this share
    exact_error: float = 1e-14  # Stop when the root mean square error is this small (data scaled to [0, 1])
    initial_damping: float = 1e-3  # Damping to start with, relative to the mean diagonal element of J^T J
    largest_bend: float = 0.75  # Refuse a step whose bend 2|a|/|v| is larger than this (Transtrum and Sethna's alpha)
    milestone: float = 0.0
    snapshots: tuple[int, ...] = ()  # Keep the parameters after these numbers of iterations


@dataclass(frozen=True)
class Result:
    """One trained member."""

    parameters: np.ndarray  # shape (P,)
    errors: np.ndarray  # shape (iterations + 1,); mean square error at the start and after every iteration
    status: Status
    gradient: float  # Norm of the gradient of the mean square error at the end
    milestone: int | None  # Iterations to the milestone; None if it was not reached
    kept: dict[int, np.ndarray]  # shape (P,); parameters by iterations done

    @property
    def iterations(self) -> int:
        return len(self.errors) - 1


def minimise(model: Model, targets: np.ndarray, start: np.ndarray, settings: Settings = Settings()) -> list[Result]:
    """Least squares from every row of `start`, all in one batch."""
    if not np.isfinite(targets).all():
        raise ValueError("the targets hold values that are not finite; leave gaps out")
    target = torch.as_tensor(targets, dtype=torch.float64)
    parameters = torch.tensor(np.atleast_2d(start), dtype=torch.float64)
    evaluation = model.evaluate(parameters)
    if not torch.isfinite(evaluation.outputs).all():
        raise ValueError("the outputs at the start are not finite")
    system = _smaller_form(model)
    everyone = [_Member(system(model), model.size, settings) for _ in parameters]
    for member, residual, gradient in zip(
        everyone, target - evaluation.outputs, _gradients(evaluation, target), strict=True
    ):
        member.begin(residual.numpy(), gradient)
    active = list(everyone)
    for iteration in itertools.count():
        tell("training iterations", iteration, settings.iterations)
        unfinished = [index for index, member in enumerate(active) if member.status is None]
        if len(unfinished) < len(active):
            for index, member in enumerate(active):
                if member.status is not None:
                    member.parameters = parameters[index].numpy().copy()
            active = [active[index] for index in unfinished]
            if not active:
                tell("training iterations", iteration, iteration)
                return [member.result() for member in everyone]
            parameters, evaluation = parameters[unfinished], evaluation.select(unfinished)
        residual = target - evaluation.outputs
        for index, member in enumerate(active):
            member.prepare(evaluation, index)
        velocity = system.expand(evaluation, _solved(active, residual))
        first, second = evaluation.along(velocity)
        bend = system.expand(evaluation, _solved(active, -second))
        trial_parameters = parameters + velocity + 0.5 * bend
        trial = model.evaluate(trial_parameters)
        trial_residual = target - trial.outputs
        predicted = (first * (residual + (residual - first))).numpy()
        sizes = velocity.numpy(), bend.numpy()
        accepted = [
            member.judge(trial_residual[index].numpy(), predicted[index], sizes[0][index], sizes[1][index])
            for index, member in enumerate(active)
        ]
        if any(accepted):
            chosen = torch.tensor(accepted)
            parameters = torch.where(chosen[:, None], trial_parameters, parameters)
            evaluation = evaluation.replaced(trial, chosen)
            for member, gradient, taken in zip(active, _gradients(evaluation, target), accepted, strict=True):
                if taken:
                    member.gradient = gradient
        for index, member in enumerate(active):
            member.keep(parameters[index])
            member.check()


def _gradients(evaluation: Evaluation, target: torch.Tensor) -> list[float]:
    """Norm of the gradient of each member's mean square error."""
    gradients = evaluation.pull_back(target - evaluation.outputs).numpy()
    return [2.0 / len(target) * float(np.linalg.norm(gradient)) for gradient in gradients]


def _solved(active: list["_Member"], right_sides: torch.Tensor) -> torch.Tensor:
    return torch.from_numpy(np.stack([m.system.solve(r) for m, r in zip(active, right_sides.numpy(), strict=True)]))


class _Member:
    """Damping, error and end of one member."""

    def __init__(self, system: "_Dual | _Primal", size: int, settings: Settings):
        self.system = system
        self._size = size
        self._settings = settings
        self.status: Status | None = None
        self.parameters: np.ndarray | None = None
        self._milestone: int | None = None
        self._kept: dict[int, np.ndarray] = {}
        self._fresh = True
        self._growth = 2.0

    def begin(self, residual: np.ndarray, gradient: float) -> None:
        self._sum = float(residual @ residual)
        self._points = len(residual)
        self.errors = [self._sum / self._points]
        self.gradient = gradient
        self._damping: float | None = None
        self.check()

    def prepare(self, evaluation: Evaluation, index: int) -> None:
        """Form the damped system, anew if the last step was taken, and factor it."""
        if self._fresh:
            typical = self.system.form(evaluation, index) / self._size
            if self._damping is None:
                self._damping = self._settings.initial_damping * typical
            self._least = typical * np.finfo(float).eps ** 2
        self._factored = self.system.factor(self._damping)

    def judge(self, residual: np.ndarray, predicted: np.ndarray, velocity: np.ndarray, bend: np.ndarray) -> bool:
        """Take the step or refuse it, and set the damping by the ratio of gained to predicted reduction."""
        total = float(residual @ residual)
        gain = (self._sum - total) / float(predicted.sum()) if self._factored else -1.0
        straight = 2.0 * np.linalg.norm(bend) <= self._settings.largest_bend * np.linalg.norm(velocity)
        self._fresh = bool(gain > 0.0 and total < self._sum and straight)
        if self._fresh:
            self._sum = total
            self._damping = max(self._damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), self._least)
            self._growth = 2.0
        else:
            self._damping *= self._growth
            self._growth *= 2.0
        self.errors.append(self._sum / self._points)
        return self._fresh

    def keep(self, parameters: torch.Tensor) -> None:
        """Keep the parameters if this is a milestone or a snapshot."""
        iterations = len(self.errors) - 1
        if self._milestone is None and self.errors[-1] <= self._settings.milestone:
            self._milestone = iterations
        if iterations == self._milestone or iterations in self._settings.snapshots:
            self._kept[iterations] = parameters.numpy().copy()

    def result(self) -> Result:
        return Result(self.parameters, np.array(self.errors), self.status, self.gradient, self._milestone, self._kept)

    def check(self) -> None:
        """Set the status if one of the stopping criteria is met; none looks at anything but the training points."""
        settings, error = self._settings, self.errors[-1]
        long_ago = len(self.errors) - 1 - settings.stall_iterations
        if error <= settings.exact_error**2:
            self.status = Status.EXACT
        elif self.gradient <= settings.minimum_gradient:
            self.status = Status.GRADIENT
        elif self._damping is not None and self._damping > settings.largest_damping:
            self.status = Status.DAMPING
        elif long_ago >= 0 and error > (1.0 - settings.stall_gain) * self.errors[long_ago]:
            self.status = Status.STALLED
        elif len(self.errors) > settings.iterations:
            self.status = Status.BUDGET


def _smaller_form(model: Model) -> "type[_Dual] | type[_Primal]":
    """The cheaper form: the dual costs points^3 / 3 and less for its matrix, the primal points x parameters^2."""
    return _Dual if model.points <= 1.5 * model.size else _Primal


class _Damped:
    """A symmetric matrix, and the Cholesky factor of it plus a multiple of the identity."""

    def __init__(self, rows: int):
        self._matrix = np.zeros((rows, rows), order="F")
        self._factor = np.zeros((rows, rows), order="F")
        self._diagonal = np.diag_indices(rows)

    def factor(self, damping: float) -> bool:
        """Factor matrix + damping I; False if it is not positive definite in double precision."""
        np.copyto(self._factor, self._matrix)
        self._factor[self._diagonal] += damping
        _, failed = dpotrf(self._factor, lower=1, clean=0, overwrite_a=1)
        return not failed

    def _solve(self, right_side: np.ndarray) -> np.ndarray:
        return dpotrs(self._factor, right_side, lower=1)[0]


class _Dual(_Damped):
    """v = J^T u with (J J^T + mu I) u = e."""

    def __init__(self, model: Model):
        super().__init__(model.points)
        self._spare = np.zeros_like(self._factor)

    def form(self, evaluation: Evaluation, index: int) -> float:
        """Form J J^T and return its trace."""
        evaluation.products_of_rows(index, self._matrix, (self._factor, self._spare))
        return float(self._matrix[self._diagonal].sum())

    def solve(self, right_side: np.ndarray) -> np.ndarray:
        return self._solve(right_side)

    @staticmethod
    def expand(evaluation: Evaluation, solutions: torch.Tensor) -> torch.Tensor:
        """The step v = J^T u, shape (B, P)."""
        return evaluation.pull_back(solutions)


class _Primal(_Damped):
    """(J^T J + mu I) v = J^T e."""

    def __init__(self, model: Model):
        super().__init__(model.size)

    def form(self, evaluation: Evaluation, index: int) -> float:
        """Form J^T J and return its trace."""
        self._jacobian = evaluation.jacobian()[index].numpy()
        self._matrix[...] = self._jacobian.T @ self._jacobian
        return float(self._matrix[self._diagonal].sum())

    def solve(self, right_side: np.ndarray) -> np.ndarray:
        return self._solve(self._jacobian.T @ right_side)

    @staticmethod
    def expand(evaluation: Evaluation, solutions: torch.Tensor) -> torch.Tensor:
        """The step v: the solutions themselves, shape (B, P)."""
        return solutions
