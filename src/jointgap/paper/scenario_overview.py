"""The scenarios side by side: one row each, the same point (genetic algorithm on the networks, main box) in all of
them.

A second part puts scenarios beside each other that differ in nothing but which joints are loose.
"""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.figures.catalogue import CATALOGUE
from jointgap.paper.looseness_variants import VariantOptimum, conclusion, looseness_variants, variant_optimum
from jointgap.report.page import Block, FigureBlock, Heading, Link, Page, Paragraph, TableBlock, written_today
from jointgap.report.plain_words import fall_in_percent

NEEDED = ("fit_errors", "optimise_optima", "optimise_resimulated", "comparison")

Loaded = Mapping[str, tuple[Mapping[str, pd.DataFrame], Scenario]]
"""By scenario: its tables `NEEDED` by name, and its configuration."""

HEADS = (
    "scenario",
    "loose joints (journal on)",
    "drive",
    "friction, largest",
    "window [deg]",
    "crank [mm]",
    "rod [mm]",
    "networks, frozen [%]",
    "simulation, frozen [%]",
    "simulated again, window [%]",
    "simulated again, settled [%]",
    "training MSE reached",
    "held-out MSE reached",
    "second surrogate, held out",
    "other printed numbers that agree",
)
_ALIGN = "lllrrrrrrrrrrrr"
_FIGURE = "resimulation"
TITLE = "The scenarios side by side"
TEXT = (
    "The name of a scenario leads to its own page: lengths, gain, price, figures. Here: reductions of the RMS error of "
    "the transmission angle at the lengths that the genetic algorithm finds on the networks (main box), against the "
    "original lengths: with the clearance motion frozen, and simulated again with the new lengths (median, 5-95 % of "
    "an ensemble of perturbed starts) over the window and over a whole settled revolution. Training and held-out "
    "errors: how many of the outputs are at or below the paper's training errors, of those for which it has one. Last: "
    "how many of the numbers that it prints besides come out."
)
COUNT_HEADS = (
    "loose joints",
    "scenario",
    "which",
    "simulated again, window [%]",
    "simulated again, settled [%]",
    "error before [deg]",
    "after [deg]",
)
_COUNT_ALIGN = "rllrrrr"
COUNT_TITLE = "By count of loose joints"


def overview(loaded: Loaded) -> pd.DataFrame:
    """One row a scenario, columns of the table overview."""
    scenarios = {name: scenario for name, (_, scenario) in loaded.items()}
    rows = []
    for name, (frames, scenario) in loaded.items():
        optimum = variant_optimum(name, scenario, frames["optimise_resimulated"])
        variants = {
            "family": looseness_variants(name, scenarios)[0],
            "loose_joints": len(optimum.loose),
            **{
                f"found_{key}": getattr(optimum, key)
                for key in ("reduction", "low", "high", "settled", "original_error", "error")
            },
        }
        rows.append(_row(name, frames, scenario) | variants)
    return pd.DataFrame(rows)


def _row(name: str, frames: Mapping[str, pd.DataFrame], scenario: Scenario) -> dict:
    errors = frames["fit_errors"]
    judged = errors[(errors["region"] == "all") & errors["paper_mse"].notna()]
    networks = judged[(judged["model"] == "network") & (judged["seed"] == scenario.surrogate.seeds[0])]
    second = judged[judged["model"] == "clearance"]
    verdicts = frames["comparison"].query("kind == 'number'")["verdict"]
    point = f"networks_{next(iter(scenario.optimise.boxes))}_genetic"
    optima = frames["optimise_optima"]
    best = optima[optima["point"] == point].iloc[0]
    again = frames["optimise_resimulated"]
    again = again[(again["point"] == point) & (again["measure"] == "rms")].set_index("stretch")
    applied = scenario.mechanism.applied()
    joints = {name: applied.joint(name) for name in applied.loose}
    reductions = {
        f"{stretch}_{column}": float(again.loc[stretch, column])
        for stretch in ("window", "settled")
        for column in ("reduction", "reduction_low", "reduction_high")
    }
    return {
        "scenario": name,
        "loose": ", ".join(f"{name.replace('_', ' ')} ({joint.journal})" for name, joint in joints.items()),
        "drive": scenario.simulate.drive.kind,
        "friction": max(joint.contact.friction for joint in joints.values()),
        "window_start": scenario.optimise.window[0],
        "window_end": scenario.optimise.window[1],
        "judged": len(networks),
        "training_reached": int((networks["training_mse"] <= networks["paper_mse"]).sum()),
        "held_out_reached": int((networks["held_out_mse"] <= networks["paper_mse"]).sum()),
        "second_reached": int((second["held_out_mse"] <= second["paper_mse"]).sum()),
        "printed": int(verdicts.isin(("agrees", "differs")).sum()),
        "printed_agree": int((verdicts == "agrees").sum()),
        "crank_length": best["crank_length"],
        "rod_length": best["rod_length"],
        "networks_reduction": best["rms_reduction"],
        "simulation_reduction": again.loc["window", "frozen_reduction"],
        **reductions,
    }


def _cells(table: pd.DataFrame) -> Iterator[tuple[str | Link, ...]]:
    for row in table.itertuples(index=False):
        yield (
            Link(row.scenario, f"{row.scenario}/summary.html"),
            row.loose,
            row.drive,
            f"{row.friction:g}",
            f"{np.degrees(row.window_start):.0f}-{np.degrees(row.window_end):.0f}",
            f"{1e3 * row.crank_length:.3f}",
            f"{1e3 * row.rod_length:.3f}",
            f"{100 * row.networks_reduction:.2f}",
            f"{100 * row.simulation_reduction:.2f}",
            _spread(row.window_reduction, row.window_reduction_low, row.window_reduction_high),
            _spread(row.settled_reduction, row.settled_reduction_low, row.settled_reduction_high),
            *(
                f"{count} of {row.judged}" if row.judged else "–"
                for count in (row.training_reached, row.held_out_reached, row.second_reached)
            ),
            f"{row.printed_agree} of {row.printed}" if row.printed else "–",
        )


def _spread(middle: float, low: float, high: float) -> str:
    return f"{100 * middle:.2f} ({100 * low:.2f} to {100 * high:.2f})"


def _families(table: pd.DataFrame) -> Iterator[tuple[str, list[tuple[str, ...]]]]:
    """For scenarios that differ in their loose joints alone: what that does, in words, and the cells of its rows."""
    for _, rows in table.groupby("family", sort=False):
        if rows["loose_joints"].nunique() < 2:
            continue
        cells, variants = [], []
        for row in rows.sort_values("loose_joints", kind="stable").itertuples():
            loose = tuple(joint.partition(" (")[0] for joint in row.loose.split(", "))
            sizes = (row.found_reduction, row.found_low, row.found_high)
            variants.append(
                VariantOptimum(
                    row.scenario, loose, *sizes, row.found_settled, row.found_original_error, row.found_error
                )
            )
            angles = (f"{np.degrees(angle):.4f}" for angle in (row.found_original_error, row.found_error))
            settled = f"{100 * row.found_settled:.2f}"
            cells.append((str(row.loose_joints), row.scenario, ", ".join(loose), _spread(*sizes), settled, *angles))
        words = (
            "These scenarios differ in nothing but which joints are loose. RMS reductions at the lengths that the "
            f"genetic algorithm finds on each simulation's own motion, simulated again. {conclusion(variants)}"
        )
        yield words, cells


def headline(table: pd.DataFrame) -> str:
    """What came out of the scenarios of the `table` overview, in a line."""
    return (
        f"In {len(table)} scenarios the RMS error of the transmission angle "
        f"{fall_in_percent(100.0 * table['window_reduction'])} at the lengths found, simulated again"
    )


def page(table: pd.DataFrame) -> Page:
    """The `table` overview on one page, with a small figure of each scenario; figures and links are relative to the
    folder of results.
    """
    spec = CATALOGUE[_FIGURE]
    figures = [
        FigureBlock(f"{name}/figures/{_FIGURE}", f"{spec.title}: {name}", small=True) for name in table["scenario"]
    ]
    shown = [*side_by_side(table), Heading("Does the gain last?"), Paragraph(spec.caption), *figures]
    return Page(headline(table), tuple(shown), subject=TITLE, footer=written_today(), width="100rem")


def side_by_side(table: pd.DataFrame) -> list[Block]:
    """The `table` overview in words and tables."""
    blocks: list[Block] = [Paragraph(TEXT), TableBlock(HEADS, tuple(_cells(table)), _ALIGN)]
    for words, cells in _families(table):
        blocks += [Heading(COUNT_TITLE), Paragraph(words), TableBlock(COUNT_HEADS, tuple(cells), _COUNT_ALIGN)]
    return blocks
