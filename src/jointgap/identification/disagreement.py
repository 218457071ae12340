"""Map of the residual: significant windows of crank angle, crank orders, scaling with speed."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import chdtrc

from jointgap.identification.line import fit_line
from jointgap.identification.problem import (
    Noise,
    Part,
    Problem,
    autoregression,
    unwhiten,
    usual_step,
    whiten,
)
from jointgap.identification.settings import DEFAULT_SETTINGS, DisagreementSettings


def order_spectrum(problem: Problem, residual: np.ndarray) -> pd.DataFrame:
    """Amplitudes of the whitened residual over crank orders [cycles per revolution]."""
    tables = []
    for part in problem.parts:
        angle, white = part.series.angle[part.used], residual[part.place]
        if angle.size < 4 or not np.isfinite(angle).all():
            continue
        turns = np.ptp(angle) / (2 * np.pi)
        step = 1.0 / max(1, round(turns))
        highest = min(
            problem.settings.disagreement.highest_order, np.pi / usual_step(np.abs(np.diff(angle)))
        )
        count = int(highest / step + 1e-9)
        order = step * np.arange(1, count + 1)
        rotation, rotated, sums = np.exp(-1j * step * angle), white - white.mean(), []
        for _ in order:  # a table of all phases may not fit in memory
            rotated = rotated * rotation
            sums.append(abs(rotated.sum()))
        amplitude = 2.0 / angle.size * np.array(sums)
        tables.append(
            pd.DataFrame(
                {
                    "run": part.series.run,
                    "channel": part.series.channel,
                    "order": order,
                    "amplitude": amplitude,
                    "p": np.exp(-angle.size * amplitude**2 / 4.0),
                }
            )
        )
    empty = pd.DataFrame({"run": [], "channel": [], "order": [], "amplitude": [], "p": []})
    return pd.concat(tables, ignore_index=True) if tables else empty


def dominant_orders(problem: Problem, residual: np.ndarray, rate: float) -> pd.DataFrame:
    """Integer crank orders that dominate the residual of a channel in a run, such as a motor's
    cogging."""
    settings, rows = problem.settings.disagreement, []
    spectrum = order_spectrum(problem, residual)
    lowest = settings.lowest_dominant_order
    order = spectrum["order"].to_numpy()
    whole = spectrum[
        np.isclose(order, np.round(order), rtol=0.0, atol=1e-6) & (order > lowest - 0.5)
    ]
    for part in problem.parts:
        own = whole[(whole["run"] == part.series.run) & (whole["channel"] == part.series.channel)]
        white = residual[part.place]
        excess = float(white @ white) - white.size
        if own.empty or excess <= 0.0:
            continue
        line = own.loc[own["amplitude"].idxmax()]
        share = 0.5 * white.size * line["amplitude"] ** 2 / excess
        if line["p"] * len(own) < rate and share > settings.dominant_share:
            amplitude = _amplitude(part, white, float(line["order"]))
            rows.append(
                {
                    "run": part.series.run,
                    "channel": part.series.channel,
                    "unit": part.series.unit,
                    "order": round(line["order"]),
                    "amplitude": amplitude,
                    "share": min(share, 1.0),
                    "p": line["p"],
                }
            )
    return pd.DataFrame(
        rows, columns=["run", "channel", "unit", "order", "amplitude", "share", "p"]
    )


def _amplitude(part: Part, white: np.ndarray, order: float) -> float:
    """Amplitude [unit] of one order in the residual of a series, fitted with a constant."""
    angle = part.series.angle[part.used]
    columns = np.column_stack([np.ones(angle.size), np.cos(order * angle), np.sin(order * angle)])
    _, cosine, sine = np.linalg.lstsq(columns, _unwhitened(part, white), rcond=None)[0]
    return float(np.hypot(cosine, sine))


def _unwhitened(part: Part, white: np.ndarray) -> np.ndarray:
    """Residual [unit] of the used samples from the whitened one."""
    whole = np.full(part.used.size, np.nan)
    whole[part.used] = white
    return (unwhiten(whole, part.noise) * part.noise.spread)[part.used]


def speed_scaling(problem: Problem, residual: np.ndarray) -> pd.DataFrame:
    """Exponent of the growth of each channel's residual with speed: 0 for a constant force, 2 for
    inertia."""
    rows = []
    for channel in dict.fromkeys(part.series.channel for part in problem.parts):
        excesses = [
            _excess(part, residual[part.place], problem.settings.disagreement.scaling_sigmas)
            for part in problem.parts
            if part.series.channel == channel
        ]
        speed, excess, sd = np.array([run for run in excesses if run is not None]).reshape(-1, 3).T
        if np.unique(speed).size < 2:
            continue
        line = fit_line(np.log(speed), np.log(excess), sd)
        rows.append(
            {
                "channel": channel,
                "exponent": line.slope,
                "low": line.low,
                "high": line.high,
                "runs": speed.size,
            }
        )
    return pd.DataFrame(rows, columns=["channel", "exponent", "low", "high", "runs"])


def _excess(part: Part, residual: np.ndarray, sigmas: float) -> tuple[float, float, float] | None:
    """Mean speed [rad/s], root mean square residual beyond noise [unit], and its relative standard
    deviation [1].

    None if it exceeds noise by fewer than `sigmas` standard deviations, or if the run has no angles
    and times.
    """
    angle, time = part.series.angle[part.used], part.series.time[part.used]
    if angle.size < 2 or not (np.isfinite(angle).all() and np.isfinite(time).all()):
        return None
    speed = (angle[-1] - angle[0]) / (time[-1] - time[0])
    square = _unwhitened(part, residual) ** 2
    noise = float(np.mean(part.noise.spread[part.used] ** 2))
    excess = float(square.mean()) - noise
    sd = np.sqrt((2.0 * noise**2 + 4.0 * noise * max(excess, 0.0)) / square.size)
    return (
        (speed, np.sqrt(excess), 0.5 * sd / excess) if speed > 0 and excess > sigmas * sd else None
    )


@dataclass(frozen=True)
class DisagreementMap:
    """Map of significant residuals."""

    chi2: float  # [1] Sum of squared whitened residuals
    p: float  # [1] Probability of such a chi2 by noise
    samples: int
    tests: pd.DataFrame  # By run and channel
    bins: pd.DataFrame  # By run, channel and bin of the crank angle
    windows: pd.DataFrame  # Merged neighbouring flagged bins
    orders: pd.DataFrame  # Spectrum over crank orders
    standout: pd.DataFrame  # Dominant integer crank orders
    scaling: pd.DataFrame  # Growth with speed, by channel
    remark: str = ""  # Runs and channels without a map


def map_disagreement(
    problem: Problem, residual: np.ndarray, false_discovery: float = 0.01
) -> DisagreementMap:
    """Test the residual by run, channel and bin of the crank angle.

    Spans of several widths are tested by Fisher's combined probability (with a limited contribution
    of each bin), as a small residual may be significant only over many bins. Within significant
    spans, bins are flagged that are likely together with their neighbours; a window begins and ends
    with bins that are likely alone, and must be significant itself.
    """
    settings = problem.settings.disagreement
    tests = pd.DataFrame(
        [_test(part, residual[part.place], settings.ljung_box_lags) for part in problem.parts]
    )
    bins = pd.DataFrame(
        [row for part in problem.parts for row in _bins(part, residual[part.place], settings.bins)],
        columns=["run", "channel", "start_deg", "end_deg", "samples", "mean", "rms", "size", "p"],
    )
    correlations = {
        part.series.key: bin_correlations(part, settings.bins) for part in problem.parts
    }
    bins = flag_bins(bins, settings, false_discovery, correlations)
    windows = _windows(bins)
    chi2 = float(residual @ residual)
    return DisagreementMap(
        chi2,
        float(chdtrc(max(residual.size, 1), chi2)),
        residual.size,
        tests,
        bins.drop(columns="size"),
        windows,
        order_spectrum(problem, residual),
        dominant_orders(problem, residual, false_discovery),
        speed_scaling(problem, residual),
        _remark(problem, bins),
    )


def _remark(problem: Problem, bins: pd.DataFrame) -> str:
    mapped = set(zip(bins["run"], bins["channel"], strict=True))
    without = [
        f"{channel} of run {run}"
        for run, channel in (part.series.key for part in problem.parts)
        if (run, channel) not in mapped
    ]
    if not without:
        return ""
    return (
        f"No map of {', '.join(without)}, as the phase is unknown; see the tests by run and"
        " channel."
    )


def _test(part: Part, residual: np.ndarray, lags: int) -> dict:
    chi2 = float(residual @ residual)
    return {
        "run": part.series.run,
        "channel": part.series.channel,
        "samples": residual.size,
        "chi2": chi2,
        "p_chi2": float(chdtrc(residual.size, chi2)),
        "p_ljung_box": ljung_box(residual, np.flatnonzero(part.used), lags),
    }


def ljung_box(
    residual: np.ndarray,
    index: np.ndarray,
    lags: int = DEFAULT_SETTINGS.disagreement.ljung_box_lags,
) -> float:
    """Probability of such autocorrelations of independent numbers (Ljung and Box 1978)."""
    lags = min(lags, residual.size // 5)
    if lags < 1:
        return float("nan")
    spaced = np.full(index[-1] - index[0] + 1 + lags, np.nan)
    spaced[index - index[0]] = residual - residual.mean()
    variance, statistic = np.mean(spaced[np.isfinite(spaced)] ** 2), 0.0
    for lag in range(1, lags + 1):
        products = spaced[lag:] * spaced[:-lag]
        products = products[np.isfinite(products)]
        if products.size:
            statistic += products.sum() ** 2 / (products.size * variance**2)
    return float(chdtrc(lags, (1.0 + 2.0 / residual.size) * statistic))


def _bins(part: Part, residual: np.ndarray, count: int) -> list[dict]:
    series, used = part.series, part.used
    if not np.isfinite(series.angle[used]).all():
        return []
    # each passage through a bin is whitened separately: otherwise the sample after a window would
    # be flagged too
    white = np.full(used.size, np.nan)
    white[used] = residual
    scaled = unwhiten(white, part.noise)
    position = np.mod(series.angle, 2 * np.pi) / (2 * np.pi) * count
    bin_of = np.where(used, np.minimum(position.astype(int), count - 1), -1)
    slope = 2.0 * (position - bin_of - 0.5)  # from -1 to 1 over the bin
    columns = np.column_stack([scaled, np.ones(used.size), slope])
    white_columns = _whiten_passages(columns, bin_of, part.noise.autocorrelation)
    rows = []
    for number in range(count):
        inside = bin_of == number
        if not inside.any():
            continue
        values = scaled[inside]
        p, size = _disagreement(white_columns[inside, 0], white_columns[inside, 1:])
        rows.append(
            {
                "run": series.run,
                "channel": series.channel,
                "start_deg": number * 360.0 / count,
                "end_deg": (number + 1) * 360.0 / count,
                "samples": int(inside.sum()),
                "mean": float(values.mean()),
                "rms": float(np.sqrt(np.mean(values**2))),
                "size": size,
                "p": p,
            }
        )
    return rows


def _whiten_passages(
    columns: np.ndarray, bin_of: np.ndarray, autocorrelation: tuple[float, ...]
) -> np.ndarray:
    """Columns (n, m), each passage through a bin whitened separately."""
    if not autocorrelation:
        return columns
    entered = np.concatenate(([0], np.cumsum(np.diff(bin_of) != 0)))
    row = np.arange(bin_of.size) + entered  # with a gap before every passage
    spaced = np.full((row[-1] + 1, columns.shape[1]), np.nan)
    spaced[row] = columns
    return whiten(spaced, Noise(np.ones(spaced.shape[0]), autocorrelation))[row]


def _disagreement(white: np.ndarray, basis: np.ndarray) -> tuple[float, float]:
    """Probability of a bin by noise, and the estimated size of its residual.

    Two tests: a constant and slope common to all cycles, and the scatter of the residuals.
    """
    left, sizes, right = np.linalg.svd(basis, full_matrices=False)
    kept = sizes > 1e-6 * sizes[0]  # a bin of one sample has no slope
    score = left[:, kept].T @ white
    shared, chi2 = float(score @ score), float(white @ white)
    p = [chdtrc(kept.sum(), shared), chdtrc(white.size, chi2)]
    constant, slope = right[kept].T @ (score / sizes[kept])
    estimated = max(constant**2 + slope**2 / 3.0, chi2 / white.size - 1.0)
    return float(min(1.0, len(p) * min(p))), float(np.sqrt(max(estimated, 0.0)))


def adjusted_for_number(p: np.ndarray) -> np.ndarray:
    """Probabilities (n,) adjusted for their number: the least rate of false discoveries at which
    each is one (Benjamini and Hochberg 1995)."""
    order = np.argsort(-p)
    ranks = np.arange(p.size, 0, -1)
    adjusted = np.empty(p.size)
    adjusted[order] = np.minimum.accumulate(np.minimum(p[order] * (p.size / ranks), 1.0))
    return adjusted


def flag_bins(
    bins: pd.DataFrame,
    settings: DisagreementSettings,
    sure: float,
    correlations: Mapping[tuple[str, str], np.ndarray] | None = None,
) -> pd.DataFrame:
    """Flag bins: in a significant span, likely with their neighbours, and in a window that is
    significant itself."""
    bins = bins.reset_index(drop=True)
    groups = list(bins.groupby(["run", "channel"], sort=False))
    circles = [
        _ChannelBins(
            rows["p"].to_numpy(float), settings, (correlations or {}).get(key, np.empty(0))
        )
        for key, rows in groups
    ]
    spans = sum(circle.spans.size for circle in circles)
    adjusted = adjusted_for_number(
        np.concatenate([np.empty(0), *(circle.spans for circle in circles)])
    )
    p_adjusted, flagged = np.ones(len(bins)), np.zeros(len(bins), bool)
    for circle, (_, rows) in zip(circles, groups, strict=True):
        own, adjusted = adjusted[: circle.spans.size], adjusted[circle.spans.size :]
        least = np.min(np.where(circle.held, own[:, None], 1.0), axis=0)
        alone = own[: circle.p.size]  # spans of one bin come first
        likely = (circle.around <= settings.likely) | (alone <= sure)
        ends = (circle.p <= settings.likely_end) & (rows["size"].to_numpy() >= settings.min_size)
        for window in _trimmed((least <= sure) & likely, ends):
            if circle.together(window) * spans <= sure:
                flagged[rows.index[window]] = True
        p_adjusted[rows.index] = least
    return bins.assign(p_adjusted=p_adjusted, flagged=flagged)


class _ChannelBins:
    """The bins of one channel in one run, and their spans."""

    def __init__(self, p: np.ndarray, settings: DisagreementSettings, correlations: np.ndarray):
        self.p, self._least, self._squares = p, settings.least_of_one, np.square(correlations)
        widths = [1, *(width for width in settings.spans if width <= p.size)]
        self.held = np.vstack([self._spans_of(width) for width in widths])
        self.spans = np.concatenate(
            [p, *(self._combined(self._spans_of(width)) for width in widths[1:])]
        )
        around = self._spans_of(min(settings.neighbours, p.size))
        self.around = np.roll(self._combined(around), settings.neighbours // 2)

    def _spans_of(self, width: int) -> np.ndarray:
        """Masks (m, m) of all spans of a width by their begin."""
        return np.array(
            [np.roll(np.arange(self.p.size) < width, begin) for begin in range(self.p.size)]
        )

    def _combined(self, held: np.ndarray) -> np.ndarray:
        """Combined probability by noise of the bins in each of the spans `held` (k, m) of one
        width.

        Fisher's sum of logarithms, corrected for correlated noise (Brown, Biometrics 31 (1975)
        987-992): squares of normal numbers correlate by the square of their correlation.
        """
        width = int(held[0].sum())
        squares = self._squares[: width - 1]
        share = 1.0 - np.arange(1, squares.size + 1) / width
        alike = 1.0 + 2.0 * float(share @ squares)
        logarithms = -2.0 * np.log(np.maximum(self.p, self._least))
        return chdtrc(2.0 * width / alike, held @ logarithms / alike)

    def together(self, window: np.ndarray) -> float:
        """Probability of a window (indices of its bins) by noise: the smallest of one bin or of all
        together."""
        held = np.isin(np.arange(self.p.size), window)[None]
        return min(float(self.p[window].min()), float(self._combined(held)[0]))


def bin_correlations(part: Part, count: int) -> np.ndarray:
    """Correlations (count - 1,) [1] of the mean noise in bins at distances 1, 2, ...; empty for
    white noise or without angles.
    """
    if not part.noise.autocorrelation:
        return np.empty(0)
    turned = np.abs(np.diff(part.series.angle[part.used]))
    turned = turned[turned > 0.0]
    if not turned.size:
        return np.empty(0)
    samples = max(round(2 * np.pi / count / float(np.median(turned))), 1)
    weights, _ = autoregression(part.noise.autocorrelation)[-1]
    lags = [1.0]
    for lag in range(1, samples * count):
        reach = min(lag, weights.size)
        known = np.array([lags[lag - back] for back in range(1, reach + 1)])
        lags.append(
            float(weights[:reach] @ known)
            if lag > weights.size
            else part.noise.autocorrelation[lag - 1]
        )
    offsets = np.subtract.outer(np.arange(samples), np.arange(samples))
    means = [
        np.mean(np.array(lags)[np.abs(offsets + apart * samples)]) for apart in range(count - 1)
    ]
    return np.array(means[1:]) / means[0]


def _trimmed(flagged: np.ndarray, ends: np.ndarray) -> list[np.ndarray]:
    """Indices of the bins of each flagged span on the circle, trimmed to bins that may be at an
    end."""
    windows = []
    for begin, length in circular_spans(flagged):
        chosen = (begin + np.arange(length)) % flagged.size
        at_ends = np.flatnonzero(ends[chosen])
        if at_ends.size:
            windows.append(
                chosen if length == flagged.size else chosen[at_ends[0] : at_ends[-1] + 1]
            )
    return windows


def _windows(bins: pd.DataFrame) -> pd.DataFrame:
    """Merge neighbouring flagged bins."""
    rows = []
    for (run, channel), rows_here in bins.groupby(["run", "channel"], sort=False):
        for begin, length in circular_spans(rows_here["flagged"].to_numpy(bool)):
            chosen = rows_here.iloc[(begin + np.arange(length)) % len(rows_here)]
            weight = chosen["samples"] / chosen["samples"].sum()
            rows.append(
                {
                    "run": run,
                    "channel": channel,
                    "start_deg": float(chosen["start_deg"].iloc[0]),
                    "end_deg": float(chosen["end_deg"].iloc[-1]),
                    "mean": float(weight @ chosen["mean"]),
                    "rms": float(np.sqrt(weight @ chosen["rms"] ** 2)),
                    "p_adjusted": float(chosen["p_adjusted"].min()),
                }
            )
    columns = ["run", "channel", "start_deg", "end_deg", "mean", "rms", "p_adjusted"]
    return pd.DataFrame(rows, columns=columns).sort_values(
        "p_adjusted", kind="stable", ignore_index=True
    )


def circular_spans(flagged: np.ndarray) -> list[tuple[int, int]]:
    """First index and length of every span of True on a circle; a full circle begins at 0."""
    if flagged.all():
        return [(0, flagged.size)]
    begins = np.flatnonzero(flagged & ~np.roll(flagged, 1))
    spans = []
    for begin in begins:
        ahead = np.roll(flagged, -begin)
        spans.append((int(begin), int(np.argmin(ahead))))
    return spans
