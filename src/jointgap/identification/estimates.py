"""Fitted parameters with standard errors and intervals, as a verdict states them."""

from typing import Any

import numpy as np

from jointgap.identification.fit import Fit, bounds_of
from jointgap.identification.protocol import Candidate, Parameter

HALF_WIDTH_90 = 1.645
"""Half the width of a 90 % interval of the normal distribution, in standard deviations [1]: five percent lie beyond
either end."""

AT_BOUND = "at its bound"
"""A parameter that the fit drew to an end of its range: the data would have it beyond, and an error within says
nothing."""

NOT_ESTIMATED = "not estimated"
"""A number that goes with an effect and that no fit varies, such as the length of a film or a whole order."""

CHANGES_NOTHING = "changes nothing in what was measured"
"""A parameter on which no measured value depends, such as a mass where no force is read: its value was not fitted."""


def nuisance_estimates(fit: Fit, covariance: np.ndarray) -> list[tuple[Parameter, dict[str, Any]]]:
    """Nuisances of a fit, each with its estimate as `estimate_with_interval` gives it; what changes nothing has none.

    Parameters
    ----------
    fit : Fit
    covariance : (k, k) array
        Of all parameters of the fit [SI], in their order.
    """
    of_effects = {f"{c.label}.{p.key}" for c in fit.hypothesis for p in c.coordinates}
    active = fit.active
    return [
        (p, estimate_with_interval(fit.values[i], np.sqrt(covariance[i, i]), p.low, p.high))
        if active[i]
        else (p, _no_estimate(fit.values[i], CHANGES_NOTHING))
        for i, p in enumerate(fit.parameters)
        if p.key not in of_effects
    ]


def effect_estimates(fit: Fit, candidate: Candidate, covariance: np.ndarray) -> dict[str, dict[str, Any]]:
    """Parameters of an effect as a verdict states them, by name, each as `estimate_with_interval` gives it.

    Parameters that follow from the coordinates (an amplitude from its cosine and sine parts) take their errors from
    these linearly.

    Parameters
    ----------
    fit : Fit
    candidate : Candidate
        One of the fit's effects.
    covariance : (k, k) array
        Of all parameters of the fit [SI], in their order.
    """
    low, high = bounds_of(fit.parameters)
    keys = [p.key for p in fit.parameters]
    own = [p for p in candidate.coordinates if f"{candidate.label}.{p.key}" in keys]
    columns = [keys.index(f"{candidate.label}.{p.key}") for p in own]
    fitted = {p.key: fit.values[column] for p, column in zip(own, columns, strict=True)}
    sd = np.sqrt(np.diag(covariance))
    values = candidate.parameters(fitted)
    slopes = {name: np.zeros(len(columns)) for name in values}
    for i, (p, column) in enumerate(zip(own, columns, strict=True)):
        if sd[column] > 0:
            step = 1e-3 * sd[column]
            moved = [candidate.parameters(fitted | {p.key: fitted[p.key] + sign * step}) for sign in (1, -1)]
            for name in values:
                slopes[name][i] = (moved[0][name] - moved[1][name]) / (2 * step)
    block = covariance[np.ix_(columns, columns)]
    # Coordinates at a bound, each with a value inside: what these would change was drawn to the bound too.
    inside = [(p, fitted[p.key] + p.step) for p in own if fitted[p.key] <= p.low]
    inside += [(p, fitted[p.key] - p.step) for p in own if fitted[p.key] >= p.high]
    estimates = {}
    for name, value in values.items():
        error = float(np.sqrt(max(slopes[name] @ block @ slopes[name], 0.0)))
        same = next((i for p, i in zip(own, columns, strict=True) if p.key == name), None)
        ends = (low[same], high[same]) if same is not None else (-np.inf, np.inf)
        estimates[name] = estimate_with_interval(value, error, *ends)
        if estimates[name].get("remark") == NOT_ESTIMATED and any(
            candidate.parameters(fitted | {p.key: nearby})[name] != value for p, nearby in inside
        ):
            estimates[name]["remark"] = AT_BOUND
    return estimates


def estimate_with_interval(value: float, sd: float, low: float, high: float) -> dict[str, Any]:
    """Value, standard error and 90 % interval, cut at the bounds; where there is no error to state, a remark why.

    Parameters
    ----------
    value, sd : float
        Estimate and standard error [unit of the parameter]; 0 where the fit gives no error.
    low, high : float
        Bounds of the parameter [unit of the parameter].
    """
    if not sd > 0.0:
        return _no_estimate(value, NOT_ESTIMATED if low < value < high else AT_BOUND)
    ends = np.clip([value - HALF_WIDTH_90 * sd, value + HALF_WIDTH_90 * sd], low, high)
    return {"value": float(value), "sd": float(sd), "interval_90": [float(end) for end in ends]}


def _no_estimate(value: float, remark: str) -> dict[str, Any]:
    return {"value": float(value), "sd": None, "interval_90": [None, None], "remark": remark}
