"""The scenarios side by side: one row each, the same point (genetic algorithm on the networks, main box) in all of them."""

import html as escape
from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from jointgap.compare.pages import STYLE
from jointgap.config import Scenario

NEEDED = ("fit_errors", "optimise_optima", "optimise_resimulated")

Loaded = Mapping[str, tuple[Mapping[str, pd.DataFrame], Scenario]]
"""By scenario: its tables `NEEDED` by name, and its configuration."""

HEADS = (
    "scenario",
    "friction, largest",
    "journals on",
    "window [deg]",
    "training MSE reached",
    "held-out MSE reached",
    "second surrogate, held out",
    "L2 [mm]",
    "L3 [mm]",
    "networks, frozen [%]",
    "simulation, frozen [%]",
    "again, window [%]",
    "again, settled [%]",
)
TITLE = "The scenarios side by side"
TEXT = (
    "Reductions of the RMS error of the transmission angle at the lengths that the genetic algorithm finds on the networks (main box), "
    "against the original lengths: with the clearance motion frozen, and simulated again with the new lengths (median, 5-95 % of an "
    "ensemble of perturbed starts) over the window and over a whole settled revolution. Training and held-out errors: how many of the "
    "eight outputs are at or below the paper's training errors."
)


def overview(loaded: Loaded) -> pd.DataFrame:
    """One row a scenario, columns of the table overview."""
    return pd.DataFrame([_row(name, frames, scenario) for name, (frames, scenario) in loaded.items()])


def _row(name: str, frames: Mapping[str, pd.DataFrame], scenario: Scenario) -> dict:
    errors = frames["fit_errors"]
    whole = errors[errors["region"] == "all"]
    networks = whole[(whole["model"] == "network") & (whole["seed"] == scenario.surrogate.seeds[0])]
    second = whole[whole["model"] == "clearance"]
    point = f"networks_{next(iter(scenario.optimise.boxes))}_genetic"
    optima = frames["optimise_optima"]
    best = optima[optima["point"] == point].iloc[0]
    again = frames["optimise_resimulated"]
    again = again[(again["point"] == point) & (again["measure"] == "rms")].set_index("stretch")
    applied = scenario.mechanism.applied()
    joints = [applied.joint(joint) for joint in applied.loose]
    reductions = {
        f"{stretch}_{column}": float(again.loc[stretch, column])
        for stretch in ("window", "settled")
        for column in ("reduction", "reduction_low", "reduction_high")
    }
    return {
        "scenario": name,
        "friction": max((joint.contact.friction for joint in joints), default=0.0),
        "journals": " and ".join(joint.journal for joint in joints),
        "window_start": scenario.optimise.window[0],
        "window_end": scenario.optimise.window[1],
        "training_reached": int((networks["training_mse"] <= networks["paper_mse"]).sum()),
        "held_out_reached": int((networks["held_out_mse"] <= networks["paper_mse"]).sum()),
        "second_reached": int((second["held_out_mse"] <= second["paper_mse"]).sum()),
        "crank_length": best["crank_length"],
        "rod_length": best["rod_length"],
        "networks_reduction": best["rms_reduction"],
        "simulation_reduction": again.loc["window", "frozen_reduction"],
        **reductions,
    }


def _cells(table: pd.DataFrame) -> Iterator[tuple[str, ...]]:
    for row in table.itertuples(index=False):
        yield (
            row.scenario,
            f"{row.friction:g}",
            row.journals,
            f"{np.degrees(row.window_start):.0f}-{np.degrees(row.window_end):.0f}",
            *(f"{count} of 8" for count in (row.training_reached, row.held_out_reached, row.second_reached)),
            f"{1e3 * row.crank_length:.3f}",
            f"{1e3 * row.rod_length:.3f}",
            f"{100 * row.networks_reduction:.2f}",
            f"{100 * row.simulation_reduction:.2f}",
            _spread(row.window_reduction, row.window_reduction_low, row.window_reduction_high),
            _spread(row.settled_reduction, row.settled_reduction_low, row.settled_reduction_high),
        )


def _spread(middle: float, low: float, high: float) -> str:
    return f"{100 * middle:.2f} ({100 * low:.2f} to {100 * high:.2f})"


def markdown(table: pd.DataFrame) -> str:
    """The table overview as Markdown."""
    lines = [f"# {TITLE}", "", TEXT, "", f"| {' | '.join(HEADS)} |", f"| {' | '.join('---' for _ in HEADS)} |"]
    return "\n".join([*lines, *(f"| {' | '.join(cells)} |" for cells in _cells(table)), ""])


def html(table: pd.DataFrame) -> str:
    """The table overview as one self-contained page."""
    heads = "".join(f"<th>{head}</th>" for head in HEADS)
    rows = "".join(
        f"<tr>{''.join(f'<td>{escape.escape(cell)}</td>' for cell in cells)}</tr>" for cells in _cells(table)
    )
    return (
        f"<!doctype html><html lang='en'><head><meta charset='utf-8'><title>{TITLE}</title><style>{STYLE}</style></head>"
        f"<body><h1>{TITLE}</h1><p>{TEXT}</p><table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table></body></html>\n"
    )
