"""What a scenario found, in numbers: the lengths, what they gain, and what they cost."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.joints import PINS

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
        errors=frames["fit_errors"],
    )


def ideal_swing(lengths: tuple[float, float], offset: float) -> tuple[float, float]:
    """Smallest and largest transmission angle without clearance over a turn [rad]."""
    crank, rod = lengths
    return tuple(math.pi / 2 + float(np.arcsin((offset + side * crank) / rod)) for side in (-1, 1))
