"""Features of cycles, and decisions by them."""

from collections.abc import Collection

import numpy as np

from jointgap.identification.problem import Problem
from jointgap.identification.settings import CycleFeatureSettings


class CycleFeatures:
    """Features of the whitened residuals of a fit, with which those of simulated changes are compared.

    For each run, channel and bin of the cycle: log(mean w^2 + a) and arcsinh(mean w), w the residual. Statistics over
    cycles, and series of which no angle is known, have none.
    """

    def __init__(self, problem: Problem, residual: np.ndarray, channels: Collection[str] | None = None):
        self._settings: CycleFeatureSettings = problem.settings.cycle_features
        bins, self._cells, cells = self._settings.bins, np.full(problem.size, -1), 0
        self._of_run: dict[str, dict[str, slice]] = {run: {} for run in problem.runs}
        for part in problem.parts:
            angle = part.series.angle[part.used]
            unheard = channels is not None and part.series.channel not in channels
            if unheard or part.series.statistic or not np.isfinite(angle).any():
                continue
            turned = np.mod(np.nan_to_num(angle), 2.0 * np.pi) / (2.0 * np.pi)
            self._cells[part.place] = np.where(np.isfinite(angle), cells + (turned * bins).astype(int) % bins, -1)
            self._of_run[part.series.run][part.series.channel] = slice(cells, cells + bins)
            cells += bins
        self._counts = np.bincount(self._cells[self._cells >= 0], minlength=cells)
        energy, mean = self._energy_and_mean(residual)
        self._features = self._transformed(energy, mean)
        count, excess = np.maximum(self._counts, 1), np.maximum(energy - 1.0, 0.0)
        unknown = self._settings.model_variance
        of_energy = (2.0 + 4.0 * excess) / count / (energy + self._settings.energy_floor) ** 2
        self._variance = np.stack([of_energy, 1.0 / count / (1.0 + mean**2)]) + unknown
        total = float(np.sum(self._counts * (energy - 1.0)))
        repeating = float(np.sum((self._counts * mean**2 - 1.0)[self._counts > 0]))
        scatter = float(np.sqrt(2.0 * np.sum(self._counts)))  # of chi2, where there is noise alone
        self.rough_share = 1.0 - repeating / total if total > self._settings.least_deviations * scatter else 0.0
        """Share of the residual's energy beyond noise [1] that is not in its means: what rings, within a bin; 0 of
        noise."""

    @property
    def size(self) -> int:
        """How many features there are."""
        return 2 * int(np.sum(self._counts > 0))

    def _energy_and_mean(self, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean square and mean of residuals (n,) by bin, each (m,)."""
        used, count = self._cells >= 0, np.maximum(self._counts, 1)
        sums = (
            np.bincount(self._cells[used], part, self._counts.size) for part in (residual[used] ** 2, residual[used])
        )
        energy, mean = (total / count for total in sums)
        return energy, mean

    def _transformed(self, energy: np.ndarray, mean: np.ndarray) -> np.ndarray:
        return np.stack([np.log(energy + self._settings.energy_floor), np.arcsinh(mean)])

    def misfit(self, change: np.ndarray, run: str) -> float:
        """How far the features of a simulated change in a run are from the residual's.

        Minus the logarithm of a Student likelihood, but for a constant: a bin that is far off does not decide.
        """
        return sum(self.misfit_by_channel(change, run).values())

    def misfit_by_channel(self, change: np.ndarray, run: str) -> dict[str, float]:
        """The parts of which `misfit` is the sum."""
        energy, mean = self._energy_and_mean(change)
        squares = (self._features - self._transformed(energy + 1.0, mean)) ** 2 / self._variance
        freedom = self._settings.degrees_of_freedom
        terms = 0.5 * (freedom + 1.0) * np.log1p(squares / freedom) * (self._counts > 0)
        return {channel: float(terms[:, bins].sum()) for channel, bins in self._of_run[run].items()}
