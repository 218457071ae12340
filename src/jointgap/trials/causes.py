"""Why a trial is not right, as far as the seal, the preflight and the fits of the analysis tell."""

import math
from collections.abc import Collection, Mapping
from typing import Any

from jointgap.identification.decide_verdict import NO_DISAGREEMENT, PARAMETERS_ONLY

NUMERICS_DECIDE = 1.15
"""Gap that the truth itself leaves by usual numerics from which on these can decide the verdict: half of the excess of
the least effect that counts as detectable (1.26)."""

_REACHED = 4.0
"""Standard deviations of chi2 above what the truth leaves within which a fit has come to the truth."""


def cause(
    truth: Mapping[str, Any],
    analysis: Mapping[str, Any],
    hidden: frozenset[str],
    named: frozenset[str],
    equal: Collection[frozenset[str]] = (),
) -> str:
    """Why not the truth was found; the first of the causes that holds."""
    if "verdict" not in analysis:
        return "the analysis failed"
    if "damage" in truth:
        return f"data damaged: {truth['damage']['what']}"
    if not all(effect["listed"] for effect in truth["effects"]):
        return "the truth is no candidate"
    if has_idle_effect(truth):
        return "an effect that is none: within a stated range, or overwritten by another"
    merged = [frozenset(group) for group in analysis["verdict"]["preflight"]["merged"]]
    extra, lacking = named - hidden, hidden - named
    if extra and lacking and any(extra | lacking <= group for group in merged):
        return "look-alikes, as preflight says"
    if hidden in equal:
        return "the truth is one of several that are equally good"
    numerics_gap = truth["numerics_gap"]
    if numerics_gap is not None and numerics_gap > NUMERICS_DECIDE:
        return f"the numerics decide the motion: the truth itself leaves a gap of {numerics_gap:.3g}"
    if hidden and analysis["verdict"].get("verdict") in (NO_DISAGREEMENT, PARAMETERS_ONLY):
        return "the model without it leaves noise alone"
    return _by_fits(analysis.get("fits"), numerics_gap, hidden, named)


def has_idle_effect(truth: Mapping[str, Any]) -> bool:
    """Whether an effect is hidden that is none (`jointgap.trials.idle_effects`)."""
    return any(effect.get("idle", False) for effect in truth["effects"])


def _by_fits(
    fits: Mapping[str, Any] | None, numerics_gap: float | None, hidden: frozenset[str], named: frozenset[str]
) -> str:
    """What chi2 of the fits says: of the truth, beside what the truth leaves and beside what was named."""
    if not fits:
        return ""
    chi2 = {frozenset(name.split(" + ")): value for name, value in fits["chi2"].items() if name != "base"}
    chi2[frozenset()] = fits["chi2"].get("base")
    own, others = chi2.get(hidden), chi2.get(named)
    if own is None:
        return "the truth was not fitted"
    samples = fits["samples"]
    left = samples * (numerics_gap or 1.0) ** 2
    if own > left + _REACHED * math.sqrt(2 * left):
        per_sample = f"chi2 {own / samples:.3g} per sample, the truth leaves {left / samples:.3g}"
        return f"the fit of the truth did not reach it: {per_sample}"
    if hidden == named or others is None:
        return "the fit of the truth reached it"
    if own <= others:
        return f"the truth fits better, chi2 less by {others - own:.3g}"
    return f"the truth was reached and fits worse, chi2 more by {own - others:.3g}"
