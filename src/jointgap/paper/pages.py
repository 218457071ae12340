"""Pages that compare: with the paper, and scenarios with each other."""

import math
from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.page import Block, Cell, FigureBlock, Heading, Link, Page, Paragraph, TableBlock, written_today
from jointgap.core.words import fall_in_percent
from jointgap.paper.compare import VariantOptimum, conclusion, looseness_variants, variant_optimum
from jointgap.paper.printed import AGREES, LENGTH_AGREES, departures
from jointgap.scenario.figures import FIGURES

_SECTIONS = {
    "number": (
        "Printed numbers",
        ("number", "unit", "paper", "ours", "ours / paper", "verdict", "what it is, and why it differs"),
    ),
    "claim": ("Claims", ("claim", "unit", "paper", "ours", "ours / paper", "verdict", "our evidence")),
}
_ALIGN = "llrrrll"
_TONES = {word: "good" for word in ("agrees", "reached", "holds")}
_TONES |= {word: "bad" for word in ("differs", "missed", "does not hold")}


def _number(value: float | None) -> str:
    if value is None or math.isnan(value):
        return "–"
    return f"{value:.6g}" if 1e-3 <= abs(value) < 1e6 or value == 0 else f"{value:.4e}"


def _counts(comparison: pd.DataFrame) -> str:
    """How many numbers agree and claims hold, in a sentence."""
    counts = comparison[comparison["kind"] == "number"]["verdict"].value_counts()

    def count(verdict: str) -> int:
        return int(counts.get(verdict, 0))

    return (
        f"Of the paper's training errors, put to the networks and to the second surrogate, {count('reached')} are "
        f"reached and {count('missed')} missed; of its other numbers {count('agrees')} agree and {count('differs')} "
        f"differ. {_claims(comparison)}"
    )


def _claims(comparison: pd.DataFrame) -> str:
    """How many claims hold, in a sentence."""
    verdicts = comparison[comparison["kind"] == "claim"]["verdict"]
    counts = [int((verdicts == verdict).sum()) for verdict in ("holds", "does not hold", "cannot be told")]
    return f"Of {len(verdicts)} claims {counts[0]} hold, {counts[1]} do not, and {counts[2]} cannot be told."


def _introduction(scenario: Scenario, comparison: pd.DataFrame) -> list[str]:
    if differences := departures(scenario.mechanism, scenario.simulate):
        return [
            scenario.description,
            f"This mechanism is not the paper's ({'; '.join(differences)}). So none of its numbers stands here, and of "
            "its claims those alone that have no size and no speed in them. What came out for this mechanism: "
            f"`summary.html`. {_claims(comparison)}",
        ]
    return [
        scenario.description,
        f"{_counts(comparison)} A number agrees within {AGREES:.0%} of the paper's, an optimum length within "
        f"{LENGTH_AGREES:.1%}. Nothing is tuned to match: contact parameters, bounds and window are those of the "
        "configuration.",
    ]


def comparison_page(comparison: pd.DataFrame, scenario: Scenario) -> Page:
    """The `comparison` (table `COMPARISON`) of a `scenario` on one page."""
    blocks: list[Block] = [Paragraph(text) for text in _introduction(scenario, comparison) if text]
    for kind, (title, heads) in _SECTIONS.items():
        rows = comparison[comparison["kind"] == kind]
        if len(rows):
            cells = tuple(_cells(row) for row in rows.itertuples())
            blocks += [Heading(title), TableBlock(heads, cells, _ALIGN)]
    return Page("The paper and this simulation side by side", tuple(blocks))


def _cells(row) -> tuple[str | Cell, ...]:
    numbers = map(_number, (row.paper, row.ours, row.ratio))
    return (row.item, row.unit, *numbers, Cell(row.verdict, _TONES.get(row.verdict, "open")), row.sentence)


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
_scenario_overview_ALIGN = "lllrrrrrrrrrrrr"
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


def _scenario_overview_cells(table: pd.DataFrame) -> Iterator[tuple[str | Link, ...]]:
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


def overview_page(table: pd.DataFrame) -> Page:
    """The `table` overview on one page, with a small figure of each scenario; figures and links are relative to the
    folder of results.
    """
    spec = FIGURES[_FIGURE]
    figures = [
        FigureBlock(f"{name}/figures/{_FIGURE}", f"{spec.title}: {name}", small=True) for name in table["scenario"]
    ]
    shown = [*side_by_side(table), Heading("Does the gain last?"), Paragraph(spec.caption), *figures]
    return Page(headline(table), tuple(shown), subject=TITLE, footer=written_today(), width="100rem")


def side_by_side(table: pd.DataFrame) -> list[Block]:
    """The `table` overview in words and tables."""
    blocks: list[Block] = [
        Paragraph(TEXT),
        TableBlock(HEADS, tuple(_scenario_overview_cells(table)), _scenario_overview_ALIGN),
    ]
    for words, cells in _families(table):
        blocks += [Heading(COUNT_TITLE), Paragraph(words), TableBlock(COUNT_HEADS, tuple(cells), _COUNT_ALIGN)]
    return blocks
