"""The damped linear system of a Levenberg-Marquardt step, in its dual and in its primal form."""

import numpy as np
import torch
from scipy.linalg.lapack import dpotrf, dpotrs

from jointgap.surrogate.network_batch import Evaluation, Model


def smaller_form(model: Model) -> "type[Dual] | type[Primal]":
    """The cheaper form: the dual costs points^3 / 3 and less than that for its matrix, the primal points x parameters^2."""
    return Dual if model.points <= 1.5 * model.size else Primal


class Damped:
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


class Dual(Damped):
    """v = J^T u with (J J^T + mu I) u = e."""

    def __init__(self, model: Model):
        super().__init__(model.points)
        self._spare = np.zeros_like(self._factor)

    def form(self, evaluation: Evaluation, index: int) -> float:
        """Form J J^T and return its trace.

        Parameters
        ----------
        evaluation : Evaluation
        index : int
            Member of the batch.
        """
        evaluation.products_of_rows(index, self._matrix, (self._factor, self._spare))
        return float(self._matrix[self._diagonal].sum())

    def solve(self, right_side: np.ndarray) -> np.ndarray:
        return self._solve(right_side)

    @staticmethod
    def expand(evaluation: Evaluation, solutions: torch.Tensor) -> torch.Tensor:
        """The step v = J^T u, shape (B, P).

        Parameters
        ----------
        evaluation : Evaluation
        solutions : Tensor, shape (B, N)
        """
        return evaluation.pull_back(solutions)


class Primal(Damped):
    """(J^T J + mu I) v = J^T e."""

    def __init__(self, model: Model):
        super().__init__(model.size)

    def form(self, evaluation: Evaluation, index: int) -> float:
        """Form J^T J and return its trace.

        Parameters
        ----------
        evaluation : Evaluation
        index : int
            Member of the batch.
        """
        self._jacobian = evaluation.jacobian()[index].numpy()
        self._matrix[...] = self._jacobian.T @ self._jacobian
        return float(self._matrix[self._diagonal].sum())

    def solve(self, right_side: np.ndarray) -> np.ndarray:
        return self._solve(self._jacobian.T @ right_side)

    @staticmethod
    def expand(evaluation: Evaluation, solutions: torch.Tensor) -> torch.Tensor:
        """The step v: the solutions themselves, shape (B, P).

        Parameters
        ----------
        evaluation : Evaluation
        solutions : Tensor, shape (B, P)
        """
        return solutions
