"""What a verdict says, in a sentence or two."""

from collections.abc import Mapping, Sequence
from typing import Any

from jointgap.campaign.phrasing import effect_in_words, explanation_in_words, is_fault
from jointgap.identification.confirmation import share_closed
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.report.plain_words import joined, percent, rounded_gap

ENOUGH = ("no_disagreement", "parameters_only")
"""Verdicts by which the model meets the measurement with nothing added."""

# Share of the squared excess over the noise on held-out data. An effect that leaves more than this is not said to close
# the gap.
_MOST_LEFT = 0.5

# Gap on held-out data [standard deviations of the noise] that still counts as noise: another seed of noise moves it by
# less.
_NOISE_GAP = 1.2


def answer(verdict: Mapping[str, Any]) -> str:
    """The verdict, content of ``verdict.json``, in a sentence or two."""
    named, taken = _named(verdict["effects"])
    count, unmet = len(verdict["equivalent"]), _unmet_held_out(verdict)
    fitted = "the data used for fitting"
    data, them = (fitted, "them") if unmet else ("these data", "the measurement")
    return {
        "no_disagreement": f"Nothing is missing that {data} could show: the model as it stands meets {them} within the "
        f"noise.{unmet}",
        "parameters_only": f"No effect is missing that {data} could show: with other parameters within their stated "
        f"ranges the model meets {them} within the noise.{unmet}",
        "named": f"{named} With this {taken} the model meets {fitted if unmet else them} within the noise.{unmet}",
        "named_with_remaining_misfit": f"{named} This closes most of the gap{f' on {fitted}' if unmet else ''}, but "
        f"not all: a small rest is left that none of the effects tried explains.{unmet}",
        "ambiguous": f"Something is missing, but these data cannot tell what: {count} explanations fit equally well. "
        "None of them was added to the model.",
        "unexplained": "Something is missing, and it is none of the effects tried: the model and the measurement "
        "disagree by more than the noise, and no explanation holds. No effect was added to the model.",
    }[verdict["verdict"]]


def _named(effects: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """What is named, in a sentence, and what was done with it: a sensor's fault is nothing that the mechanism lacks."""
    faults = [effect for effect in effects if is_fault(effect)]
    missing = [effect for effect in effects if not is_fault(effect)]
    wrong = explanation_in_words(faults)
    if not missing:
        return f"The fault lies in the measurement, not in the mechanism: {wrong}.", "taken into account"
    lacks = f"Missing in the model {'are' if len(missing) > 1 else 'is'} {joined(map(effect_in_words, missing))}"
    if not faults:
        return f"{lacks}.", "added"
    return f"{lacks}, and the measurement has a fault: {wrong}.", "taken into account"


def _unmet_held_out(verdict: Mapping[str, Any]) -> str:
    """Says that the held-out data are not met; empty where they are, or where that is not known."""
    added, gap = bool(verdict["effects"]), verdict["gap"]["confirm"]
    reason, where, gaps = "", "there", [gap]
    if added and gap["after"] is None:
        reason, where = f" {_not_simulated(verdict)}.", "in another run"
        gaps = [run["gap"] for run in verdict["held_out"] if run["gap"]["after"] is not None]
    unmet = [gap["after" if added else "before"] for gap in gaps if _is_unmet(verdict, gap)]
    if not unmet:
        return reason
    more = "more" if added else "something"
    largest = rounded_gap(max(unmet))
    return f"{reason} It does not meet the held-out data: the gap {where} is {largest}, so {more} may be missing."


def _is_unmet(verdict: Mapping[str, Any], gap: Mapping[str, float | None]) -> bool:
    """Whether a gap on held-out data is more than noise, and more than the verdict itself admits."""
    left = gap["after" if verdict["effects"] else "before"]
    if left is None or left <= _NOISE_GAP:
        return False
    admits_misfit = verdict["verdict"] == "named_with_remaining_misfit"
    return not admits_misfit or left**2 - 1.0 > _MOST_LEFT * (gap["before"] ** 2 - 1.0)


def held_out_in_words(verdict: Mapping[str, Any]) -> str:
    """What the gap is on data that took no part, and what that says, without the last full stop."""
    before, after = (verdict["gap"]["confirm"][when] for when in ("before", "after"))
    if not verdict["effects"]:
        sentence = f"On data that took no part in fitting it is {rounded_gap(before)}"
        if verdict["verdict"] in ENOUGH and before > _NOISE_GAP:
            sentence += ". That is more than noise: what the held-out data hold is not all in the model"
        return sentence
    sentence = "On data that took no part in fitting or choosing it"
    if after is None:
        return f"{sentence} is {rounded_gap(before)} before anything is added. {_not_simulated(verdict)}"
    falls = after < before
    sentence += f" {'falls' if falls else 'does not fall: it goes'} from {rounded_gap(before)} to {rounded_gap(after)}"
    if falls and before**2 > DEFAULT_SETTINGS.decision.tolerated_reduced_chi2:
        closed = share_closed(before, after)
        sentence += f": {percent(min(closed, 1.0))} of what exceeds the noise is gone"
    if after > _NOISE_GAP:
        sentence += ", so what was added does not hold there" * (not falls)
        sentence += ". More than noise is left there: the effect, or what else the held-out data hold, is not all known"
    return sentence


def _not_simulated(verdict: Mapping[str, Any]) -> str:
    """Which held-out runs cannot be simulated with what was added, and why."""
    lost = [f"run {run['run']} ({run['not_simulated']})" for run in verdict["held_out"] if "not_simulated" in run]
    return f"What was added cannot be simulated in {joined(lost)}, so it is not confirmed there"
