"""What whoever designs the mechanism has to know before taking over the lengths; a sentence for each."""

import math
from collections.abc import Iterator

from jointgap.dynamics.model import mechanism_warnings
from jointgap.link_lengths.constraints import MET, geometric
from jointgap.report.plain_words import in_words
from jointgap.summary.scenario_outcome import FORCE_MET, Outcome

NOTICED = 0.002
"""Change of the stroke, as a share of it, from which on it is worth a remark."""

NOTICED_FORCE = 0.05
"""The same of the largest force in a pin."""

NOTICED_PEAK = 0.01
"""The same of the peak error."""

WORSE_BETWEEN_POINTS = 10.0
"""Factor on a network's error from which on it does not know the motion between the points it was trained at."""

HOLDS = 2.0
"""Factor on a regularised network's error up to which it does."""


def remarks(outcome: Outcome) -> tuple[str, ...]:
    """Remarks on an `outcome`, the most important first; empty where all is as one would think."""
    return (
        *_gain(outcome),
        *_rod_tolerance(outcome),
        *_unmet(outcome),
        *_bounds(outcome),
        *_price(outcome),
        *mechanism_warnings.sentences(outcome.scenario.mechanism),
        *_networks(outcome),
    )


def _gain(outcome: Outcome) -> Iterator[str]:
    gain = outcome.gain
    spread = f"{-100 * gain.high:+.1f} to {-100 * gain.low:+.1f} %"
    if gain.is_loss:
        advice = "keep your own" if _own_lengths_meet_all(outcome) else "that is what the constraints cost"
        yield (
            f"The error at the lengths found is larger than at your own once simulated again ({spread} over "
            f"{outcome.stretch_in_words}): {advice}."
        )
    elif not gain.is_certain:
        yield (
            f"The gain cannot be told from chance: simulated again from slightly different starts, the error over "
            f"{outcome.stretch_in_words} changes by {spread}."
        )


def _rod_tolerance(outcome: Outcome) -> Iterator[str]:
    gain, rod = outcome.gain, outcome.rod
    if not gain.is_certain:
        return
    name = "its stated tolerance" if rod.is_stated else "a tolerance of IT7"
    half, allowed = (f"±{1e6 * value:.3g} um" for value in (rod.width / 2, rod.allowed))
    gained, lost = (f"{math.degrees(value):.2g} deg" for value in (gain.before - gain.after, rod.error_off - rod.error))
    does = f"takes up to {lost} of that" if rod.allowed >= rod.width / 2 else "undoes it"
    yield (
        f"The gain is {gained}. It is worth it only if the rod is made to {allowed}; {name}, {half}, {does} (estimated "
        "with the motion in the joints frozen)."
    )


def _own_lengths_meet_all(outcome: Outcome) -> bool:
    options = outcome.scenario.optimise.constraints
    asked = geometric(options, outcome.scenario.mechanism.applied().slider.offset)
    force, most = max(outcome.peak_pin_forces[0].values()), options.largest_pin_force
    return all(each.missed(outcome.original) <= MET for each in asked) and (most is None or force <= FORCE_MET * most)


def _unmet(outcome: Outcome) -> Iterator[str]:
    """The largest force is known once simulated; constraints on the lengths alone were refused before the search."""
    most = outcome.scenario.optimise.constraints.largest_pin_force
    if not outcome.keeps_force:
        found = max(outcome.peak_pin_forces[1].values())
        box = next(iter(outcome.scenario.optimise.boxes))
        yield (
            f"No lengths were found in the box `{box}` with a largest force in a pin of {most:.4g} N at most; the "
            f"nearest are shown, with {found:.4g} N. Widen the box, or allow more."
        )


def _bounds(outcome: Outcome) -> Iterator[str]:
    box = next(iter(outcome.scenario.optimise.boxes))
    for bound in outcome.bounds:
        yield f"The {bound.replace(' at ', ' lies at ', 1)}; {what_to_do(bound, box)}."


def what_to_do(bound: str, box: str) -> str:
    """Advice on a `bound` that lengths lie at, in words, of the `box` called so."""
    if "times the rod length" in bound:
        return "the search went no further: raise `optimise.ratio_limit` if the drive allows it"
    key = next((key for key in ("crank_length", "rod_length") if bound.startswith(in_words(key))), None)
    if key is None:
        return "the search went no further"
    return f"the search went no further: move `optimise.boxes.{box}.{key}` if you can"


def _price(outcome: Outcome) -> Iterator[str]:
    """What changes by more than a designer may want, and how to hold it."""
    constraints, (before, after) = outcome.scenario.optimise.constraints, outcome.cycle("simulated")
    change = after["stroke"] / before["stroke"] - 1
    if constraints.stroke is None and abs(change) > NOTICED:
        yield (
            f"The stroke changes by {1e3 * (after['stroke'] - before['stroke']):+.3g} mm ({100 * change:+.1f} %): if "
            "it may not, fix it with `optimise.constraints.stroke`."
        )
    peak = outcome.gains[outcome.stretch, "peak"]
    if peak.after / peak.before - 1 > NOTICED_PEAK:
        yield (
            f"The peak error grows from {math.degrees(peak.before):.3g} to {math.degrees(peak.after):.3g} deg "
            f"({100 * (peak.after / peak.before - 1):+.0f} %) over {outcome.stretch_in_words}, though the RMS error is "
            "what was minimised."
        )
    old, new = (max(force.values()) for force in outcome.peak_pin_forces)
    if constraints.largest_pin_force is None and new / old - 1 > NOTICED_FORCE:
        yield (
            f"The largest force in a pin grows from {old:.3g} to {new:.3g} N ({100 * (new / old - 1):+.0f} %): if it "
            "may not, limit it with `optimise.constraints.largest_pin_force`."
        )


def _networks(outcome: Outcome) -> Iterator[str]:
    errors = outcome.errors
    errors = errors[(errors["region"] == "all") & (errors["seed"] == outcome.scenario.surrogate.seeds[0])]
    own, regularised = (errors[errors["model"] == model] for model in ("network", "regularised"))
    factor = own["held_out_mse"] / own["training_mse"]
    worse = int((factor > WORSE_BETWEEN_POINTS).sum())
    held_out, training = regularised["held_out_mse"], regularised["training_mse"]
    if worse:
        yield (
            f"{worse} of {len(own)} networks {'does' if worse == 1 else 'do'} not know the motion between the points "
            f"of {'its' if worse == 1 else 'their'} training (mean square error {factor.max():.0f} times as large). "
            + (
                "The lengths were found on such networks; what they gain is simulated again and does not rest on them."
                if outcome.source == "networks"
                else "The lengths do not rest on them."
            )
            + (
                f" Of the regularised networks of the same outputs {int((held_out <= HOLDS * training).sum())} of "
                f"{len(regularised)} know it (error between their points at most {HOLDS:g} times that at them)."
                if len(regularised)
                else ""
            )
        )
