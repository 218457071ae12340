"""Frequencies, in time or over the crank angle, at which a swinging effect may be hidden in a residual."""

from collections.abc import Callable, Sequence

import numpy as np

from jointgap.identification.problem import Part
from jointgap.identification.protocol import Parameter
from jointgap.identification.settings import ScreeningSettings


def likely_frequencies(
    parts: Sequence[Part],
    residual: np.ndarray,
    jacobian: np.ndarray,
    carrier: np.ndarray,
    frequency: Parameter,
    settings: ScreeningSettings,
) -> list[float]:
    """The most likely frequencies [Hz] of an effect that is `carrier` times a cosine in time, the likeliest first.

    A periodogram by least squares: at each frequency the carrier times a cosine and a sine, of each run its own, are
    fitted beside the nuisances. It is exact where the motion does not respond to the force (a prescribed motion, of
    which forces are read).
    """
    time, run = np.full(residual.size, np.nan), np.empty(residual.size, dtype=object)
    for part in parts:
        run[part.place] = part.series.run
        if not part.series.statistic:
            time[part.place] = part.series.time[part.used]
    timed = np.isfinite(time)
    if not timed.any() or not residual.any():  # a preflight has nothing to search
        return []
    span = max(np.ptp(part.series.time[part.used]) for part in parts if timed[part.place].all())
    step = 1.0 / (settings.frequencies_per_line * span)
    densest = min(np.median(np.diff(part.series.time[part.used])) for part in parts if timed[part.place].all())
    tried = np.arange(max(frequency.low, 0.5 / span), min(frequency.high, 0.5 / densest), step)
    order = orders_of_cranks(parts, settings)
    tried = np.array([hertz for hertz in tried if not order(hertz)])  # an effect in step with the crank is another one
    basis, left = _beyond_nuisances(residual, jacobian)
    carriers = [np.where(timed & (run == name), carrier, 0.0) for name in dict.fromkeys(run)]
    time = np.where(timed, time, 0.0)
    power = np.array([_power(2 * np.pi * hertz * time, carriers, basis, left) for hertz in tried])
    inner = np.arange(1, power.size - 1)
    peaks = inner[(power[inner] >= power[inner - 1]) & (power[inner] > power[inner + 1])]
    return [float(tried[i]) for i in sorted(peaks, key=lambda i: -power[i])[: settings.max_frequencies]]


def likely_orders(
    parts: Sequence[Part],
    residual: np.ndarray,
    jacobian: np.ndarray,
    carrier: np.ndarray,
    order: Parameter,
    settings: ScreeningSettings,
) -> list[float]:
    """The most likely orders [cycles per revolution] of an effect that is `carrier` times a cosine of the crank angle.

    As `likely_frequencies`, over those that the parameter says; an effect in step with the crank has one phase in all
    runs. Orders that the samples of a series do not resolve are not looked for.
    """
    angle = np.full(residual.size, np.nan)
    finest = np.inf
    for part in parts:
        own = part.series.angle[part.used]
        angle[part.place] = own
        if np.isfinite(own).sum() > 1:
            finest = min(finest, float(np.nanmedian(np.abs(np.diff(own)))))
    known = np.isfinite(angle)
    if not known.any() or not residual.any():  # a preflight has nothing to search
        return []
    tried = np.array([value for value in order.tried if value <= np.pi / max(finest, 1e-9)])
    basis, left = _beyond_nuisances(residual, jacobian)
    carriers, angle = [np.where(known, carrier, 0.0)], np.where(known, angle, 0.0)
    power = [_power(k * angle, carriers, basis, left) for k in tried]
    return [float(tried[i]) for i in sorted(range(tried.size), key=lambda i: -power[i])[: settings.max_frequencies]]


def orders_of_cranks(parts: Sequence[Part], settings: ScreeningSettings) -> Callable[[float], str]:
    """What tells of a frequency [Hz] whether it is an order or half an order of a run's crank, in words; empty where it
    is none.
    """
    rates = {}
    for series in (part.series for part in parts if not part.series.statistic):
        known = np.isfinite(series.time) & np.isfinite(series.angle)
        turns, seconds = (np.ptp(values[known]) if known.any() else 0.0 for values in (series.angle, series.time))
        if turns > 0.0 and seconds > 0.0:
            rates[series.run] = float(turns / seconds / (2.0 * np.pi))

    def order_in_words(frequency: float) -> str:
        for run, rate in rates.items():
            order = max(round(2.0 * frequency / rate), 1) / 2.0
            if abs(frequency / rate - order) <= settings.order_width:
                return f"order {order:g} of the crank in run {run}"
        return ""

    return order_in_words


def _beyond_nuisances(residual: np.ndarray, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal columns of what nuisances change, and what they leave of the residual."""
    basis = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    return basis, residual - basis @ (basis.T @ residual)


def _power(phase: np.ndarray, carriers: Sequence[np.ndarray], basis: np.ndarray, left: np.ndarray) -> float:
    """How much of the squared residual the cosine and the sine of `phase` explain, with each carrier by themselves."""
    columns = np.column_stack([carrier * wave for carrier in carriers for wave in (np.cos(phase), np.sin(phase))])
    columns -= basis @ (basis.T @ columns)
    weight = np.linalg.lstsq(columns, left, rcond=None)[0]
    return float(left @ (columns @ weight))
