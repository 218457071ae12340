"""Pairs of lengths side by side on fresh draws, which took no part in the search.

The draws are independent of each other, and the same for all lengths: differences are taken draw by draw. Intervals of
statistics are bootstrap percentiles over the draws, those of probabilities Clopper and Pearson's.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from jointgap.core.errors import InputError
from jointgap.robust_lengths.robust_measure import RobustMeasure, deviation
from jointgap.robust_lengths.search_lengths import RobustProblem
from jointgap.robust_lengths.simulated_draws import Responses

CONFIDENCE = 0.95
QUANTITIES = ("error", "force", "stroke")
STATISTICS = ("mean", "deviation", "measure", "quantile_05", "median", "quantile_95")

_AT_ONCE = 4_000_000  # numbers of bootstrap samples in memory
_BOOTSTRAP = 2  # beside the seed: the stream of the bootstrap


@dataclass(frozen=True)
class Comparison:
    """What fresh draws say of some pairs of lengths; frames of the tables of the same names."""

    lengths: pd.DataFrame  # A row for each pair of lengths: each statistic of each quantity, with its interval
    gains: pd.DataFrame  # A row for each two of them: how often, and by how much, the error of one is the smaller
    constraints: pd.DataFrame  # A row for each pair of lengths and constraint
    counted: np.ndarray  # shape (n,); draws that were simulated with all lengths


def compare(
    asked: RobustProblem, names: tuple[str, ...], responses: Responses, resamples: int, seed: int
) -> Comparison:
    """Put lengths side by side."""
    counted = ~np.isnan(responses.error).any(axis=0)
    if np.count_nonzero(counted) < 2:
        reason = next(reason for row in responses.reasons for reason in row if reason)
        raise InputError(
            f"optimise_robust: of {len(counted)} fresh draws fewer than two could be simulated with all lengths that "
            f"are compared; the first that failed: {reason}"
        )
    values = {name: getattr(responses, name)[:, counted] for name in QUANTITIES}
    found = {name: statistics(each, asked.measure) for name, each in values.items()}
    low, high = _intervals(values, asked.measure, resamples, seed)
    lengths = pd.DataFrame(
        {
            "lengths": names,
            "crank_length": responses.lengths[:, 0],
            "rod_length": responses.lengths[:, 1],
            "draws": np.count_nonzero(counted),
            "failed": responses.failed,
        }
        | {
            f"{name}_{statistic}{suffix}": each[name][statistic]
            for name in QUANTITIES
            for statistic in STATISTICS
            for suffix, each in (("", found), ("_low", low), ("_high", high))
        }
    )
    return Comparison(
        lengths,
        pd.DataFrame(_gains(asked.measure, names, values["error"], resamples, seed)),
        pd.DataFrame(_held(asked, names, responses), columns=_HELD),
        counted,
    )


def statistics(values: np.ndarray, measure: RobustMeasure) -> dict[str, np.ndarray]:
    """The numbers `STATISTICS` of `values` (..., n), shape (...) each; `measure` is one of them."""
    quantiles = np.quantile(values, (0.05, 0.5, 0.95), axis=-1)
    found = (np.mean(values, axis=-1), deviation(values), measure.of(values), *quantiles)
    return dict(zip(STATISTICS, found, strict=True))


def share_with_interval(times: int, trials: int) -> tuple[float, float, float]:
    """How often something happened, and the exact interval of its probability: (share, low, high)."""
    interval = binomtest(int(times), int(trials)).proportion_ci(CONFIDENCE, method="exact")
    return times / trials, float(interval.low), float(interval.high)


def _resampled(count: int, resamples: int, seed: int) -> Iterator[np.ndarray]:
    """Places (k, count) of draws, so many at a time that memory holds them, `resamples` in all."""
    random = np.random.default_rng([seed, _BOOTSTRAP])
    for first in range(0, resamples, each := max(1, _AT_ONCE // count)):
        yield random.integers(0, count, (min(each, resamples - first), count))


def _ends(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the interval of bootstrap `samples` (resamples, ...)."""
    outside = (1.0 - CONFIDENCE) / 2.0
    return tuple(np.quantile(samples, (outside, 1.0 - outside), axis=0))


def _intervals(
    values: Mapping[str, np.ndarray], measure: RobustMeasure, resamples: int, seed: int
) -> tuple[dict[str, dict[str, np.ndarray]], dict[str, dict[str, np.ndarray]]]:
    """Ends of the intervals of all statistics by quantity."""
    low: dict[str, dict[str, np.ndarray]] = {}
    high: dict[str, dict[str, np.ndarray]] = {}
    for name, each in values.items():
        columns: dict[str, list[list[np.ndarray]]] = {statistic: [] for statistic in STATISTICS}
        for row in each:
            parts = [statistics(row[places], measure) for places in _resampled(len(row), resamples, seed)]
            for statistic, ends in columns.items():
                ends.append(_ends(np.concatenate([part[statistic] for part in parts])))
        low[name] = {statistic: np.array([end[0] for end in ends]) for statistic, ends in columns.items()}
        high[name] = {statistic: np.array([end[1] for end in ends]) for statistic, ends in columns.items()}
    return low, high


def _gains(
    measure: RobustMeasure, names: tuple[str, ...], errors: np.ndarray, resamples: int, seed: int
) -> Iterator[dict[str, object]]:
    for beside, new in combinations(range(len(names)), 2):
        was, now = errors[beside], errors[new]
        share, low, high = share_with_interval(np.count_nonzero(now < was), len(now))
        row: dict[str, object] = {"lengths": names[new], "beside": names[beside], "draws": len(now)}
        row |= {"probability": share, "probability_low": low, "probability_high": high}
        for name, of in (("mean", lambda each: np.mean(each, axis=-1)), ("measure", measure.of)):
            falls = [1.0 - of(now[places]) / of(was[places]) for places in _resampled(len(now), resamples, seed)]
            ends = _ends(np.concatenate(falls))
            row |= {f"{name}_fall": float(1.0 - of(now) / of(was))}
            row |= {f"{name}_fall_low": float(ends[0]), f"{name}_fall_high": float(ends[1])}
        yield row


_HELD = ("lengths", "constraint", "asked", "probability", "probability_low", "probability_high", "draws")


def _held(
    asked: RobustProblem, names: tuple[str, ...], responses: Responses
) -> Iterator[tuple[str | float | int, ...]]:
    for key, missed in asked.missed(responses).items():
        for name, row in zip(names, missed, strict=True):
            held = share_with_interval(np.count_nonzero(row <= 0.0), len(row))
            yield (name, key, asked.probability, *held, len(row))
