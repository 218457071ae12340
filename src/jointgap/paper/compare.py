"""The paper's numbers and claims compared with the simulation: table `comparison` and its page.
Texts: printed.yaml."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.core.page import Block, Cell, Heading, Page, Paragraph, TableBlock
from jointgap.core.words import format_name
from jointgap.paper.printed import (
    CLAIMS,
    OPTIMA,
    REMARKS,
    TRAINING_ITERATIONS,
    TRAINING_MSE,
    PrintedOptimum,
    departures,
)

NEEDED = ("trajectory", "kinematics", "fit_errors") + tuple(
    f"optimise_{name}" for name in ("optima", "tolerance", "resimulated", "worth")
)
"""Tables required for the comparison."""

AGREES, LENGTH_AGREES = 0.01, 0.001
"""Relative tolerance of a number, and of an optimum length."""

ABOUT = 1.2  # tolerance factor of a number that the paper calls "about" or shows in a figure
ALIKE = 0.05  # relative difference below which two sizes are equal
TIE = 0.001  # [percentage points] difference of two optimisers below which they are equal
IN_CONTACT = 0.999  # distance of the centres, over the clearance, above which a joint is in contact
FOLLOWS = 30.0  # [deg] RMS deviation below which a direction follows the crank
ONE_POINT = 1e-6  # [m] distance below which two end points are equal
_TONES = dict.fromkeys(("agrees", "reached", "holds"), "good")
_TONES |= dict.fromkeys(("differs", "missed", "does not hold"), "bad")

Row = dict[str, Any]


def _row(
    kind: str, item: str, unit: str, paper: float | None, ours: float | None, verdict: str, why: str
) -> Row:
    ours = None if ours is None or pd.isna(ours) else float(ours)
    ratio = ours / paper if paper and ours is not None else None
    row = {"kind": kind, "item": item, "unit": unit, "paper": paper, "ours": ours, "ratio": ratio}
    return row | {"verdict": verdict, "sentence": why}


def number(
    item: str, unit: str, paper: float, ours: float, why: str, within: float = AGREES
) -> Row:
    """A printed number and its simulated value."""
    verdict = "agrees" if abs(ours / paper - 1.0) <= within else "differs"
    return _row("number", item, unit, paper, ours, verdict, why)


def limit(item: str, paper: float, ours: float, why: str) -> Row:
    """A printed error as an upper limit, and its simulated value."""
    return _row("number", item, "1", paper, ours, "reached" if ours <= paper else "missed", why)


def claim(key: str, ours: float | None, holds: bool | None, **evidence: Any) -> Row:
    """A claim of the paper (key of `CLAIMS`) with evidence; `holds` is None where it is
    undecided."""
    known = CLAIMS[key]
    paper = known.get("paper")
    verdict = "undecided" if holds is None else "holds" if holds else "does not hold"
    unit = "" if paper is None and ours is None else known["unit"]
    why = known["evidence"].format(**evidence)
    return _row(
        "claim", known["item"], unit, None if paper is None else float(paper), ours, verdict, why
    )


def compare(
    frames: Mapping[str, pd.DataFrame], scenario: Scenario, variants: Sequence[Row | None]
) -> pd.DataFrame:
    """The table comparison: every number and claim of the paper.

    `variants` are rows of `variant_optimum`. Another mechanism is compared only with claims without
    a size.
    """
    first = (
        frames["trajectory"]
        .iloc[: scenario.simulate.samples_per_revolution + 1]
        .reset_index(drop=True)
    )
    turned = np.degrees(first["crank_angle"] - first["crank_angle"].iloc[0]).to_numpy()
    ideal = frames["kinematics"].query("source == 'ideal'").reset_index(drop=True)
    loose, default = scenario.mechanism.applied().loose, scenario.surrogate.seeds[0]
    searched = {"source": "networks", "box": next(iter(scenario.optimise.boxes))}
    found, ends = (
        table[(table[list(searched)] == pd.Series(searched)).all(axis=1)]
        for table in (frames["optimise_optima"], frames["optimise_tolerance"])
    )
    found = found.set_index("method")
    has_optimum = "genetic" in found.index  # not where no lengths satisfy the constraints
    several_tolerances = has_optimum and ends["tolerance"].nunique() > 1
    rows = [
        *([superposition_claim(first, ideal, loose)] if len(loose) > 1 else []),
        *([genetic_claim(found)] if has_optimum else []),
        *([minima_claim(ends)] if several_tolerances else []),
        joints_claim(pd.DataFrame([each for each in variants if each is not None])),
        *(
            gain_claims(frames["optimise_resimulated"], frames["optimise_worth"], scenario)
            if has_optimum
            else ()
        ),
    ]
    if departures(scenario.mechanism, scenario.simulate):
        return pd.DataFrame([row | {"paper": None, "ratio": None} for row in rows])
    errors = frames["fit_errors"].query("region == 'all'")
    numbers = [
        *training_errors(errors, default),
        *(optimum(OPTIMA[0], found.loc["genetic"]) if has_optimum else ()),
        *(optimum(OPTIMA[1], found.loc["local"]) if has_optimum else ()),
        *(another_end(OPTIMA[2], ends) if several_tolerances else ()),
        *printed_points(frames["optimise_optima"]),
    ]
    claims = [
        *contact_claims(first, turned, scenario),
        *deviation_claims(first, turned, ideal),
        networks_claim(errors, default),
        *([evaluations_claim(found)] if has_optimum else []),
    ]
    return pd.DataFrame([*numbers, *claims, *rows])


# -- numbers


def training_errors(errors: pd.DataFrame, default: int) -> Iterator[Row]:
    """Training errors of the networks, default start."""
    networks = errors[errors["model"] == "network"]
    for output, printed in TRAINING_MSE.items():
        every = networks[networks["output"] == output]
        ours = every[every["seed"] == default].iloc[0]
        said = {"allowed": TRAINING_ITERATIONS, "reached": "", "starts": ""}
        if not pd.isna(ours["iterations_to_paper"]):
            said["reached"] = (
                f" Reached the paper's error after {ours['iterations_to_paper']:.0f} iterations."
            )
        if len(every) > 1:
            shown = (
                f"{name} {every[column].median():.2g} ({every[column].min():.2g} to"
                f" {every[column].max():.2g})"
                for name, column in (("training", "training_mse"), ("held-out", "held_out_mse"))
            )
            said["starts"] = f" Median (range) of {len(every)} starts: {', '.join(shown)}."
        why = REMARKS["training"].format(**{**ours, "stop": ours["stop"].partition(";")[0]}, **said)
        yield limit(f"training MSE of {output}", printed, ours["training_mse"], why)


def _lengths_and_reduction(printed: PrintedOptimum, ours: pd.Series, *why: str) -> Iterator[Row]:
    name = printed.name
    crank, rod, fall = 1e3 * printed.crank_length, 1e3 * printed.rod_length, 100 * printed.reduction
    yield number(
        f"{name}: crank length L2", "mm", crank, 1e3 * ours["crank_length"], why[0], LENGTH_AGREES
    )
    yield number(
        f"{name}: rod length L3", "mm", rod, 1e3 * ours["rod_length"], why[1], LENGTH_AGREES
    )
    yield number(f"{name}: error decreases by", "%", fall, 100 * ours["rms_reduction"], why[2])


def optimum(printed: PrintedOptimum, ours: pd.Series) -> Iterator[Row]:
    """The paper's optimum of an optimiser, compared with a row of optimise_optima."""
    after, bounds = np.degrees(ours["rms"]), ours["active_bounds"]
    said = {"printed": printed.crank_length / printed.rod_length, "after": after}
    said["before"] = after / (1 - ours["rms_reduction"])
    said["active"] = (
        "No bound is active: the search stopped earlier."
        if bounds == "none"
        else f"Active: {bounds}."
    )
    why = (
        REMARKS[key].format(**ours, **said) for key in ("crank_length", "rod_length", "reduction")
    )
    yield from _lengths_and_reduction(printed, ours, *why)
    if printed.evaluations is not None:
        reached = _after(ours["evaluations_within_1_percent"])
        why = REMARKS["calls"].format(status=str(ours["status"]).capitalize(), reached=reached)
        yield number(
            f"{printed.name}: function evaluations",
            "1",
            printed.evaluations,
            ours["evaluations"],
            why,
        )


def _after(calls: float) -> str:
    return "never" if pd.isna(calls) else f"after {calls:.0f} evaluations"


def another_end(printed: PrintedOptimum, ends: pd.DataFrame) -> Iterator[Row]:
    """The paper's poorer end point, compared with the poorest one at the loosest stopping
    tolerance."""
    by_tolerance = dict(list(ends.groupby("tolerance")))
    tightest, loosest = min(by_tolerance), max(by_tolerance)
    own, apart = by_tolerance[loosest], 100 * np.ptp(by_tolerance[tightest]["rms_reduction"])
    why = REMARKS["another_end"].format(
        number=len(own), loosest=loosest, tightest=tightest, apart=apart
    )
    yield from _lengths_and_reduction(
        printed, own.loc[own["rms_reduction"].idxmin()], why, why, why
    )


def printed_points(optima: pd.DataFrame) -> Iterator[Row]:
    """The error at the paper's lengths with the simulated motion."""
    points = optima[(optima["source"] == "networks") & (optima["method"] == "printed")].set_index(
        "point"
    )
    for printed in OPTIMA:
        ours, theirs = points.loc[printed.key], 1e3 * (1 - printed.reduction) * printed.rod_length
        why = REMARKS["printed_point"].format(ours=1e3 * ours["invariant"], theirs=theirs)
        item = f"at the printed lengths of: {printed.name}, error decreases by"
        yield number(item, "%", 100 * printed.reduction, 100 * ours["rms_reduction"], why)


# -- claims


def contact_claims(first: pd.DataFrame, turned: np.ndarray, scenario: Scenario) -> Iterator[Row]:
    """Angles `turned` (n,) [deg] of lost contact in the first revolution, and whether gamma2
    follows the crank."""
    mechanism, last, shares = scenario.mechanism.applied(), 0.0, []
    until = CLAIMS["unstable"]["paper"]
    for joint in mechanism.loose:
        lost = first[f"r{JOINT_NUMBERS[joint]}"].to_numpy() < IN_CONTACT * mechanism.clearance(
            joint
        )
        at, rest = float(turned[lost].max(initial=0.0)), lost[turned > until].mean()
        shares.append(
            f"{format_name(joint)} at {at:.1f} deg (then {rest:.1%} of the samples without contact)"
        )
        last = max(last, at)
    yield claim(
        "unstable", last, last <= ABOUT * until, touching=IN_CONTACT, lost="; ".join(shares)
    )
    past = turned >= 60.0
    gamma, angle = np.degrees(first["gamma2"].to_numpy())[past], turned[past]
    turns = (gamma[-1] - gamma[0]) / (angle[-1] - angle[0])
    deviation = gamma - angle
    deviation -= deviation.mean()
    rms = np.sqrt(np.mean(deviation**2))
    yield claim(
        "gamma2", turns, rms < FOLLOWS, rms=rms, most=np.abs(deviation).max(), limit=FOLLOWS
    )


def deviation_claims(first: pd.DataFrame, turned: np.ndarray, ideal: pd.DataFrame) -> Iterator[Row]:
    """Deviations from the `ideal` motion over the first revolution, `turned` (n,) [deg]."""

    def sizes(column: str) -> tuple[float, float, float]:
        """RMS, peak, and the angle of the peak [deg]."""
        size = (first[column] - ideal[column]).abs().to_numpy()
        return np.sqrt(np.nanmean(size**2)), np.nanmax(size), turned[np.nanargmax(size)]

    x, y, piston = (
        1e3 * sizes(name)[1] for name in ("rod_position_x", "rod_position_y", "slider_position")
    )
    for key, largest, shown in (
        ("rod", max(x, y), {"x": x, "y": y}),
        ("piston", piston, {"x": piston}),
    ):
        yield claim(key, largest, largest <= ABOUT * CLAIMS[key]["paper"], about=ABOUT - 1, **shown)
    for key in ("rod_velocity", "rod_acceleration"):
        (x, peak_x, _), (y, peak_y, _) = (sizes(f"{key}_{axis}") for axis in "xy")
        holds = None if abs(y / x - 1) < ALIKE else y > x
        yield claim(key, y / x, holds, x=x, y=y, peak_x=peak_x, peak_y=peak_y, alike=ALIKE)
    peaks = {
        "rod in X": "rod_acceleration_x",
        "rod in Y": "rod_acceleration_y",
        "piston": "slider_acceleration",
    }
    peaks = {words: sizes(column) for words, column in peaks.items()}
    latest = max(angle for _, _, angle in peaks.values())
    where = ", ".join(
        f"{words} at {angle:.1f} deg by {peak:.4g} m/s^2"
        for words, (_, peak, angle) in peaks.items()
    )
    yield claim("peaks", latest, latest <= ABOUT * CLAIMS["peaks"]["paper"], where=where)


def superposition_claim(first: pd.DataFrame, ideal: pd.DataFrame, loose: Sequence[str]) -> Row:
    """Share of the piston's deviation explained by the clearances of the `loose` joints along the
    slide."""
    signs = {
        number: -1 if number == 3 else 1
        for number in sorted(JOINT_NUMBERS[joint] for joint in loose)
    }
    defined = first[[f"gamma{number}" for number in signs]].notna().all(axis=1).to_numpy()
    deviation = (first["slider_position"] - ideal["slider_position"]).to_numpy()[defined]
    parts = [
        sign * (first[f"r{number}"] * np.cos(first[f"gamma{number}"])).to_numpy()[defined]
        for number, sign in signs.items()
    ]
    explained, *alone = (
        1.0 - np.var(deviation - part) / np.var(deviation) for part in (sum(parts), *parts)
    )
    terms = "".join(
        f" {'-' if sign < 0 else '+'} r{number} cos gamma{number}" for number, sign in signs.items()
    )
    shown = {"terms": terms.removeprefix(" + "), "explained": explained, "alone": max(alone)}
    return claim("superposed", explained, explained > 0.95, **shown)


def networks_claim(errors: pd.DataFrame, default: int) -> Row:
    """Held-out errors of the networks against the paper's training errors."""
    own = errors[(errors["model"] == "network") & (errors["seed"] == default)].set_index("output")
    ratios = (own["held_out_mse"] / own["paper_mse"]).dropna()
    worst, why = ratios.idxmax(), ""
    held_out, training = own.loc[worst, ["held_out_mse", "training_mse"]]
    if ratios.max() > 1:
        overfit = " Overfitting: contacts oscillate faster than the training points resolve."
        why = " The training stopped short." if held_out < 2.0 * training else overfit
    shown = {"reached": int((ratios <= 1).sum()), "number": len(ratios), "worst": worst, "why": why}
    return claim(
        "networks", ratios.max(), ratios.max() <= 1.0, held_out=held_out, training=training, **shown
    )


def evaluations_claim(found: pd.DataFrame) -> Row:
    """Evaluations until both optimisers are near the optimum."""
    genetic, local = (
        found.loc[method, "evaluations_within_1_percent"] for method in ("genetic", "local")
    )
    pairs = zip((genetic, local), OPTIMA[:2], strict=True)
    enough = all(not pd.isna(own) and own <= printed.evaluations for own, printed in pairs)
    return claim("evaluations", genetic, enough, genetic=_after(genetic), local=_after(local))


def genetic_claim(found: pd.DataFrame) -> Row:
    """Genetic against local optimiser."""
    (genetic, local), (calls, local_calls) = (
        found.loc[["genetic", "local"], column] for column in ("rms_reduction", "evaluations")
    )
    lead = 100 * (genetic - local)
    shown = {
        "genetic": genetic,
        "local": local,
        "calls": calls,
        "local_calls": local_calls,
        "tie": TIE,
    }
    return claim("genetic", lead, lead > TIE, **shown)


def minima_claim(ends: pd.DataFrame) -> Row:
    """Number of end points of the local searches, at the tightest and the loosest tolerance."""
    counts = {
        tolerance: distinct(part[["crank_length", "rod_length"]].to_numpy())
        for tolerance, part in ends.groupby("tolerance")
    }
    tightest, loosest = min(counts), max(counts)
    few, many = counts[tightest], counts[loosest]
    shown = {
        "apart": 1e6 * ONE_POINT,
        "few": few,
        "many": many,
        "tightest": tightest,
        "loosest": loosest,
    }
    return claim("minima", few, few > 1, **shown)


def distinct(points: np.ndarray) -> int:
    """Number of points, shape (n, 2) [m], that are farther than `ONE_POINT` from every earlier
    one."""
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
    stroke, angle = (
        1e3 * machine["stroke_change"],
        np.degrees(machine["smallest_transmission_angle_change"]),
    )
    for stretch in ("window", "settled"):
        row = rows.loc[stretch]
        holds = True if row["reduction_low"] > 0 else False if row["reduction_high"] < 0 else None
        before, after = np.degrees([row["original_error"], row["error"]])
        shown = {"before": before, "after": after, "stroke": stroke, "angle": angle}
        yield claim(f"gain_{stretch}", 100 * row["reduction"], holds, **row, **shown)


# -- scenarios that differ only in their loose joints


def looseness_variants(name: str, scenarios: Mapping[str, Scenario]) -> tuple[str, ...]:
    """Names of the `scenarios`, including `name`, that differ from it only in which joints are
    loose.

    The training of networks may differ. Scenarios without a loose joint have no optimum and are
    excluded.
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
    mechanism.pop("contacts")  # included in each joint
    return {"mechanism": mechanism, "simulate": scenario.simulate, "optimise": scenario.optimise}


def variant_optimum(name: str, scenario: Scenario, resimulated: pd.DataFrame) -> Row | None:
    """The re-simulated optimum of a scenario for its own simulated motion: columns of the table
    overview; None where no lengths satisfy the constraints.

    Optima found with networks would depend on their training, which may differ between scenarios.
    """
    point = f"simulation_{next(iter(scenario.optimise.boxes))}_genetic"
    rows = resimulated[
        (resimulated["point"] == point) & (resimulated["measure"] == "rms")
    ].set_index("stretch")
    if rows.empty:
        return None
    window, applied = rows.loc["window"], scenario.mechanism.applied()
    columns = {"reduction": "reduction", "low": "reduction_low", "high": "reduction_high"}
    columns |= {name: name for name in ("original_error", "error")}
    return {
        "scenario": name,
        "loose": ", ".join(
            f"{format_name(joint)} ({applied.joint(joint).journal})" for joint in applied.loose
        ),
        "loose_joints": len(applied.loose),
        "found_settled": float(rows.loc["settled", "reduction"]),
    } | {f"found_{name}": float(window[column]) for name, column in columns.items()}


def more_is_better(variants: pd.DataFrame) -> bool | None:
    """Whether the reduction grows with the number of loose joints, spreads included; None where
    undecided.

    `variants` are rows of `variant_optimum`.
    """
    pairs = variants.merge(variants, how="cross", suffixes=("_few", "_many"))
    pairs = pairs.query("loose_joints_few < loose_joints_many")
    if (pairs["found_high_many"] < pairs["found_low_few"]).any():
        return False
    return (
        True if len(pairs) and (pairs["found_low_many"] > pairs["found_high_few"]).all() else None
    )


def joints_claim(variants: pd.DataFrame) -> Row:
    """The claim that more loose joints gain more, from scenarios that differ only in their loose
    joints."""
    if variants.empty or variants["loose_joints"].nunique() < 2:
        return claim("joints", None, None, why=REMARKS["too_few"])
    means = variants.groupby("loose_joints")["found_reduction"].mean()
    numbers = "; ".join(
        f"{row.loose_joints} loose ({row.scenario}): {row.found_reduction:.2%} ({row.found_low:.2%}"
        f" to {row.found_high:.2%})"
        for row in variants.sort_values("loose_joints", kind="stable").itertuples()
    )
    why = REMARKS["measured"].format(numbers=numbers, conclusion=conclusion(variants))
    return claim(
        "joints", 100 * (means.iloc[-1] - means.iloc[0]), more_is_better(variants), why=why
    )


def conclusion(variants: pd.DataFrame) -> str:
    """Conclusion on the number of loose joints."""
    verdict = more_is_better(variants)
    if verdict is not False:
        return REMARKS["undecided" if verdict is None else "more"]
    ranked = variants.sort_values("found_reduction")
    (least, most), (in_least, in_most) = (
        ranked[name].iloc[[0, -1]] for name in ("scenario", "loose_joints")
    )
    return REMARKS["other"].format(most=most, least=least, in_most=in_most, in_least=in_least)


# -- page


def comparison_page(comparison: pd.DataFrame, scenario: Scenario) -> Page:
    """The page of the table `comparison`."""
    counts = (
        f"{kind.capitalize()}s:"
        f" {', '.join(f'{verdict} {n}' for verdict, n in rows['verdict'].value_counts().items())}."
        for kind, rows in comparison.groupby("kind", sort=False)
    )
    if differences := departures(scenario.mechanism, scenario.simulate):
        basis = (
            f"This mechanism is not the paper's ({'; '.join(differences)}), so only claims without"
            " a size are compared. Results of this mechanism: `summary.html`."
        )
    else:
        basis = (
            f"A number agrees within {AGREES:.0%} of the paper's, an optimum length within"
            f" {LENGTH_AGREES:.1%}. No parameter is tuned to match: contact parameters, bounds and"
            " window are those of the configuration."
        )
    texts = (scenario.description, f"{' '.join(counts)} {basis}")
    blocks: list[Block] = [Paragraph(text) for text in texts if text]
    for kind, title, why in (
        ("number", "Printed numbers", "remark"),
        ("claim", "Claims", "evidence"),
    ):
        rows = comparison[comparison["kind"] == kind]
        if len(rows):
            heads = (kind, "unit", "paper", "simulation", "simulation / paper", "verdict", why)
            blocks += [
                Heading(title),
                TableBlock(heads, tuple(map(_cells, rows.itertuples())), "llrrrll"),
            ]
    return Page("Comparison with the paper", tuple(blocks))


def _cells(row) -> tuple[str | Cell, ...]:
    numbers = (
        "–" if pd.isna(value) else f"{value:.6g}" for value in (row.paper, row.ours, row.ratio)
    )
    return (
        row.item,
        row.unit,
        *numbers,
        Cell(row.verdict, _TONES.get(row.verdict, "open")),
        row.sentence,
    )
