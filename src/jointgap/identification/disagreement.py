"""Where simulation and measurement disagree: runs, channels and degrees of the crank angle, at a stated rate of false discoveries."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import chdtrc

from jointgap.identification.order_spectrum import order_spectrum, speed_scaling
from jointgap.identification.problem import Part, Problem
from jointgap.identification.unwhitening import unwhiten
from jointgap.identification.whitening import Noise, whiten

BINS = 36

_LEAST = 0.1
"""Disagreements that are estimated to be smaller [noise's standard deviations] are no matter, however sure."""

_LAGS = 10  # of the Ljung-Box test


@dataclass(frozen=True)
class Map:
    """Where the residual is more than noise.

    Attributes
    ----------
    chi2, p : float
        Sum of the squared whitened residuals of all samples, and its probability by noise alone.
    samples : int
    tests : DataFrame
        Per run and channel: samples, chi2, p_chi2, p_ljung_box (whether whitened residuals remember each other).
    bins : DataFrame
        Per run, channel and bin of the crank angle: start_deg, end_deg, samples, mean and rms [standard deviations of the noise],
        p, p_adjusted (Benjamini-Hochberg over all bins), flagged.
    windows : DataFrame
        Neighbouring flagged bins as one: run, channel, start_deg, end_deg (smaller than the start where 0 lies between), mean,
        rms, p_adjusted; the surest first.
    orders : DataFrame
        Spectrum of the whitened residual over orders of the crank: run, channel, order, amplitude, p.
    scaling : DataFrame
        Per channel, how the disagreement grows with speed: exponent, low, high (90 % interval), runs.
    """

    chi2: float
    p: float
    samples: int
    tests: pd.DataFrame
    bins: pd.DataFrame
    windows: pd.DataFrame
    orders: pd.DataFrame
    scaling: pd.DataFrame


def locate(problem: Problem, residual: np.ndarray, false_discovery: float = 0.01) -> Map:
    """Test the residual run by run, channel by channel, bin by bin of the crank angle.

    Parameters
    ----------
    problem : Problem
    residual : (size,) array
        Whitened, as `Problem.residual` gives it.
    false_discovery : float
        Probability that noise alone makes any window.

    Returns
    -------
    Map
        Channels without crank angle have tests but no bins.
    """
    tests = pd.DataFrame([_test(part, residual[part.place]) for part in problem.parts])
    bins = pd.DataFrame(
        [row for part in problem.parts for row in _bins(part, residual[part.place])],
        columns=["run", "channel", "start_deg", "end_deg", "samples", "mean", "rms", "size", "p"],
    )
    bins["p_adjusted"] = adjusted(bins["p"].to_numpy())
    bins["flagged"] = (bins["p_adjusted"] <= false_discovery) & (bins["size"] >= _LEAST)
    windows = _windows(bins, false_discovery)
    chi2 = float(residual @ residual)
    return Map(
        chi2,
        float(chdtrc(max(residual.size, 1), chi2)),
        residual.size,
        tests,
        bins.drop(columns="size"),
        windows,
        order_spectrum(problem, residual),
        speed_scaling(problem, residual),
    )


def _test(part: Part, residual: np.ndarray) -> dict:
    chi2 = float(residual @ residual)
    return {
        "run": part.series.run,
        "channel": part.series.channel,
        "samples": residual.size,
        "chi2": chi2,
        "p_chi2": float(chdtrc(residual.size, chi2)),
        "p_ljung_box": ljung_box(residual, np.flatnonzero(part.used)),
    }


def ljung_box(residual: np.ndarray, index: np.ndarray, lags: int = _LAGS) -> float:
    """Probability that independent numbers are as correlated over the first lags (Ljung and Box 1978).

    Parameters
    ----------
    residual : (n,) array
    index : (n,) int array
        Place of each among all samples: across gaps nothing is compared.
    lags : int

    Returns
    -------
    float
        NaN where there are too few samples.
    """
    lags = min(lags, residual.size // 5)
    if lags < 1:
        return float("nan")
    row = np.full(index[-1] - index[0] + 1 + lags, np.nan)
    row[index - index[0]] = residual - residual.mean()
    variance, total = np.mean(row[np.isfinite(row)] ** 2), 0.0
    for lag in range(1, lags + 1):
        products = row[lag:] * row[:-lag]
        products = products[np.isfinite(products)]
        if products.size:
            total += (products.size + 2 * lag) / products.size * products.sum() ** 2 / (products.size * variance**2)
    return float(chdtrc(lags, total))


def adjusted(p: np.ndarray) -> np.ndarray:
    """Probabilities adjusted for their number, so that a bound on them bounds the share of false discoveries.

    Benjamini and Hochberg 1995.
    """
    if not p.size:
        return p
    order = np.argsort(p)
    scaled = p[order] * p.size / np.arange(1, p.size + 1)
    found = np.empty(p.size)
    found[order] = np.minimum.accumulate(scaled[::-1])[::-1]
    return np.minimum(found, 1.0)


def _bins(part: Part, residual: np.ndarray) -> list[dict]:
    series, used = part.series, part.used
    if not np.isfinite(series.angle[used]).all():
        return []
    # Whitened residuals right after a window still compare with what was in it: each stay in a bin is whitened for itself.
    white = np.full(used.size, np.nan)
    white[used] = residual
    scaled = unwhiten(white, part.noise)
    turn = np.mod(series.angle, 2 * np.pi) / (2 * np.pi) * BINS
    place = np.where(used, np.minimum(turn.astype(int), BINS - 1), -1)
    line = 2.0 * (turn - place - 0.5)
    columns = np.column_stack([scaled, np.ones(used.size), line])
    apart = _whitened_apart(columns, place, part.noise.autocorrelation)
    rows = []
    for number in range(BINS):
        here = place == number
        if not here.any():
            continue
        values = scaled[here]
        p, size = _disagreement(apart[here, 0], apart[here, 1:])
        rows.append(
            {
                "run": series.run,
                "channel": series.channel,
                "start_deg": number * 360.0 / BINS,
                "end_deg": (number + 1) * 360.0 / BINS,
                "samples": int(here.sum()),
                "mean": float(values.mean()),
                "rms": float(np.sqrt(np.mean(values**2))),
                "size": size,
                "p": p,
            }
        )
    return rows


def _whitened_apart(columns: np.ndarray, place: np.ndarray, autocorrelation: tuple[float, ...]) -> np.ndarray:
    """Columns whitened as if nothing were known before each stay in a bin."""
    if not autocorrelation:
        return columns
    entered = np.concatenate(([0], np.cumsum(np.diff(place) != 0)))
    row = np.arange(place.size) + entered  # a gap before every stay
    spaced = np.full((row[-1] + 1, columns.shape[1]), np.nan)
    spaced[row] = columns
    return whiten(spaced, Noise(np.ones(spaced.shape[0]), autocorrelation))[row]


def _disagreement(white: np.ndarray, basis: np.ndarray) -> tuple[float, float]:
    """Probability of a bin by noise alone, and how large its disagreement is estimated to be.

    Two questions: is there a constant or a slope common to all cycles, and do the residuals scatter more than noise?
    """
    left, sizes, right = np.linalg.svd(basis, full_matrices=False)
    kept = sizes > 1e-6 * sizes[0]
    score = left[:, kept].T @ white
    shared, chi2 = float(score @ score), float(white @ white)
    questions = [chdtrc(kept.sum(), shared), chdtrc(white.size, chi2)]
    constant, slope = right[kept].T @ (score / sizes[kept])
    estimated = max(constant**2 + slope**2 / 3.0, chi2 / white.size - 1.0)
    return float(min(1.0, len(questions) * min(questions))), float(np.sqrt(max(estimated, 0.0)))


def _windows(bins: pd.DataFrame, false_discovery: float) -> pd.DataFrame:
    """Neighbouring flagged bins as one, where at least one of them is sure among all bins (Bonferroni).

    A share of false discoveries among bins is not one among windows: a true window may be many bins, a false one is alone.
    """
    rows = []
    for (run, channel), here in bins.groupby(["run", "channel"], sort=False):
        number = np.rint(here["start_deg"] * BINS / 360.0).to_numpy(int)
        flagged = np.zeros(BINS, bool)
        flagged[number] = here["flagged"]
        for begin, length in circular_spans(flagged):
            chosen = here[np.isin(number, (begin + np.arange(length)) % BINS)]
            if chosen["p"].min() * len(bins) > false_discovery:
                continue
            weight = chosen["samples"] / chosen["samples"].sum()
            end = 360.0 if length == BINS else (begin + length) % BINS * 360.0 / BINS or 360.0
            rows.append(
                {
                    "run": run,
                    "channel": channel,
                    "start_deg": begin * 360.0 / BINS,
                    "end_deg": end,
                    "mean": float(weight @ chosen["mean"]),
                    "rms": float(np.sqrt(weight @ chosen["rms"] ** 2)),
                    "p_adjusted": float(chosen["p_adjusted"].min()),
                }
            )
    columns = ["run", "channel", "start_deg", "end_deg", "mean", "rms", "p_adjusted"]
    return pd.DataFrame(rows, columns=columns).sort_values("p_adjusted", kind="stable", ignore_index=True)


def circular_spans(flagged: np.ndarray) -> list[tuple[int, int]]:
    """First place and length of every row of True on a circle; one that is full begins at 0."""
    if flagged.all():
        return [(0, flagged.size)]
    begins = np.flatnonzero(flagged & ~np.roll(flagged, 1))
    spans = []
    for begin in begins:
        ahead = np.roll(flagged, -begin)
        spans.append((int(begin), int(np.argmin(ahead))))
    return spans
