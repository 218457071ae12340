"""The paper's numbers and claims compared with ours: table `comparison` and its page."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.core.page import Block, Cell, Heading, Page, Paragraph, TableBlock
from jointgap.core.words import in_words
from jointgap.paper.printed import (
    CLAIMS,
    OPTIMA,
    TRAINING_ITERATIONS,
    TRAINING_MSE,
    PrintedOptimum,
    departures,
)

NEEDED = (
    "trajectory",
    "kinematics",
    "fit_errors",
    "optimise_optima",
    "optimise_tolerance",
    "optimise_resimulated",
    "optimise_worth",
)
"""Names of the tables that are compared."""

AGREES, LENGTH_AGREES = 0.01, 0.001
"""Share of the paper's value within which a number, or an optimum length, agrees."""

ABOUT = 1.2  # how far a number that the paper calls "about", or shows in a figure, may go beyond it
ALIKE = 0.05  # two sizes that differ by less are alike
TIE = 0.001  # percentage points by which an optimiser has to lead
IN_CONTACT = 0.999  # share of the clearance from which on the journal counts as on its bearing
FOLLOWS = 30.0  # [deg] RMS deviation up to which a direction follows the crank
ONE_POINT = 1e-6  # [m] within which two end points are one
_TONES = {"agrees": "good", "reached": "good", "holds": "good"}
_TONES |= {"differs": "bad", "missed": "bad", "does not hold": "bad"}

Row = dict[str, Any]


def _row(kind: str, item: str, unit: str, paper: float | None, ours: float | None, verdict: str, why: str) -> Row:
    ours = None if ours is None or pd.isna(ours) else float(ours)
    ratio = ours / paper if paper and ours is not None else None
    row = {"kind": kind, "item": item, "unit": unit, "paper": paper, "ours": ours, "ratio": ratio}
    return row | {"verdict": verdict, "sentence": why}


def number(item: str, unit: str, paper: float, ours: float, why: str, within: float = AGREES) -> Row:
    """A printed number and ours."""
    verdict = "agrees" if abs(ours / paper - 1.0) <= within else "differs"
    return _row("number", item, unit, paper, ours, verdict, why)


def limit(item: str, paper: float, ours: float, why: str) -> Row:
    """A printed error and ours, which reaches it where it is not larger."""
    return _row("number", item, "1", paper, ours, "reached" if ours <= paper else "missed", why)


def claim(key: str, ours: float | None, holds: bool | None, why: str) -> Row:
    """A claim of the paper (key of `CLAIMS`) and our evidence; `holds` is None where it cannot be told."""
    item, unit, *paper = CLAIMS[key]
    verdict = "cannot be told" if holds is None else "holds" if holds else "does not hold"
    unit = unit if paper or ours is not None else ""
    return _row("claim", item, unit, float(paper[0]) if paper else None, ours, verdict, why)


def compare(frames: Mapping[str, pd.DataFrame], scenario: Scenario, variants: Sequence[Row]) -> pd.DataFrame:
    """Every number and claim of the paper beside ours: frame of the table comparison.

    `variants` are rows of `variant_optimum`. For another mechanism than the paper's, only claims without a size.
    """
    first = frames["trajectory"].iloc[: scenario.simulate.samples_per_revolution + 1].reset_index(drop=True)
    turned = np.degrees(first["crank_angle"] - first["crank_angle"].iloc[0]).to_numpy()
    ideal = frames["kinematics"].query("source == 'ideal'").reset_index(drop=True)
    loose = scenario.mechanism.applied().loose
    found = _of_networks(frames["optimise_optima"], scenario).set_index("method")
    ends = _of_networks(frames["optimise_tolerance"], scenario)
    rows = [
        *([superposition_claim(first, ideal, loose)] if len(loose) > 1 else []),
        *optimiser_claims(found, ends),
        joints_claim(pd.DataFrame(list(variants))),
        *gain_claims(frames["optimise_resimulated"], frames["optimise_worth"], scenario),
    ]
    if departures(scenario.mechanism, scenario.simulate):
        return pd.DataFrame([row | {"paper": None, "ratio": None} for row in rows])
    errors = frames["fit_errors"].query("region == 'all'")
    numbers = [
        *training_errors(errors, scenario.surrogate.seeds[0]),
        *second_surrogate(errors),
        *(
            row
            for printed, method in zip(OPTIMA, ("genetic", "local"), strict=False)
            for row in optimum(printed, found.loc[method])
        ),
        *another_end(OPTIMA[2], ends),
        *printed_points(frames["optimise_optima"]),
    ]
    claims = [
        *contact_claims(first, turned, scenario),
        *deviation_claims(first, turned, ideal),
        networks_claim(errors, scenario.surrogate.seeds[0]),
        evaluations_claim(found),
    ]
    return pd.DataFrame([*numbers, *claims, *rows])


def _of_networks(table: pd.DataFrame, scenario: Scenario) -> pd.DataFrame:
    """Rows of an optimisation on the networks' motion in the main box."""
    return table[(table["source"] == "networks") & (table["box"] == next(iter(scenario.optimise.boxes)))]


def training_errors(errors: pd.DataFrame, default: int) -> Iterator[Row]:
    """Training errors of the networks, default start."""
    networks = errors[errors["model"] == "network"]
    for output, printed in TRAINING_MSE.items():
        every = networks[networks["output"] == output]
        ours = every[every["seed"] == default].iloc[0]
        done, stop = ours["iterations"], ours["stop"].partition(";")[0]
        why = f"Default start, {done:.0f} of {TRAINING_ITERATIONS} iterations ({stop})."
        if not pd.isna(ours["iterations_to_paper"]):
            why += f" Reached the paper's error after {ours['iterations_to_paper']:.0f} iterations."
        held_out, spline = ours["held_out_mse"], ours["spline_held_out_mse"]
        why += f" Held-out MSE {held_out:.2g}; spline through the same points {spline:.2g}."
        if len(every) > 1:
            shown = (
                f"{name} {every[column].median():.2g} ({every[column].min():.2g} to {every[column].max():.2g})"
                for name, column in (("training", "training_mse"), ("held-out", "held_out_mse"))
            )
            why += f" Median (range) of {len(every)} starts: {', '.join(shown)}."
        yield limit(f"training MSE of {output}", printed, ours["training_mse"], why)


def second_surrogate(errors: pd.DataFrame) -> Iterator[Row]:
    """Held-out errors of the second surrogate against the paper's training errors."""
    ours = errors[errors["model"] == "clearance"].set_index("output")
    for output, printed in TRAINING_MSE.items():
        row = ours.loc[output]
        why = (
            f"The paper's is a training error. {row['training_points']:.0f} training points, {row['weights']:.0f} "
            f"weights for the joint; spline through the same points {row['spline_held_out_mse']:.2g}."
        )
        yield limit(f"held-out MSE of {output}, second surrogate", printed, row["held_out_mse"], why)


def _lengths_and_reduction(printed: PrintedOptimum, ours: pd.Series, *why: str) -> Iterator[Row]:
    for name, key, unit, factor, within, sentence in (
        ("crank length L2", "crank_length", "mm", 1e3, LENGTH_AGREES, why[0]),
        ("rod length L3", "rod_length", "mm", 1e3, LENGTH_AGREES, why[1]),
        ("error decreases by", "reduction", "%", 100, AGREES, why[2]),
    ):
        value = ours["rms_reduction" if key == "reduction" else key]
        yield number(f"{printed.name}: {name}", unit, factor * getattr(printed, key), factor * value, sentence, within)


def optimum(printed: PrintedOptimum, ours: pd.Series) -> Iterator[Row]:
    """The paper's optimum of an optimiser and ours, a row of optimise_optima."""
    after = np.degrees(ours["rms"])
    others = ("mean_absolute", "peak", "sum_of_squares")
    bounds = ours["active_bounds"]
    yield from _lengths_and_reduction(
        printed,
        ours,
        f"L2/L3 = {ours['ratio']:.5f}; paper {printed.crank_length / printed.rod_length:.5f}.",
        "The error falls with L3 along the valley, so bounds decide; the paper does not print them. "
        + ("No bound is active: the search stopped before." if bounds == "none" else f"Active: {bounds}."),
        f"RMS error {after / (1 - ours['rms_reduction']):.4f} -> {after:.4f} deg; other measures: "
        + ", ".join(f"{in_words(name)} {ours[f'{name}_reduction']:.2%}" for name in others)
        + ". The result depends on measure, window and friction, which the paper does not print.",
    )
    if printed.evaluations is not None:
        within = ours["evaluations_within_1_percent"]
        reached = "never" if pd.isna(within) else f"after {within:.0f} evaluations"
        why = f"{str(ours['status']).capitalize()}; within 1 % of the lowest value {reached}."
        yield number(f"{printed.name}: function evaluations", "1", printed.evaluations, ours["evaluations"], why)


def another_end(printed: PrintedOptimum, ends: pd.DataFrame) -> Iterator[Row]:
    """The paper's poorer end point and the poorest of ours, at the loosest stopping tolerance tried."""
    loosest, tightest = (ends[ends["tolerance"] == ends["tolerance"].agg(edge)] for edge in ("max", "min"))
    why = (
        f"The poorest of {len(loosest)} end points at the loosest tolerance ({loosest['tolerance'].iloc[0]:.0e}). At "
        f"the tightest ({tightest['tolerance'].iloc[0]:.0e}) they differ by "
        f"{100 * np.ptp(tightest['rms_reduction']):.2g} percentage points: the search stopped in a flat valley."
    )
    yield from _lengths_and_reduction(printed, loosest.loc[loosest["rms_reduction"].idxmin()], why, why, why)


def printed_points(optima: pd.DataFrame) -> Iterator[Row]:
    """The error at the paper's own lengths on our motion."""
    points = optima[(optima["source"] == "networks") & (optima["method"] == "printed")].set_index("point")
    for printed in OPTIMA:
        ours, theirs = points.loc[printed.key], 1e3 * (1 - printed.reduction) * printed.rod_length
        yield number(
            f"at the printed lengths of: {printed.name}, error decreases by",
            "%",
            100 * printed.reduction,
            100 * ours["rms_reduction"],
            f"RMS on our motion. (1 - R) L3 = {1e3 * ours['invariant']:.2f} mm; paper {theirs:.2f} mm. It is constant "
            "along the valley: the three printed points are one valley.",
        )


def contact_claims(first: pd.DataFrame, turned: np.ndarray, scenario: Scenario) -> Iterator[Row]:
    """Where contact is lost in the first revolution, `turned` (n,) [deg], and whether gamma2 follows the crank."""
    mechanism, last, shares = scenario.mechanism.applied(), {}, []
    until = CLAIMS["unstable"][2]
    for joint in mechanism.loose:
        lost = first[f"r{JOINT_NUMBERS[joint]}"].to_numpy() < IN_CONTACT * mechanism.clearance(joint)
        last[joint] = float(turned[lost].max(initial=0.0))
        shares.append(
            f"{in_words(joint)} at {last[joint]:.1f} deg ({lost[turned > until].mean():.1%} of the rest without "
            "contact)"
        )
    worst = max(last.values())
    why = f"Contact (r >= {IN_CONTACT} rc) is lost last: {'; '.join(shares)}."
    yield claim("unstable", worst, worst <= ABOUT * until, why)
    past = turned >= 60.0
    gamma = np.degrees(first["gamma2"].to_numpy())[past]
    turns = (gamma[-1] - gamma[0]) / (turned[past][-1] - turned[past][0])
    deviation = gamma - turned[past]
    deviation -= deviation.mean()
    rms = np.sqrt(np.mean(deviation**2))
    why = (
        f"Past 60 deg gamma2 deviates from the crank angle by {rms:.1f} deg RMS, {np.abs(deviation).max():.0f} deg at "
        f"most, apart from a constant; less than {FOLLOWS:g} deg RMS counts as following."
    )
    yield claim("gamma2", turns, rms < FOLLOWS, why)


def deviation_claims(first: pd.DataFrame, turned: np.ndarray, ideal: pd.DataFrame) -> Iterator[Row]:
    """Sizes of the deviations from the `ideal` motion over the first revolution, `turned` (n,) [deg]."""

    def sizes(column: str) -> tuple[float, float, float]:
        """RMS, peak, and the angle of the peak [deg]."""
        size = (first[column] - ideal[column]).abs().to_numpy()
        return np.sqrt(np.nanmean(size**2)), np.nanmax(size), turned[np.nanargmax(size)]

    (_, x, _), (_, y, _), (_, piston, _) = map(sizes, ("rod_position_x", "rod_position_y", "slider_position"))
    for key, largest, why in (
        ("rod", 1e3 * max(x, y), f"Largest deviation {1e3 * x:.3f} mm in X, {1e3 * y:.3f} mm in Y"),
        ("piston", 1e3 * piston, f"Largest deviation {1e3 * piston:.3f} mm"),
    ):
        holds = largest <= ABOUT * CLAIMS[key][2]
        yield claim(key, largest, holds, f"{why}; up to {ABOUT - 1:.0%} more than the paper's counts as about.")
    for quantity, unit in (("velocity", "m/s"), ("acceleration", "m/s^2")):
        (x, peak_x, _), (y, peak_y, _) = (sizes(f"rod_{quantity}_{axis}") for axis in "xy")
        holds = None if abs(y / x - 1) < ALIKE else y > x
        why = (
            f"RMS {x:.4g} in X, {y:.4g} {unit} in Y; peaks {peak_x:.4g}, {peak_y:.4g} {unit}. Less than {ALIKE:.0%} "
            "apart: alike."
        )
        yield claim(f"rod_{quantity}", y / x, holds, why)
    peaks = {
        "rod in X": sizes("rod_acceleration_x"),
        "rod in Y": sizes("rod_acceleration_y"),
        "piston": sizes("slider_acceleration"),
    }
    latest = max(angle for _, _, angle in peaks.values())
    where = ", ".join(f"{words} at {angle:.1f} deg by {peak:.4g} m/s^2" for words, (_, peak, angle) in peaks.items())
    yield claim("peaks", latest, latest <= ABOUT * CLAIMS["peaks"][2], f"Largest deviations: {where}.")


def superposition_claim(first: pd.DataFrame, ideal: pd.DataFrame, loose: Sequence[str]) -> Row:
    """How much of the piston's deviation the clearances of the `loose` joints along the slide explain."""
    numbers = sorted(JOINT_NUMBERS[joint] for joint in loose)
    signs = {number: -1.0 if number == 3 else 1.0 for number in numbers}
    defined = first[[f"gamma{number}" for number in numbers]].notna().all(axis=1).to_numpy()
    deviation = (first["slider_position"] - ideal["slider_position"]).to_numpy()[defined]
    parts = [
        sign * (first[f"r{number}"] * np.cos(first[f"gamma{number}"])).to_numpy()[defined]
        for number, sign in signs.items()
    ]
    explained, *alone = (1.0 - np.var(deviation - part) / np.var(deviation) for part in (sum(parts), *parts))
    terms = "".join(f" {'-' if sign < 0 else '+'} r{number} cos gamma{number}" for number, sign in signs.items())
    why = (
        f"{terms.removeprefix(' + ')} explains {explained:.1%} of the variance of the piston's deviation, the best "
        f"single joint {max(alone):.1%}; the rest comes from the rod's tilt."
    )
    return claim("superposed", explained, explained > 0.95, why)


def networks_claim(errors: pd.DataFrame, default: int) -> Row:
    """Held-out errors of the networks against the paper's training errors."""
    own = errors[(errors["model"] == "network") & (errors["seed"] == default)].set_index("output")
    ratios = (own["held_out_mse"] / own["paper_mse"]).dropna()
    worst = ratios.idxmax()
    held_out, training = own.loc[worst, ["held_out_mse", "training_mse"]]
    why = (
        f"Held-out error at or below the paper's training error: {int((ratios <= 1).sum())} of {len(ratios)} networks. "
        f"Farthest: {worst}, {held_out:.2g} held out, {training:.2g} in training."
    )
    if ratios.max() > 1:
        overfit = "Overfitting: contacts oscillate faster than the training points resolve."
        why += " The training stopped short." if held_out < 2.0 * training else f" {overfit}"
    return claim("networks", ratios.max(), bool((ratios <= 1.0).all()), why)


def evaluations_claim(found: pd.DataFrame) -> Row:
    """Evaluations until both optimisers came near the optimum."""
    within = [found.loc[method, "evaluations_within_1_percent"] for method in ("genetic", "local")]
    enough = all(not pd.isna(own) and own <= printed.evaluations for own, printed in zip(within, OPTIMA, strict=False))
    shown = ["never" if pd.isna(own) else f"after {own:.0f} evaluations" for own in within]
    why = f"Within 1 % of the lowest sum of squares: genetic {shown[0]}, best local start {shown[1]}."
    return claim("evaluations", within[0], enough, why)


def optimiser_claims(found: pd.DataFrame, ends: pd.DataFrame) -> Iterator[Row]:
    """Genetic against local, and in how many points the local optimiser ends."""
    genetic, local = found.loc["genetic"], found.loc["local"]
    lead = 100 * (genetic["rms_reduction"] - local["rms_reduction"])
    why = (
        f"Genetic {genetic['rms_reduction']:.4%} after {genetic['evaluations']:.0f} evaluations, best local "
        f"{local['rms_reduction']:.4%} after {local['evaluations']:.0f}; a lead of {TIE:g} percentage points or less "
        "is a tie."
    )
    yield claim("genetic", lead, lead > TIE, why)
    counts = {
        tolerance: distinct(part[["crank_length", "rod_length"]].to_numpy())
        for tolerance, part in ends.groupby("tolerance")
    }
    (tightest, few), *_, (loosest, many) = counts.items()
    why = (
        f"End points more than {1e6 * ONE_POINT:.0f} um apart: {few} at the tolerance {tightest:.0e}, {many} at "
        f"{loosest:.0e}. Apparent minima are where the search stopped."
    )
    yield claim("minima", few, few > 1, why)


def distinct(points: np.ndarray) -> int:
    """How many of the points, shape (n, 2) [m], lie farther than `ONE_POINT` from every earlier one."""
    kept: list[np.ndarray] = []
    for point in points:
        if all(np.hypot(*(point - other)) > ONE_POINT for other in kept):
            kept.append(point)
    return len(kept)


def gain_claims(again: pd.DataFrame, worth: pd.DataFrame, scenario: Scenario) -> Iterator[Row]:
    """Whether the gain of the genetic algorithm's lengths remains when simulated again."""
    point = f"networks_{next(iter(scenario.optimise.boxes))}_genetic"
    rows = again[(again["point"] == point) & (again["measure"] == "rms")].set_index("stretch")
    machine = worth[(worth["point"] == point) & (worth["cycle"] == "simulated")].iloc[0]
    for stretch in ("window", "settled"):
        row = rows.loc[stretch]
        low, middle, high = (100 * row[name] for name in ("reduction_low", "reduction", "reduction_high"))
        why = (
            f"RMS error {np.degrees(row['original_error']):.4f} -> {np.degrees(row['error']):.4f} deg: {middle:.2f} % "
            f"(5-95 %: {low:.2f} to {high:.2f} %) over {row['members']:.0f} perturbed starts for each pair of lengths, "
            f"improved in {row['share_better']:.0%} of run pairs; frozen {100 * row['frozen_reduction']:.2f} %. Stroke "
            f"{1e3 * machine['stroke_change']:+.3f} mm, smallest transmission angle "
            f"{np.degrees(machine['smallest_transmission_angle_change']):+.3f} deg."
        )
        yield claim(f"gain_{stretch}", middle, True if low > 0 else False if high < 0 else None, why)


def looseness_variants(name: str, scenarios: Mapping[str, Scenario]) -> tuple[str, ...]:
    """Names of those of the `scenarios`, `name` among them, that differ from it in nothing but which joints are loose.

    How networks are trained may differ; scenarios in which all joints are ideal have no optimum and are left out.
    """
    wanted = _apart_from_looseness(scenarios[name])
    return tuple(
        other
        for other, scenario in scenarios.items()
        if scenario.mechanism.applied().loose and _apart_from_looseness(scenario) == wanted
    )


def _apart_from_looseness(scenario: Scenario) -> dict:
    mechanism = scenario.mechanism.applied().model_dump()
    for joint in mechanism["joints"].values():
        if isinstance(joint, dict):
            joint.pop("loose")
    mechanism.pop("contacts")  # each joint carries its own
    return {"mechanism": mechanism, "simulate": scenario.simulate, "optimise": scenario.optimise}


def variant_optimum(name: str, scenario: Scenario, resimulated: pd.DataFrame) -> Row:
    """The re-simulated optimum of a scenario, found on the simulation's own motion: columns of the table overview.

    Lengths found on networks would depend on their training, which may differ between scenarios.
    """
    point = f"simulation_{next(iter(scenario.optimise.boxes))}_genetic"
    rows = resimulated[(resimulated["point"] == point) & (resimulated["measure"] == "rms")].set_index("stretch")
    window, applied = rows.loc["window"], scenario.mechanism.applied()
    return {
        "scenario": name,
        "loose": ", ".join(f"{in_words(joint)} ({applied.joint(joint).journal})" for joint in applied.loose),
        "loose_joints": len(applied.loose),
        "found_reduction": float(window["reduction"]),
        "found_low": float(window["reduction_low"]),
        "found_high": float(window["reduction_high"]),
        "found_settled": float(rows.loc["settled", "reduction"]),
        "found_original_error": float(window["original_error"]),
        "found_error": float(window["error"]),
    }


def more_is_better(variants: pd.DataFrame) -> bool | None:
    """Whether the reduction grows with the count of loose joints, spreads included; None where it cannot be told.

    `variants` are rows of `variant_optimum`.
    """
    pairs = variants.merge(variants, how="cross", suffixes=("_few", "_many")).query(
        "loose_joints_few < loose_joints_many"
    )
    if (pairs["found_high_many"] < pairs["found_low_few"]).any():
        return False
    return True if len(pairs) and (pairs["found_low_many"] > pairs["found_high_few"]).all() else None


def joints_claim(variants: pd.DataFrame) -> Row:
    """The claim that more loose joints gain more, judged by scenarios that differ in their loose joints only."""
    if variants["loose_joints"].nunique() < 2:
        return claim("joints", None, None, "Needs scenarios in the same run that differ only in their loose joints.")
    means = variants.groupby("loose_joints")["found_reduction"].mean()
    numbers = "; ".join(
        f"{row.loose_joints} loose ({row.scenario}): {row.found_reduction:.2%} ({row.found_low:.2%} to "
        f"{row.found_high:.2%})"
        for row in variants.sort_values("loose_joints", kind="stable").itertuples()
    )
    why = f"RMS reduction over the window, simulated again, median (5-95 %): {numbers}. {conclusion(variants)}"
    return claim("joints", 100 * (means.iloc[-1] - means.iloc[0]), more_is_better(variants), why)


def conclusion(variants: pd.DataFrame) -> str:
    """What the `variants` show about the count of loose joints, in words."""
    verdict = more_is_better(variants)
    if verdict is None:
        return "The spreads overlap, so this cannot be decided."
    if verdict:
        return "Each scenario with more loose joints gains more than each with fewer, spreads included."
    most, least = (variants.loc[getattr(variants["found_reduction"], edge)()] for edge in ("idxmax", "idxmin"))
    return (
        f"{most['scenario']} (loose joints: {most['loose_joints']}) gains most, {least['scenario']} (loose joints: "
        f"{least['loose_joints']}) least: the number of loose joints does not determine the gain. The part of the "
        "error that is proportional to the sine of the crank angle does, because another length ratio removes only "
        "that part."
    )


def comparison_page(comparison: pd.DataFrame, scenario: Scenario) -> Page:
    """The `comparison` (table comparison) of a `scenario` on one page."""
    if differences := departures(scenario.mechanism, scenario.simulate):
        basis = (
            f"This mechanism is not the paper's ({'; '.join(differences)}), so only its claims without a size are "
            "compared. Results for this mechanism: `summary.html`."
        )
    else:
        basis = (
            f"A number agrees within {AGREES:.0%} of the paper's, an optimum length within {LENGTH_AGREES:.1%}. "
            "Nothing is tuned to match: contact parameters, bounds and window are those of the configuration."
        )
    texts = (scenario.description, f"{_counts(comparison)} {basis}")
    blocks: list[Block] = [Paragraph(text) for text in texts if text]
    for kind, title, why in (("number", "Printed numbers", "remark"), ("claim", "Claims", "our evidence")):
        rows = comparison[comparison["kind"] == kind]
        if len(rows):
            heads = (kind, "unit", "paper", "ours", "ours / paper", "verdict", why)
            blocks += [Heading(title), TableBlock(heads, tuple(map(_cells, rows.itertuples())), "llrrrll")]
    return Page("The paper and this simulation side by side", tuple(blocks))


def _counts(comparison: pd.DataFrame) -> str:
    """How many numbers agree and claims hold, in words."""
    sentences = []
    for kind, rows in comparison.groupby("kind", sort=False):
        counts = (f"{verdict} {count}" for verdict, count in rows["verdict"].value_counts().items())
        sentences.append(f"{kind.capitalize()}s: {', '.join(counts)}.")
    return " ".join(sentences)


def _cells(row) -> tuple[str | Cell, ...]:
    numbers = map(_number, (row.paper, row.ours, row.ratio))
    return (row.item, row.unit, *numbers, Cell(row.verdict, _TONES.get(row.verdict, "open")), row.sentence)


def _number(value: float | None) -> str:
    if value is None or math.isnan(value):
        return "–"
    return f"{value:.6g}" if 1e-3 <= abs(value) < 1e6 or value == 0 else f"{value:.4e}"
