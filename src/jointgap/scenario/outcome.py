"""The result of a scenario's optimisation, and remarks on it."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.joints import PINS
from jointgap.core.schema import FIT_ERRORS
from jointgap.core.words import in_words
from jointgap.dynamics import mechanism_warnings
from jointgap.lengths.region import MET, geometric

NEEDED = ("fit_errors", "optimise_optima", "optimise_floor", "optimise_resimulated", "optimise_worth", "optimise_loads")
"""Names of the tables that an outcome is made of."""

MOTIONS = {
    "simulation_settled": "simulation, a settled revolution",
    "simulation": "simulation, the first revolution",
    "clearance": "second surrogate, the first revolution",
    "networks": "networks, the first revolution",
}
"""Sources of the frozen motion in the joints, in words; the nearest to the running machine first."""

AS_GOOD = 1.01  # times the smallest error: lengths with less are as good, and those nearest to the original are chosen
FORCE_MET = 1.005  # times the largest force allowed, which a median of an ensemble may reach
NOTICED, NOTICED_FORCE, NOTICED_PEAK = (
    0.002,
    0.05,
    0.01,
)  # relative changes of stroke, pin force, peak error remarked on
OVERFIT = 10.0  # ratio of a network's held-out to its training error
GENERALISES = 2.0  # the same of a regularised network
_WHOLE_TURN = 2 * math.pi * (1 - 1e-9)


@dataclass(frozen=True)
class Gain:
    """One measure of the error of the transmission angle at the original lengths and at those found.

    Attributes
    ----------
    before, after : float
        Medians of the ensembles [rad].
    reduction, low, high : float
        Relative reduction when simulated again: median, 5 % and 95 % quantile over pairs of runs.
    frozen : float
        The same with the joint motion frozen at the original lengths.
    share_better : float
        Share of the pairs of runs in which the new lengths have the smaller error.
    """

    before: float
    after: float
    reduction: float
    low: float
    high: float
    frozen: float
    share_better: float

    @property
    def is_certain(self) -> bool:
        """Whether the error falls in 95 % of the pairs of runs."""
        return self.low > 0.0

    @property
    def is_loss(self) -> bool:
        """Whether the error grows in 95 % of the pairs of runs."""
        return self.high < 0.0


@dataclass(frozen=True)
class Outcome:
    """The lengths found in a scenario and their effects.

    Attributes
    ----------
    scenario : Scenario
    chosen : mapping
        Row of the table optimise_optima of the lengths found.
    found : mapping of str to str
        By source of the motion (key of `MOTIONS`) the better of the points that both optimisers found on it.
    stretch : str
        Basis of the result: ``settled``, a whole settled revolution, or ``window``, where one was asked for.
    gains : mapping of (str, str) to Gain
        By stretch and measure (rms, mean_absolute, peak).
    frames : mapping of str to DataFrame
        The tables `NEEDED` by name.
    """

    scenario: Scenario
    chosen: Mapping[str, Any]
    found: Mapping[str, str]
    stretch: str
    gains: Mapping[tuple[str, str], Gain]
    frames: Mapping[str, pd.DataFrame]

    @property
    def original(self) -> tuple[float, float]:
        """Crank and rod length before [m]."""
        applied = self.scenario.mechanism.applied()
        return applied.crank.length, applied.rod.length

    @property
    def lengths(self) -> tuple[float, float]:
        """Crank and rod length found [m]."""
        return float(self.chosen["crank_length"]), float(self.chosen["rod_length"])

    @property
    def bounds(self) -> tuple[str, ...]:
        """Active bounds and constraints, in words."""
        return () if self.chosen["active_bounds"] == "none" else tuple(self.chosen["active_bounds"].split("; "))

    @property
    def keeps_crank(self) -> bool:
        """Whether the crank keeps its length, to the micrometre."""
        return abs(self.lengths[0] - self.original[0]) < 1e-6

    @property
    def gain(self) -> Gain:
        """Of the RMS error over `stretch`."""
        return self.gains[self.stretch, "rms"]

    @property
    def stretch_in_words(self) -> str:
        """``a settled revolution``."""
        return self.words_of(self.stretch)

    def words_of(self, stretch: str) -> str:
        """A stretch, ``settled`` or ``window``, in words."""
        first, last = (math.degrees(angle) for angle in self.scenario.optimise.window)
        if stretch == "settled":
            return "a settled revolution"
        whole = last - first >= math.degrees(_WHOLE_TURN)
        return "the first revolution" if whole else f"the first revolution from {first:g} to {last:g} deg"

    def cycle(self, kind: str) -> tuple[pd.Series, pd.Series]:
        """Rows of the table optimise_worth before and after; `kind` is ``ideal`` or ``simulated``."""
        return self._pair("optimise_worth", "cycle", kind)

    def load(self, joint: str) -> tuple[pd.Series, pd.Series]:
        """Rows of the table optimise_loads of one `joint` before and after."""
        return self._pair("optimise_loads", "joint", joint)

    def _pair(self, table: str, column: str, value: str) -> tuple[pd.Series, pd.Series]:
        own = self.frames[table][self.frames[table][column] == value].set_index("point")
        return own.loc["original"], own.loc[self.chosen["point"]]

    @property
    def peak_pin_forces(self) -> tuple[dict[str, float], dict[str, float]]:
        """Largest force in each pin over the settled revolution before and after [N], medians."""
        pairs = {joint: self.load(joint) for joint in PINS}
        return tuple({joint: float(pair[side]["peak_force"]) for joint, pair in pairs.items()} for side in (0, 1))

    @property
    def keeps_force(self) -> bool:
        """Whether the lengths found keep the largest pin force that is allowed, if one is given."""
        most = self.scenario.optimise.constraints.largest_pin_force
        return most is None or max(self.peak_pin_forces[1].values()) <= FORCE_MET * most


def outcome(frames: Mapping[str, pd.DataFrame], scenario: Scenario) -> Outcome:
    """The best lengths in the main box by their re-simulated error, and what they change.

    The error counts over a whole settled revolution, or over the window where the scenario asks for one. Of lengths
    within 1 % of the smallest error, those nearest to the original are chosen.
    """
    first, last = scenario.optimise.window
    stretch = "settled" if last - first >= _WHOLE_TURN else "window"
    optima, again, loads = (frames[f"optimise_{name}"] for name in ("optima", "resimulated", "loads"))
    error = again[(again["measure"] == "rms") & (again["stretch"] == stretch)].set_index("point")["error"]
    force = loads[loads["joint"].isin(PINS)].groupby("point")["peak_force"].max()
    most = FORCE_MET * (scenario.optimise.constraints.largest_pin_force or math.inf)
    applied = scenario.mechanism.applied()
    own_name = optima["source"] + f"_{next(iter(scenario.optimise.boxes))}_" + optima["method"]
    candidates = optima[(optima["point"] == own_name) & optima["point"].isin(error.index)]
    candidates = candidates.assign(
        force=candidates["point"].map(force).clip(lower=most),  # lengths that keep the force come first
        error=candidates["point"].map(error),
        change=np.hypot(
            candidates["crank_length"] / applied.crank.length - 1, candidates["rod_length"] / applied.rod.length - 1
        ),
    ).sort_values(["force", "error"], kind="stable")
    best = candidates.iloc[0]
    as_good = candidates[(candidates["force"] == best["force"]) & (candidates["error"] <= AS_GOOD * best["error"])]
    chosen = as_good.loc[as_good["change"].idxmin()]
    firsts = candidates.drop_duplicates("source").set_index("source")["point"].to_dict()
    firsts |= {chosen["source"]: chosen["point"]}
    columns = (
        "original_error",
        "error",
        "reduction",
        "reduction_low",
        "reduction_high",
        "frozen_reduction",
        "share_better",
    )
    gains = {
        (row["stretch"], row["measure"]): Gain(*(row[column] for column in columns))
        for row in again[again["point"] == chosen["point"]].to_dict("records")
    }
    errors = frames.get("fit_errors", pd.DataFrame(columns=FIT_ERRORS.names))
    found = {source: firsts[source] for source in MOTIONS if source in firsts}
    return Outcome(scenario, chosen.to_dict(), found, stretch, gains, {**frames, "fit_errors": errors})


def ideal_swing(lengths: tuple[float, float], offset: float) -> tuple[float, float]:
    """Smallest and largest transmission angle without clearance over a turn [rad]."""
    crank, rod = lengths
    return tuple(math.pi / 2 + float(np.arcsin((offset + side * crank) / rod)) for side in (-1, 1))


def remarks(outcome: Outcome) -> tuple[str, ...]:
    """Remarks on an `outcome`, the most important first; empty where nothing is unusual."""
    return (
        *_gain(outcome),
        *_constraints(outcome),
        *_changes(outcome),
        *mechanism_warnings.sentences(outcome.scenario.mechanism),
        *_networks(outcome),
    )


def _gain(outcome: Outcome) -> Iterator[str]:
    gain, row = outcome.gain, outcome.chosen
    spread = f"{-100 * gain.high:+.1f} to {-100 * gain.low:+.1f} % over {outcome.stretch_in_words}"
    if gain.is_loss:
        advice = "keep your own" if _original_meets_all(outcome) else "the constraints cost this"
        yield f"Simulated again, the error at the lengths found is larger than at your own ({spread}): {advice}."
    elif not gain.is_certain:
        yield f"The gain is not significant: simulated again from perturbed starts, the error changes by {spread}."
    else:
        width, allowed = float(row["rod_tolerance"]), float(row["rod_deviation_allowed"])
        name = "IT7" if outcome.scenario.optimise.rod_tolerance is None else "the stated tolerance"
        half, allowed_um = (f"±{1e6 * value:.3g} um" for value in (width / 2, allowed))
        gained, lost = (math.degrees(value) for value in (gain.before - gain.after, row["rms_rod_off"] - row["rms"]))
        does = f"costs up to {lost:.2g} deg of it" if allowed >= width / 2 else "cancels it"
        yield (
            f"The gain is {gained:.2g} deg. It requires a rod length within {allowed_um}; {name}, {half}, {does} "
            "(estimated with frozen joint motion)."
        )


def _original_meets_all(outcome: Outcome) -> bool:
    options = outcome.scenario.optimise.constraints
    asked = geometric(options, outcome.scenario.mechanism.applied().slider.offset)
    force, most = max(outcome.peak_pin_forces[0].values()), options.largest_pin_force
    return all(each.missed(outcome.original) <= MET for each in asked) and (most is None or force <= FORCE_MET * most)


def _constraints(outcome: Outcome) -> Iterator[str]:
    """A force that no lengths keep, and active bounds."""
    box = next(iter(outcome.scenario.optimise.boxes))
    if not outcome.keeps_force:
        most, found = outcome.scenario.optimise.constraints.largest_pin_force, max(outcome.peak_pin_forces[1].values())
        yield (
            f"No lengths in the box `{box}` keep the largest pin force at {most:.4g} N; the nearest have {found:.4g} "
            "N. Widen the box, or allow a larger force."
        )
    for bound in outcome.bounds:
        key = next((key for key in ("crank_length", "rod_length") if bound.startswith(in_words(key))), None)
        if "times the rod length" in bound:
            advice = "; raise `optimise.ratio_limit` if the drive allows it"
        else:
            advice = f"; move `optimise.boxes.{box}.{key}` if you can" if key else ""
        yield f"The {bound.replace(' at ', ' is at ', 1)} and limits the result{advice}."


def _changes(outcome: Outcome) -> Iterator[str]:
    """Side effects that a designer may not want, and how to limit them."""
    constraints, (before, after) = outcome.scenario.optimise.constraints, outcome.cycle("simulated")
    stroke, change = before["stroke"], after["stroke"] - before["stroke"]
    if constraints.stroke is None and abs(change / stroke) > NOTICED:
        yield (
            f"The stroke changes by {1e3 * change:+.3g} mm ({100 * change / stroke:+.1f} %); fix it with "
            "`optimise.constraints.stroke`."
        )
    peak = outcome.gains[outcome.stretch, "peak"]
    if peak.after / peak.before - 1 > NOTICED_PEAK:
        yield (
            f"The peak error grows from {math.degrees(peak.before):.3g} to {math.degrees(peak.after):.3g} deg "
            f"({100 * (peak.after / peak.before - 1):+.0f} %) over {outcome.stretch_in_words}; the RMS error was "
            "minimised."
        )
    old, new = (max(force.values()) for force in outcome.peak_pin_forces)
    if constraints.largest_pin_force is None and new / old - 1 > NOTICED_FORCE:
        yield (
            f"The largest force in a pin grows from {old:.3g} to {new:.3g} N ({100 * (new / old - 1):+.0f} %); limit "
            "it with `optimise.constraints.largest_pin_force`."
        )


def _networks(outcome: Outcome) -> Iterator[str]:
    errors = outcome.frames["fit_errors"]
    errors = errors[(errors["region"] == "all") & (errors["seed"] == outcome.scenario.surrogate.seeds[0])]
    own, regularised = (errors[errors["model"] == model] for model in ("network", "regularised"))
    factor = own["held_out_mse"] / own["training_mse"]
    if overfit := int((factor > OVERFIT).sum()):
        sentence = (
            f"{overfit} of {len(own)} networks overfit: test error up to {factor.max():.0f} times the training error. "
            + (
                "The gain is simulated without them."
                if outcome.chosen["source"] == "networks"
                else "The lengths were found without them."
            )
        )
        if len(regularised):
            good = int((regularised["held_out_mse"] <= GENERALISES * regularised["training_mse"]).sum())
            sentence += f" {good} of {len(regularised)} regularised networks do not (at most {GENERALISES:g} times)."
        yield sentence
