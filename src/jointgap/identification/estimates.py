"""Fitted parameters with standard errors and intervals, as a verdict states them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jointgap.identification.fit import MATCHED, Fit
from jointgap.identification.protocol import Candidate, Parameter
from jointgap.identification.settings import DEFAULT_SETTINGS

HALF_WIDTHS = {50: 0.6745, 90: 1.645, 99: 2.576}
"""By level [%], half the width of an interval of the normal distribution in standard deviations [1]: five percent lie
beyond either end of that of 90 %."""

LEVELS = tuple(HALF_WIDTHS)
"""Of the intervals that are stated [%]: that of 90 to read, the others to see by how often they hold what is wrong."""

AT_BOUND = "at its bound"
"""A parameter that the fit drew to an end of its range: the data would have it beyond, and an error within says
nothing."""

NOT_ESTIMATED = "not estimated"
"""A number that goes with an effect and that no fit varies, such as the length of a film or a whole order; a nuisance
where features of the cycle decide: it is adapted, and not fitted."""

CHANGES_NOTHING = "changes nothing in what was measured"
"""A parameter on which no measured value depends, such as a mass where no force is read: its value was not fitted."""


def nuisance_estimates(fit: Fit) -> list[tuple[Parameter, dict[str, Any]]]:
    """Nuisances of a fit, each with its estimate as `coordinate_estimate` gives it; what changes nothing, or was not
    fitted with the effects, has none.
    """
    of_effects = {f"{c.label}.{p.key}" for c in fit.hypothesis for p in c.coordinates}
    active = fit.active

    def estimate(place: int) -> dict[str, Any]:
        if fit.status == MATCHED or not active[place]:
            remark = NOT_ESTIMATED if fit.status == MATCHED else CHANGES_NOTHING
            return _no_estimate(fit.values[place], remark)
        return coordinate_estimate(fit, place)

    return [(p, estimate(i)) for i, p in enumerate(fit.parameters) if p.key not in of_effects]


def determined_values(fit: Fit) -> dict[str, float]:
    """Values of a fit by key, for a model that others use: nuisances that the data do not determine are nominal.

    These end at a bound, change nothing in what was measured, or may lie almost anywhere within their range.
    """
    values = fit.mapping
    for p, estimate in nuisance_estimates(fit):
        if not is_taken_over(p, estimate):
            values[p.key] = p.nominal
    return values


def is_taken_over(parameter: Parameter, estimate: dict[str, Any]) -> bool:
    """Whether a model that others use takes over a nuisance: what the data determine, fitted within its range with an
    interval that is narrower; and what is adapted to features of the cycle.
    """
    if "remark" in estimate:
        return estimate["remark"] == NOT_ESTIMATED
    low, high = estimate["interval_90"]
    if low is None or high is None:
        return False
    width = parameter.high - parameter.low
    return not np.isfinite(width) or high - low < DEFAULT_SETTINGS.intervals.determined_share * width


def coordinate_estimate(fit: Fit, place: int) -> dict[str, Any]:
    """Value, standard error and intervals (`LEVELS`) of one parameter of a fit, by its `place` among them.

    An interval that the bounds cut off is that of the draws, to one side where it would not hold the value. At a bound
    there is no standard error, but an interval to the other side and the remark; where the fit says nothing of the
    parameter there is neither.
    """
    p, value, known = fit.parameters[place], float(fit.values[place]), fit.distribution
    if p.whole:
        return _no_estimate(value, NOT_ESTIMATED)
    sd = float(np.sqrt(known.covariance[place, place]))
    if known.draws is None or not sd > 0.0:
        return estimate_with_interval(value, sd, p.low, p.high)
    return _from_draws(value, known.draws[:, place], sd, not p.low < value < p.high)


def effect_estimates(fit: Fit, candidate: Candidate) -> dict[str, dict[str, Any]]:
    """Parameters of an effect as a verdict states them, by name, each as `coordinate_estimate` gives it.

    Parameters that follow from the coordinates (an amplitude from its cosine and sine parts) take their errors from
    these linearly, as they do draws along a curved valley; where a bound cuts off a coordinate on which they depend
    their intervals are from draws, each followed through.
    """
    keys = [p.key for p in fit.parameters]
    own = [p for p in candidate.coordinates if f"{candidate.label}.{p.key}" in keys]
    columns = [keys.index(f"{candidate.label}.{p.key}") for p in own]
    fitted = {p.key: fit.values[column] for p, column in zip(own, columns, strict=True)}
    known = fit.distribution
    sd = np.sqrt(np.diag(known.covariance))
    values = candidate.parameters(fitted)
    slopes = {name: np.zeros(len(columns)) for name in values}
    for i, (p, column) in enumerate(zip(own, columns, strict=True)):
        if sd[column] > 0:
            step = 1e-3 * sd[column]
            moved = [candidate.parameters(fitted | {p.key: fitted[p.key] + sign * step}) for sign in (1, -1)]
            for name in values:
                slopes[name][i] = (moved[0][name] - moved[1][name]) / (2 * step)
    block = known.covariance[np.ix_(columns, columns)]
    cut = np.array([_is_cut_off(fit, column) for column in columns], dtype=bool)
    # Coordinates at a bound, each with a value inside: what these would change was drawn to the bound too.
    inside = [(p, fitted[p.key] + p.step) for p in own if fitted[p.key] <= p.low]
    inside += [(p, fitted[p.key] - p.step) for p in own if fitted[p.key] >= p.high]
    estimates = {}
    for name, value in values.items():
        same = next((i for p, i in zip(own, columns, strict=True) if p.key == name and value == fitted[name]), None)
        if same is not None:
            estimates[name] = coordinate_estimate(fit, same)
            continue
        error = float(np.sqrt(max(slopes[name] @ block @ slopes[name], 0.0)))
        at_bound = any(candidate.parameters(fitted | {p.key: nearby})[name] != value for p, nearby in inside)
        if at_bound and known.draws is None:
            estimates[name] = _no_estimate(value, AT_BOUND)
        elif at_bound or (known.draws is not None and any(cut & (slopes[name] != 0.0))):
            mapped = _mapped_draws(fit, candidate, [p.key for p in own], columns, name)
            estimates[name] = _from_draws(float(value), mapped, error, at_bound)
        elif fit.draws is not None and error > 0.0:
            moved_by = (fit.draws[:, columns] - fit.values[columns]) @ slopes[name]
            estimates[name] = _from_draws(float(value), value + moved_by, error, False)
        else:
            estimates[name] = estimate_with_interval(value, error, -np.inf, np.inf)
    return estimates


def _is_cut_off(fit: Fit, place: int) -> bool:
    """Whether a bound cuts off what may be counted on of one parameter."""
    p, value = fit.parameters[place], fit.values[place]
    far = fit.settings.intervals.far_standard_deviations * np.sqrt(fit.distribution.covariance[place, place])
    return bool(min(value - p.low, p.high - value) <= far)


def _mapped_draws(fit: Fit, candidate: Candidate, keys: Sequence[str], columns: Sequence[int], name: str) -> np.ndarray:
    """Draws (s,) of a parameter that follows from the coordinates `keys` of an effect, at `columns` of the fit."""
    draws = fit.distribution.draws[:, columns]
    draws = draws[:: max(len(draws) // fit.settings.intervals.mapped_draws, 1)]
    return np.array([candidate.parameters(dict(zip(keys, map(float, row), strict=True)))[name] for row in draws])


def _from_draws(value: float, draws: np.ndarray, sd: float, at_bound: bool) -> dict[str, Any]:
    """The estimate of a `value` that is distributed as its `draws` (s,).

    An interval holds its share of the draws, as many beyond either end. One that would not hold the value begins or
    ends there instead, so that those of higher levels hold those of lower ones.
    """
    estimate: dict[str, Any] = {"value": value, "sd": None if at_bound else sd}
    below, above = float(np.mean(draws < value)), float(np.mean(draws > value))
    for level in LEVELS:
        share = level / 100.0
        beyond = 0.5 * (1.0 - share)
        with np.errstate(invalid="ignore"):  # some draws may be infinite
            ends = np.quantile(draws, [beyond, 1.0 - beyond]).tolist()
            if value < ends[0]:
                ends = [value, float(np.quantile(draws, min(below + share, 1.0)))]
            elif value > ends[1]:
                ends = [float(np.quantile(draws, max(1.0 - above - share, 0.0))), value]
        # what grows without end at a bound, as the frequency of a rod that does not bend, has no end there
        estimate[f"interval_{level}"] = [end if np.isfinite(end) else None for end in ends]
    return estimate | {"remark": AT_BOUND} if at_bound else estimate


def estimate_with_interval(value: float, sd: float, low: float, high: float) -> dict[str, Any]:
    """Value, standard error and intervals (`LEVELS`), cut at the bounds; where there is no error, a remark why."""
    if not sd > 0.0:
        return _no_estimate(value, NOT_ESTIMATED if low < value < high else AT_BOUND)
    estimate: dict[str, Any] = {"value": float(value), "sd": float(sd)}
    for level in LEVELS:
        half_width = HALF_WIDTHS[level] * sd
        ends = np.clip([value - half_width, value + half_width], low, high)
        estimate[f"interval_{level}"] = [float(end) for end in ends]
    return estimate


def _no_estimate(value: float, remark: str) -> dict[str, Any]:
    intervals = {f"interval_{level}": [None, None] for level in LEVELS}
    return {"value": float(value), "sd": None, **intervals, "remark": remark}
