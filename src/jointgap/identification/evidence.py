"""The table of evidence for the verdict, from fits and predictions."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from jointgap.core.candidates import Candidate
from jointgap.identification.confirmation import Confirmed
from jointgap.identification.fit import FAILED, Fit, chance
from jointgap.identification.settings import DEFAULT_SETTINGS, DecisionSettings
from jointgap.identification.verdict import Decision, Evidence, Row, Thresholds, verdict, weigh

Bounds = Mapping[str, tuple[float, float, float]]
"""Nominal value, lower and upper bound of nuisances by name."""

_Decided = TypeVar("_Decided", bound=Decision)


def reduced_chi2(fit: Fit) -> float:
    """Reduced chi2; infinite if the fit failed."""
    return fit.chi2 / max(fit.residual.size - len(fit.parameters), 1)


def row_of(
    fit: Fit,
    bounds: Bounds | None = None,
    settings: DecisionSettings = DEFAULT_SETTINGS.decision,
    order_label: Callable[[float], str] = lambda _: "",
    similarity: float = 0.0,
) -> Row:
    """A fit as a row; with the `bounds` of nuisances, its objection too."""
    objection = (fit.reason or fit.status) if fit.status == FAILED else ""
    if bounds is not None and not objection:
        objection = _objection(fit, bounds, settings, order_label)
    active = zip(fit.parameters, fit.values, fit.active, strict=True)
    shared = [
        (p, value) for p, value, moves in active if moves and p.run is None and "." not in p.name
    ]
    return Row(
        fit=fit,
        effects=tuple(candidate.label for candidate in fit.hypothesis),
        chi2=fit.chi2,
        samples=fit.residual.size,
        parameters=len(fit.parameters),
        bic=fit.bic,
        objection=objection,
        reason=fit.reason,
        similarity=similarity,
        at_bounds=tuple(p.name for p, value in shared if not p.low < value < p.high),
        is_nonsmooth=any(candidate.is_nonsmooth for candidate in fit.hypothesis),
    )


def weigh_fit(base: Fit, fit: Fit, limits: Thresholds, bounds: Bounds | None = None) -> Row:
    """A fit relative to the base; with the `bounds` of nuisances, whether it is admissible too."""
    settings = fit.settings.decision
    return weigh(row_of(base), row_of(fit, bounds, settings), limits, settings)


def final_verdict(
    decision: _Decided,
    confirmed: Confirmed,
    inconsistent_channels: Collection[str] = (),
    settings: DecisionSettings = DEFAULT_SETTINGS.decision,
) -> _Decided:
    """The verdict including held-out data and inconsistent channels; sets `Fit.gap_left` of its
    fits."""
    base, limits, gap = row_of(decision.base), Thresholds(0.0, 0.0, 0.0), confirmed.gap("confirm")
    rows = [row_of(fit) for fit in (decision.proposed,) if fit]
    heard = Evidence(
        base,
        base,
        rows,
        limits,
        by_fits=decision,
        held_out=confirmed.held_out,
        inconsistent=inconsistent_channels,
    )
    found = verdict(heard, settings)
    if not gap > 1.0:
        return found
    leaving = {id(fit) for fit in (found.proposed or found.chosen, *found.equivalent)}
    fits = {name: getattr(found, name) for name in ("chosen", "best_known")}
    fits = {
        name: replace(fit, gap_left=gap) if id(fit) in leaving else fit
        for name, fit in fits.items()
    }
    others = {
        name: [replace(fit, gap_left=gap) for fit in getattr(found, name)]
        for name in ("equivalent", "twins")
    }
    return replace(found, **others, **fits)


def _objection(
    fit: Fit, bounds: Bounds, settings: DecisionSettings, order_label: Callable[[float], str]
) -> str:
    """Why an effect of an explanation is zero or no effect; empty if there is no objection."""
    values = fit.mapping
    for candidate in (one for one in fit.hypothesis if one.carrier):
        frequency = values.get(f"{candidate.label}.frequency_Hz")
        if frequency is not None and (order := order_label(frequency)):
            return f"{candidate.label} oscillates at {frequency:.4g} Hz, which is {order}"
    for candidate in fit.hypothesis:
        own = [p for p in fit.parameters if p.key.startswith(f"{candidate.label}.")]
        sizes = [
            p for p in own if p.key.removeprefix(f"{candidate.label}.") in candidate.amplitudes
        ]
        if not any(values[p.key] for p in sizes):
            return f"{candidate.label} was fitted with size 0"
        stated = {p.key.removeprefix(f"{candidate.label}."): values[p.key] for p in own}
        size, value = next(iter(candidate.parameters(stated).items()))
        for p in sizes:
            # the lower bound of a change of a known value is a valid size
            at_low, at_high = (
                values[p.key] <= p.low and not candidate.is_perturbation,
                values[p.key] >= p.high,
            )
            if at_low or at_high:
                key = p.key.removeprefix(f"{candidate.label}.")
                inside = stated | {key: values[p.key] + (p.step if at_low else -p.step)}
                # one of several amplitudes may be zero, unless the size that is stated depends on
                # it
                if values[p.key] != 0.0 or candidate.parameters(inside)[size] != value:
                    bound = key if values[p.key] != 0.0 else size
                    return (
                        f"{candidate.label} is at the bound of {bound}, so the cause is another one"
                    )
        if _is_within_range(fit, candidate, bounds):
            replaced = " and ".join(candidate.replaces)
            return (
                f"{candidate.label} is equivalent to {replaced} within its range: a parameter, no"
                " effect"
            )
    for candidate in fit.hypothesis:
        if chance(fit, candidate) > settings.max_chance_of_size:
            return f"{candidate.label} is not significant: the interval of its size contains 0"
    return ""


def _is_within_range(fit: Fit, candidate: Candidate, bounds: Bounds) -> bool:
    """Whether an effect only replaces nuisances within their ranges."""
    # if it keeps a shared nuisance, the effect is the difference of the two
    if not candidate.replaces or candidate.replaces.keys() & {
        p.name for p in candidate.coordinates
    }:
        return False
    replaced = {
        f"{candidate.label}.{key}": bounds[name] for name, key in candidate.replaces.items()
    }
    sizes, errors = (
        {f"{candidate.label}.{key}" for key in candidate.amplitudes},
        np.sqrt(np.diag(fit.covariance())),
    )
    for p, value, error in zip(fit.parameters, fit.values, errors, strict=True):
        if p.key in replaced:
            nominal, low, high = replaced[p.key]
            if not low <= nominal + value <= high:
                return False
        elif p.key in sizes and abs(value) > 2.0 * error:
            return False
    return True
