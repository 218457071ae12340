"""Sentences of the verdict."""

from collections.abc import Mapping
from math import floor
from typing import Any

from jointgap.campaign.labels import (
    format_effect,
    format_explanation,
    format_label,
    headline,
    is_fault,
    label_of,
    names_to_labels,
)
from jointgap.core.words import format_name, joined, percent, rounded_gap
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.verdict import (
    FALLS,
    RISES,
    STAYS,
    HeldOutTest,
    gap_change,
    share_closed,
)

ENOUGH = ("no_disagreement", "parameters_only")
"""Verdicts without a missing effect."""

Verdict = Mapping[str, Any]
"""The content of ``verdict.json``."""

_DECISION = DEFAULT_SETTINGS.decision
_LARGEST_GAIN = 1000.0
_UNEXPLAINED = "An effect is missing, but no tested effect explains the residual"
_NOTHING_HELD_OUT = "No held-out data confirm it: none of their samples can be used"


def subject(verdict: Verdict) -> str:
    """``campaign rig-a``, or ``model pendulum`` for a model of the user."""
    return f"{verdict.get('subject', 'campaign')} {verdict['campaign']}"


def title(verdict: Verdict) -> str:
    """The verdict in a line, with the parameter and its interval."""
    factor, wider = verdict.get("interval_factor", 1.0), ""
    if factor >= 1.1:
        wider = f"; intervals widened by the factor {factor:.1f}, as the residual exceeds noise"
    if verdict["effects"]:
        text = headline(verdict["effects"]) + wider
        return text[:1].upper() + text[1:]
    if verdict["doubted_channels"] and verdict["verdict"] == "unexplained":
        return "Channels are inconsistent, so no effect can be identified"
    certain = f"certain is {headline(verdict['certain'])}{wider}" if verdict["certain"] else ""
    if (best := verdict["best_known"]) and not is_refuted(verdict):
        if certain:
            return f"An effect is missing; {certain}"
        share = share_explained(verdict)
        partly = f"partly explained ({share}) by " if share else ""
        return f"Not confirmed: {partly}{headline(best['effects'])}{wider}"
    if verdict["verdict"] == "ambiguous":
        count = len(verdict["equivalent"])
        text = f"An effect is missing: {count} explanations fit equally well"
        return f"{text}; {certain}" if certain else text
    return {
        "no_disagreement": "No missing effect detected",
        "parameters_only": (
            "No missing effect detected: re-fitted parameters explain the measurement"
        ),
    }.get(verdict["verdict"], _UNEXPLAINED)


def answer(verdict: Verdict) -> str:
    """The verdict in a few sentences."""
    if verdict["effects"]:
        return _named(verdict)
    if verdict["verdict"] in ENOUGH:
        model = "after re-fitting the uncertain parameters"
        if verdict["verdict"] == "no_disagreement":
            model = "of the current model"
        text = f"No missing effect detected: the residual {model} is consistent with noise."
        return text + _held_out_misfit(verdict)
    certain = certain_summary(verdict)
    if verdict["verdict"] == "ambiguous":
        count = len(verdict["equivalent"])
        text = f"An effect is missing: {count} explanations fit equally well.{certain}"
        return f"{text}{_misfit_of_equivalent(verdict)} None was added to the model."
    return f"{_unexplained(verdict)}{certain} No effect was added to the model."


def _named(verdict: Verdict) -> str:
    effects, gap = verdict["effects"], verdict["gap"]["identify"]
    faults = [effect for effect in effects if is_fault(effect)]
    missing = [effect for effect in effects if not is_fault(effect)]
    text = "The mechanism model lacks no effect."
    if missing:
        text = f"The model lacks {joined(map(format_effect, missing))}."
    if faults:
        text += f" The measurement has a fault: {format_explanation(faults)}."
        if any(effect.get("alternatives") for effect in faults):
            text += " These data cannot show which of them."
    if gap["after"] > _DECISION.noise_gap:
        text += f" The gap {gap_change(**gap)}; no tested effect explains the remaining residual."
    else:
        added = "these effects" if len(effects) > 1 else "this effect"
        text += f" With {added} the residual of the fitted data is consistent with noise."
    return text + _held_out_misfit(verdict)


def _unexplained(verdict: Verdict) -> str:
    best, gap = verdict["best_known"], verdict["gap"]["confirm"]
    if inconsistent := verdict["doubted_channels"]:
        channels = joined(map(format_name, inconsistent))
        return f"Channels are inconsistent, so no effect can be identified: check {channels}."
    if is_refuted(verdict):
        change = gap_change(**gap, most_digits=4)
        explanation = format_explanation(best["effects"])
        return (
            f"{_UNEXPLAINED}. With the best fit, {explanation}, the gap on held-out data {change}."
        )
    if not best:
        return f"{_UNEXPLAINED}."
    text = f"An effect is missing. The best candidate, {format_explanation(best['effects'])}, "
    text += f"{_explained(verdict)}, but is not confirmed"
    if _exceeds_noise(verdict):
        text += f": on the held-out data a gap of {rounded_gap(gap['after'])} remains"
    return f"{text}."


def is_refuted(verdict: Verdict) -> bool:
    """Whether the gap on held-out data rises with the best candidate."""
    gap = verdict["gap"]["confirm"]
    if not verdict["best_known"] or gap["after"] is None:
        return False
    return verdict["held_out_test"] == RISES or gap_change(**gap).startswith(RISES)


def _explained(verdict: Verdict) -> str:
    """What the best candidate explains of the fitted data; nearly all only if the held-out gap is
    noise."""
    gap = verdict["gap"]["identify"]
    if share := share_explained(verdict):
        return f"explains {share} of the misfit of the fitted data"
    if gap["after"] <= _DECISION.noise_gap < gap["before"] and not _exceeds_noise(verdict):
        return "explains the misfit of the fitted data"
    change = gap_change(**gap)
    if change.startswith(FALLS):
        return f"reduces the gap of the fitted data{change.removeprefix(FALLS)}"
    return f"does not reduce the gap of the fitted data, which {change}"


def _exceeds_noise(verdict: Verdict) -> bool:
    """Whether the gap on held-out data exceeds noise with the best candidate."""
    return (verdict["gap"]["confirm"]["after"] or 0.0) > _DECISION.max_gap_of_noise


def certain_summary(verdict: Verdict) -> str:
    """What all near explanations share, and in what they differ; empty if they share nothing."""
    certain, best = verdict["certain"], verdict["best_known"]
    is_inconsistent = verdict["verdict"] == "unexplained" and bool(verdict["doubted_channels"])
    if not certain or is_inconsistent or is_refuted(verdict):
        return ""
    shared = {label_of(effect) for effect in certain}
    explanations = [[label_of(effect) for effect in effects] for effects in verdict["equivalent"]]
    if not explanations and best:
        explanations = [[label_of(effect) for effect in best["effects"]]]
        rival = best["rival"]["explanation"].split(" + ") if best["rival"] else []
        if shared < {*rival}:
            explanations.append(rival)
    differing = [
        " + ".join(label for label in labels if label not in shared) for labels in explanations
    ]
    alternatives = ""
    if len(differing) > 1 and all(differing):
        alternatives = f"; the rest is {' or '.join(map(format_label, differing))}"
    begin = "All contain" if verdict["verdict"] == "ambiguous" else "Certain is"
    return f" {begin} {format_explanation(certain)}{alternatives}, of those tried."


def _misfit_of_equivalent(verdict: Verdict) -> str:
    """What equivalent explanations leave of the gap on held-out data, if that is most of it."""
    before, after = verdict["gap"]["confirm"].values()
    if after is None or not before > _DECISION.noise_gap or after <= _DECISION.noise_gap:
        return ""
    if share_closed(before, after) >= 1.0 - _DECISION.max_share_of_wrong_misfit:
        return ""
    gaps = f"{rounded_gap(after)} where it was {rounded_gap(before)}"
    return f" They explain little: on held-out data the best of them leaves a gap of {gaps}."


def _held_out_misfit(verdict: Verdict) -> str:
    """Which held-out runs cannot be simulated, and the largest gap if it exceeds noise."""
    gap, when = verdict["gap"]["confirm"], "after" if verdict["effects"] else "before"
    if gap["before"] is None:
        return f" {_NOTHING_HELD_OUT}."
    text, gaps = "", [gap[when]]
    if gap[when] is None:
        text = f" {_not_simulated(verdict)}."
        gaps = [run["gap"][when] for run in verdict["held_out"]]
    largest = max((gap for gap in gaps if gap is not None), default=0.0)
    if largest > _DECISION.max_gap_of_noise:
        text += " The model does not fit the held-out data: their gap is"
        return f"{text} {rounded_gap(largest)} (1 is noise)."
    if verdict["held_out_test"] == STAYS:
        text += " The held-out data do not confirm it."
    return text


def _not_simulated(verdict: Verdict) -> str:
    runs = joined(
        f"run {run['run']} ({run['not_simulated']})"
        for run in verdict["held_out"]
        if "not_simulated" in run
    )
    text = f"The model with the added effects cannot be simulated in {runs}, so there it is"
    return f"{text} not confirmed"


def left_out_summary(verdict: Verdict) -> tuple[str, ...]:
    """A sentence for each run that was not used and each output that failed, and the steps that
    were not run."""
    sentences = [
        f"Run {run['run']} was not used: {run['because']}." for run in verdict.get("left_out", ())
    ]
    if steps := verdict.get("not_searched"):
        labels = joined(map(names_to_labels, steps))
        sentences.append(f"Not completed, as the limit of simulations was reached: {labels}.")
    for step, error in verdict.get("failed", {}).items():
        sentences.append(f"{format_name(step)} failed: {error}.")
    return tuple(sentences)


def share_explained(verdict: Verdict) -> str:
    """Share of the misfit beyond noise [%] that the best candidate explains of the fitted data;
    empty if it is unknown, all, nearly all although the held-out gap exceeds noise, or no fall of
    the gap."""
    share, gap = verdict["best_known"]["explained_share"], verdict["gap"]["identify"]
    if share is None or not 0.0 < round(share, 3) < 1.0:
        return ""
    if share >= _DECISION.min_explained_share and _exceeds_noise(verdict):
        return ""
    return percent(share) if gap_change(**gap).startswith(FALLS) else ""


def format_gain(gain: float) -> str:
    """A gain in BIC: a number up to 1000, as residuals beyond noise make larger ones
    meaningless."""
    if round(gain) <= 0:
        return "none"
    return "more than 1000" if gain > _LARGEST_GAIN else f"{gain:.0f}"


def held_out_summary(verdict: Verdict) -> str:
    """The change of the gap on held-out data, without the full stop."""
    test, (before, after) = verdict["held_out_test"], verdict["gap"]["confirm"].values()
    best, equivalent = verdict["best_known"], verdict["equivalent"]
    if before is None:
        return _NOTHING_HELD_OUT
    if not (verdict["effects"] or best or equivalent):
        return f"The gap on held-out data is {rounded_gap(before)}"
    if after is None:
        text = f"The gap on held-out data is {rounded_gap(before)} without effects."
        return f"{text} {_not_simulated(verdict)}"
    gap = "With the best fit the gap" if best else "The gap"
    if equivalent:
        gap = "With the first of these explanations the gap"
    text = f"{gap} on held-out data {HeldOutTest(test, before, after).summary}"
    if verdict["effects"] and test == FALLS and before > _DECISION.noise_gap:
        share = share_closed(before, after)
        explained = 100.0 if after <= 1.0 else floor(round(1000.0 * share, 6)) / 10.0
        text += f": {explained:.1f} % of the excess over noise is explained"
    endings = {
        STAYS: ", although it should fall",
        RISES: ": the added effects do not hold there",
        "cannot_tell": ": these data cannot tell whether the effects hold",
    }
    return text + endings.get(test, "")


def best_known_summary(verdict: Verdict) -> tuple[str, ...]:
    """The best candidate: its gaps, the next best one, and how to confirm it."""
    best = verdict["best_known"]
    if best is None:
        return ()
    lines = [
        f"On the fitted data the gap {gap_change(**verdict['gap']['identify'])}.",
        f"{held_out_summary(verdict)}.",
    ]
    if rival := best["rival"]:
        behind, label = rival["behind"], format_label(rival["explanation"])
        if round(behind) < 0:
            gain = format_gain(-behind)
            lines.append(f"Another explanation, {label}, has a BIC that is smaller by {gain}.")
        else:
            difference = f"larger by {format_gain(behind)}" if round(behind) else "the same"
            lines.append(f"The next best explanation is {label}; its BIC is {difference}.")
    return (*lines, *_confirmation(verdict))


def _confirmation(verdict: Verdict) -> tuple[str, ...]:
    """How the best candidate can be confirmed; empty if the held-out data contradict it or no
    measurement helps."""
    test, (before, after) = verdict["held_out_test"], verdict["gap"]["confirm"].values()
    if verdict["doubted_channels"]:
        step = "check the wiring of the inconsistent channels and measure again"
    elif is_refuted(verdict) or (test == STAYS and after >= before):
        return ()
    elif is_near(verdict["best_known"]["rival"]):
        advice = verdict.get("separated_by")
        return (names_to_labels(advice),) if advice else ()
    elif test == "not_simulated":
        step = "hold out a run that can be simulated with it"
    elif test in ("cannot_tell", "nothing_held_out"):
        step = "measure a longer held-out run"
    else:
        step = (
            "explain the remaining residual by a further effect or wider bounds; see the map of"
            " disagreement"
        )
    return (f"To confirm it: {step}.",)


def is_near(rival: Mapping[str, Any] | None) -> bool:
    """Whether the next best explanation is equivalent to the best candidate."""
    return rival is not None and abs(rival["behind"]) < _DECISION.min_delta_bic
