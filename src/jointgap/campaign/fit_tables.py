"""Fits to tables and back, so that stages hand them on through files."""

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.campaign.clockwise import parameter_as_read
from jointgap.campaign.folder import Frames
from jointgap.errors import InputError
from jointgap.identification.bounded_step import compressed
from jointgap.identification.fit import FAILED, Fit, bounds_of
from jointgap.identification.problem import Explanation, Problem, label_of
from jointgap.identification.protocol import Candidate, Parameter

HALF_WIDTH = 1.645
"""Half the width of a 90 % interval, in standard errors."""

JOINED = " + "

AT_BOUND = "at its bound"
"""A parameter that the fit drew to an end of its range: the data would have it beyond, and an error within says nothing."""

NOT_ESTIMATED = "not estimated"
"""A number that goes with an effect and that no fit varies, such as the length of a film or a whole order."""


def explanation_of(label: str, candidates: Sequence[Candidate]) -> Explanation:
    """The explanation that `label_of` calls so.

    Raises
    ------
    InputError
        The model has no such candidate.
    """
    known = {candidate.label: candidate for candidate in candidates}
    names = [] if label == label_of(()) else label.split(JOINED)
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"explanation '{label}': the model has no candidate {unknown}; run the stages before it again")
    return tuple(known[name] for name in names)


def kind_of(explanation: Explanation) -> str:
    """How the table fits calls it."""
    if any(candidate.name.startswith("discovered_") for candidate in explanation):
        return "formula"
    return ("base", "single", "pair")[len(explanation)]


def to_frames(fits: Iterable[Fit], seconds: Iterable[float] | None = None, whole: bool = False) -> Frames:
    """Fits as tables; those that failed keep their reason and values, and have neither curvature nor residuals.

    Parameters
    ----------
    fits : iterable of Fit
    seconds : iterable of float, optional
        How long each took.
    whole : bool
        Whether to keep all rows of the Jacobians, which further fits start from, instead of their inner products alone.
    """
    fits = list(fits)
    took = [np.nan] * len(fits) if seconds is None else list(seconds)
    rows, values, curvature, residuals = [], [], [], []
    for fit, time in zip(fits, took, strict=True):
        lost = fit.status == FAILED
        rows.append(
            {
                "explanation": fit.label,
                "kind": kind_of(fit.explanation),
                "status": fit.status,
                "reason": fit.reason or None,
                "chi2": np.nan if lost else fit.chi2,
                "samples": fit.residual.size,
                "parameters": len(fit.parameters),
                "bic": np.nan if lost else fit.bic,
                "simulations": fit.simulations,
                "seconds": time,
            }
        )
        keys = [p.key for p in fit.parameters]
        values.append(_named(fit, {"key": keys, "value": fit.values}))
        if not lost:
            small = fit.jacobian if whole else compressed(fit.jacobian)[0]
            places = np.arange(len(small))
            curvature += [
                _named(fit, {"key": key, "sample": places, "derivative": small[:, i]}) for i, key in enumerate(keys)
            ]
            residuals.append(_named(fit, {"sample": np.arange(fit.residual.size), "residual": fit.residual}))
    return {
        "fits": _frame(tables.FITS, [pd.DataFrame(rows)] if rows else []),
        "fit_values": _frame(tables.FIT_VALUES, values),
        "fit_curvature": _frame(tables.FIT_CURVATURE, curvature),
        "fit_residuals": _frame(tables.FIT_RESIDUALS, residuals),
    }


def from_frames(frames: Frames, problem: Problem, more: Sequence[Candidate] = ()) -> list[Fit]:
    """The fits in these tables, in order.

    Unless they were kept whole, their Jacobians have as many rows as columns and the same inner products, which is all that
    covariances ask of them.

    Parameters
    ----------
    frames : mapping of str to DataFrame
    problem : Problem
        That was fitted.
    more : sequence of Candidate
        Candidates beside the model's own, such as those of a library.
    """
    candidates = (*problem.model.candidates, *more)
    values, small, residuals = (
        {label: rows for label, rows in frames[name].groupby("explanation", sort=False)}
        for name in ("fit_values", "fit_curvature", "fit_residuals")
    )
    found = []
    for row in frames["fits"].to_dict("records"):
        label = row["explanation"]
        explanation = explanation_of(label, candidates)
        stored = dict(zip(values[label]["key"], values[label]["value"], strict=True)) if label in values else {}
        parameters = tuple(p for p in problem.parameters(explanation) if p.key in stored)
        keys = [p.key for p in parameters]
        at = np.array([stored[key] for key in keys], dtype=float)
        jacobian, residual = np.empty((problem.size, 0)), np.full(problem.size, np.nan)
        if row["status"] != FAILED:
            residual = residuals[label]["residual"].to_numpy()
            if keys:
                jacobian = small[label].pivot(index="sample", columns="key", values="derivative")[keys].to_numpy()
        found.append(
            Fit(explanation, parameters, at, residual, jacobian, row["simulations"], row["status"], row["reason"] or "")
        )
    return found


def parameter_frame(fits: Iterable[Fit], clockwise: Collection[str] = ()) -> pd.DataFrame:
    """Table `jointgap.tables.FIT_PARAMETERS`: nuisances as fitted, effects' parameters as a verdict states them.

    Parameters
    ----------
    fits : iterable of Fit
    clockwise : collection of str
        As in `nuisances`.
    """
    rows = []
    for fit in fits:
        if fit.status == FAILED:
            continue
        covariance = fit.covariance()
        for p, interval in nuisances(fit, covariance, clockwise):
            rows.append(_row(fit, p.key, p.name, None, p.run, interval, p.unit))
        for candidate in fit.explanation:
            for name, interval in effect_parameters(fit, candidate, covariance).items():
                rows.append(_row(fit, f"{candidate.label}.{name}", name, candidate.label, None, interval, ""))
    return _frame(tables.FIT_PARAMETERS, [pd.DataFrame(rows)] if rows else [])


def nuisances(
    fit: Fit, covariance: np.ndarray, clockwise: Collection[str] = ()
) -> list[tuple[Parameter, dict[str, Any]]]:
    """Nuisances of a fit, each as `stated` says it.

    Parameters
    ----------
    fit : Fit
    covariance : (k, k) array
    clockwise : collection of str
        Runs whose crank turns clockwise: their first angles are those of the file.
    """
    of_effects = {f"{c.label}.{p.key}" for c in fit.explanation for p in c.coordinates}
    return [
        (p, parameter_as_read(p, stated(fit.values[i], np.sqrt(covariance[i, i]), p.low, p.high), clockwise))
        for i, p in enumerate(fit.parameters)
        if p.key not in of_effects
    ]


def effect_parameters(fit: Fit, candidate: Candidate, covariance: np.ndarray) -> dict[str, dict]:
    """Parameters of an effect as a verdict states them, each as `stated` says it (errors carried on linearly)."""
    low, high = bounds_of(fit.parameters)
    keys = [p.key for p in fit.parameters]
    own = [p for p in candidate.coordinates if f"{candidate.label}.{p.key}" in keys]
    places = [keys.index(f"{candidate.label}.{p.key}") for p in own]
    at = {p.key: fit.values[place] for p, place in zip(own, places, strict=True)}
    sd = np.sqrt(np.diag(covariance))
    values = candidate.parameters(at)
    slopes = {name: np.zeros(len(places)) for name in values}
    for i, (p, place) in enumerate(zip(own, places, strict=True)):
        if sd[place] > 0:
            step = 1e-3 * sd[place]
            moved = [candidate.parameters(at | {p.key: at[p.key] + sign * step}) for sign in (1, -1)]
            for name in values:
                slopes[name][i] = (moved[0][name] - moved[1][name]) / (2 * step)
    block = covariance[np.ix_(places, places)]
    # coordinates at a bound, each with a value within
    bounded = [(p, at[p.key] + p.step) for p in own if at[p.key] <= p.low]
    bounded += [(p, at[p.key] - p.step) for p in own if at[p.key] >= p.high]
    found = {}
    for name, value in values.items():
        error = float(np.sqrt(max(slopes[name] @ block @ slopes[name], 0.0)))
        same = next((i for p, i in zip(own, places, strict=True) if p.key == name), None)
        ends = (low[same], high[same]) if same is not None else (-np.inf, np.inf)
        found[name] = stated(value, error, *ends)
        if found[name].get("remark") == NOT_ESTIMATED and any(
            candidate.parameters(at | {p.key: inside})[name] != value for p, inside in bounded
        ):
            found[name]["remark"] = AT_BOUND
    return found


def stated(value: float, sd: float, low: float, high: float) -> dict[str, Any]:
    """Value, standard error and 90 % interval, cut at the bounds; where there is no error to state, a remark why."""
    if not sd > 0.0:
        remark = NOT_ESTIMATED if low < value < high else AT_BOUND
        return {"value": float(value), "sd": None, "interval_90": [None, None], "remark": remark}
    ends = np.clip([value - HALF_WIDTH * sd, value + HALF_WIDTH * sd], low, high)
    return {"value": float(value), "sd": float(sd), "interval_90": [float(end) for end in ends]}


def _row(fit: Fit, key, parameter, effect, run, interval, unit) -> dict:
    low, high = interval["interval_90"]
    return {
        "explanation": fit.label,
        "key": key,
        "parameter": parameter,
        "effect": effect,
        "run": run,
        "value": interval["value"],
        "sd": interval["sd"],
        "low_90": low,
        "high_90": high,
        "remark": interval.get("remark"),
        "unit": unit,
    }


def _named(fit: Fit, columns: dict) -> pd.DataFrame:
    return pd.DataFrame(columns).assign(explanation=fit.label)


def _frame(table: tables.Table, parts: list[pd.DataFrame]) -> pd.DataFrame:
    """The parts below each other, with the table's columns even where there is none."""
    names = [column.name for column in table.columns]
    filled = [part.reindex(columns=names) for part in parts if len(part)]
    return pd.concat(filled, ignore_index=True) if filled else pd.DataFrame(columns=names)
