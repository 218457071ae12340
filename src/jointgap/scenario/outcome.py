"""The result of a scenario's optimisation: lengths, gain, side effects and remarks, as a page and
as JSON."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.joints import FROM_FRAME, PINS
from jointgap.core.page import (
    Block,
    Bullets,
    Cell,
    FigureBlock,
    Heading,
    Link,
    Page,
    Paragraph,
    TableBlock,
)
from jointgap.core.schema import FIT_ERRORS
from jointgap.core.words import format_falls, format_name, format_range, format_size, joined, number
from jointgap.dynamics import mechanism_warnings
from jointgap.dynamics.kinematics import ideal_cycle
from jointgap.lengths.objective import GOALS, Goal
from jointgap.lengths.region import (
    FEASIBLE,
    FORCE_TOLERANCE,
    LEAST_FORCE,
    Constraint,
    geometric,
    regions,
)
from jointgap.paper.printed import departures
from jointgap.scenario.figures import FIGURES, described

NEEDED = tuple(f"optimise_{name}" for name in ("optima", "floor", "resimulated", "worth", "loads"))
"""Tables required, besides `fit_errors` where networks were trained."""

MOTIONS = {  # sources of the frozen joint motion; the closest to steady operation first
    "simulation_settled": "simulation, a settled revolution",
    "simulation": "simulation, the first revolution",
    "networks": "networks, the first revolution",
    "with_clearance": "simulations with clearance",
    "ideal_joints": "simulations with ideal joints",
}
EQUIVALENT = (
    1.01  # factor of the smallest error within which the lengths nearest to the original are chosen
)
REMARKABLE = {"stroke": 0.002, "force": 0.05, "peak": 0.01}  # relative changes that cause a remark
OVERFIT, GENERALISES = (
    10.0,
    2.0,
)  # ratio of held-out to training error of a network, and of a regularised one
FLAT = 0.02  # spread of the reduction along the valley below which its points are equivalent
_WHOLE_TURN = 2 * math.pi * (1 - 1e-9)
_MEASURES = {"rms": "root mean square (RMS)", "mean_absolute": "mean absolute", "peak": "peak"}
_FIGURES = ("valley", "resimulation", "contact_forces", "orbits")


@dataclass(frozen=True)
class Outcome:
    """The lengths found in a scenario and their effects."""

    scenario: Scenario
    frames: Mapping[str, pd.DataFrame]  # the tables `NEEDED`, by name
    chosen: Mapping[str, Any]  # row of the table optimise_optima
    found: Mapping[
        str, str
    ]  # better point of the two optimisers, by source of the motion; empty without an optimum
    # part of the motion that the result refers to: settled (a revolution) or window (configured)
    stretch: str
    gains: (
        pd.DataFrame
    )  # rows of the table optimise_resimulated of the chosen point, by stretch and measure

    @property
    def goal(self) -> Goal:
        """The objective."""
        return GOALS[self.scenario.optimise.objective]

    @property
    def is_of_angle(self) -> bool:
        """Whether the objective is the error of the transmission angle."""
        return self.scenario.optimise.objective == "transmission_angle"

    @property
    def original(self) -> tuple[float, float]:
        """Original crank and rod length [m]."""
        applied = self.scenario.mechanism.applied()
        return applied.crank.length, applied.rod.length

    @property
    def lengths(self) -> tuple[float, float]:
        """Crank and rod length found [m]."""
        return float(self.chosen["crank_length"]), float(self.chosen["rod_length"])

    @property
    def box(self) -> str:
        """Name of the search box."""
        return next(iter(self.scenario.optimise.boxes))

    @property
    def bounds(self) -> tuple[str, ...]:
        """Labels of the active bounds and constraints."""
        active = self.chosen["active_bounds"]
        return () if pd.isna(active) or active == "none" else tuple(active.split("; "))

    @property
    def keeps_crank(self) -> bool:
        """Whether the crank length is unchanged to the micrometre."""
        return abs(self.lengths[0] - self.original[0]) < 1e-6

    @property
    def gain(self) -> pd.Series:
        """Reduction of the objective (of the transmission angle: the RMS error) over `stretch`."""
        return self.gains.loc[(self.stretch, self.goal.measure)]

    @property
    def sizes(self) -> tuple[float, float]:
        """The objective before and after in its display unit, median."""
        return tuple(self.goal.factor * self.gain[["original_error", "error"]].astype(float))

    def stretch_label(self, stretch: str) -> str:
        """Label of a stretch, ``settled`` or ``window``."""
        first, last = map(math.degrees, self.scenario.optimise.window)
        if stretch == "settled":
            return "a settled revolution"
        whole = last - first >= math.degrees(_WHOLE_TURN)
        return (
            "the first revolution"
            if whole
            else f"the first revolution from {first:g} to {last:g} deg"
        )

    def pair(self, table: str, kind: str) -> pd.DataFrame:
        """Rows before and after, of ``optimise_worth`` for a `kind` of cycle or of
        ``optimise_loads`` for a joint."""
        own = self.frames[table].set_index("point").loc[["original", self.chosen["point"]]]
        return own[own["cycle" if "cycle" in own else "joint"] == kind]

    @property
    def peak_force(self) -> tuple[float, float]:
        """Largest force in a pin over the settled revolution before and after [N], median."""
        return tuple(
            np.max([self.pair("optimise_loads", joint)["peak_force"] for joint in PINS], axis=0)
        )

    def within_force_limit(self, after: bool = True) -> bool:
        """Whether the lengths found (or the original ones) satisfy the limit on the pin force."""
        most = self.scenario.optimise.constraints.largest_pin_force
        return most is None or self.peak_force[after] <= FORCE_TOLERANCE * most

    @property
    def status(self) -> str:
        """``optimal``, ``infeasible``, or ``not converged``; without an optimum the lengths have
        the smallest force."""
        if self.chosen["method"] == LEAST_FORCE:
            most = self.scenario.optimise.constraints.largest_pin_force
            return "infeasible" if self.peak_force[1] > most else "not converged"
        return "optimal" if self.within_force_limit() else "infeasible"


def outcome(frames: Mapping[str, pd.DataFrame], scenario: Scenario) -> Outcome:
    """The lengths in the main box with the smallest re-simulated objective, and their effects.

    It refers to a settled revolution, or to the window where the scenario configures one.
    """
    first, last = scenario.optimise.window
    stretch = "settled" if last - first >= _WHOLE_TURN else "window"
    optima, again, loads = (
        frames[f"optimise_{name}"] for name in ("optima", "resimulated", "loads")
    )
    measure = GOALS[scenario.optimise.objective].measure
    error = again[(again["measure"] == measure) & (again["stretch"] == stretch)].set_index("point")[
        "error"
    ]
    force = loads[loads["joint"].isin(PINS)].groupby("point")["peak_force"].max()
    most = FORCE_TOLERANCE * (scenario.optimise.constraints.largest_pin_force or math.inf)
    applied = scenario.mechanism.applied()
    lengths = optima[["crank_length", "rod_length"]] / [applied.crank.length, applied.rod.length]
    box = next(iter(scenario.optimise.boxes))
    is_own = optima["point"] == optima["source"] + f"_{box}_" + optima["method"]
    is_own |= optima["point"] == f"{LEAST_FORCE}_{box}"
    candidates = optima.assign(
        force=optima["point"].map(force).clip(lower=most),  # feasible lengths come first
        error=optima["point"].map(error),
        change=np.hypot(lengths["crank_length"] - 1, lengths["rod_length"] - 1),
    )
    candidates = candidates[is_own & optima["point"].isin(error.index)]
    candidates = candidates.sort_values(["force", "error"], kind="stable")
    best = candidates.iloc[0]
    as_good = candidates[
        (candidates["force"] == best["force"]) & (candidates["error"] <= EQUIVALENT * best["error"])
    ]
    chosen = as_good.loc[as_good["change"].idxmin()]
    firsts = candidates.drop_duplicates("source").set_index("source")["point"].to_dict()
    firsts |= {chosen["source"]: chosen["point"]}
    found = {
        source: firsts[source]
        for source in MOTIONS
        if source in firsts and chosen["method"] != LEAST_FORCE
    }
    gains = again[again["point"] == chosen["point"]].set_index(["stretch", "measure"]).sort_index()
    frames = {"fit_errors": pd.DataFrame(columns=FIT_ERRORS.names), **frames}
    return Outcome(scenario, frames, chosen.to_dict(), found, stretch, gains)


# -- remarks


def remarks(outcome: Outcome) -> tuple[str, ...]:
    """Remarks on an `outcome`, the most important first."""
    own = mechanism_warnings.sentences(
        outcome.scenario.mechanism, outcome.scenario.simulate.highest_speed
    )
    if outcome.status == "infeasible":
        return (*_limits(outcome), *own)
    return (_gain(outcome), *_limits(outcome), *_changes(outcome), *own, *_networks(outcome))


def _gain(outcome: Outcome) -> str:
    gain, row, options = outcome.gain, outcome.chosen, outcome.scenario.optimise
    low, high = -100 * gain["reduction_high"], -100 * gain["reduction_low"]
    spread = f"{_interval(gain)} % over {outcome.stretch_label(outcome.stretch)}"
    quantity = "error" if outcome.is_of_angle else outcome.goal.words
    if low > 0.0:
        meets_all = outcome.within_force_limit(after=False)
        meets_all &= all(
            each.violation(outcome.original) <= FEASIBLE for each in _geometric(outcome)
        )
        advice = "keep the original lengths" if meets_all else "this is the cost of the constraints"
        return (
            f"Simulated again, the {quantity} increases at the lengths found ({spread}): {advice}."
        )
    if high >= 0.0:
        return (
            f"The gain is not significant: simulated again from perturbed starts, the {quantity}"
            f" changes by {spread}."
        )
    half, allowed = float(row["rod_tolerance"]) / 2, float(row["rod_deviation_allowed"])
    if not outcome.is_of_angle:
        size = f"{number(np.subtract(*outcome.sizes))} {outcome.goal.unit}"
        return (
            f"The gain is {size}. It requires a rod length within ±{format_size(allowed, 'm')}"
            f" (estimate of the search); the tolerance is ±{format_size(half, 'm')}."
        )
    name = "The tolerance IT7" if options.rod_tolerance is None else "The configured tolerance"
    lost = format_size(row["rms_rod_off"] - row["rms"], "rad")
    does = f"reduces the gain by up to {lost}" if allowed >= half else "cancels the gain"
    return (
        f"The gain is {format_size(gain['original_error'] - gain['error'], 'rad')}. It requires a"
        f" rod length within ±{format_size(allowed, 'm')}. {name}, ±{format_size(half, 'm')},"
        f" {does} (estimated with frozen joint motion)."
    )


def _limits(outcome: Outcome) -> Iterator[str]:
    """An infeasible force limit, and active bounds."""
    box = outcome.box
    if outcome.status == "infeasible":
        least = number(outcome.peak_force[1])
        yield f"Allow a force above {least} N, or widen `optimise.boxes.{box}`."
    if outcome.status == "not converged":
        yield (
            "The search did not converge under the force limit; these are the lengths with the"
            " smallest pin force."
        )
    for bound in outcome.bounds:
        advice = ""
        if "times the rod length" in bound:
            advice = "; raise `optimise.ratio_limit` if the drive allows it"
        elif bound.startswith(("crank length", "rod length")):
            advice = (
                f"; widen `optimise.boxes.{box}.{bound.split()[0]}_length` if the design allows it"
            )
        yield f"The {bound.replace(' at ', ' is at ', 1)} and limits the result{advice}."


def _changes(outcome: Outcome) -> Iterator[str]:
    """Side effects above `REMARKABLE`, and how to limit them."""
    constraints = outcome.scenario.optimise.constraints
    stroke, new = outcome.pair("optimise_worth", "simulated")["stroke"]
    if constraints.stroke is None and abs(new / stroke - 1) > REMARKABLE["stroke"]:
        yield (
            f"The stroke changes by {1e3 * (new - stroke):+.3g} mm ({100 * (new / stroke - 1):+.1f}"
            " %); fix it with `optimise.constraints.stroke`."
        )
    measure = "peak" if outcome.is_of_angle else "rms"
    before, after = np.degrees(
        outcome.gains.loc[(outcome.stretch, measure), ["original_error", "error"]].astype(float)
    )
    if after / before - 1 > REMARKABLE["peak"]:
        error = "peak error" if outcome.is_of_angle else "RMS error of the transmission angle"
        minimised = "RMS error" if outcome.is_of_angle else outcome.goal.words
        yield (
            f"The {error} grows from {before:.3g} to {after:.3g} deg"
            f" ({100 * (after / before - 1):+.0f} %) over {outcome.stretch_label(outcome.stretch)};"
            f" the {minimised} was minimised."
        )
    before, after = outcome.peak_force
    is_free = constraints.largest_pin_force is None and outcome.goal.measure != "largest_pin_force"
    if is_free and after / before - 1 > REMARKABLE["force"]:
        yield (
            f"The largest force in a pin grows from {number(before)} to {number(after)} N"
            f" ({100 * (after / before - 1):+.0f} %); limit it with"
            " `optimise.constraints.largest_pin_force`."
        )


def _networks(outcome: Outcome) -> Iterator[str]:
    errors = outcome.frames["fit_errors"]
    errors = errors[
        (errors["region"] == "all") & (errors["seed"] == outcome.scenario.surrogate.seeds[0])
    ]
    own, regularised = (errors[errors["model"] == model] for model in ("network", "regularised"))
    factor = own["held_out_mse"] / own["training_mse"]
    if overfit := int((factor > OVERFIT).sum()):
        used = outcome.found and outcome.chosen["source"] == "networks"
        sentence = (
            f"{overfit} of {len(own)} networks overfit: between their training points the error is"
            f" up to {factor.max():.2g} times as large. The"
            f" {'gain is simulated' if used else 'lengths were found'} without them."
        )
        if len(regularised):
            good = int(
                (regularised["held_out_mse"] <= GENERALISES * regularised["training_mse"]).sum()
            )
            sentence += (
                f" {good} of {len(regularised)} regularised networks do not (at most"
                f" {GENERALISES:g} times)."
            )
        yield sentence


# -- page


def headline(outcome: Outcome) -> str:
    """Lengths found and change of the error; without an optimum, the smallest force."""
    if outcome.status == "infeasible":
        least, most = outcome.peak_force[1], outcome.scenario.optimise.constraints.largest_pin_force
        others = len(_geometric(outcome)) > 0
        return (
            f"No lengths within the bounds{' and the other constraints' if others else ''} keep the"
            f" pin force below {number(most)} N (least: {number(least)} N at {_nearest(outcome)})"
        )
    (crank, rod), gain = (_rounded(1e3 * length, 2) for length in outcome.lengths), outcome.gain
    unsure = "" if gain["reduction_low"] > 0 or gain["reduction_high"] < 0 else " (not significant)"
    change = (
        f"{abs(100 * gain['reduction']):.1f} % {'smaller' if gain['reduction'] > 0 else 'larger'}"
    )
    return f"Crank {crank} mm, rod {rod} mm: {outcome.goal.words} {change}{unsure}"


def details(outcome: Outcome) -> str:
    """Error and lengths before and after; without an optimum, the forces."""
    if outcome.status == "infeasible":
        before, after = map(number, outcome.peak_force)
        return (
            f"No optimum is reported. The largest force in a pin is {before} N at the original"
            f" lengths and at least {after} N within the bounds, at {_nearest(outcome)}: medians of"
            f" {outcome.gains['members'].iloc[0]} simulations from perturbed starts."
        )
    (crank, rod), (new_crank, new_rod), gain = outcome.original, outcome.lengths, outcome.gain
    before, after = _aligned(*outcome.sizes)
    quantity = "RMS error" if outcome.is_of_angle else outcome.goal.words.capitalize()
    ends = _interval(gain)
    ends = f"{ends} % over the starts" if " to " in ends else "the same for every start"
    lengths = [
        (
            f"{name} {_rounded(1e3 * old, 2)} mm (unchanged)"
            if abs(new - old) < 1e-6
            else f"{name} {_rounded(1e3 * old, 2)} → {_rounded(1e3 * new, 2)} mm"
        )
        for name, old, new in (("Crank", crank, new_crank), ("rod", rod, new_rod))
    ]
    return (
        f"{quantity} over {outcome.stretch_label(outcome.stretch)}, simulated again: {before} →"
        f" {after} {outcome.goal.unit} ({ends}). {', '.join(lengths)}; crank over rod"
        f" {crank / rod:.4f} → {new_crank / new_rod:.4f}."
    )


def document(outcome: Outcome, name: str, remarks: Sequence[str]) -> dict[str, Any]:
    """The content of ``summary.json``."""
    error, is_found = outcome.gains.loc[(outcome.stretch, "rms")], outcome.status != "infeasible"
    crank, rod = (
        {"before": 1e3 * old, "after": 1e3 * new if is_found else None}
        for old, new in zip(outcome.original, outcome.lengths, strict=True)
    )
    fall = {"median": "reduction", "5_percent": "reduction_low", "95_percent": "reduction_high"}

    def reduction(gain: pd.Series, **more: str) -> dict[str, float | None]:
        return {
            key: 100 * float(gain[column]) if is_found else None
            for key, column in (fall | more).items()
        }

    minimised = {}
    if not outcome.is_of_angle:
        before, after = outcome.sizes
        minimised[outcome.goal.measure] = {
            "unit": outcome.goal.unit.replace(" ", "*"),
            "before": before,
            "after": after if is_found else None,
            "reduction_percent": reduction(outcome.gain, search="frozen_reduction"),
        }
    return {
        "scenario": name,
        "status": outcome.status,
        "headline": headline(outcome),
        "objective": outcome.scenario.optimise.objective,
        **minimised,
        "details": details(outcome),
        "remarks": list(remarks),
        "found_on": outcome.chosen["source"] if outcome.found else None,
        "crank_length_mm": crank,
        "rod_length_mm": rod,
        "at_bounds": list(outcome.bounds),
        "rms_error_deg": {
            "before": math.degrees(error["original_error"]),
            "after": math.degrees(error["error"]) if is_found else None,
        },
        "reduction_percent": reduction(error, motion_frozen="frozen_reduction"),
        "speed_rpm": outcome.scenario.simulate.speed * 30 / math.pi,
        "largest_force_N": {joint: _largest_force(outcome, joint) for joint in PINS},
    } | ({} if is_found else {"smallest_force": _smallest_force(outcome)})


def _smallest_force(outcome: Outcome) -> dict[str, float]:
    """Force limit, the smallest force within the bounds, and its lengths."""
    crank, rod = outcome.lengths
    limit, force = (
        outcome.scenario.optimise.constraints.largest_pin_force,
        float(outcome.peak_force[1]),
    )
    return {
        "limit_N": limit,
        "force_N": force,
        "crank_length_mm": 1e3 * crank,
        "rod_length_mm": 1e3 * rod,
    }


def _largest_force(outcome: Outcome, joint: str) -> dict[str, float]:
    before, after = outcome.pair("optimise_loads", joint)["peak_force"]
    if outcome.status == "infeasible":
        return {"before": float(before), "after": None, "after_at_deg": None}
    angle = math.degrees(outcome.pair("optimise_loads", joint)["peak_angle"].iloc[1])
    return {"before": float(before), "after": float(after), "after_at_deg": angle}


def page(outcome: Outcome, name: str, remarks: Sequence[str]) -> Page:
    """The summary page."""
    scenario = outcome.scenario
    compared = scenario.paper and not departures(scenario.mechanism, scenario.simulate)
    links = (
        *([Link("Comparison with the paper", "comparison.html")] if compared else []),
        Link("Impacts, interactive", "figures/impacts.html", ": gaps, contact forces and modes"),
        Link("All figures", "figures", " (PNG, SVG, and the plotted data as Parquet)"),
        Link("Results as JSON", "summary.json"),
        Link("Tables of the search", "optimise", "; `jointgap describe FILE` explains the columns"),
    )
    is_found = outcome.status != "infeasible"
    checks = "Check before you use this" if is_found else "Next steps"
    result = (
        (
            Heading("Lengths"),
            *_lengths(outcome),
            Heading("Gain"),
            *_gains(outcome),
            Heading("Side effects"),
            *_side_effects(outcome),
            *_constraints(outcome),
            *_motions(outcome),
        )
        if is_found
        else _constraints(outcome)
    )
    blocks: list[Block] = [
        Paragraph(details(outcome), strong=True),
        _figure("animation", scenario),
        *([Paragraph(scenario.description)] if scenario.description else []),
        *([Heading(checks), Bullets(tuple(remarks))] if remarks else []),
        *result,
        Heading("Figures"),
        *(
            _figure(name, scenario)
            for name in _FIGURES
            if is_found or FIGURES[name].category != "Optimum"
        ),
        Heading("Files"),
        Bullets(links),
    ]
    return Page(headline(outcome), tuple(blocks), subject=f"Scenario {name}", width="60rem")


def _figure(name: str, scenario: Scenario) -> FigureBlock:
    spec = described(name, scenario)
    title = f"{spec.title}, original lengths" if spec.category == "Contact" else spec.title
    return FigureBlock(name, title, spec.caption, spec.moving)


def _rounded(value: float, decimals: int) -> str:
    """A number with at most `decimals` decimals, at least one."""
    return np.format_float_positional(value, decimals, trim="0")


def _signed(value: float, decimals: int) -> str:
    """A change with its sign; no sign where it rounds to zero."""
    text = f"{value:+.{decimals}f}"
    return text if float(text) else text[1:]


def _nearest(outcome: Outcome) -> str:
    """The lengths found; without the crank length where it is kept."""
    crank, rod = (_rounded(1e3 * length, 2) for length in outcome.lengths)
    return f"rod {rod} mm" if outcome.keeps_crank else f"crank {crank} mm, rod {rod} mm"


def _percent(reduction: float) -> str:
    """The change [%] of a reduction."""
    return _signed(-100 * reduction, 1)


def _interval(gain: pd.Series) -> str:
    """Range of the changes [%] of a row of the table optimise_resimulated."""
    return format_range(_percent(gain["reduction_high"]), _percent(gain["reduction_low"]))


def _aligned(before: float, after: float) -> tuple[str, str]:
    """Two numbers with the same decimals: three digits of the larger and two of the difference, at
    most five."""
    largest = max(abs(before), abs(after))
    sizes = [largest, max(10 * abs(after - before), 0.01 * largest) if after != before else 0.0]
    decimals = min(max([0, *(2 - math.floor(math.log10(size)) for size in sizes if size > 0)]), 5)
    return f"{before:.{decimals}f}", f"{after:.{decimals}f}"


def _definition(outcome: Outcome) -> str:
    applied, (crank, rod) = outcome.scenario.mechanism.applied(), outcome.original
    low, high = (
        90 + np.degrees(np.arcsin((applied.slider.offset + side * crank) / rod)) for side in (-1, 1)
    )
    return (
        "The transmission angle is the angle between the rod and the normal to the slide; the"
        " ideal is 90 deg. Its error is the angle without clearance at the original lengths minus"
        f" the angle with clearance in the {joined(map(format_name, applied.loose))}, over"
        f" {outcome.stretch_label(outcome.stretch)}. The angle varies from {low:.1f} to {high:.1f}"
        " deg."
    )


def _change(words: str, before: float, after: float, decimals: int | None = None) -> dict[str, str]:
    """A row of values before and after; relative change only for quantities without [deg] and
    [%]."""
    old, new = (
        _aligned(before, after)
        if decimals is None
        else (f"{value:.{decimals}f}" for value in (before, after))
    )
    is_relative = before and not words.endswith(("[deg]", "[%]"))
    return {
        "": words,
        "before": old,
        "after": new,
        "change": _signed(float(new) - float(old), len(old.partition(".")[2])),
        "change [%]": _signed(100 * (after / before - 1), 2) if is_relative else "–",
    }


def _lengths(outcome: Outcome) -> Iterator[Block]:
    options, searched = outcome.scenario.optimise, f"searched (box {outcome.box})"
    region = regions(outcome.scenario.mechanism.applied(), options)[outcome.box]
    (crank, rod), (new_crank, new_rod), (cranks, rods) = (
        outcome.original,
        outcome.lengths,
        region.searched,
    )
    low, high = 1e3 * np.array(options.boxes[outcome.box].rod_length)
    limit = "–" if options.ratio_limit is None else f"up to {options.ratio_limit:g}"
    rows = (
        _change("crank length [mm]", 1e3 * crank, 1e3 * new_crank, 3) | {searched: cranks},
        _change("rod length [mm]", 1e3 * rod, 1e3 * new_rod, 3) | {searched: rods},
        _change("crank over rod [1]", crank / rod, new_crank / new_rod, 5) | {searched: limit},
    )
    yield TableBlock.of(rows, "lrrrrr")
    if outcome.found and not outcome.bounds and outcome.within_force_limit():
        by_default = (
            cranks == "fixed" and outcome.box == "own"
        )  # without boxes in the configuration
        kept = " The crank keeps its length; `optimise.boxes` lets both vary." if by_default else ""
        yield Paragraph(f"No bound is active.{kept}")
    floor = outcome.frames["optimise_floor"]
    floor = floor[(floor["source"] == outcome.chosen["source"]) & (floor["box"] == outcome.box)]
    if floor.empty or not outcome.is_of_angle:  # empty: the search did not converge
        return
    ratios, reductions = (
        floor.loc[floor["measure"] == "rms", column] for column in ("ratio", "reduction")
    )
    yield Paragraph(
        "The error depends on the ratio only. With frozen joint motion and the best crank for each"
        f" rod from {low:g} to {high:g} mm, the ratio is"
        f" {format_range(f'{ratios.min():.5f}', f'{ratios.max():.5f}')}. The RMS error"
        f" {format_falls(100 * reductions)}"
        + (": all these pairs are equivalent." if np.ptp(reductions) <= FLAT else ".")
    )


def _gains(outcome: Outcome) -> Iterator[Block]:
    runs = f"{outcome.gains['members'].iloc[0]} pairs of runs with perturbed starts"
    if not outcome.is_of_angle:
        gain, (before, after) = outcome.gain, _aligned(*outcome.sizes)
        row = {"objective": outcome.goal.words, f"before [{outcome.goal.unit}]": before}
        row |= {f"after [{outcome.goal.unit}]": after} | _reductions(gain, "search [%]")
        yield TableBlock.of([row], "lrrrrrr")
        yield Paragraph(
            f"{outcome.goal.words.capitalize()}: {outcome.goal.definition}, over"
            f" {outcome.stretch_label(outcome.stretch)}. Simulated again: the result that counts;"
            f" median and spread over {runs}. Search: estimate from one simulation."
        )
        yield Heading("Transmission angle", 3)
    rows = []
    for stretch in (outcome.stretch, "window" if outcome.stretch == "settled" else "settled"):
        for measure, words in _MEASURES.items():
            gain = outcome.gains.loc[(stretch, measure)]
            before, after = _aligned(*np.degrees([gain["original_error"], gain["error"]]))
            rows.append(
                {
                    "error": f"{words}, {outcome.stretch_label(stretch)}",
                    "before [deg]": before,
                    "after [deg]": after,
                    **_reductions(gain, "frozen [%]"),
                }
            )
    yield TableBlock.of(rows, "lrrrrrr")
    yield Paragraph(_definition(outcome))
    yield Paragraph(
        f"Simulated again: the result that counts; median and spread over {runs}. Frozen: estimate"
        " with unchanged joint motion."
    )


def _reductions(gain: pd.Series, estimate: str) -> dict[str, str]:
    """Cells of the changes of a row of the table optimise_resimulated; `estimate` labels that of
    the search."""
    return {
        "simulated again [%]": _percent(gain["reduction"]),
        "5 to 95 % [%]": _interval(gain),
        estimate: _percent(gain["frozen_reduction"]),
        "improved in [% of run pairs]": f"{100 * gain['share_better']:.0f}",
    }


def _side_effects(outcome: Outcome) -> Iterator[Block]:
    applied, cycle = (
        outcome.scenario.mechanism.applied(),
        outcome.pair("optimise_worth", "simulated"),
    )
    loads = {joint: outcome.pair("optimise_loads", joint) for joint in FROM_FRAME}
    ideal = [
        ideal_cycle(*lengths, applied.slider.offset)
        for lengths in (outcome.original, outcome.lengths)
    ]
    changes = {  # before and after
        "stroke [mm]": 1e3 * cycle["stroke"],
        "stroke without clearance [mm]": [1e3 * one.stroke for one in ideal],
        "outer dead centre, slider at [mm]": 1e3 * cycle["outer_dead_centre"],
        "inner dead centre, slider at [mm]": 1e3 * cycle["inner_dead_centre"],
        "outer dead centre, crank at [deg]": [
            math.degrees(one.outer_dead_centre_angle) for one in ideal
        ],
        "inner dead centre, crank at [deg]": [
            math.degrees(one.inner_dead_centre_angle) for one in ideal
        ],
        "smallest transmission angle [deg]": np.degrees(cycle["smallest_transmission_angle"]),
    }
    for joint, load in loads.items():
        changes[f"largest force in the {format_name(joint)} [N]"] = load["peak_force"]
        changes[f"crank angle of the largest force in the {format_name(joint)} [deg]"] = np.degrees(
            load["peak_angle"]
        )
        changes[f"RMS force in the {format_name(joint)} [N]"] = load["rms_force"]
    for joint in applied.loose:
        changes[f"share of time in contact, {format_name(joint)} [%]"] = (
            100 * loads[joint]["contact_share"]
        )
    yield TableBlock.of((_change(words, *pair) for words, pair in changes.items()), "lrrrr")
    yield Paragraph(
        "Medians over the runs with clearance, for a settled revolution. Crank angles of the dead"
        " centres: without clearance, measured from the slide's direction. Forces include inertia"
        " and the effects listed in the mechanism file; gas pressure and external loads count only"
        " if listed there."
    )


def _geometric(outcome: Outcome) -> list[Constraint]:
    """Constraints that depend on the lengths only, without that of a crank that keeps its
    length."""
    offset = outcome.scenario.mechanism.applied().slider.offset
    asked = geometric(outcome.scenario.optimise.constraints, offset)
    return [each for each in asked if not (each.key == "crank_length" and outcome.keeps_crank)]


def _constraints(outcome: Outcome) -> Iterator[Block]:
    """Constraints besides the bounds of the lengths."""
    options, lengths = outcome.scenario.optimise.constraints, (outcome.original, outcome.lengths)
    rows = [
        (
            each.words,
            each.range_text(),
            *(each.show(float(each.value(at))) for at in lengths),
            each.violation(lengths[1]) <= FEASIBLE,
        )
        for each in _geometric(outcome)
    ]
    if (most := options.largest_pin_force) is not None:
        forces = (f"{number(force)} N" for force in outcome.peak_force)
        rows.append(
            (
                "largest force in a pin",
                f"{number(most)} N at most",
                *forces,
                outcome.status != "infeasible",
            )
        )
    if rows:
        yield Heading("Constraints")
        shown = tuple(
            (*words, Cell("yes", "good") if met else Cell("no", "bad")) for *words, met in rows
        )
        after = "smallest force" if outcome.status == "infeasible" else "after"
        yield TableBlock(("", "required", "before", after, "met"), shown, "lrrrl")
        yield Paragraph("Lengths and angles without clearance; forces simulated with clearance.")


def _motions(outcome: Outcome) -> Iterator[Block]:
    if not outcome.found:
        return
    yield Heading("Motion used by the search")
    optima, again = outcome.frames["optimise_optima"], outcome.frames["optimise_resimulated"]
    again = again[again["measure"] == outcome.goal.measure].set_index(["point", "stretch"])
    quantity, rows = ("RMS error" if outcome.is_of_angle else outcome.goal.words), []
    for source, point in outcome.found.items():
        own = optima[(optima["source"] == source) & (optima["point"] == point)].iloc[0]
        chosen = " (chosen)" if source == outcome.chosen["source"] else ""
        row = {"motion from": f"{MOTIONS[source]}{chosen}"}
        row |= {f"{link} [mm]": f"{1e3 * own[f'{link}_length']:.3f}" for link in ("crank", "rod")}
        for stretch in ("settled", "window") if outcome.is_of_angle else ("settled",):
            own_gain = again.loc[(point, stretch)]
            shown = f"{_percent(own_gain['reduction'])} ({_interval(own_gain)})"
            row[f"{quantity}, {outcome.stretch_label(stretch)} [%]"] = shown
        rows.append(row)
    motion = (
        "frozen joint motion from several sources"
        if outcome.is_of_angle
        else "one simulation for each pair of lengths on a grid"
    )
    yield Paragraph(
        f"The search uses {motion}. The result is the pair of lengths with the smallest"
        f" re-simulated {quantity} over {outcome.stretch_label(outcome.stretch)}."
    )
    yield TableBlock.of(rows, "l" + "r" * (len(rows[0]) - 1))
