"""The paper's numbers and claims beside ours."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.core.words import in_words
from jointgap.paper.printed import (
    AGREES,
    LENGTH_AGREES,
    MISSED,
    OPTIMA,
    PISTON_DEVIATION_M,
    REACHED,
    ROD_DEVIATION_M,
    TRAINING_ITERATIONS,
    TRAINING_MSE,
    UNSTABLE_UNTIL_DEG,
    PrintedOptimum,
    Row,
    claim,
    departures,
)

MM = 1e3  # [1/m] numbers in mm
PERCENT = 100  # [1] shares in percent


def numbers(frames: Mapping[str, pd.DataFrame], scenario: Scenario) -> Iterator[Row]:
    """A row for each printed number, none for another mechanism than the paper's.

    Arguments as in `jointgap.paper.compare.compare`.
    """
    if departures(scenario.mechanism, scenario.simulate):
        return
    yield from _training_errors(frames["fit_errors"], scenario)
    yield from _second_surrogate(frames["fit_errors"])
    optima = frames["optimise_optima"]
    main = next(iter(scenario.optimise.boxes))
    of_networks = optima[(optima["source"] == "networks") & (optima["box"] == main)].set_index("method")
    ends = frames["optimise_tolerance"]
    ends = ends[(ends["source"] == "networks") & (ends["box"] == main)]
    for printed, method in zip(OPTIMA[:2], ("genetic", "local"), strict=True):
        yield from _optimum(printed, of_networks.loc[method])
    yield from _another_end(OPTIMA[2], ends)
    yield from _printed_points(optima)


def _training_errors(errors: pd.DataFrame, scenario: Scenario) -> Iterator[Row]:
    networks = errors[(errors["model"] == "network") & (errors["region"] == "all")]
    default = networks[networks["seed"] == scenario.surrogate.seeds[0]].set_index("output")
    for output, printed in TRAINING_MSE.items():
        ours = default.loc[output]
        done = int(ours["iterations"])
        budget = (
            ""
            if done >= TRAINING_ITERATIONS
            else f" of the paper's {TRAINING_ITERATIONS} ({ours['stop'].split(';')[0]})"
        )
        reached = (
            ""
            if pd.isna(ours["iterations_to_paper"])
            else f" It came to the paper's error after {ours['iterations_to_paper']:.0f} iterations, with "
            f"{ours['held_out_mse_at_paper']:.2g} between the points then."
        )
        yield Row(
            "number",
            f"training MSE of {output}",
            "1",
            printed,
            float(ours["training_mse"]),
            f"Default seed after {done} iterations{budget}, another simulation's data. Between its training points "
            f"the same network has {ours['held_out_mse']:.2g}, a spline through them "
            f"{ours['spline_held_out_mse']:.2g}: the training error alone says little.{reached} "
            f"{_over_seeds(networks[networks['output'] == output])}",
            REACHED if ours["training_mse"] <= printed else MISSED,
        )


def _over_seeds(rows: pd.DataFrame) -> str:
    """The spread over the seeds, in a sentence; empty for one seed."""
    if len(rows) < 2:
        return ""
    training, held_out = rows["training_mse"], rows["held_out_mse"]
    fewest, most = rows["iterations"].min(), rows["iterations"].max()
    return (
        f"Over {len(rows)} seeds ({fewest} to {most} iterations): training median {training.median():.2g} "
        f"({training.min():.2g} to {training.max():.2g}), between the points median {held_out.median():.2g} "
        f"({held_out.min():.2g} to {held_out.max():.2g})."
    )


def _second_surrogate(errors: pd.DataFrame) -> Iterator[Row]:
    """The consistent set, held out, beside the errors that the paper has in training."""
    ours = errors[(errors["model"] == "clearance") & (errors["region"] == "all")].set_index("output")
    for output, printed in TRAINING_MSE.items():
        row = ours.loc[output]
        better = row["held_out_mse"] <= row["spline_held_out_mse"]
        yield Row(
            "number",
            f"held-out MSE of {output}, second surrogate",
            "1",
            printed,
            float(row["held_out_mse"]),
            f"The paper's is a training error. {row['training_points']:.0f} points of its own, none held out, "
            f"{row['weights']:.0f} weights for the joint; a spline through the same points has "
            f"{row['spline_held_out_mse']:.2g}: {'the network' if better else 'the spline'} wins.",
            REACHED if row["held_out_mse"] <= printed else MISSED,
        )


def _optimum(printed: PrintedOptimum, ours: pd.Series) -> Iterator[Row]:
    where = (
        "here no bound is active: the search stopped before it came to one"
        if ours["active_bounds"] == "none"
        else f"ours lies at: {ours['active_bounds']}"
    )
    yield Row(
        "number",
        f"{printed.name}: crank length L2",
        "mm",
        printed.crank_length * MM,
        ours["crank_length"] * MM,
        f"Follows from the rod's length along the valley: L2/L3 = {ours['ratio']:.5f}, the paper's "
        f"{printed.crank_length / printed.rod_length:.5f}.",
        agrees=LENGTH_AGREES,
    )
    yield Row(
        "number",
        f"{printed.name}: rod length L3",
        "mm",
        printed.rod_length * MM,
        ours["rod_length"] * MM,
        "Along the valley the error falls with L3 all the way, so that bounds decide, which the paper does not print; "
        f"{where}.",
        agrees=LENGTH_AGREES,
    )
    yield Row(
        "number",
        f"{printed.name}: error decreases by",
        "%",
        printed.reduction * PERCENT,
        ours["rms_reduction"] * PERCENT,
        f"RMS, {np.degrees(ours['rms']) / (1 - ours['rms_reduction']):.4f} deg before and "
        f"{np.degrees(ours['rms']):.4f} deg after; by mean absolute {ours['mean_absolute_reduction']:.2%}, peak "
        f"{ours['peak_reduction']:.2%}, sum of squares {ours['sum_of_squares_reduction']:.2%}. Measure, window, "
        "friction and carrier of the journals decide, none of which the paper prints.",
    )
    if printed.evaluations is not None:
        within = ours["evaluations_within_1_percent"]
        reached = (
            "never within 1 % of the lowest value"
            if pd.isna(within)
            else f"within 1 % of the lowest value after {within:.0f}"
        )
        yield Row(
            "number",
            f"{printed.name}: function evaluations",
            "1",
            printed.evaluations,
            float(ours["evaluations"]),
            f"{str(ours['status']).capitalize()}; {reached}. "
            + (
                "Population and generations are settings, which the paper does not print."
                if ours.name == "genetic"
                else "Of the best start; gradients are exact and not counted, by differences each would take two calls "
                "more."
            ),
        )


def _another_end(printed: PrintedOptimum, ends: pd.DataFrame) -> Iterator[Row]:
    """The paper's poorer end point beside the poorest of our six, at the loosest stopping tolerance tried."""
    loosest = ends[ends["tolerance"] == ends["tolerance"].max()]
    ours = loosest.loc[loosest["rms_reduction"].idxmin()]
    tightest = ends[ends["tolerance"] == ends["tolerance"].min()]
    spread = tightest["rms_reduction"].max() - tightest["rms_reduction"].min()
    sentence = (
        f"The poorest of our six end points at the loosest tolerance tried ({ours['tolerance']:.0e}); at the tightest "
        f"({tightest['tolerance'].iloc[0]:.0e}) the six differ by {spread * PERCENT:.2g} percentage points: such end "
        "points are where a search stopped in a flat valley."
    )
    for name, theirs, value, unit in (
        ("crank length L2", printed.crank_length * MM, ours["crank_length"] * MM, "mm"),
        ("rod length L3", printed.rod_length * MM, ours["rod_length"] * MM, "mm"),
        ("error decreases by", printed.reduction * PERCENT, ours["rms_reduction"] * PERCENT, "%"),
    ):
        agrees = LENGTH_AGREES if unit == "mm" else AGREES
        yield Row("number", f"{printed.name}: {name}", unit, theirs, float(value), sentence, agrees=agrees)


def _printed_points(optima: pd.DataFrame) -> Iterator[Row]:
    """What the paper's own lengths give on our motion."""
    points = optima[(optima["source"] == "networks") & (optima["method"] == "printed")]
    for printed in OPTIMA:
        ours = points[points["point"] == printed.key].iloc[0]
        yield Row(
            "number",
            f"at the printed lengths of: {printed.name}, error decreases by",
            "%",
            printed.reduction * PERCENT,
            float(ours["rms_reduction"]) * PERCENT,
            f"RMS on our motion; (1 - R) L3 = {ours['invariant'] * MM:.2f} mm, the paper's "
            f"{(1 - printed.reduction) * printed.rod_length * MM:.2f} mm: constant along the valley for any measure "
            "linear in the angle, so the three printed points are one valley.",
        )


_CLAIM = "better results with an increasing number of joints with clearance"


@dataclass(frozen=True)
class VariantOptimum:
    """The optimum of one scenario, simulated again, by RMS."""

    scenario: str  # Its name
    loose: tuple[str, ...]  # Names of its loose joints
    reduction: float  # Median, 5 % and 95 % quantile of the reduction over the window
    low: float  # Median, 5 % and 95 % quantile of the reduction over the window
    high: float  # Median, 5 % and 95 % quantile of the reduction over the window
    settled: float  # Median of the reduction over a whole settled revolution
    original_error: float  # RMS error over the window at the original lengths and at the optimum, medians [rad]
    error: float  # RMS error over the window at the original lengths and at the optimum, medians [rad]


def _apart_from_looseness(scenario: Scenario) -> dict:
    mechanism = scenario.mechanism.applied().model_dump()
    for joint in mechanism["joints"].values():
        if isinstance(joint, dict):
            joint.pop("loose")
    mechanism.pop("contacts")  # each joint carries its own
    return {"mechanism": mechanism, "simulate": scenario.simulate, "optimise": scenario.optimise}


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


def variant_optimum(name: str, scenario: Scenario, resimulated: pd.DataFrame) -> VariantOptimum:
    """What the lengths found on the simulation's own motion gain in the `scenario` called `name`, by its table
    `resimulated`.

    Lengths found on networks would hang on how long these were trained, which may differ between scenarios.
    """
    point = f"simulation_{next(iter(scenario.optimise.boxes))}_genetic"
    rows = resimulated[(resimulated["point"] == point) & (resimulated["measure"] == "rms")].set_index("stretch")
    window = rows.loc["window"]
    return VariantOptimum(
        scenario=name,
        loose=scenario.mechanism.applied().loose,
        reduction=float(window["reduction"]),
        low=float(window["reduction_low"]),
        high=float(window["reduction_high"]),
        settled=float(rows.loc["settled", "reduction"]),
        original_error=float(window["original_error"]),
        error=float(window["error"]),
    )


def _by_count(variants: Iterable[VariantOptimum]) -> dict[int, list[VariantOptimum]]:
    """Variants by how many joints are loose, counts rising."""
    groups: dict[int, list[VariantOptimum]] = {}
    for variant in sorted(variants, key=lambda variant: len(variant.loose)):
        groups.setdefault(len(variant.loose), []).append(variant)
    return groups


def more_is_better(variants: Iterable[VariantOptimum]) -> bool | None:
    """Whether the reduction grows with the count of loose joints.

    True where all scenarios with one joint more lie above all with one fewer, spreads included; False where, spreads
    included, some scenario with more joints lies below one with fewer; None where spreads overlap or there is one count
    alone.
    """
    counts = list(_by_count(variants).values())
    if len(counts) < 2:
        return None
    pairs = [
        (few, many) for i, fewer in enumerate(counts) for more in counts[i + 1 :] for few in fewer for many in more
    ]
    if any(many.high < few.low for few, many in pairs):
        return False
    return True if all(many.low > few.high for few, many in pairs) else None


def joints_claim(variants: Sequence[VariantOptimum]) -> Row:
    """The paper's last claim, judged by the reductions of scenarios that differ in their loose joints alone."""
    counts = _by_count(variants)
    if len(counts) < 2:
        needs = "Needs scenarios in the same run that differ from this one in nothing but which joints are loose."
        return claim(_CLAIM, None, None, "", None, needs)
    fewest, most = (
        float(np.mean([variant.reduction for variant in counts[count]])) for count in (min(counts), max(counts))
    )
    difference = 100 * (most - fewest)
    return claim(_CLAIM, None, difference, "percentage points", more_is_better(variants), _sentence(variants))


def _sentence(variants: Sequence[VariantOptimum]) -> str:
    """The reductions by count of loose joints, and what they say."""
    parts = []
    for count, group in _by_count(variants).items():
        numbers = ", ".join(
            f"{v.reduction:.2%} ({in_words(' + '.join(v.loose))}; 5-95 %: {v.low:.2%} to {v.high:.2%}; "
            f"error {np.degrees(v.original_error):.4f} to {np.degrees(v.error):.4f} deg)"
            for v in group
        )
        parts.append(f"with {count} loose {'joint' if count == 1 else 'joints'} {numbers}")
    return (
        "RMS reduction over the window at the lengths found on each simulation's own motion, simulated again: "
        f"{'; '.join(parts)}. {conclusion(variants)}"
    )


def conclusion(variants: Sequence[VariantOptimum]) -> str:
    """The verdict in plain words."""
    verdict = more_is_better(variants)
    if verdict:
        return "Every scenario with more loose joints gains more than every one with fewer, spreads included."
    if verdict is None:
        return "The spreads overlap, so this cannot be decided."
    ranked = sorted(variants, key=lambda variant: variant.reduction)
    return (
        f"{_with_count(ranked[-1])} gains most and {_with_count(ranked[0])} least, so the number of loose joints is "
        "not what matters. What matters is how much of the error is proportional to the sine of the crank angle, the "
        "only part that another length ratio can remove."
    )


def _with_count(variant: VariantOptimum) -> str:
    count = len(variant.loose)
    return f"{variant.scenario} with {count} loose {'joint' if count == 1 else 'joints'}"


ABOUT = 1.2  # how far a number that the paper calls "about", or shows in a figure, may go beyond it
ALIKE = 0.05  # two sizes that differ by less are alike
TIE = 0.001  # percentage points by which an optimiser has to lead
IN_CONTACT = 0.999  # share of the clearance from which on the journal counts as on its bearing
ONE_POINT = 1e-6  # [m] within which two end points are one
_MM, UM = 1e3, 1e6  # [1/m] numbers in mm and um


def claims(frames: Mapping[str, pd.DataFrame], scenario: Scenario, variants: Sequence[VariantOptimum]) -> Iterator[Row]:
    """A row for each claim that has a subject in this mechanism. Arguments as in `comparison.compare`.

    Of a mechanism that is not the paper's, those alone that hold or do not hold whatever its size and speed, and beside
    none of the paper's numbers.
    """
    if departures(scenario.mechanism, scenario.simulate):
        yield from (replace(row, paper=None) for row in _general(frames, scenario, variants))
        return
    first, turned, ideal = _first_revolution(frames, scenario)
    yield from _contact(first, turned, scenario)
    yield from _deviations(first, turned, ideal)
    if frames["fit_errors"]["paper_mse"].notna().any():
        yield _networks(frames["fit_errors"], scenario)
    yield _evaluations(_main_optima(frames, scenario))
    yield from _general(frames, scenario, variants)


def _first_revolution(
    frames: Mapping[str, pd.DataFrame], scenario: Scenario
) -> tuple[pd.DataFrame, np.ndarray, pd.DataFrame]:
    """Samples of the first revolution, the angle turned since the start [deg], and the motion without clearance."""
    first = frames["trajectory"].iloc[: scenario.simulate.samples_per_revolution + 1].reset_index(drop=True)
    turned = np.degrees(first["crank_angle"] - first["crank_angle"].iloc[0]).to_numpy()
    motion = frames["kinematics"]
    return first, turned, motion[motion["source"] == "ideal"].reset_index(drop=True)


def _general(
    frames: Mapping[str, pd.DataFrame], scenario: Scenario, variants: Sequence[VariantOptimum]
) -> Iterator[Row]:
    """Claims without a size in them."""
    first, _, ideal = _first_revolution(frames, scenario)
    loose = scenario.mechanism.applied().loose
    if len(loose) > 1:
        yield _superposed(first, ideal, loose)
    yield from _optimisers(frames, scenario)
    yield joints_claim(variants)
    yield from _real_gain(frames["optimise_resimulated"], frames["optimise_worth"], scenario)


def _contact(first: pd.DataFrame, turned: np.ndarray, scenario: Scenario) -> Iterator[Row]:
    mechanism, last, share = scenario.mechanism.applied(), {}, {}
    for joint in mechanism.loose:
        lost = first[f"r{JOINT_NUMBERS[joint]}"].to_numpy() < IN_CONTACT * mechanism.clearance(joint)
        last[joint] = float(turned[lost].max(initial=0.0))
        share[joint] = float(lost[turned > UNSTABLE_UNTIL_DEG].mean())
    worst = max(last.values())
    last_losses = [
        f"in the {joint.replace('_', ' ')} at {last[joint]:.1f} deg ({share[joint]:.1%} of what follows 30 deg is off "
        "contact)"
        for joint in last
    ]
    yield claim(
        "motion is unstable only between 0 and about 30 deg, then r = rc",
        UNSTABLE_UNTIL_DEG,
        worst,
        "deg",
        worst <= ABOUT * UNSTABLE_UNTIL_DEG,
        f"Contact (r >= {IN_CONTACT} rc) is last lost {' and '.join(last_losses)}.",
    )
    if "crank_pin" not in mechanism.loose:
        return
    past = turned >= 60.0
    gamma = np.degrees(first["gamma2"].to_numpy())[past]
    departure = gamma - turned[past]
    departure -= departure.mean()
    yield claim(
        "gamma2 follows the crank angle",
        1.0,
        float((gamma[-1] - gamma[0]) / (turned[past][-1] - turned[past][0])),
        "turns per turn",
        bool(np.sqrt(np.mean(departure**2)) < 30.0),
        f"Past 60 deg gamma2 departs from the crank angle by {np.sqrt(np.mean(departure**2)):.1f} deg RMS and "
        f"{np.abs(departure).max():.0f} deg at most, a constant apart; below 30 deg RMS it counts as following.",
    )


def _largest(first: pd.DataFrame, ideal: pd.DataFrame, column: str) -> tuple[float, int]:
    size = (first[column] - ideal[column]).abs().to_numpy()
    return float(np.nanmax(size)), int(np.nanargmax(size))


def _rms(first: pd.DataFrame, ideal: pd.DataFrame, column: str) -> float:
    return float(np.sqrt(np.nanmean((first[column] - ideal[column]) ** 2)))


def _deviations(first: pd.DataFrame, turned: np.ndarray, ideal: pd.DataFrame) -> Iterator[Row]:
    x, _ = _largest(first, ideal, "rod_position_x")
    y, _ = _largest(first, ideal, "rod_position_y")
    yield claim(
        "the rod's centre deviates by about +-1 mm",
        ROD_DEVIATION_M * _MM,
        max(x, y) * _MM,
        "mm",
        max(x, y) <= ABOUT * ROD_DEVIATION_M,
        f"Largest deviation {x * _MM:.3f} mm in X and {y * _MM:.3f} mm in Y; up to 20 % more than the paper's counts "
        "as about.",
    )
    piston, _ = _largest(first, ideal, "slider_position")
    yield claim(
        "the piston deviates by +-2 mm",
        PISTON_DEVIATION_M * _MM,
        piston * _MM,
        "mm",
        piston <= ABOUT * PISTON_DEVIATION_M,
        f"Largest deviation {piston * _MM:.3f} mm; up to 20 % more counts. The clearances and the rod's tilt allow "
        "little else.",
    )
    for quantity, unit in (("velocity", "m/s"), ("acceleration", "m/s^2")):
        sizes = {axis: _rms(first, ideal, f"rod_{quantity}_{axis}") for axis in "xy"}
        peaks = {axis: _largest(first, ideal, f"rod_{quantity}_{axis}")[0] for axis in "xy"}
        yield claim(
            f"the rod's {quantity} deviates more in Y than in X",
            None,
            sizes["y"] / sizes["x"],
            "Y / X, RMS",
            None if abs(sizes["y"] / sizes["x"] - 1) < ALIKE else sizes["y"] > sizes["x"],
            f"RMS {sizes['x']:.4g} in X and {sizes['y']:.4g} {unit} in Y; peaks {peaks['x']:.4g} and {peaks['y']:.4g} "
            f"{unit}. Within {ALIKE:.0%} of each other they count as alike.",
        )
    peaks = {
        words: _largest(first, ideal, column)
        for words, column in (
            ("rod's in X", "rod_acceleration_x"),
            ("rod's in Y", "rod_acceleration_y"),
            ("piston's", "slider_acceleration"),
        )
    }
    latest = float(max(turned[at] for _, at in peaks.values()))
    yield claim(
        "the accelerations' peaks come early in the motion (first 30 deg)",
        UNSTABLE_UNTIL_DEG,
        latest,
        "deg",
        latest <= ABOUT * UNSTABLE_UNTIL_DEG,
        "Accelerations deviate most: "
        + ", ".join(f"the {words} at {turned[at]:.1f} deg by {size:.4g} m/s^2" for words, (size, at) in peaks.items())
        + ".",
    )


def _superposed(first: pd.DataFrame, ideal: pd.DataFrame, loose: Sequence[str]) -> Row:
    deviation = (first["slider_position"] - ideal["slider_position"]).to_numpy()
    numbers = sorted(JOINT_NUMBERS[joint] for joint in loose)
    defined = first[[f"gamma{number}" for number in numbers]].notna().all(axis=1).to_numpy()
    signs = {number: -1.0 if number == 3 else 1.0 for number in numbers}
    shares = [
        sign * (first[f"r{number}"] * np.cos(first[f"gamma{number}"])).to_numpy()[defined]
        for number, sign in signs.items()
    ]
    terms = "".join(f" {'-' if sign < 0 else '+'} r{number} cos gamma{number}" for number, sign in signs.items())
    deviation = deviation[defined]
    left = float(np.var(deviation - sum(shares)) / np.var(deviation))
    alone = min(float(np.var(deviation - share) / np.var(deviation)) for share in shares)
    return claim(
        "the piston carries the joints' clearances superposed",
        1.0,
        1.0 - left,
        "share of variance",
        1.0 - left > 0.95,
        f"{terms.removeprefix(' + ')} explains {1 - left:.1%} of the variance of the piston's deviation, the best of "
        f"the joints alone {1 - alone:.1%}; the rod's tilt does the rest.",
    )


def _networks(errors: pd.DataFrame, scenario: Scenario) -> Row:
    default = errors[
        (errors["model"] == "network") & (errors["region"] == "all") & (errors["seed"] == scenario.surrogate.seeds[0])
    ].set_index("output")
    ratios = (default["held_out_mse"] / default["paper_mse"]).dropna()
    worst = ratios.idxmax()
    held_out, trained = (float(default.loc[worst, f"{kind}_mse"]) for kind in ("held_out", "training"))
    why = (
        "So it is the training that stopped short, not what lies between its points."
        if held_out < 2.0 * trained
        else "Between the points it trained at it does not know the motion: contacts ring faster than the points can "
        "show."
    )
    return claim(
        "the networks deviate by nearly zero on inputs not used in training",
        1.0,
        float(ratios.max()),
        "held-out MSE / paper's MSE",
        bool((ratios <= 1.0).all()),
        f"On samples between the training points {int((ratios <= 1).sum())} of {len(ratios)} networks stay at or "
        f"below the paper's training MSE; farthest from it is {worst} with {held_out:.2g} against {trained:.2g} in "
        f"training{'.' if ratios.max() <= 1 else '. ' + why}",
    )


def _optimisers(frames: Mapping[str, pd.DataFrame], scenario: Scenario) -> Iterator[Row]:
    main = next(iter(scenario.optimise.boxes))
    genetic, local = _main_optima(frames, scenario)
    lead = 100 * float(genetic["rms_reduction"] - local["rms_reduction"])
    yield claim(
        "the genetic algorithm beats the local optimiser",
        100 * (OPTIMA[0].reduction - OPTIMA[1].reduction),
        lead,
        "percentage points",
        lead > TIE,
        f"Genetic {genetic['rms_reduction']:.4%} after {genetic['evaluations']:.0f} evaluations, best local "
        f"{local['rms_reduction']:.4%} after {local['evaluations']:.0f}, same box and objective; a lead of {TIE:g} "
        "percentage points or less is a tie.",
    )
    ends = frames["optimise_tolerance"]
    ends = ends[(ends["source"] == "networks") & (ends["box"] == main)]
    counts = {
        tolerance: _distinct(part[["crank_length", "rod_length"]].to_numpy())
        for tolerance, part in ends.groupby("tolerance")
    }
    tightest, loosest = min(counts), max(counts)
    yield claim(
        "there are a lot of local minima",
        None,
        float(counts[tightest]),
        "end points",
        counts[tightest] > 1,
        f"Six starts end in {counts[tightest]} {'point' if counts[tightest] == 1 else 'points'} (more than "
        f"{ONE_POINT * UM:.0f} um apart) at the tolerance {tightest:.0e} and in {counts[loosest]} at {loosest:.0e}: "
        "what looks like minima is where a search stopped.",
    )


def _main_optima(frames: Mapping[str, pd.DataFrame], scenario: Scenario) -> tuple[pd.Series, pd.Series]:
    """What the genetic and the local optimiser found on the networks in the main box."""
    main = next(iter(scenario.optimise.boxes))
    optima = frames["optimise_optima"]
    of_networks = optima[(optima["source"] == "networks") & (optima["box"] == main)].set_index("method")
    return of_networks.loc["genetic"], of_networks.loc["local"]


def _evaluations(found: tuple[pd.Series, pd.Series]) -> Row:
    within = tuple(each["evaluations_within_1_percent"] for each in found)
    enough = [
        not pd.isna(calls) and calls <= printed.evaluations for calls, printed in zip(within, OPTIMA[:2], strict=True)
    ]
    return claim(
        "32 and 17 evaluations are enough",
        32.0,
        None if pd.isna(within[0]) else float(within[0]),
        "evaluations (genetic)",
        all(enough),
        "Within 1 % of the lowest sum of squares: genetic "
        + ", best local start ".join("never" if pd.isna(calls) else f"after {calls:.0f} calls" for calls in within)
        + ".",
    )


def _distinct(points: np.ndarray) -> int:
    """How many of the points, shape (n, 2) [m], lie farther than ONE_POINT from every earlier one."""
    kept: list[np.ndarray] = []
    for point in points:
        if all(np.hypot(*(point - other)) > ONE_POINT for other in kept):
            kept.append(point)
    return len(kept)


def _real_gain(again: pd.DataFrame, machine: pd.DataFrame, scenario: Scenario) -> Iterator[Row]:
    main = next(iter(scenario.optimise.boxes))
    point = f"networks_{main}_genetic"
    rows = again[(again["point"] == point) & (again["measure"] == "rms")].set_index("stretch")
    for stretch, words in (("window", "the configured window"), ("settled", "a whole settled revolution")):
        row = rows.loc[stretch]
        low, middle, high = (100 * float(row[name]) for name in ("reduction_low", "reduction", "reduction_high"))
        yield claim(
            f"the optimum's gain is real: simulated again, over {words}",
            OPTIMA[0].reduction * 100,
            middle,
            "%",
            True if low > 0 else False if high < 0 else None,
            f"RMS reduction {middle:.2f} % (5-95 %: {low:.2f} to {high:.2f} %) in {row['members']:.0f} perturbed "
            f"starts for each pair of lengths, beside {100 * row['frozen_reduction']:.2f} % with the clearance "
            f"motion frozen; better in {row['share_better']:.0%} of the pairs. In degrees: RMS error "
            f"{np.degrees(row['original_error']):.4f} before and {np.degrees(row['error']):.4f} after. "
            f"{_machine_metrics(machine, point)}",
        )


def _machine_metrics(machine: pd.DataFrame, point: str) -> str:
    """What the lengths mean for the machine over a settled revolution, in a sentence."""
    row = machine[(machine["point"] == point) & (machine["cycle"] == "simulated")].iloc[0]
    smallest, departure = np.degrees(row["smallest_transmission_angle"]), np.degrees(row["largest_departure"])
    change = np.degrees(row["smallest_transmission_angle_change"])
    return (
        f"Over the settled cycle the smallest transmission angle becomes {smallest:.3f} deg ({change:+.3f} deg), "
        f"{departure:.3f} deg from 90 deg at most; the stroke changes by {row['stroke_change'] * _MM:+.3f} mm, the "
        f"dead centres by {row['outer_dead_centre_change'] * _MM:+.3f} mm (outer) and "
        f"{row['inner_dead_centre_change'] * _MM:+.3f} mm (inner)."
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


def compare(frames: Mapping[str, pd.DataFrame], scenario: Scenario, variants: Sequence[VariantOptimum]) -> pd.DataFrame:
    """Every number and claim of the paper beside ours."""
    rows: list[Row] = [*numbers(frames, scenario), *claims(frames, scenario, variants)]
    return pd.DataFrame([row.record() for row in rows])
