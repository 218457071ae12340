"""The lengths that a scenario's optimisation chooses: facts and remarks on them."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.facts import Fact
from jointgap.core.facts import document as facts_document
from jointgap.core.joints import FROM_FRAME, PINS
from jointgap.core.schema import FIT_ERRORS
from jointgap.core.words import format_name, format_range, format_size, number
from jointgap.lengths.objective import GOALS, Goal
from jointgap.lengths.region import FEASIBLE, FORCE_TOLERANCE, LEAST_FORCE, Constraint, geometric
from jointgap.motion import mechanism_warnings

NEEDED = tuple(f"optimise_{name}" for name in ("optima", "floor", "resimulated", "worth", "loads"))
"""Tables required, besides `fit_errors` where networks were trained."""

MOTIONS = {  # sources of the joint motion
    "simulation_settled": "simulation, a settled revolution",
    "simulation": "simulation, the first revolution",
    "networks": "networks, the first revolution",
    "with_clearance": "simulations with clearance",
    "ideal_joints": "simulations with ideal joints",
}
EQUIVALENT = 1.01  # times the smallest error: then the lengths nearest to the original are chosen
REMARKABLE = {"stroke": 0.002, "force": 0.05, "peak": 0.01}  # relative changes that cause a remark
OVERFIT = 10.0  # ratio of held-out to training error of a network
GENERALISES = 2.0  # the same ratio of a regularised network
_WHOLE_TURN = 2 * math.pi * (1 - 1e-9)


@dataclass(frozen=True)
class ChosenLengths:
    """The lengths chosen in a scenario and their effects."""

    scenario: Scenario
    tables: Mapping[str, pd.DataFrame]  # `NEEDED` and fit_errors, by name
    row: Mapping[str, Any]  # of the table optimise_optima
    stretch: str  # part of the motion: settled (a revolution) or window (configured)
    gains: pd.DataFrame  # of the table optimise_resimulated, by stretch and measure

    @property
    def goal(self) -> Goal:
        """The objective."""
        return GOALS[self.scenario.optimise.objective]

    @property
    def is_of_angle(self) -> bool:
        """Whether the objective is the error of the transmission angle."""
        return self.scenario.optimise.objective == "transmission_angle"

    @property
    def objective_label(self) -> str:
        """Label of the objective."""
        return "RMS error" if self.is_of_angle else self.goal.words

    @property
    def original(self) -> tuple[float, float]:
        """Original crank and rod length [m]."""
        applied = self.scenario.mechanism.applied()
        return applied.crank.length, applied.rod.length

    @property
    def lengths(self) -> tuple[float, float]:
        """Crank and rod length chosen [m]."""
        return float(self.row["crank_length"]), float(self.row["rod_length"])

    @property
    def box(self) -> str:
        """Name of the search box."""
        return next(iter(self.scenario.optimise.boxes))

    @property
    def bounds(self) -> tuple[str, ...]:
        """Labels of the active bounds and constraints."""
        active = self.row["active_bounds"]
        return () if pd.isna(active) or active == "none" else tuple(active.split("; "))

    @property
    def gain(self) -> pd.Series:
        """Reduction of the objective (of the transmission angle: the RMS error) over `stretch`."""
        return self.gains.loc[(self.stretch, self.goal.measure)]

    @property
    def constraints(self) -> list[Constraint]:
        """Constraints that depend on the lengths only, except a crank that keeps its length."""
        offset = self.scenario.mechanism.applied().slider.offset
        keeps_crank = abs(self.lengths[0] - self.original[0]) < 1e-6
        return [
            constraint
            for constraint in geometric(self.scenario.optimise.constraints, offset)
            if not (keeps_crank and constraint.key == "crank_length")
        ]

    def stretch_label(self, stretch: str) -> str:
        """Label of a stretch, ``settled`` or ``window``."""
        start, end = self.scenario.optimise.window
        if stretch == "settled":
            return "a settled revolution"
        if end - start >= _WHOLE_TURN:
            return "the first revolution"
        return f"the first revolution from {math.degrees(start):g} to {math.degrees(end):g} deg"

    def pair(self, table: str, kind: str) -> pd.DataFrame:
        """Rows before and after, of ``optimise_worth`` for a `kind` of cycle or of
        ``optimise_loads`` for a joint."""
        rows = self.tables[table].set_index("point").loc[["original", self.row["point"]]]
        return rows[rows["cycle" if "cycle" in rows else "joint"] == kind]

    @property
    def peak_force(self) -> np.ndarray:
        """Largest force in a pin over the settled revolution before and after [N], median."""
        return np.max([self.pair("optimise_loads", joint)["peak_force"] for joint in PINS], axis=0)

    @property
    def force_limit(self) -> float:
        """Largest allowed force in a pin [N]; infinite without a limit."""
        return self.scenario.optimise.constraints.largest_pin_force or math.inf

    @property
    def is_found(self) -> bool:
        """Whether a search found the lengths; otherwise they have the smallest pin force."""
        return self.row["method"] != LEAST_FORCE

    @property
    def status(self) -> str:
        """``optimal``, ``infeasible``, or ``not converged``; without an optimum the lengths have
        the smallest force."""
        force = self.peak_force[1]
        if not self.is_found:
            return "infeasible" if force > self.force_limit else "not converged"
        return "optimal" if force <= FORCE_TOLERANCE * self.force_limit else "infeasible"


def choose_lengths(tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> ChosenLengths:
    """The lengths in the main box with the smallest re-simulated objective.

    It refers to a settled revolution, or to the window where the scenario configures one.
    """
    start, end = scenario.optimise.window
    stretch = "settled" if end - start >= _WHOLE_TURN else "window"
    optima, resimulated, loads = (
        tables[f"optimise_{name}"] for name in ("optima", "resimulated", "loads")
    )
    measure = GOALS[scenario.optimise.objective].measure
    gains = resimulated[(resimulated["measure"] == measure) & (resimulated["stretch"] == stretch)]
    error = gains.set_index("point")["error"]
    force = loads[loads["joint"].isin(PINS)].groupby("point")["peak_force"].max()
    limit = FORCE_TOLERANCE * (scenario.optimise.constraints.largest_pin_force or math.inf)
    applied = scenario.mechanism.applied()
    box = next(iter(scenario.optimise.boxes))
    in_box = optima["point"] == optima["source"] + f"_{box}_" + optima["method"]
    in_box |= optima["point"] == f"{LEAST_FORCE}_{box}"
    candidates = optima.assign(
        force=optima["point"].map(force).clip(lower=limit),  # feasible lengths come first
        error=optima["point"].map(error),
        change=np.hypot(
            optima["crank_length"] / applied.crank.length - 1,
            optima["rod_length"] / applied.rod.length - 1,
        ),
    )
    candidates = candidates[in_box & optima["point"].isin(error.index)]
    candidates = candidates.sort_values(["force", "error"], kind="stable")
    best = candidates.iloc[0]
    is_equivalent = candidates["force"] == best["force"]
    is_equivalent &= candidates["error"] <= EQUIVALENT * best["error"]
    row = candidates.loc[candidates.loc[is_equivalent, "change"].idxmin()]
    return ChosenLengths(
        scenario,
        {"fit_errors": pd.DataFrame(columns=FIT_ERRORS.names), **tables},
        row.to_dict(),
        stretch,
        resimulated[resimulated["point"] == row["point"]]
        .set_index(["stretch", "measure"])
        .sort_index(),
    )


# -- facts


def facts(optimum: ChosenLengths) -> list[Fact]:
    """The result in numbers, named as the keys of summary.json; values after the optimisation are
    None where no lengths are feasible."""
    result = [*length_facts(optimum), *gain_facts(optimum), *side_effects(optimum)]
    if optimum.status == "infeasible":
        result = [replace(fact, value=None) for fact in result]
    return result


def length_facts(optimum: ChosenLengths) -> list[Fact]:
    """Lengths and their ratio."""
    (crank, rod), (new_crank, new_rod) = optimum.original, optimum.lengths
    return [
        Fact("crank_length_mm", 1e3 * new_crank, "mm", "crank length", before=1e3 * crank),
        Fact("rod_length_mm", 1e3 * new_rod, "mm", "rod length", before=1e3 * rod),
        Fact("crank_over_rod", new_crank / new_rod, "", "crank over rod", before=crank / rod),
    ]


def gain_facts(optimum: ChosenLengths) -> Iterator[Fact]:
    """Objective and error of the transmission angle, with their reductions."""
    goal, angle = optimum.goal, GOALS["transmission_angle"]
    if not optimum.is_of_angle:
        yield from _gain_facts(optimum, goal, goal.measure, f"{goal.measure}/", "search")
    yield from _gain_facts(optimum, angle, "rms_error_deg", "", "motion_frozen")


def _gain_facts(
    optimum: ChosenLengths, goal: Goal, name: str, group: str, estimate: str
) -> Iterator[Fact]:
    gain = optimum.gains.loc[(optimum.stretch, goal.measure)]
    original, error = goal.factor * gain[["original_error", "error"]].astype(float)
    words = f"RMS {goal.words}" if goal.measure == "rms" else goal.words
    label = f"{words} over {optimum.stretch_label(optimum.stretch)}"
    yield Fact(name, error, goal.unit, label, before=original)
    columns = {
        "median": "reduction",
        "5_percent": "reduction_low",
        "95_percent": "reduction_high",
        estimate: "frozen_reduction",
    }
    for key, column in columns.items():
        reduction = 100 * float(gain[column])
        label = f"reduction of the {words}, {format_name(key)}"
        yield Fact(f"{group}reduction_percent/{key}", reduction, "%", label)


def side_effects(optimum: ChosenLengths) -> Iterator[Fact]:
    """Stroke, dead centres, transmission angle, forces and contact over a settled revolution."""
    cycle = optimum.pair("optimise_worth", "simulated")
    for column in ("stroke", "outer_dead_centre", "inner_dead_centre"):
        original, optimised = 1e3 * cycle[column]
        yield Fact(f"{column}_mm", optimised, "mm", format_name(column), before=original)
    original, optimised = np.degrees(cycle["smallest_transmission_angle"])
    label = "smallest transmission angle"
    yield Fact("smallest_transmission_angle_deg", optimised, "deg", label, before=original)
    for joint in FROM_FRAME:
        load, words = optimum.pair("optimise_loads", joint), format_name(joint)
        for column, name, unit, label in (
            ("peak_force", "largest_force_N", "N", "largest force"),
            ("rms_force", "rms_force_N", "N", "RMS force"),
            ("contact_share", "contact_share_percent", "%", "share of time in contact"),
        ):
            original, optimised = load[column] * (100 if unit == "%" else 1)
            if not math.isnan(optimised):  # as the contact share of an ideal joint
                yield Fact(f"{name}/{joint}", optimised, unit, f"{label}, {words}", before=original)
        angle, label = math.degrees(load["peak_angle"].iloc[1]), "crank angle of the largest force"
        yield Fact(f"largest_force_N/{joint}/after_at_deg", angle, "deg", f"{label}, {words}")


# -- remarks


def remarks(optimum: ChosenLengths) -> tuple[str, ...]:
    """Remarks on the result, the most important first."""
    scenario = optimum.scenario
    mechanism = mechanism_warnings.sentences(scenario.mechanism, scenario.simulate.highest_speed)
    if optimum.status == "infeasible":
        return (*_limits(optimum), *mechanism)
    return (
        _gain(optimum),
        *_limits(optimum),
        *_large_side_effects(optimum),
        *mechanism,
        *_overfit_networks(optimum),
    )


def interval(gain: pd.Series) -> str:
    """Range of the changes [%] of a row of the table optimise_resimulated."""
    return format_range(percent(gain["reduction_high"]), percent(gain["reduction_low"]))


def percent(reduction: float) -> str:
    """The change [%] of a reduction."""
    return f"{-100 * reduction:+z.1f}"


def _gain(optimum: ChosenLengths) -> str:
    gain, row, goal = optimum.gain, optimum.row, optimum.goal
    spread = f"{interval(gain)} % over {optimum.stretch_label(optimum.stretch)}"
    if gain["reduction_high"] < 0.0:
        is_feasible = optimum.peak_force[0] <= FORCE_TOLERANCE * optimum.force_limit and all(
            constraint.violation(optimum.original) <= FEASIBLE for constraint in optimum.constraints
        )
        advice = "keep the original lengths" if is_feasible else "the constraints cause it"
        return f"Simulated again, the {optimum.objective_label} increases ({spread}): {advice}."
    if gain["reduction_low"] <= 0.0:
        return (
            "The gain is not significant: simulated again from perturbed starts, the"
            f" {optimum.objective_label} changes by {spread}."
        )
    allowed = format_size(row["rod_deviation_allowed"], "m")
    size = f"{number(goal.factor * (gain['original_error'] - gain['error']), 3)} {goal.unit}"
    return (
        f"The gain is {size}. It requires a rod length within ±{allowed} (estimate of the search):"
        " compare it with the tolerance of the rod."
    )


def _limits(optimum: ChosenLengths) -> Iterator[str]:
    """An infeasible force limit, and active bounds."""
    if optimum.status == "infeasible":
        force = number(optimum.peak_force[1])
        yield f"Allow a force above {force} N, or widen `optimise.boxes.{optimum.box}`."
    if optimum.status == "not converged":
        yield (
            "The search did not converge under the force limit; these are the lengths with the"
            " smallest pin force."
        )
    for bound in optimum.bounds:
        advice = ""
        if "times the rod length" in bound:
            advice = "; raise `optimise.ratio_limit` if the drive allows it"
        elif bound.startswith(("crank length", "rod length")):
            key = f"optimise.boxes.{optimum.box}.{bound.split()[0]}_length"
            advice = f"; widen `{key}` if the design allows it"
        yield f"The {bound.replace(' at ', ' is at ', 1)} and limits the result{advice}."


def _large_side_effects(optimum: ChosenLengths) -> Iterator[str]:
    """Side effects above `REMARKABLE`, and how to limit them."""
    constraints = optimum.scenario.optimise.constraints
    original, optimised = 1e3 * optimum.pair("optimise_worth", "simulated")["stroke"]
    if constraints.stroke is None and abs(optimised / original - 1) > REMARKABLE["stroke"]:
        yield (
            f"The stroke changes by {optimised - original:+.3g} mm"
            f" ({100 * (optimised / original - 1):+.1f} %); fix it with"
            " `optimise.constraints.stroke`."
        )
    error = "peak" if optimum.is_of_angle else "rms"
    gain = optimum.gains.loc[(optimum.stretch, error)]
    original, optimised = np.degrees([gain["original_error"], gain["error"]])
    if optimised / original - 1 > REMARKABLE["peak"]:
        yield (
            f"The {format_name(error)} error of the transmission angle grows from {original:.3g} to"
            f" {optimised:.3g} deg ({100 * (optimised / original - 1):+.0f} %) over"
            f" {optimum.stretch_label(optimum.stretch)}; the {optimum.objective_label} was"
            " minimised."
        )
    original, optimised = optimum.peak_force
    is_free = math.isinf(optimum.force_limit) and optimum.goal.measure != "largest_pin_force"
    if is_free and optimised / original - 1 > REMARKABLE["force"]:
        yield (
            f"The largest force in a pin grows from {number(original)} to {number(optimised)} N"
            f" ({100 * (optimised / original - 1):+.0f} %); limit it with"
            " `optimise.constraints.largest_pin_force`."
        )


def _overfit_networks(optimum: ChosenLengths) -> Iterator[str]:
    errors = optimum.tables["fit_errors"]
    seed = optimum.scenario.surrogate.seeds[0]
    errors = errors[(errors["region"] == "all") & (errors["seed"] == seed)]
    factors = (errors["held_out_mse"] / errors["training_mse"]).groupby(errors["model"])
    factors = {model: factor for model, factor in factors}
    networks, regularised = factors.get("network"), factors.get("regularised")
    if networks is None or not (networks > OVERFIT).any():
        return
    text = (
        f"{(networks > OVERFIT).sum()} of {len(networks)} networks overfit: between their training"
        f" points the error is up to {networks.max():.2g} times as large. The gain is simulated"
        " without them."
    )
    if regularised is not None:
        count = (regularised <= GENERALISES).sum()
        text += (
            f" {count} of {len(regularised)} regularised networks do not (at most {GENERALISES:g}"
            " times)."
        )
    yield text


# -- texts and summary.json


def headline(optimum: ChosenLengths) -> str:
    """Lengths chosen and change of the objective; without an optimum, the smallest force."""
    if optimum.status == "infeasible":
        others = " and the other constraints" if optimum.constraints else ""
        return (
            f"No lengths within the bounds{others} keep the pin force below"
            f" {number(optimum.force_limit)} N (least: {number(optimum.peak_force[1])} N at"
            f" {_lengths(optimum)})"
        )
    gain = optimum.gain
    is_sure = gain["reduction_low"] > 0 or gain["reduction_high"] < 0
    change = "smaller" if gain["reduction"] > 0 else "larger"
    return (
        f"{_lengths(optimum).capitalize()}: {optimum.goal.words}"
        f" {abs(100 * gain['reduction']):.1f} % {change}{'' if is_sure else ' (not significant)'}"
    )


def _lengths(optimum: ChosenLengths) -> str:
    crank, rod = optimum.lengths
    return f"crank {1e3 * crank:.2f} mm, rod {1e3 * rod:.2f} mm"


def details(optimum: ChosenLengths) -> str:
    """Objective and lengths before and after; without an optimum, the forces."""
    if optimum.status == "infeasible":
        original, optimised = map(number, optimum.peak_force)
        return (
            f"No optimum is reported. The largest force in a pin is {original} N at the original"
            f" lengths and at least {optimised} N within the bounds, at {_lengths(optimum)}:"
            f" medians of {optimum.gains['members'].iloc[0]} simulations from perturbed starts."
        )
    objective = next(gain_facts(optimum))
    lengths = "; ".join(f"{fact.words} {fact.text}" for fact in length_facts(optimum))
    return (
        f"Simulated again, {objective.words}: {objective.text} ({interval(optimum.gain)} % over the"
        f" starts). {lengths.capitalize()}."
    )


def document(optimum: ChosenLengths, name: str) -> dict[str, Any]:
    """The content of ``summary.json``."""
    numbers = facts_document(facts(optimum))
    if not optimum.is_of_angle:
        numbers[optimum.goal.measure] |= {"unit": optimum.goal.unit.replace(" ", "*")}
    if optimum.status == "infeasible":
        crank, rod = optimum.lengths
        numbers["smallest_force"] = {
            "limit_N": optimum.force_limit,
            "force_N": float(optimum.peak_force[1]),
            "crank_length_mm": 1e3 * crank,
            "rod_length_mm": 1e3 * rod,
        }
    return {
        "scenario": name,
        "status": optimum.status,
        "headline": headline(optimum),
        "objective": optimum.scenario.optimise.objective,
        "details": details(optimum),
        "remarks": list(remarks(optimum)),
        "found_on": optimum.row["source"] if optimum.is_found else None,
        "at_bounds": list(optimum.bounds),
        "speed_rpm": optimum.scenario.simulate.speed * 30 / math.pi,
        **numbers,
    }
