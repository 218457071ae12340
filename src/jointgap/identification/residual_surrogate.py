"""Whitened residuals of a model as a function of its parameters, from the simulations that there are.

They are linear about a fit, and what simulations elsewhere differ from that is interpolated: a Gaussian process whose
mean is the linear model, with a length of its own for each parameter (C. E. Rasmussen and C. K. I. Williams, Gaussian
Processes for Machine Learning, MIT Press 2006, chapters 2 and 5). All samples share the lengths, so that chi2 asks for
inner products alone, however many samples there are.
"""

import numpy as np
from scipy.optimize import minimize

from jointgap.identification.settings import DEFAULT_SETTINGS, ValleySettings


class ResidualSurrogate:
    """Residuals about a fit of k parameters to n samples."""

    def __init__(
        self,
        values: np.ndarray,
        residual: np.ndarray,
        jacobian: np.ndarray,
        errors: np.ndarray,
        settings: ValleySettings = DEFAULT_SETTINGS.valley,
    ):
        self._values, self.errors, self._settings = values, errors, settings
        self._residual, self._jacobian = residual, jacobian
        # of the fit itself, where the linear model is exact, and then of what was simulated
        self._points, self._changes = np.zeros((1, values.size)), np.zeros((1, residual.size))
        self._log_lengths = np.full(values.size, np.log(settings.usual_length))
        self._prepare()

    def add(self, points: np.ndarray, residuals: np.ndarray) -> None:
        """Learn the `residuals` (m, n) that were simulated at `points` (m, k) [SI], and the lengths from them all."""
        away = points - self._values
        self._points = np.vstack([self._points, away / self.errors])
        self._changes = np.vstack([self._changes, residuals - self._residual - away @ self._jacobian.T])
        products = self._changes @ self._changes.T
        apart = (self._points[:, None, :] - self._points[None, :, :]) ** 2
        settings = self._settings
        farthest = settings.max_length_spreads * settings.log_length_spread  # beyond, exponentials overflow
        ends = np.log(settings.usual_length) + farthest * np.array([-1.0, 1.0])
        found = minimize(
            self._improbability,
            self._log_lengths,
            (products, apart),
            jac=True,
            method="L-BFGS-B",
            bounds=[ends] * self._log_lengths.size,
            options={"maxiter": settings.max_length_steps},
        )
        self._log_lengths = found.x
        self._prepare()

    def chi2(self, points: np.ndarray) -> np.ndarray:
        """Sum of squared residuals at `points` (m, k) [SI], (m,)."""
        away = points - self._values
        scaled = away / self.errors / np.exp(self._log_lengths)
        distance = np.sum(scaled**2, axis=1)[:, None] + self._squares - 2.0 * scaled @ self._scaled.T
        weights = np.exp(-0.5 * np.maximum(distance, 0.0)) @ self._inverse
        factors = np.hstack([np.ones((len(points), 1)), away, weights])
        return np.sum((factors @ self._products) * factors, axis=1)

    def _prepare(self) -> None:
        """What `chi2` needs, for the lengths and simulations that there are."""
        self._scaled = self._points / np.exp(self._log_lengths)
        self._squares = np.sum(self._scaled**2, axis=1)
        apart = (self._points[:, None, :] - self._points[None, :, :]) ** 2
        self._inverse = np.linalg.inv(self._kernel(self._log_lengths, apart))
        rows = np.vstack([self._residual, self._jacobian.T, self._changes])
        self._products = rows @ rows.T

    def _kernel(self, log_lengths: np.ndarray, apart: np.ndarray) -> np.ndarray:
        return np.exp(-0.5 * apart @ np.exp(-2.0 * log_lengths)) + self._settings.nugget * np.eye(len(apart))

    def _improbability(
        self, log_lengths: np.ndarray, products: np.ndarray, apart: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Minus the log-likelihood of the lengths per sample, for the best variance, less their prior; its derivative.

        Samples are far from independent, so all of them count as one number for each simulation.
        """
        count, kernel = len(apart), self._kernel(log_lengths, apart)
        inverse = np.linalg.inv(kernel)
        explained = inverse @ products @ inverse
        total = max(float(np.sum(inverse * products)), 1e-300)
        by_kernel = 0.5 * inverse - 0.5 * count / total * explained
        slope = np.einsum("ij,ijk->k", by_kernel * kernel, apart) * np.exp(-2.0 * log_lengths)
        off = (log_lengths - np.log(self._settings.usual_length)) / self._settings.log_length_spread
        value = 0.5 * np.linalg.slogdet(kernel)[1] + 0.5 * count * np.log(total) + 0.5 * off @ off
        return value, slope + off / self._settings.log_length_spread
