"""What came out of a scenario, and remarks on it."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

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

ORIGINAL = "original"

AS_GOOD = 1.01
"""Factor on the smallest error, simulated again, up to which lengths that differ less from one's own are taken."""

FORCE_MET = 1.005
"""Factor up to which the largest force, a median of an ensemble, counts as the one asked for."""

MOTIONS = {
    "simulation_settled": "simulation, a settled revolution",
    "simulation": "simulation, the first revolution",
    "clearance": "second surrogate, the first revolution",
    "networks": "networks, the first revolution",
}
"""Sources of the frozen motion in the joints, in words; the nearest to the running machine first."""

_WHOLE_TURN = 2 * math.pi * (1 - 1e-9)


@dataclass(frozen=True)
class Gain:
    """One measure of the error of the transmission angle before and after, over one stretch.

    Attributes
    ----------
    before, after : float
        Medians of the ensembles [rad].
    reduction, low, high : float
        By which share the error falls, simulated again: median, 5 % and 95 % quantile over pairs of runs.
    frozen : float
        The same with the motion in the joints frozen at the original lengths.
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
        """Whether the ensemble leaves no doubt that the error falls."""
        return self.low > 0.0

    @property
    def is_loss(self) -> bool:
        """Whether the ensemble leaves no doubt that the error grows."""
        return self.high < 0.0


@dataclass(frozen=True)
class RodTolerance:
    """What the rod's tolerance does to the error at the lengths found, the motion in the joints frozen.

    Attributes
    ----------
    width : float
        Of the tolerance [m].
    is_stated : bool
        Whether the scenario states it; else it is IT7.
    error, error_off : float
        RMS error with the nominal rod, and with one half the tolerance off [rad].
    allowed : float
        How far off [m] the rod may be until nothing is gained.
    """

    width: float
    is_stated: bool
    error: float
    error_off: float
    allowed: float


@dataclass(frozen=True)
class Outcome:
    """What a scenario found.

    Attributes
    ----------
    scenario : Scenario
    point : str
        Name of the lengths found, as in the table optimise_optima.
    source : str
        Of the motion that they were found on, a key of `MOTIONS`.
    found : mapping of str to str
        By source the better of the points that both optimisers found on it.
    rod : RodTolerance
    original, lengths : tuple of float
        Crank and rod length before and after [m].
    bounds : tuple of str
        Bounds and constraints that the lengths lie at, in words.
    stretch : str
        What counts: ``settled``, a whole settled revolution, or ``window``, where one was asked for.
    gains : mapping of (str, str) to Gain
        By stretch and measure (rms, mean_absolute, peak).
    worth, loads : DataFrame
        Rows of the tables optimise_worth and optimise_loads.
    floor : DataFrame
        The best crank for each rod on the motion of `source` in the main box: rows of the table optimise_floor.
    optima, resimulated, errors : DataFrame
        The tables optimise_optima, optimise_resimulated and fit_errors.
    """

    scenario: Scenario
    point: str
    source: str
    found: Mapping[str, str]
    rod: RodTolerance
    original: tuple[float, float]
    lengths: tuple[float, float]
    bounds: tuple[str, ...]
    stretch: str
    gains: Mapping[tuple[str, str], Gain]
    worth: pd.DataFrame
    loads: pd.DataFrame
    floor: pd.DataFrame
    optima: pd.DataFrame
    resimulated: pd.DataFrame
    errors: pd.DataFrame

    @property
    def keeps_crank(self) -> bool:
        """Whether the crank keeps its length, to the micrometre."""
        return abs(self.lengths[0] - self.original[0]) < 1e-6

    @property
    def gain(self) -> Gain:
        """Of the RMS error over the stretch that counts."""
        return self.gains[self.stretch, "rms"]

    @property
    def stretch_in_words(self) -> str:
        """``a settled revolution``."""
        return self.words_of(self.stretch)

    def words_of(self, stretch: str) -> str:
        """A stretch in words.

        Parameters
        ----------
        stretch : str
            ``settled`` or ``window``.
        """
        first, last = (math.degrees(angle) for angle in self.scenario.optimise.window)
        whole = last - first >= math.degrees(_WHOLE_TURN)
        if stretch == "settled":
            return "a settled revolution"
        return "the first revolution" if whole else f"the first revolution from {first:g} to {last:g} deg"

    def cycle(self, kind: str) -> tuple[pd.Series, pd.Series]:
        """Rows of the table optimise_worth before and after.

        Parameters
        ----------
        kind : str
            ``ideal`` or ``simulated``.
        """
        own = self.worth[self.worth["cycle"] == kind].set_index("point")
        return own.loc[ORIGINAL], own.loc[self.point]

    def load(self, joint: str) -> tuple[pd.Series, pd.Series]:
        """Rows of the table optimise_loads of one `joint` before and after."""
        own = self.loads[self.loads["joint"] == joint].set_index("point")
        return own.loc[ORIGINAL], own.loc[self.point]

    @property
    def peak_pin_forces(self) -> tuple[dict[str, float], dict[str, float]]:
        """Largest force in each pin over the settled revolution before and after [N], medians."""
        pairs = {joint: self.load(joint) for joint in PINS}
        return tuple({joint: float(pair[side]["peak_force"]) for joint, pair in pairs.items()} for side in (0, 1))

    @property
    def keeps_force(self) -> bool:
        """Whether the lengths found keep the largest force in a pin that was asked for, if one was."""
        most = self.scenario.optimise.constraints.largest_pin_force
        return most is None or max(self.peak_pin_forces[1].values()) <= FORCE_MET * most


def outcome(frames: Mapping[str, pd.DataFrame], scenario: Scenario) -> Outcome:
    """What was found in the main box, judged by simulating again.

    Of all lengths that were found on the several descriptions of the motion, those with the smallest error simulated
    again are taken: over a whole settled revolution, or over the window where the scenario asks for one. Where others
    come within 1 % of that error, those are taken that differ least from one's own.
    """
    first, last = scenario.optimise.window
    stretch = "settled" if last - first >= _WHOLE_TURN else "window"
    optima, again = frames["optimise_optima"], frames["optimise_resimulated"]
    main = next(iter(scenario.optimise.boxes))
    rms = again[(again["measure"] == "rms") & (again["stretch"] == stretch)].set_index("point")["error"]
    loads = frames["optimise_loads"]
    force = loads[loads["joint"].isin(PINS)].groupby("point")["peak_force"].max()
    most = FORCE_MET * (scenario.optimise.constraints.largest_pin_force or math.inf)
    applied = scenario.mechanism.applied()
    original = (applied.crank.length, applied.rod.length)
    own_name = optima["source"] + f"_{main}_" + optima["method"]
    candidates = optima[(optima["point"] == own_name) & optima["point"].isin(rms.index)]
    candidates = candidates.assign(
        force=candidates["point"].map(force).clip(lower=most),  # what keeps the force comes first
        error=candidates["point"].map(rms),
        change=np.hypot(candidates["crank_length"] / original[0] - 1, candidates["rod_length"] / original[1] - 1),
    ).sort_values(["force", "error"], kind="stable")
    best = candidates.iloc[0]
    as_good = candidates[(candidates["force"] == best["force"]) & (candidates["error"] <= AS_GOOD * best["error"])]
    row = as_good.loc[as_good["change"].idxmin()]
    source, point = row["source"], row["point"]
    firsts = dict(zip(candidates["source"][::-1], candidates["point"][::-1], strict=True)) | {source: point}
    found = {name: firsts[name] for name in MOTIONS if name in firsts}
    gains = {
        (each["stretch"], each["measure"]): Gain(
            each["original_error"],
            each["error"],
            each["reduction"],
            each["reduction_low"],
            each["reduction_high"],
            each["frozen_reduction"],
            each["share_better"],
        )
        for each in again[again["point"] == point].to_dict("records")
    }
    bounds, options, floor = row["active_bounds"], scenario.optimise, frames["optimise_floor"]
    valley = floor[(floor["source"] == source) & (floor["box"] == main) & (floor["measure"] == "rms")]
    return Outcome(
        scenario=scenario,
        point=point,
        source=source,
        found=found,
        rod=RodTolerance(
            float(row["rod_tolerance"]),
            options.rod_tolerance is not None,
            float(row["rms"]),
            float(row["rms_rod_off"]),
            float(row["rod_deviation_allowed"]),
        ),
        original=original,
        lengths=(float(row["crank_length"]), float(row["rod_length"])),
        bounds=() if bounds == "none" else tuple(bounds.split("; ")),
        stretch=stretch,
        gains=gains,
        worth=frames["optimise_worth"],
        loads=frames["optimise_loads"],
        floor=valley,
        optima=optima,
        resimulated=again,
        errors=frames.get("fit_errors", pd.DataFrame(columns=FIT_ERRORS.names)),
    )


def ideal_swing(lengths: tuple[float, float], offset: float) -> tuple[float, float]:
    """Smallest and largest transmission angle without clearance over a turn [rad]."""
    crank, rod = lengths
    return tuple(math.pi / 2 + float(np.arcsin((offset + side * crank) / rod)) for side in (-1, 1))


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
