"""The numbers that the paper prints, and ours."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.paper.printed import (
    AGREES,
    LENGTH_AGREES,
    MISSED,
    OPTIMA,
    REACHED,
    TRAINING_ITERATIONS,
    TRAINING_MSE,
    PrintedOptimum,
    Row,
    departures,
)

MM = 1e3  # [1/m] numbers in mm
PERCENT = 100  # [1] shares in percent


def numbers(frames: Mapping[str, pd.DataFrame], scenario: Scenario) -> Iterator[Row]:
    """A row for each printed number, none for another mechanism than the paper's.

    Arguments as in `jointgap.paper.comparison.compare`.
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
