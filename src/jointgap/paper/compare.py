"""The paper's numbers and claims compared with the simulation: table `comparison` and its page.

Numbers, claims, limits and texts are in printed.yaml; here stands where our values come from."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from jointgap.core.joints import JOINT_NUMBERS
from jointgap.core.page import Block, Cell, Heading, Page, Paragraph, TableBlock
from jointgap.core.words import format_name
from jointgap.paper.printed import (
    CLAIMS,
    CONCLUSIONS,
    NUMBERS,
    OPTIMA,
    OTHER_END,
    TRAINING_ITERATIONS,
    TRAINING_MSE,
    PrintedOptimum,
    departures,
)

if TYPE_CHECKING:
    from jointgap.config import Scenario

NEEDED = ("trajectory", "kinematics", "fit_errors") + tuple(
    f"optimise_{name}" for name in ("optima", "tolerance", "resimulated", "worth")
)
"""Tables required for the comparison."""

SAME_POINT = 1e-6  # [m] distance below which two end points are equal
TONES = {"agrees": "good", "reached": "good", "holds": "good"}
TONES |= {"differs": "bad", "missed": "bad", "does not hold": "bad"}

Row = dict[str, Any]


def number(key: str, paper: float, ours: float, **evidence: Any) -> Row:
    """A row of the table for a printed number (`key` in printed.yaml)."""
    tolerance = NUMBERS[key].get("within")
    if tolerance is None:
        verdict = "reached" if ours <= paper else "missed"
    else:
        verdict = "agrees" if abs(ours / paper - 1.0) <= tolerance else "differs"
    return _row("number", NUMBERS[key], paper, ours, verdict, evidence)


def claim(key: str, ours: float | None, interval: Sequence[float] = (), **evidence: Any) -> Row:
    """A row of the table for a claim (`key` in printed.yaml).

    The `interval`, by default of the value itself, decides: a claim is undecided where the limit
    is inside, or without a value.
    """
    expected = CLAIMS[key]
    low, high = interval or (ours, ours)
    verdict = "undecided"
    if ours is not None and "at_most" in expected:
        verdict = _decided(high <= expected["at_most"], low > expected["at_most"])
    elif ours is not None:
        verdict = _decided(low > expected["above"], high <= expected["above"])
    return _row("claim", expected, expected.get("paper"), ours, verdict, evidence)


def _decided(holds: bool, fails: bool) -> str:
    return "holds" if holds else "does not hold" if fails else "undecided"


def _row(
    kind: str, expected: Row, paper: float | None, ours: float | None, verdict: str, evidence: Row
) -> Row:
    texts = expected | evidence
    return {
        "kind": kind,
        "item": expected["item"].format(**texts),
        "unit": "" if paper is None and ours is None else expected["unit"],
        "paper": None if paper is None else float(paper),
        "ours": ours,
        "ratio": ours / paper if paper and ours is not None else None,
        "verdict": verdict,
        "sentence": texts["evidence"].format(**texts),
    }


def compare(
    frames: Mapping[str, pd.DataFrame], scenario: "Scenario", variants: Sequence[Row | None]
) -> pd.DataFrame:
    """The table comparison: every number and claim of the paper.

    `variants` are rows of `variant_optimum`. Another mechanism is compared only with claims without
    a size.
    """
    samples = scenario.simulate.samples_per_revolution
    motion = frames["trajectory"].iloc[: samples + 1].reset_index(drop=True)
    motion["turned"] = np.degrees(motion["crank_angle"] - motion["crank_angle"].iloc[0])
    ideal = frames["kinematics"].query("source == 'ideal'").reset_index(drop=True)
    box = next(iter(scenario.optimise.boxes))
    search = f"source == 'networks' and box == {box!r}"
    end_points = frames["optimise_tolerance"].query(search)
    optima = frames["optimise_optima"].query(search).set_index("method")
    has_optimum = "genetic" in optima.index  # not where no lengths satisfy the constraints
    is_paper = not departures(scenario.mechanism, scenario.simulate)

    rows = []
    if is_paper:
        errors = frames["fit_errors"].query("region == 'all' and model == 'network'")
        default = errors[errors["seed"] == scenario.surrogate.seeds[0]].set_index("output")
        rows += training_errors(errors, default)
        if has_optimum:
            rows += optimum(OPTIMA[0], optima.loc["genetic"])
            rows += optimum(OPTIMA[1], optima.loc["local"])
            rows += other_end(OPTIMA[2], end_points)
        rows += printed_points(frames["optimise_optima"])
        rows += contact_claims(motion, scenario)
        rows += deviation_claims(motion, ideal)
        rows.append(networks_claim(default))
        if has_optimum:
            rows.append(evaluations_claim(optima))
    loose = scenario.mechanism.applied().loose
    if len(loose) > 1:
        rows.append(superposition_claim(motion, ideal, loose))
    if has_optimum:
        rows += optimiser_claims(optima, end_points)
    rows.append(joints_claim(pd.DataFrame(filter(None, variants))))
    if has_optimum:
        rows += gain_claims(frames["optimise_resimulated"], frames["optimise_worth"], box)
    table = pd.DataFrame(rows)
    return table if is_paper else table.assign(paper=None, ratio=None)


# -- numbers


def training_errors(errors: pd.DataFrame, default: pd.DataFrame) -> Iterator[Row]:
    """Training errors of the networks, default start; the range of all starts as evidence."""
    starts = errors.groupby("output")["training_mse"].agg(
        starts="count", lowest="min", highest="max"
    )
    for output, printed in TRAINING_MSE.items():
        evidence = {**default.loc[output], **starts.loc[output], "output": output}
        evidence["allowed"] = TRAINING_ITERATIONS
        yield number("training", printed, evidence["training_mse"], **evidence)


def optimum(printed: PrintedOptimum, ours: pd.Series, **evidence: Any) -> Iterator[Row]:
    """The paper's optimum, compared with a row of the table optimise_optima."""
    error = np.degrees(ours["rms"])
    evidence = {
        **ours,
        "name": printed.name,
        "printed_ratio": printed.crank_length / printed.rod_length,
        "before": error / (1 - ours["rms_reduction"]),
        "after": error,
        "near": _after(ours["evaluations_within_1_percent"]),
        **evidence,
    }
    for key in ("crank_length", "rod_length"):
        yield number(key, 1e3 * getattr(printed, key), 1e3 * ours[key], **evidence)
    yield number("reduction", 100 * printed.reduction, 100 * ours["rms_reduction"], **evidence)
    if printed.evaluations is not None:
        yield number("evaluations", printed.evaluations, float(ours["evaluations"]), **evidence)


def _after(evaluations: float) -> str:
    return "never" if pd.isna(evaluations) else f"after {evaluations:.0f} evaluations"


def other_end(printed: PrintedOptimum, end_points: pd.DataFrame) -> Iterator[Row]:
    """The paper's poorer end point, compared with the poorest one at the loosest stopping
    tolerance."""
    end_points = end_points[end_points["tolerance"] == end_points["tolerance"].max()]
    poorest = end_points.loc[end_points["rms_reduction"].idxmin()]
    text = OTHER_END.format(number=len(end_points), loosest=poorest["tolerance"])
    evidence = {"name": printed.name, "evidence": text}
    for key in ("crank_length", "rod_length"):
        yield number(key, 1e3 * getattr(printed, key), 1e3 * poorest[key], **evidence)
    yield number("reduction", 100 * printed.reduction, 100 * poorest["rms_reduction"], **evidence)


def printed_points(optima: pd.DataFrame) -> Iterator[Row]:
    """The error at the paper's lengths with the simulated motion."""
    points = optima.query("source == 'networks' and method == 'printed'").set_index("point")
    for printed in OPTIMA:
        ours = points.loc[printed.key]
        yield number(
            "printed_point",
            100 * printed.reduction,
            100 * ours["rms_reduction"],
            name=printed.name,
            invariant=1e3 * ours["invariant"],
            printed_invariant=1e3 * (1 - printed.reduction) * printed.rod_length,
        )


# -- claims


def contact_claims(motion: pd.DataFrame, scenario: "Scenario") -> Iterator[Row]:
    """Where contact is last lost in the first revolution, and whether gamma2 follows the crank."""
    mechanism, turned = scenario.mechanism.applied(), motion["turned"].to_numpy()
    lost_at = {}
    for joint in mechanism.loose:
        distance = motion[f"r{JOINT_NUMBERS[joint]}"] / mechanism.clearance(joint)
        is_lost = distance.to_numpy() < CLAIMS["unstable"]["in_contact"]
        lost_at[format_name(joint)] = float(turned[is_lost].max(initial=0.0))
    texts = (f"{joint} at {angle:.1f} deg" for joint, angle in lost_at.items())
    yield claim("unstable", max(lost_at.values()), lost="; ".join(texts))

    past = turned >= 60.0
    angle, gamma = turned[past], np.degrees(motion["gamma2"].to_numpy())[past]
    deviation = gamma - angle - np.mean(gamma - angle)
    rms, turns = np.sqrt(np.mean(deviation**2)), (gamma[-1] - gamma[0]) / (angle[-1] - angle[0])
    yield claim("gamma2", turns, (rms, rms), rms=rms, peak=np.abs(deviation).max())


def deviation_claims(motion: pd.DataFrame, ideal: pd.DataFrame) -> Iterator[Row]:
    """Deviations from the `ideal` motion over the revolution `motion`."""
    columns = [name for name in ideal if name.startswith(("rod_", "slider_"))]
    deviation = (motion[columns] - ideal[columns]).abs()
    rms, peak = np.sqrt((deviation**2).mean()), deviation.max()

    x, y, piston = 1e3 * peak[["rod_position_x", "rod_position_y", "slider_position"]]
    yield claim("rod", max(x, y), x=x, y=y)
    yield claim("piston", piston)
    for key in ("rod_velocity", "rod_acceleration"):
        x, y = rms[[f"{key}_x", f"{key}_y"]]
        alike = CLAIMS[key]["alike"]
        interval = y / x - alike, y / x + alike
        yield claim(key, y / x, interval, x=x, y=y)

    bodies = {"rod in X": "rod_acceleration_x", "rod in Y": "rod_acceleration_y"}
    bodies["piston"] = "slider_acceleration"
    places = {body: motion["turned"][deviation[column].idxmax()] for body, column in bodies.items()}
    texts = (
        f"{body} at {places[body]:.1f} deg by {peak[column]:.4g} m/s^2"
        for body, column in bodies.items()
    )
    yield claim("peaks", max(places.values()), peaks=", ".join(texts))


def superposition_claim(motion: pd.DataFrame, ideal: pd.DataFrame, loose: Sequence[str]) -> Row:
    """Share of the piston's deviation explained by the clearances of the `loose` joints along the
    slide."""
    numbers = sorted(JOINT_NUMBERS[joint] for joint in loose)
    sides = {
        f"{'-' if number == 3 else '+'} r{number} cos gamma{number}": (
            (-1 if number == 3 else 1) * motion[f"r{number}"] * np.cos(motion[f"gamma{number}"])
        )
        for number in numbers
    }
    terms = pd.DataFrame(sides).dropna()
    deviation = (motion["slider_position"] - ideal["slider_position"])[terms.index]

    def explained(part: pd.Series) -> float:
        return 1.0 - np.var(deviation - part) / np.var(deviation)

    share, best_joint = explained(terms.sum(axis=1)), terms.apply(explained).max()
    text = " ".join(terms).removeprefix("+ ")
    return claim("superposed", share, terms=text, explained=share, best_joint=best_joint)


def networks_claim(default: pd.DataFrame) -> Row:
    """Held-out errors of the networks against the paper's training errors."""
    ratios = (default["held_out_mse"] / default["paper_mse"]).dropna()
    output, reached = ratios.idxmax(), int((ratios <= 1).sum())
    errors = default.loc[output, ["held_out_mse", "training_mse"]]
    return claim(
        "networks", ratios.max(), reached=reached, number=len(ratios), output=output, **errors
    )


def evaluations_claim(optima: pd.DataFrame) -> Row:
    """Evaluations until both optimisers are near the optimum."""
    genetic, local = optima.loc[["genetic", "local"], "evaluations_within_1_percent"].astype(float)
    share = np.max([genetic / OPTIMA[0].evaluations, local / OPTIMA[1].evaluations])
    share = np.inf if np.isnan(share) else share
    texts = {"genetic": _after(genetic), "local": _after(local)}
    return claim("evaluations", None if np.isnan(genetic) else genetic, (share, share), **texts)


def optimiser_claims(optima: pd.DataFrame, end_points: pd.DataFrame) -> Iterator[Row]:
    """Genetic against local optimiser, and the number of end points of the local one."""
    genetic, local = optima.loc[["genetic", "local"], "rms_reduction"]
    evaluations, local_evaluations = optima.loc[["genetic", "local"], "evaluations"]
    counts = {"evaluations": evaluations, "local_evaluations": local_evaluations}
    yield claim("genetic", 100 * (genetic - local), genetic=genetic, local=local, **counts)

    lengths = end_points.groupby("tolerance")[["crank_length", "rod_length"]]
    counts = {tolerance: distinct(points.to_numpy()) for tolerance, points in lengths}
    if len(counts) > 1:  # the variants search with several tolerances
        tightest, loosest = min(counts), max(counts)
        few, many = counts[tightest], counts[loosest]
        yield claim("minima", few, few=few, many=many, tightest=tightest, loosest=loosest)


def distinct(points: np.ndarray) -> int:
    """Number of points, shape (n, 2) [m], that are farther than `SAME_POINT` from every earlier
    one."""
    count = 0
    while len(points):
        points = points[np.hypot(*(points - points[0]).T) > SAME_POINT]
        count += 1
    return count


def gain_claims(resimulated: pd.DataFrame, worth: pd.DataFrame, box: str) -> Iterator[Row]:
    """Whether the gain of the genetic algorithm's lengths remains when simulated again."""
    point = f"networks_{box}_genetic"
    gains = resimulated.query(f"point == {point!r} and measure == 'rms'").set_index("stretch")
    change = worth.query(f"point == {point!r} and cycle == 'simulated'").iloc[0]
    side_effects = {
        "stroke": 1e3 * change["stroke_change"],
        "angle": np.degrees(change["smallest_transmission_angle_change"]),
    }
    for stretch in ("window", "settled"):
        gain = gains.loc[stretch]
        original, optimised = np.degrees([gain["original_error"], gain["error"]])
        interval = gain["reduction_low"], gain["reduction_high"]
        texts = {**gain, **side_effects, "before": original, "after": optimised}
        yield claim(f"gain_{stretch}", 100 * gain["reduction"], interval, **texts)


# -- scenarios that differ only in their loose joints


def looseness_variants(name: str, scenarios: Mapping[str, "Scenario"]) -> tuple[str, ...]:
    """Names of the `scenarios`, including `name`, that differ from it only in which joints are
    loose.

    The training of networks may differ. Scenarios without a loose joint have no optimum and are
    excluded.
    """
    scope = _apart_from_looseness(scenarios[name])
    return tuple(
        variant
        for variant, scenario in scenarios.items()
        if scenario.mechanism.applied().loose and _apart_from_looseness(scenario) == scope
    )


def _apart_from_looseness(scenario: "Scenario") -> dict:
    mechanism = scenario.mechanism.applied().model_dump()
    for joint in mechanism["joints"].values():
        if isinstance(joint, dict):
            joint.pop("loose", None)  # a slide has a clearance instead
    mechanism.pop("contacts")  # included in each joint
    return {"mechanism": mechanism, "simulate": scenario.simulate, "optimise": scenario.optimise}


def variant_optimum(name: str, scenario: "Scenario", resimulated: pd.DataFrame) -> Row | None:
    """The re-simulated optimum of a scenario for its own simulated motion: columns of the table
    overview; None where no lengths satisfy the constraints.

    Optima found with networks would depend on their training, which may differ between scenarios.
    """
    point = f"simulation_{next(iter(scenario.optimise.boxes))}_genetic"
    gains = resimulated.query(f"point == {point!r} and measure == 'rms'").set_index("stretch")
    if gains.empty:
        return None
    applied, window = scenario.mechanism.applied(), gains.loc["window"]
    journals = (f"{format_name(joint)} ({applied.joint(joint).journal})" for joint in applied.loose)
    return {
        "scenario": name,
        "loose": ", ".join(journals),
        "loose_joints": len(applied.loose),
        "found_reduction": float(window["reduction"]),
        "found_low": float(window["reduction_low"]),
        "found_high": float(window["reduction_high"]),
    }


def joints_claim(variants: pd.DataFrame) -> Row:
    """The claim that more loose joints gain more, from rows of `variant_optimum`."""
    if variants.empty or variants["loose_joints"].nunique() < 2:
        return claim("joints", None, variants=CONCLUSIONS["too few"])
    means = variants.groupby("loose_joints")["found_reduction"].mean()
    pairs = variants.merge(variants, how="cross", suffixes=("_few", "_many"))
    pairs = pairs.query("loose_joints_few < loose_joints_many")
    leads = (
        (pairs["found_low_many"] - pairs["found_high_few"]).min(),
        (pairs["found_high_many"] - pairs["found_low_few"]).min(),
    )
    row = claim("joints", 100 * (means.iloc[-1] - means.iloc[0]), leads, variants="")
    gains = (
        f"{row.loose_joints} loose ({row.scenario}) {row.found_reduction:.2%} ({row.found_low:.2%}"
        f" to {row.found_high:.2%})"
        for row in variants.sort_values("loose_joints", kind="stable").itertuples()
    )
    row["sentence"] = f"{CONCLUSIONS['gains']} {'; '.join(gains)}. {CONCLUSIONS[row['verdict']]}"
    return row


# -- page


def comparison_page(comparison: pd.DataFrame, scenario: "Scenario") -> Page:
    """The page of the table `comparison`."""
    if differences := departures(scenario.mechanism, scenario.simulate):
        basis = (
            f"This mechanism is not the paper's ({'; '.join(differences)}), so only claims without"
            " a size are compared. Results of this mechanism: `summary.html`."
        )
    else:
        basis = (
            f"A number agrees within {NUMBERS['reduction']['within']:.0%} of the paper's, an"
            f" optimum length within {NUMBERS['crank_length']['within']:.1%}. No parameter is tuned"
            " to match: contact parameters, bounds and window are those of the configuration."
        )
    blocks: list[Block] = [Paragraph(scenario.description)] if scenario.description else []
    counts, tables = [], []
    for title, rows in comparison.groupby(
        comparison["kind"].map({"number": "Printed numbers", "claim": "Claims"}), sort=False
    ):
        verdicts = (f"{name} {count}" for name, count in rows["verdict"].value_counts().items())
        counts.append(f"{title}: {', '.join(verdicts)}.")
        tables += [Heading(title), TableBlock.of(map(_cells, rows.itertuples()), "llrrrll")]
    return Page(
        "Comparison with the paper",
        (*blocks, Paragraph(" ".join([*counts, basis])), *tables),
    )


def _cells(row) -> dict[str, str | Cell]:
    paper, ours, ratio = (
        "–" if pd.isna(value) else f"{value:.6g}" for value in (row.paper, row.ours, row.ratio)
    )
    return {
        row.kind: row.item,
        "unit": row.unit,
        "paper": paper,
        "simulation": ours,
        "simulation / paper": ratio,
        "verdict": Cell(row.verdict, TONES.get(row.verdict, "open")),
        "remark" if row.kind == "number" else "evidence": row.sentence,
    }
