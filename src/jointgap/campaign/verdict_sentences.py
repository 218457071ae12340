"""What a verdict says, in a sentence or two."""

from collections.abc import Mapping, Sequence
from typing import Any

from jointgap.campaign.phrasing import effect_in_words, explanation_in_words, explanation_label_in_words, is_fault
from jointgap.identification.confirmation import RISES, STAYS, HeldOutTest, share_closed
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.report.plain_words import in_words, joined, percent, rounded_gap

ENOUGH = ("no_disagreement", "parameters_only")
"""Verdicts by which the model meets the measurement with nothing added."""

# Share of the squared excess over the noise on held-out data. An effect that leaves more than this is not said to close
# the gap.
_MOST_LEFT = 0.5

_DECISION = DEFAULT_SETTINGS.decision
_NOISE_GAP = _DECISION.max_gap_of_noise


def answer(verdict: Mapping[str, Any]) -> str:
    """The verdict, content of ``verdict.json``, in a sentence or two."""
    named, taken = _named(verdict["effects"])
    if verdict["effects"] and is_told_by_features(verdict, verdict["effects"]):
        return (
            f"{named} With this {taken} the model meets where in the cycle impacts come and how hard they are, and "
            "nothing else that was tried does. Single samples it does not meet: impacts ring in another phase, since "
            "their instants depend on more digits than can be measured."
        )
    count, unmet = len(verdict["equivalent"]), _unmet_held_out(verdict)
    fitted = "the data used for fitting"
    data, them = (fitted, "them") if unmet else ("these data", "the measurement")
    return {
        "no_disagreement": f"Nothing is missing that {data} could show: the model as it stands meets {them} within the "
        f"noise.{unmet}",
        "parameters_only": f"No effect is missing that {data} could show: with other parameters within their stated "
        f"ranges the model meets {them} within the noise.{unmet}",
        "named": f"{named} With this {taken} the model meets {fitted if unmet else them} within the noise.{unmet}",
        "named_with_remaining_misfit": f"{named} {_closed(verdict, unmet)}{unmet}",
        "ambiguous": f"{_certain(verdict['certain'])} {count} explanations fit equally well. None of them was added to "
        "the model.",
        "unexplained": f"{_unexplained(verdict)} No effect was added to the model.",
    }[verdict["verdict"]]


def left_out_in_words(verdict: Mapping[str, Any]) -> tuple[str, ...]:
    """Which runs a verdict does not rest on, and what could not be made beside it, and why, a sentence each."""
    left = [f"Run {one['run']} is left out: {one['because']}." for one in verdict.get("left_out", ())]
    failed = verdict.get("failed", {})
    return (*left, *(f"{in_words(what)} could not be made: {why}." for what, why in failed.items()))


def is_told_by_features(verdict: Mapping[str, Any], effects: Sequence[Mapping[str, Any]]) -> bool:
    """Whether features of the cycle told the `effects` of a verdict, where motion repeats: samples count nothing for
    them.
    """
    told = bool(effects) and all(effect["delta_bic"] is None for effect in effects)
    return verdict["basis"] == "statistics" and told


def _closed(verdict: Mapping[str, Any], unmet: str) -> str:
    """How far what was named closes the gap."""
    before, after = (verdict["gap"]["identify"][when] for when in ("before", "after"))
    if after**2 <= _DECISION.tolerated_reduced_chi2 and unmet:
        return "With it the model meets the data used for fitting within the noise."
    if after**2 <= _DECISION.tolerated_reduced_chi2 and verdict["held_out_test"] == STAYS:
        return (
            "With it the model meets the data used for fitting within the noise; on the held-out data the gap falls by "
            "less than noise leaves open, so they do not confirm it."
        )
    confirmed = verdict["gap"]["confirm"]["after"]
    least = _DECISION.max_low_end_of_gap
    if after**2 <= _DECISION.tolerated_reduced_chi2 and confirmed is not None and confirmed > least:
        return (
            "With it the model meets the data used for fitting within the noise; on the held-out data a gap of "
            f"{rounded_gap(confirmed)} is left, which is more."
        )
    part = "most" if share_closed(before, after) > _MOST_LEFT else "part"
    where = " on the data used for fitting" if unmet else ""
    left = max(after, confirmed or 0.0)
    rest = "a small rest" if left < _DECISION.max_gap_held_out else f"a gap of {rounded_gap(left)}"
    return f"This closes {part} of the gap{where}, but not all: {rest} is left that none of the effects tried explains."


def _certain(certain: Sequence[Mapping[str, Any]]) -> str:
    """What all of several explanations hold, and that the rest is open, up to the number of these."""
    if not certain:
        return "Something is missing, but these data cannot tell what:"
    shared = joined(map(effect_in_words, certain))
    return f"Certain is {shared}: all explanations hold it. What acts beside it these data cannot tell:"


def _unexplained(verdict: Mapping[str, Any]) -> str:
    if doubted := verdict["doubted_channels"]:
        names = joined(channel.replace("_", " ") for channel in doubted)
        return f"These data cannot tell what is missing: {names} {'reads' if len(doubted) == 1 else 'read'} what " + (
            "contradicts other channels."
        )
    best = verdict["best_known"]
    if best is None:
        return (
            "Something is missing, and it is none of the effects tried: the model and the measurement disagree by more "
            "than the noise, and no explanation holds."
        )
    share = share_explained(best)
    part = f"{share} of what exceeds the noise" if share else "A part"
    return (
        f"Something is missing, and it is not proven what. {part} is explained by "
        f"{explanation_in_words(best['effects'])}."
    )


def share_explained(best: Mapping[str, Any]) -> str:
    """Of what exceeds the noise, the part in percent that the best explanation explains; empty where it is not known,
    or rounds to all of it."""
    share = best["explained_share"]
    return "" if share is None or round(share, 2) >= 1.0 else percent(share, 0)


def best_known_in_words(verdict: Mapping[str, Any]) -> tuple[str, ...]:
    """How far the best explanation goes that is not proven, its test on held-out data, its nearest rival, and what
    would prove it; nothing where there is none.
    """
    best = verdict["best_known"]
    if best is None:
        return ()
    gap, rival = best["gap"], best["rival"]
    before, after = (rounded_gap(gap["identify"][when]) for when in ("before", "after"))
    says = [f"With it the gap on the data used for fitting goes from {before} to {after}."]
    hardly_shows = gap["identify"]["before"] ** 2 <= _DECISION.tolerated_reduced_chi2
    if best["explained_share"] is not None and not hardly_shows:
        says[0] = says[0][:-1] + f": {percent(best['explained_share'])} of the misfit is explained."
    says.append(f"{_held_out_test(verdict, gap['confirm'])}.")
    if is_told_by_features(verdict, best["effects"]):
        says.append("On the data used for fitting it meets where in the cycle impacts come and how hard.")
    elif rival is None:
        says.append("No other explanation was fitted that could be held against it.")
    else:
        share = (
            ""
            if rival["explained_share"] is None or hardly_shows
            else f", and explains {percent(rival['explained_share'])}"
        )
        says.append(
            f"The next best that is another one, {explanation_label_in_words(rival['explanation'])}, is "
            f"{rival['behind']:.0f} of BIC behind{share}."
        )
    return (*says, _would_prove(verdict))


def _would_prove(verdict: Mapping[str, Any]) -> str:
    best, test = verdict["best_known"], verdict["held_out_test"]
    if verdict["doubted_channels"]:
        return "What would prove it: the wiring of these channels checked, and a run recorded anew."
    held_out = best["gap"]["confirm"]
    if test == RISES or (test == STAYS and not held_out["after"] < held_out["before"]):
        return "What would prove it: data that took no part, on which its gap falls. On those held out it does not."
    if best["rival"] and best["rival"]["behind"] < _DECISION.min_delta_bic:
        return "What would prove it: a speed, a load or a channel in which it differs from its rival."
    if test in ("cannot_tell", "not_simulated", "nothing_held_out"):
        return "What would prove it: a held-out run in which it shows, longer or at a speed at which it does more."
    return (
        "What would prove it: that what it leaves is explained too, by another effect or by parameters with wider "
        "bounds; the map of disagreement and the residuals show where it is."
    )


def _held_out_test(verdict: Mapping[str, Any], gap: Mapping[str, float | None]) -> str:
    """What the gap on held-out data does with an explanation, without the last full stop."""
    test, before, after = verdict["held_out_test"], gap["before"], gap["after"]
    where = "On data that took no part in fitting or choosing it"
    if after is None:
        return f"{where} is {rounded_gap(before)} before anything is added"
    features = verdict["held_out_features"]
    words = HeldOutTest(test, before, after, features and (features["before"], features["after"])).words
    if features:
        return f"{where} the gap {words.removeprefix('it ')}"
    words = words.removeprefix("it ")
    told = {
        "stays": ", though it should fall",
        "rises": ", so what was added does not hold there",
        "cannot_tell": ": these data cannot tell, the effect would hardly show there",
    }
    return f"{where} {words}{told.get(test, '')}"


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
    sentence = _held_out_test(verdict, verdict["gap"]["confirm"])
    if verdict["held_out_features"]:
        return sentence
    if verdict["held_out_test"] == "falls" and before**2 > _DECISION.tolerated_reduced_chi2:
        closed = share_closed(before, after)
        sentence += f": {percent(min(closed, 1.0))} of what exceeds the noise is gone"
    if after > _NOISE_GAP:
        sentence += ". More than noise is left there: the effect, or what else the held-out data hold, is not all known"
    return sentence


def _not_simulated(verdict: Mapping[str, Any]) -> str:
    """Which held-out runs cannot be simulated with what was added, and why."""
    lost = [f"run {run['run']} ({run['not_simulated']})" for run in verdict["held_out"] if "not_simulated" in run]
    return f"What was added cannot be simulated in {joined(lost)}, so it is not confirmed there"
