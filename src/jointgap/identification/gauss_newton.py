"""Parts of a bounded, damped Gauss-Newton descent: step, correction of the Jacobian, damping and stopping rule.

`jointgap.identification.fit` puts them together; the step is also what a screening of candidates is made of.
"""

import numpy as np
from scipy.optimize import lsq_linear

from jointgap.identification.settings import DampingSettings, StoppingSettings


def compress_rows(*blocks: np.ndarray) -> list[np.ndarray]:
    """The blocks' columns in fewer rows, with all inner products between them kept."""
    wide = [block[:, None] if block.ndim == 1 else block for block in blocks]
    small = np.linalg.qr(np.hstack(wide), mode="r")
    ends = np.cumsum([block.shape[1] for block in wide])[:-1]
    return [
        part[:, 0] if block.ndim == 1 else part
        for part, block in zip(np.split(small, ends, axis=1), blocks, strict=True)
    ]


def bounded_step(
    jacobian: np.ndarray, residual: np.ndarray, low: np.ndarray, high: np.ndarray, damping: float = 0.0
) -> tuple[np.ndarray, float]:
    """The step within bounds that makes ``residual + jacobian @ step`` smallest, and the square of what remains."""
    length = np.linalg.norm(jacobian, axis=0)
    live = (length > 0) & (high > low)
    step = np.zeros(jacobian.shape[1])
    if not live.any():
        return step, float(residual @ residual)
    small, rest = compress_rows(jacobian[:, live] / length[live], residual)
    # A touch of damping keeps combinations of parameters that change nothing from running off to the bounds.
    ridge = np.sqrt(damping + 1e-10) * np.eye(small.shape[1])
    scale = length[live]
    bounds = np.minimum(low[live], 0.0) * scale, np.maximum(high[live], 0.0) * scale
    matrix, target = np.vstack([small, ridge]), np.concatenate([-rest, np.zeros(small.shape[1])])
    free = np.linalg.lstsq(matrix, target, rcond=None)[0]
    if (free < bounds[0]).any() or (free > bounds[1]).any():
        free = lsq_linear(matrix, target, bounds, method="bvls").x
    step[live] = free / scale
    remainder = rest + small @ free
    return step, float(remainder @ remainder + max(residual @ residual - rest @ rest, 0.0))


def broyden_update(jacobian: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The Jacobian made to agree with one step (Broyden 1965), in units of the columns' lengths: none is preferred."""
    weight = step * np.sum(jacobian**2, axis=0)
    if not (inner := weight @ step) > 0:
        return jacobian
    return jacobian + np.outer(change - jacobian @ step, weight / inner)


def next_damping(damping: float, gain_ratio: float, fresh: bool, settings: DampingSettings) -> float | None:
    """The damping of the next step; None where the Jacobian is to be made anew instead, undamped.

    A corrected Jacobian is blamed for a bad step first; only where one made at this point predicts badly is it
    curvature.
    """
    if gain_ratio > settings.good_gain_ratio:
        return damping / settings.factor if damping > settings.negligible else 0.0
    return max(settings.factor * damping, settings.first) if fresh else None


class StoppingRule:
    """When a descent ends, from the course of its chi2."""

    def __init__(
        self,
        settings: StoppingSettings,
        size: int,
        numerical_noise_chi2: float = 0.0,
        sufficient_chi2: float = np.inf,
        smoothed: bool = False,
    ):
        self.settings, self.size = settings, size
        self.max_steps = settings.smoothed_max_steps if smoothed else settings.max_steps
        self._share = settings.smoothed_decrease if smoothed else 0.0
        self._numerical_noise, self._sufficient = numerical_noise_chi2, sufficient_chi2
        self._creeping = max(settings.creeping_decrease, numerical_noise_chi2)
        self._renewed, self._chi2_at_renewal = 0, np.inf
        self.chi2: list[float] = []

    def record(self, chi2: float) -> None:
        """Note chi2 at the start, and after each step that was tried."""
        self.chi2.append(chi2)

    def _before(self, steps: int) -> float:
        return self.chi2[max(len(self.chi2) - 1 - steps, 0)]

    def min_decrease(self) -> float:
        """The smallest predicted decrease of chi2 that is worth a step."""
        chi2 = self.chi2[-1]
        per_sample = max(1.0, chi2 / self.size)
        wanted = min(self.settings.min_decrease * per_sample**2, per_sample)
        return max(wanted, self._numerical_noise, self._share * chi2)

    def poor_and_slow(self) -> bool:
        """Whether the fit is poor and hardly improves, so that it will not be named; sooner for one that is beaten."""
        settings, chi2 = self.settings, self.chi2[-1]
        beaten = chi2 > settings.beaten_factor * self._sufficient
        window = settings.beaten_window if beaten else settings.stalled_window
        progress = settings.beaten_progress if beaten else settings.poor_progress
        if len(self.chi2) <= window:
            return False
        slow = self._before(window) - chi2 < progress * chi2
        return slow and progress * chi2 > progress * settings.poor_chi2_per_sample * self.size

    def creeping(self, iteration: int) -> bool:
        """Whether a long fit gains so little that its corrected Jacobian is worn out."""
        settings = self.settings
        long = iteration >= self._renewed + settings.creeping_after
        return long and self._before(settings.stalled_window) - self.chi2[-1] < self._creeping

    def renew(self, iteration: int) -> bool:
        """Note that a creeping fit gets a new Jacobian; False where the last renewal did not help: then it ends."""
        if self._renewed and self._chi2_at_renewal - self.chi2[-1] < self._creeping:
            return False
        self._renewed, self._chi2_at_renewal = iteration, self.chi2[-1]
        return True
