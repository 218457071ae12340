"""Whitened residuals of a model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dtbsv

from jointgap.core.candidates import Candidate, Linearised, Model, Parameter, Series, runs_of
from jointgap.core.errors import SimulationError
from jointgap.core.progress import report_progress
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings

# Simulated runs that take as long as a linearisation, and as each of its variations
LINEARISATION_RUNS, VARIATION_RUNS = 3.3, 0.3


@dataclass(frozen=True)
class Noise:
    """Noise of one series."""

    sd: np.ndarray  # Marginal standard deviation of the measurement [unit]
    autocorrelation: tuple[float, ...] = ()
    numerics: np.ndarray | float = (
        0.0  # Standard deviation between equivalent solver variants [unit]
    )
    source: str = "stated"  # Source of `sd`
    drive: np.ndarray | None = None

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation (n,) [unit] of the residual of a true model."""
        return np.sqrt(self.sd**2 + np.square(self.numerics))


def whiten(residual: np.ndarray, noise: Noise) -> np.ndarray:
    """Whitened residuals: independent, of variance 1, if they are noise.

    The prediction from previous samples (back to the last gap) is subtracted: exact for an
    autoregressive process.
    """
    flat = residual.ndim == 1
    scaled = (residual[:, None] if flat else residual) / noise.spread[:, None]
    if noise.autocorrelation:
        scaled = _innovations(scaled, autoregression(noise.autocorrelation))
    return scaled[:, 0] if flat else scaled


class SharedErrors:
    """Errors common to several series, whitened after their noise."""

    def __init__(self, changes: np.ndarray):
        self._directions, sizes, _ = np.linalg.svd(changes, full_matrices=False)
        self._excess = 1.0 - 1.0 / np.hypot(1.0, sizes)
        self.changes = self._directions * sizes

    def whiten(self, residual: np.ndarray) -> np.ndarray:
        """Whiten residuals (n,) with the covariance I + changes changes', by its symmetric root."""
        return residual - self._directions @ (self._excess * (self._directions.T @ residual))


def usual_step(steps: np.ndarray) -> float:
    """Usual step [rad] of the crank angle between samples: the median, or the mean if an encoder is
    read faster than it counts, so that readings repeat."""
    return float(np.median(steps) if steps.all() else np.mean(steps))


def autoregression(autocorrelation: Sequence[float]) -> list[tuple[np.ndarray, float]]:
    """Prediction weights (order,) and remaining standard deviation for the orders 0, 1, ..., p
    (Levinson).

    In standard deviations of the process; `autocorrelation` at lags 1 ... p.
    """
    rho = np.concatenate(([1.0], autocorrelation))
    weights, variance = np.empty(0), 1.0
    orders = [(weights, 1.0)]
    for order in range(1, rho.size):
        reflection = (rho[order] - weights @ rho[order - 1 : 0 : -1]) / variance
        weights = np.append(weights - reflection * weights[::-1], reflection)
        variance *= 1.0 - reflection**2
        if not variance > 0.0:
            raise ValueError(f"autocorrelation {list(autocorrelation)} is not positive definite")
        orders.append((weights, float(np.sqrt(variance))))
    return orders


def _innovations(scaled: np.ndarray, orders: list[tuple[np.ndarray, float]]) -> np.ndarray:
    present = np.isfinite(scaled[:, 0])
    index = np.arange(present.size)
    since_gap = index - np.maximum.accumulate(np.where(present, -1, index))  # including this one
    innovations = np.full(scaled.shape, np.nan)
    for order, (weights, sd) in enumerate(orders):
        last = order == len(orders) - 1
        chosen = index[present & ((since_gap > order) if last else (since_gap == order + 1))]
        value = scaled[chosen]
        for lag, weight in enumerate(weights, 1):
            value = value - weight * scaled[chosen - lag]
        innovations[chosen] = value / sd
    return innovations


def unwhiten(white: np.ndarray, noise: Noise) -> np.ndarray:
    """The inverse of `whiten`, in units of the noise's spread."""
    if not noise.autocorrelation:
        return white
    orders = autoregression(noise.autocorrelation)
    weights, sd = orders[-1]
    scaled = np.full(white.size, np.nan)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], np.isfinite(white), [False]))))
    for begin, end in edges.reshape(-1, 2):
        # rows y_i - w_1 y_(i-1) - ... = sd white_i, with the lower orders at the beginning
        band, driven = np.ones((weights.size + 1, end - begin)), sd * white[begin:end]
        band[1:] = -weights[:, None]
        for i, (earlier, innovation) in enumerate(orders[:-1][: end - begin]):
            driven[i] = innovation * white[begin + i]
            for lag, weight in enumerate(earlier, 1):
                band[lag, i - lag] = -weight
        scaled[begin:end] = dtbsv(weights.size, band, driven, lower=1, diag=1)
    return scaled


Hypothesis = tuple[Candidate, ...]
"""Effects added to the model; () is the current model."""


def label_of(hypothesis: Hypothesis) -> str:
    """``gravity + slider_spring``; ``base`` for the current model."""
    return " + ".join(candidate.label for candidate in hypothesis) or "base"


def values_in_run(
    model: Model, run: str, values: Mapping[str, float], hypothesis: Hypothesis = ()
) -> tuple[dict[str, float], list[tuple[Candidate, dict[str, float]]]]:
    """Arguments of `Model.simulate`: nuisances [SI] of a run by name, and effects with their
    values."""
    replaced = {name for candidate in hypothesis for name in candidate.replaces}
    here = [p for p in model.nuisances if p.run in (None, run)]
    nuisances = {
        p.name: p.nominal if p.name in replaced else values.get(p.key, p.nominal) for p in here
    }
    effects = [
        (
            candidate,
            {p.name: values[f"{candidate.label}.{p.key}"] for p in candidate.coordinates_in((run,))}
            | ({"middle_s": candidate.middles[run]} if run in candidate.middles else {}),
        )
        for candidate in hypothesis
    ]
    return nuisances, effects


@dataclass(frozen=True)
class Part:
    """Position of one series in the vector of residuals."""

    series: Series
    noise: Noise
    used: np.ndarray  # (n,) bool: used samples of the series
    place: slice


@dataclass(frozen=True)
class SearchLimit:
    """Number of simulated runs after which a step of the search begins no further fit."""

    problem: "Problem"
    step: str  # In words
    simulations: float

    def reached(self) -> bool:
        """Whether the next fit is omitted; if so, the problem's `not_searched` has the step."""
        reached = self.problem.simulations > self.simulations
        if reached and self.step not in self.problem.not_searched:
            self.problem.not_searched.append(self.step)
        return reached


class LinearisedChange(NamedTuple):
    """Change (size,) of the residuals of `runs` by linearisation; zero in other runs."""

    change: np.ndarray
    runs: tuple[str, ...]


class Problem:
    """The fitted or held-out samples, and the whitened residuals of a hypothesis."""

    def __init__(
        self,
        model: Model,
        noise: Mapping[tuple[str, str], Noise],
        held_out: bool = False,
        planned: bool = False,
        settings: IdentificationSettings = DEFAULT_SETTINGS,
    ):
        self.model, self.noise, self.settings = model, noise, settings
        self.simulations = 0
        self.not_searched: list[str] = []  # Steps of the search that ended at their limit, in words
        self.parts: list[Part] = []
        begin = 0
        for series in model.series:
            used = series.held_out == held_out
            if not planned:
                used = used & np.isfinite(series.value)
            if used.any():
                count = int(used.sum())
                self.parts.append(
                    Part(series, noise[series.key], used, slice(begin, begin + count))
                )
                begin += count
        self.size = begin
        self._shared = {
            run: shared for run in self.runs if (shared := self._shared_errors(run)) is not None
        }
        self._planned: dict[tuple[str, str], np.ndarray] = {}
        if planned:
            at_nominal = {p.key: p.nominal for p in self.nuisances}
            self._planned = {
                (run, channel): values
                for run in self.runs
                for channel, values in self.predict(run, at_nominal).items()
            }

    @cached_property
    def runs(self) -> tuple[str, ...]:
        """Runs with used samples."""
        here = {part.series.run for part in self.parts}
        return tuple(run for run in runs_of(self.model) if run in here)

    @cached_property
    def has_statistics(self) -> bool:
        """Whether a run has non-periodic motion, compared by statistics over cycles."""
        return any(part.series.statistic for part in self.parts)

    @cached_property
    def is_rough(self) -> bool:
        """Whether chi2 of all samples is rough, as with loose joints: their solver error counts as
        noise."""
        rough = any(np.any(part.noise.numerics) for part in self.parts)
        return rough and not self.has_statistics

    def limit(self, step: str, share: float = 1.0) -> "SearchLimit":
        """The limit of a step of the search that begins now, with a `share` [1] of all simulated
        runs."""
        settings = self.settings.selection
        most = (
            settings.max_simulations_of_statistics
            if self.has_statistics
            else settings.max_simulations
        )
        return SearchLimit(self, step, self.simulations + share * most)

    @cached_property
    def nuisances(self) -> tuple[Parameter, ...]:
        """Nuisances of these runs."""
        return tuple(p for p in self.model.nuisances if p.run in (None, *self.runs))

    def parameters(self, hypothesis: Hypothesis) -> tuple[Parameter, ...]:
        """Parameters of a fit of `hypothesis`: nuisances that no effect replaces, then coordinates.

        Coordinates are renamed ``label.coordinate``; those of other runs are omitted.
        """
        replaced = {name for candidate in hypothesis for name in candidate.replaces}
        kept = [p for p in self.nuisances if p.name not in replaced]
        for candidate in hypothesis:
            for p in candidate.coordinates_in(self.runs):
                kept.append(replace(p, name=f"{candidate.label}.{p.name}"))
        return tuple(kept)

    def predict(
        self, run: str, values: Mapping[str, float], hypothesis: Hypothesis = (), numerics: int = 0
    ) -> Mapping[str, np.ndarray]:
        """Predicted sensor readings of one run."""
        self.simulations += 1
        report_progress("simulated runs of the rig", self.simulations)
        return self.model.simulate(
            run, *values_in_run(self.model, run, values, hypothesis), numerics
        )

    def residual(
        self,
        values: Mapping[str, float],
        hypothesis: Hypothesis = (),
        runs: Sequence[str] | None = None,
        out: np.ndarray | None = None,
        numerics: int = 0,
    ) -> np.ndarray:
        """Whitened residuals (size,): independent, of variance 1, if the model is true."""
        residual = np.empty(self.size) if out is None else out.copy()
        for run in self.runs if runs is None else runs:
            predicted = self.predict(run, values, hypothesis, numerics)
            for part in self.parts:
                if part.series.run == run:
                    residual[part.place] = self._whitened(part, predicted[part.series.channel])
            if run in self._shared:
                place, errors = self._shared[run]
                residual[place] = errors.whiten(residual[place])
        return residual

    def linearised(
        self,
        values: Mapping[str, float],
        hypothesis: Hypothesis,
        variations: Sequence[tuple[Mapping[str, float], Hypothesis]],
    ) -> list["LinearisedChange"]:
        """Changes of the residuals from `values` and `hypothesis` to each of the nearby
        `variations`, as far as the model linearises its runs."""
        changes = [np.zeros(self.size) for _ in variations]
        known: list[tuple[str, ...]] = [() for _ in variations]
        for run in self.runs if isinstance(self.model, Linearised) else ():
            base = values_in_run(self.model, run, values, hypothesis)
            nearby = [values_in_run(self.model, run, *variation) for variation in variations]
            found = self.model.changes(run, *base, nearby) if nearby else None
            if found is None:
                continue
            self.simulations += round(LINEARISATION_RUNS + VARIATION_RUNS * len(nearby))
            for place, change in enumerate(found):
                if change is not None:
                    changes[place] += self._whitened_change(run, change)
                    known[place] += (run,)
        return [LinearisedChange(*pair) for pair in zip(changes, known, strict=True)]

    def _whitened_change(self, run: str, change: Mapping[str, np.ndarray]) -> np.ndarray:
        """Change (size,) of the residuals by a change of a run's predicted readings."""
        found = np.zeros(self.size)
        for part in self.parts:
            if part.series.run == run:
                changed = np.where(part.used, -change[part.series.channel], np.nan)
                found[part.place] = whiten(changed, part.noise)[part.used]
        if run in self._shared:
            place, errors = self._shared[run]
            found[place] = errors.whiten(found[place])
        return found

    def shared_changes(self, run: str) -> np.ndarray:
        """Change (n, e) of a run's residuals by each common error of variance 1."""
        places = np.concatenate(
            [np.arange(p.place.start, p.place.stop) for p in self.parts if p.series.run == run]
        )
        if run not in self._shared:
            return np.zeros((places.size, 0))
        sharing, errors = self._shared[run]
        changes = np.zeros((self.size, errors.changes.shape[1]))
        changes[sharing] = errors.changes
        return changes[places]

    def together(self, residual: np.ndarray) -> np.ndarray:
        """Residuals (n,), whitened by series, whitened for common errors too."""
        residual = residual.copy()
        for sharing, errors in self._shared.values():
            residual[sharing] = errors.whiten(residual[sharing])
        return residual

    def _shared_errors(self, run: str) -> tuple[np.ndarray, SharedErrors] | None:
        """Indices of the residuals with common errors, and these; None if the drive is exact."""
        parts = [
            part for part in self.parts if part.series.run == run and part.noise.drive is not None
        ]
        if not parts:
            return None
        changes = [
            whiten(np.where(part.used[:, None], part.noise.drive, np.nan), part.noise)[part.used]
            for part in parts
        ]
        places = np.concatenate([np.arange(part.place.start, part.place.stop) for part in parts])
        return places, SharedErrors(np.vstack(changes))

    def _whitened(self, part: Part, predicted: np.ndarray) -> np.ndarray:
        if not np.isfinite(predicted[part.used]).all():
            raise SimulationError(
                f"run {part.series.run}: the simulated {part.series.channel} is not finite"
            )
        value = self._planned.get(part.series.key, part.series.value)
        return whiten(np.where(part.used, value - predicted, np.nan), part.noise)[part.used]

    def gap(self, residual: np.ndarray) -> float:
        """Root of the mean over runs and channels of the mean squared whitened residual; 1 is
        noise."""
        return float(np.sqrt(np.mean([np.mean(residual[part.place] ** 2) for part in self.parts])))
