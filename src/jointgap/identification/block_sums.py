"""Whitened residuals summed over blocks of samples.

An impact that comes a few samples later changes single residuals by more than any effect does, so
that their chi2 has many local minima. Sums over a part of a revolution change smoothly.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from jointgap.identification.fit import FAILED, FiniteDifferences, Fit, fit_hypothesis
from jointgap.identification.problem import Hypothesis, LinearisedChange, Part, Problem


class BlockSums(Problem):
    """A problem with the whitened residuals summed over blocks, divided by the root of their
    number: again of variance 1, if they are noise."""

    def __init__(self, problem: Problem, per_revolution: int):
        super().__init__(problem.model, problem.noise, settings=problem.settings)
        self._samples, self._problem, self._blocks, begin = self.size, problem, [], 0
        for i, part in enumerate(self.parts):
            edges = _edges(part, per_revolution)
            place = slice(begin, begin + edges.size)
            begin = place.stop
            counts = np.diff(np.append(edges, part.place.stop - part.place.start))
            self._blocks.append((part.place, edges, np.sqrt(counts)))
            self.parts[i] = replace(part, place=place)
        self.size = begin

    def predict(
        self, run: str, values: Mapping[str, float], hypothesis: Hypothesis = (), numerics: int = 0
    ) -> Mapping[str, np.ndarray]:
        """Readings predicted by the whole problem, which counts the simulations."""
        return self._problem.predict(run, values, hypothesis, numerics)

    def residual(
        self,
        values: Mapping[str, float],
        hypothesis: Hypothesis = (),
        runs: Sequence[str] | None = None,
        out: np.ndarray | None = None,
        numerics: int = 0,
    ) -> np.ndarray:
        """Summed residuals (size,); those of runs that are not in `runs` are taken from `out`."""
        summed = self.sums(
            self._problem.residual(values, hypothesis, runs, np.zeros(self._samples), numerics)
        )
        if out is not None and runs is not None:
            for part in self.parts:
                if part.series.run not in runs:
                    summed[part.place] = out[part.place]
        return summed

    def linearised(
        self,
        values: Mapping[str, float],
        hypothesis: Hypothesis,
        variations: Sequence[tuple[Mapping[str, float], Hypothesis]],
    ) -> list[LinearisedChange]:
        """As of `Problem.linearised`, for the sums."""
        found = self._problem.linearised(values, hypothesis, variations)
        return [LinearisedChange(self.sums(change), runs) for change, runs in found]

    def sums(self, residual: np.ndarray) -> np.ndarray:
        """Sums (size,) or (size, k) of residuals or their derivatives (n,) or (n, k)."""
        parts = [
            np.add.reduceat(residual[place], edges, axis=0)
            / (root if residual.ndim == 1 else root[:, None])
            for place, edges, root in self._blocks
        ]
        return np.concatenate(parts)


def _edges(part: Part, per_revolution: int) -> np.ndarray:
    """First samples of the blocks of a part; single samples where the angle is unknown."""
    angle = part.series.angle[part.used]
    known = angle[np.isfinite(angle)]
    turns = np.ptp(known) / (2.0 * np.pi) if known.size and not part.series.statistic else 0.0
    length = max(round(angle.size / (turns * per_revolution)), 1) if turns > 0.0 else 1
    return np.arange(0, angle.size, length)


def fit_through_sums(problem: Problem, fit: Fit, differences: FiniteDifferences) -> Fit:
    """The fit of the same hypothesis to all samples by sums of ever shorter blocks, however much
    they exceed noise."""
    start = fit.mapping
    for per_revolution in problem.settings.selection.sums_per_revolution:
        summed = fit_hypothesis(BlockSums(problem, per_revolution), fit.hypothesis, start)
        start = summed.mapping if summed.status != FAILED else start
    return fit_hypothesis(problem, fit.hypothesis, start, differences=differences, refresh=True)


def is_poor(fit: Fit) -> bool:
    """Whether a fit leaves far more than noise."""
    return (
        fit.status == FAILED
        or fit.chi2 > fit.settings.stopping.poor_chi2_per_sample * fit.residual.size
    )
