"""Levenberg-Marquardt for batches of small networks.

One iteration solves (J^T J + mu I) v = J^T e for the residual e = target - output, here in its dual form: with
N points not many more than P parameters, v = J^T u with (J J^T + mu I) u = e is the same step, and J J^T comes cheaply
(`products_of_rows`) without J. With many more points than parameters the primal form is smaller and is taken.

Two things make the iterations count. The damping mu follows the gain ratio (Nielsen, Damping parameter in Marquardt's
method, 1999): it falls by up to 3 where the linear model was right, instead of the factor 10 by which MATLAB's trainlm
moves it both ways, where on these signals every second step is refused. And the step is bent along the second
derivative of the outputs ("geodesic acceleration", Transtrum and Sethna, arXiv 1201.5885), v + a/2, which costs one
more solution with the factor at hand; a bend longer than the step allows is refused like a step that raises the error.
Members of a batch share the loop only: each has its own damping, factor and end.
"""

import itertools
from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from jointgap.errors import needs
from jointgap.progress import tell
from jointgap.surrogate.network_batch import Evaluation, Model

with needs("training networks", "learn"):
    import torch


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
