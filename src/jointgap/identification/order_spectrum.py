"""What kind of disagreement it is: its spectrum over orders of the crank, and how it grows with speed."""

import numpy as np
import pandas as pd

from jointgap.identification.estimates import HALF_WIDTHS
from jointgap.identification.problem import Part, Problem
from jointgap.identification.whitening import unwhiten


def order_spectrum(problem: Problem, residual: np.ndarray) -> pd.DataFrame:
    """Amplitudes of the whitened residual over orders, cycles per turn of the crank; whole ones keep in step with
    it.
    """
    tables = []
    for part in problem.parts:
        angle, white = part.series.angle[part.used], residual[part.place]
        if angle.size < 4 or not np.isfinite(angle).all():
            continue
        turns = np.ptp(angle) / (2 * np.pi)
        step = 1.0 / max(1, round(turns))
        highest = min(problem.settings.disagreement.highest_order, np.pi / np.median(np.abs(np.diff(angle))))
        count = int(highest / step + 1e-9)  # what falls short of a whole number by rounding is one
        order = step * np.arange(1, count + 1)
        rotation, rotated, sums = np.exp(-1j * step * angle), white - white.mean(), []
        for _ in order:  # one order after the other, as the whole table of phases need not fit in memory
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


def standout_orders(problem: Problem, residual: np.ndarray, rate: float) -> pd.DataFrame:
    """Whole orders of the crank that hold most of what a channel of a run misses, such as a motor's cogging."""
    settings, rows = problem.settings.disagreement, []
    spectrum = order_spectrum(problem, residual)
    lowest = settings.lowest_standout_order
    order = spectrum["order"].to_numpy()
    whole = spectrum[np.isclose(order, np.round(order), rtol=0.0, atol=1e-6) & (order > lowest - 0.5)]
    for part in problem.parts:
        own = whole[(whole["run"] == part.series.run) & (whole["channel"] == part.series.channel)]
        white = residual[part.place]
        excess = float(white @ white) - white.size
        if own.empty or excess <= 0.0:
            continue
        line = own.loc[own["amplitude"].idxmax()]
        share = 0.5 * white.size * line["amplitude"] ** 2 / excess
        if line["p"] * len(own) < rate and share > settings.standout_share:
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
    return pd.DataFrame(rows, columns=["run", "channel", "unit", "order", "amplitude", "share", "p"])


def _amplitude(part: Part, white: np.ndarray, order: float) -> float:
    """Amplitude [unit] of one order in what a series misses, fitted beside a constant."""
    angle = part.series.angle[part.used]
    columns = np.column_stack([np.ones(angle.size), np.cos(order * angle), np.sin(order * angle)])
    _, cosine, sine = np.linalg.lstsq(columns, _missed(part, white), rcond=None)[0]
    return float(np.hypot(cosine, sine))


def _missed(part: Part, white: np.ndarray) -> np.ndarray:
    """Residual [unit] of the samples that count, from the whitened one."""
    whole = np.full(part.used.size, np.nan)
    whole[part.used] = white
    return (unwhiten(whole, part.noise) * part.noise.spread)[part.used]


def speed_scaling(problem: Problem, residual: np.ndarray) -> pd.DataFrame:
    """The power of the speed with which the disagreement of each channel grows: 0 for a constant force, 2 for
    inertia.
    """
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
        x, y, weight = np.log(speed), np.log(excess), 1.0 / sd**2
        x = x - np.average(x, weights=weight)
        exponent = np.sum(weight * x * y) / np.sum(weight * x**2)
        deviation = y - np.average(y, weights=weight) - exponent * x
        # Where runs scatter more than noise lets them, the interval is as wide as their scatter says.
        variance = max(1.0, np.sum(weight * deviation**2) / max(x.size - 2, 1)) / np.sum(weight * x**2)
        half_width = HALF_WIDTHS[90] * np.sqrt(variance)
        rows.append(
            {
                "channel": channel,
                "exponent": exponent,
                "low": exponent - half_width,
                "high": exponent + half_width,
                "runs": x.size,
            }
        )
    return pd.DataFrame(rows, columns=["channel", "exponent", "low", "high", "runs"])


def _excess(part: Part, residual: np.ndarray, sigmas: float) -> tuple[float, float, float] | None:
    """Mean speed [rad/s], root mean square of the disagreement beyond noise [unit], and its relative standard deviation
    [1].

    None where it exceeds noise by fewer than `sigmas` standard deviations, or the run has no angles and times.
    """
    angle, time = part.series.angle[part.used], part.series.time[part.used]
    if angle.size < 2 or not (np.isfinite(angle).all() and np.isfinite(time).all()):
        return None
    speed = (angle[-1] - angle[0]) / (time[-1] - time[0])
    square = _missed(part, residual) ** 2
    noise = float(np.mean(part.noise.spread[part.used] ** 2))
    excess = float(square.mean()) - noise
    sd = noise * np.sqrt(2.0 / square.size) + 2.0 * np.sqrt(noise * max(excess, 0.0) / square.size)
    return (speed, np.sqrt(excess), 0.5 * sd / excess) if speed > 0 and excess > sigmas * sd else None
