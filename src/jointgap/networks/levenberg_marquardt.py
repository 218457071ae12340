"""Levenberg-Marquardt training.

A model has `points` N, `size` P and `evaluate(parameters)`, which returns the `outputs` (N,), their
`jacobian()` (N, P), its `pull_back` J^T w, `row_products` J J^T, and the derivatives of the outputs
`along` a step.
"""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
from scipy.linalg.blas import dsyrk
from scipy.linalg.lapack import dpotrf, dpotrs

from jointgap.core.errors import needs
from jointgap.core.progress import report_progress
from jointgap.networks.network import Layout, activations_and_outputs, tansig_slope

with needs("training networks", "learn"):
    import torch

torch.set_num_threads(1)  # small matrices; outputs train in parallel processes


class NetworkModel:
    """The outputs of a network at `inputs` (N,) as a function of its parameters (P,)."""

    def __init__(self, layout: Layout, inputs: np.ndarray):
        self.layout, self.points, self.size = layout, len(inputs), layout.size
        self._inputs = np.stack([inputs, np.ones_like(inputs)])

    def evaluate(self, parameters: np.ndarray) -> "NetworkEvaluation":
        return NetworkEvaluation(self.layout, parameters, self._inputs)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Matrix product by torch; numpy sums in another order, which trains another network."""
    return torch.mm(torch.from_numpy(a), torch.from_numpy(b)).numpy()


class NetworkEvaluation:
    """A network at given parameters: outputs, and derivatives on demand."""

    def __init__(self, layout: Layout, parameters: np.ndarray, inputs: np.ndarray):
        self._layout, self._matrices = layout, layout.split(parameters)
        self._activations, self.outputs = activations_and_outputs(self._matrices, inputs, _product)

    @cached_property
    def _sensitivities(self) -> list[np.ndarray]:
        """d(output)/d(weighted sum) of every hidden neuron, (neurons, N) for each hidden layer."""
        backward = self._matrices[-1][0, :-1, None]
        from_last = [backward * tansig_slope(self._activations[-1])]
        below = zip(self._matrices[-2:0:-1], self._activations[-2:0:-1], strict=True)
        for matrix, layer in below:
            from_last.append(_product(matrix[:, :-1].T, from_last[-1]) * tansig_slope(layer))
        return from_last[::-1]

    def pull_back(self, weights: np.ndarray) -> np.ndarray:
        """J^T w, (P,), of w (N,)."""
        parts = [
            _product(sensitivity * weights, layer.T).ravel()
            for sensitivity, layer in zip(self._sensitivities, self._activations, strict=False)
        ]
        by_output = (weights[None] @ self._activations[-1].T)[0]
        return np.concatenate([*parts, by_output])

    def jacobian(self) -> np.ndarray:
        """d(outputs)/d(parameters), (N, P)."""
        parts = [
            np.einsum("in,jn->nij", sensitivity, layer).reshape(self.outputs.size, -1)
            for sensitivity, layer in zip(self._sensitivities, self._activations, strict=False)
        ]
        return np.ascontiguousarray(np.hstack([*parts, self._activations[-1].T]))

    def row_products(self, out: np.ndarray, work: tuple[np.ndarray, np.ndarray]) -> None:
        """J J^T into the lower triangle of `out`, without forming J; `work`: two such arrays.

        A row of J is, layer by layer, the outer product of sensitivities and activations. The
        scalar product of two rows is the sum over layers of (product of sensitivities) times
        (product of activations): Hadamard products of matrices of rank 10 and 11. This costs a
        third of multiplying J by its transpose.
        """
        total = torch.from_numpy(out.T)  # the same memory, row by row
        factors = [torch.from_numpy(matrix.T) for matrix in work]
        for depth, sensitivity in enumerate(self._sensitivities):
            _symmetric_product(sensitivity, work[0])
            _symmetric_product(self._activations[depth], work[1])
            torch.mul(*factors, out=total) if depth == 0 else total.addcmul_(*factors)
        _symmetric_product(self._activations[-1], out, keep=1.0)

    def along(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and second derivative of the outputs along a `step` (P,) of the parameters, (N,)
        each.

        Exact: the Taylor expansion of outputs(parameters + t step) in t is propagated through the
        layers.
        """
        *hidden, (change, matrix) = zip(self._layout.split(step), self._matrices, strict=True)
        rate = bend = None  # of the activations below
        for depth, (weight_change, weights) in enumerate(hidden):
            velocity = _product(weight_change, self._activations[depth])
            acceleration = np.zeros_like(velocity)
            if depth > 0:
                velocity += _product(weights[:, :-1], rate)
                by_change = _product(weight_change[:, :-1], rate)
                acceleration = _product(weights[:, :-1], bend) + 2.0 * by_change
            above = self._activations[depth + 1]
            slope = tansig_slope(above)
            rate = slope * velocity
            bend = slope * acceleration - 2.0 * above[:-1] * rate * velocity
        weights = matrix[:, :-1]
        velocity = (change @ self._activations[-1])[0] + (weights @ rate)[0]
        acceleration = (weights @ bend)[0] + 2.0 * (change[:, :-1] @ rate)[0]
        return velocity, acceleration


def _symmetric_product(factor: np.ndarray, out: np.ndarray, keep: float = 0.0) -> None:
    """`out` = keep out + factor^T factor in its lower triangle; factor (K, N), out (N, N) in
    Fortran order."""
    dsyrk(1.0, factor.T, beta=keep, c=out, lower=1, overwrite_c=1)


class Status(Enum):
    """Stopping criterion; the text gives advice."""

    BUDGET = (
        "iteration limit reached while the error still decreased; increase the iterations for a"
        " smaller error"
    )
    GRADIENT = (
        "gradient below its limit: a stationary point; try another seed if the error is too large"
    )
    DAMPING = "no step reduces the error, however short; try another seed if the error is too large"
    STALLED = "no significant progress; try another seed or more neurons if the error is too large"
    EXACT = "residual at the rounding error of the data"

    @property
    def sentence(self) -> str:
        """Name and text, for tables."""
        return f"{self.name.lower()}: {self.value}"


@dataclass(frozen=True)
class Settings:
    """Stopping criteria and initial damping."""

    iterations: int = 20_000  # Largest number of solved systems, including rejected steps
    minimum_gradient: float = 1e-7
    largest_damping: float = 1e10
    # stop if so many iterations reduce the mean square error by less than `stall_gain`
    stall_iterations: int = 1000
    stall_gain: float = 1e-3
    # stop when the root mean square error is this small (data scaled to [0, 1])
    exact_error: float = 1e-14
    initial_damping: float = 1e-3  # Relative to the mean diagonal element of J^T J
    largest_bend: float = 0.75  # Reject a step if 2|a|/|v| is larger (Transtrum and Sethna's alpha)
    milestone: float = 0.0  # Mean square error whose iteration is recorded
    snapshots: tuple[int, ...] = ()  # Iterations whose parameters are stored


@dataclass(frozen=True)
class Result:
    """Result of the training."""

    parameters: np.ndarray  # shape (P,)
    errors: np.ndarray  # shape (iterations + 1,); mean square error at the start and after each
    status: Status
    gradient: float  # Norm of the gradient of the mean square error at the end
    milestone: int | None  # Iterations to the milestone; None if it was not reached
    snapshots: dict[int, np.ndarray]  # shape (P,); parameters by iteration

    @property
    def iterations(self) -> int:
        return len(self.errors) - 1


def minimise(
    model, targets: np.ndarray, start: np.ndarray, settings: Settings = Settings()
) -> Result:
    """Least squares from `start` (P,) with geodesic acceleration."""
    evaluation, parameters = model.evaluate(start), start
    residual = targets - evaluation.outputs
    if not np.isfinite(residual).all():
        raise ValueError("targets or outputs at the start are not finite; remove undefined points")
    system, points = _System(model), len(targets)
    total, gradient = float(residual @ residual), _gradient(evaluation, residual)
    errors, snapshots, milestone = [total / points], {}, None
    damping, growth, accepted = 0.0, 2.0, True
    while (status := _status(settings, errors, gradient, damping)) is None:
        report_progress("training iterations", len(errors) - 1, settings.iterations)
        if accepted:
            typical = system.form(evaluation) / model.size
            damping = damping or settings.initial_damping * typical
        is_definite = system.factor(damping)
        velocity = system.step(evaluation, residual)
        slope, curvature = evaluation.along(velocity)
        bend = system.step(evaluation, -curvature)
        trial_parameters = parameters + velocity + 0.5 * bend
        trial = model.evaluate(trial_parameters)
        trial_residual = targets - trial.outputs
        trial_total = float(trial_residual @ trial_residual)
        predicted = float((slope * (residual + (residual - slope))).sum())
        gain = (total - trial_total) / predicted if is_definite else -1.0
        largest_bend = settings.largest_bend * np.linalg.norm(velocity)
        is_straight = 2.0 * np.linalg.norm(bend) <= largest_bend
        accepted = bool(gain > 0.0 and trial_total < total and is_straight)
        if accepted:
            parameters, evaluation = trial_parameters, trial
            residual, total = trial_residual, trial_total
            gradient, growth = _gradient(evaluation, residual), 2.0
            least = typical * np.finfo(float).eps ** 2
            factor = max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3)
            damping = max(damping * factor, least)
        else:
            damping, growth = damping * growth, 2.0 * growth
        errors.append(total / points)
        iteration = len(errors) - 1
        if milestone is None and errors[-1] <= settings.milestone:
            milestone = iteration
        if iteration == milestone or iteration in settings.snapshots:
            snapshots[iteration] = parameters
    report_progress("training iterations", len(errors) - 1, len(errors) - 1)
    return Result(parameters, np.array(errors), status, gradient, milestone, snapshots)


def _gradient(evaluation, residual: np.ndarray) -> float:
    """Norm of the gradient of the mean square error."""
    return 2.0 / len(residual) * float(np.linalg.norm(evaluation.pull_back(residual)))


def _status(
    settings: Settings, errors: list[float], gradient: float, damping: float
) -> Status | None:
    """The first stopping criterion that applies; all use training points only."""
    long_ago = len(errors) - 1 - settings.stall_iterations
    if errors[-1] <= settings.exact_error**2:
        return Status.EXACT
    if gradient <= settings.minimum_gradient:
        return Status.GRADIENT
    if damping > settings.largest_damping:
        return Status.DAMPING
    if long_ago >= 0 and errors[-1] > (1.0 - settings.stall_gain) * errors[long_ago]:
        return Status.STALLED
    return Status.BUDGET if len(errors) > settings.iterations else None


class _System:
    """The damped normal equations in the cheaper of two forms.

    Dual: v = J^T u with (J J^T + mu I) u = e; cost up to points^3 / 3. Primal: (J^T J + mu I) v =
    J^T e; cost points x parameters^2.
    """

    def __init__(self, model):
        self._is_dual = model.points <= 1.5 * model.size
        rows = model.points if self._is_dual else model.size
        self._matrix, self._factor, self._spare = (
            np.zeros((rows, rows), order="F") for _ in range(3)
        )
        self._diagonal = np.diag_indices(rows)

    def form(self, evaluation) -> float:
        """Form the matrix without damping and return its trace."""
        if self._is_dual:
            evaluation.row_products(self._matrix, (self._factor, self._spare))
        else:
            self._jacobian = evaluation.jacobian()
            self._matrix[...] = self._jacobian.T @ self._jacobian
        return float(self._matrix[self._diagonal].sum())

    def factor(self, damping: float) -> bool:
        """Factor matrix + damping I; False if it is not positive definite in double precision."""
        np.copyto(self._factor, self._matrix)
        self._factor[self._diagonal] += damping
        return not dpotrf(self._factor, lower=1, clean=0, overwrite_a=1)[1]

    def step(self, evaluation, residual: np.ndarray) -> np.ndarray:
        """The step v (P,) for a residual e (N,)."""
        if self._is_dual:
            return evaluation.pull_back(dpotrs(self._factor, residual, lower=1)[0])
        return dpotrs(self._factor, self._jacobian.T @ residual, lower=1)[0]
