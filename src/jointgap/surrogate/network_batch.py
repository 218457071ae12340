"""A batch of networks of one layout at the same inputs, with exact derivatives with respect to their weights.

Shapes: B members of the batch, N points, P parameters. The activations of a layer are (B, neurons + 1, N) with a last
row of ones, so that a bias is a weight like the others. All derivatives are backpropagation or Taylor propagation by
hand; nothing is recorded for automatic differentiation. A member's numbers are the same to the last bit whoever else
is in the batch; where torch's kernels depend on the size of the batch (products with a single row, sums), numpy works
on the same memory instead.
"""

from typing import Protocol

import numpy as np
from scipy.linalg.blas import dsyrk

from jointgap.errors import needs
from jointgap.surrogate.network import Layout, activations_and_outputs, tansig_slope

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
