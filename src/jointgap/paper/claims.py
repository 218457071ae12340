"""The claims that the paper makes, and whether they hold here."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.joints import JOINT_NUMBERS
from jointgap.paper.looseness_variants import VariantOptimum, joints_claim
from jointgap.paper.printed import (
    OPTIMA,
    PISTON_DEVIATION_M,
    ROD_DEVIATION_M,
    UNSTABLE_UNTIL_DEG,
    Row,
    claim,
    departures,
)

ABOUT = 1.2  # how far a number that the paper calls "about", or shows in a figure, may go beyond it
ALIKE = 0.05  # two sizes that differ by less are alike
TIE = 0.001  # percentage points by which an optimiser has to lead
IN_CONTACT = 0.999  # share of the clearance from which on the journal counts as on its bearing
ONE_POINT = 1e-6  # [m] within which two end points are one
MM, UM = 1e3, 1e6  # [1/m] numbers in mm and um


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
        ROD_DEVIATION_M * MM,
        max(x, y) * MM,
        "mm",
        max(x, y) <= ABOUT * ROD_DEVIATION_M,
        f"Largest deviation {x * MM:.3f} mm in X and {y * MM:.3f} mm in Y; up to 20 % more than the paper's counts as "
        "about.",
    )
    piston, _ = _largest(first, ideal, "slider_position")
    yield claim(
        "the piston deviates by +-2 mm",
        PISTON_DEVIATION_M * MM,
        piston * MM,
        "mm",
        piston <= ABOUT * PISTON_DEVIATION_M,
        f"Largest deviation {piston * MM:.3f} mm; up to 20 % more counts. The clearances and the rod's tilt allow "
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
        f"{departure:.3f} deg from 90 deg at most; the stroke changes by {row['stroke_change'] * MM:+.3f} mm, the "
        f"dead centres by {row['outer_dead_centre_change'] * MM:+.3f} mm (outer) and "
        f"{row['inner_dead_centre_change'] * MM:+.3f} mm (inner)."
    )
