"""Comparison of the scenarios of a run: table `overview` and its page."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.page import (
    Block,
    FigureBlock,
    Heading,
    Link,
    Page,
    Paragraph,
    TableBlock,
    write_page,
    written_today,
)
from jointgap.core.parquet import write
from jointgap.core.schema import OVERVIEW
from jointgap.core.words import format_falls, format_range
from jointgap.paper.compare import joints_claim, looseness_variants, variant_optimum
from jointgap.scenario.figures import FIGURES
from jointgap.scenario.results import ScenarioResults

NEEDED = ("fit_errors", "optimise_optima", "optimise_resimulated", "comparison")
"""Tables of a scenario required for its row."""

TITLE = "Comparison of scenarios"
_TEXT = (
    "Reductions of the RMS error of the transmission angle at the lengths that the genetic"
    " algorithm finds on the networks within the first bounds, relative to the original lengths."
    " Frozen: estimate with unchanged joint motion. Simulated again: the result that counts, median"
    " and 5-95 % of an ensemble. Training and held-out MSE: outputs at or below the paper's"
    " training error."
)


def write_overview(scenarios: Mapping[str, ScenarioResults], folder: Path) -> None:
    """Write the table overview and its page to a `folder`."""
    table = overview(
        {name: (results.read_all(NEEDED), results.scenario) for name, results in scenarios.items()}
    )
    write_page(folder / "overview", overview_page(table))
    write(OVERVIEW, table, folder / OVERVIEW.path)


def overview(loaded: Mapping[str, tuple[Mapping[str, pd.DataFrame], Scenario]]) -> pd.DataFrame:
    """The table overview, one row per scenario with an optimum, from its tables `NEEDED` and its
    configuration."""
    scenarios = {name: scenario for name, (_, scenario) in loaded.items()}
    rows = [
        _row(name, *own) | {"family": looseness_variants(name, scenarios)[0]} | variant
        for name, own in loaded.items()
        if (variant := variant_optimum(name, own[1], own[0]["optimise_resimulated"])) is not None
    ]
    return pd.DataFrame(rows, columns=None if rows else OVERVIEW.names)


def _row(name: str, frames: Mapping[str, pd.DataFrame], scenario: Scenario) -> dict:
    errors = frames["fit_errors"]
    judged = errors[(errors["region"] == "all") & errors["paper_mse"].notna()]
    networks = judged[
        (judged["model"] == "network") & (judged["seed"] == scenario.surrogate.seeds[0])
    ]
    verdicts = frames["comparison"].query("kind == 'number'")["verdict"]
    point = f"networks_{next(iter(scenario.optimise.boxes))}_genetic"
    best = frames["optimise_optima"].set_index("point").loc[point]
    again = (
        frames["optimise_resimulated"]
        .query("measure == 'rms'")
        .set_index(["point", "stretch"])
        .loc[point]
    )
    applied = scenario.mechanism.applied()
    return {
        "drive": scenario.simulate.drive.kind,
        "friction": max(applied.joint(joint).contact.friction for joint in applied.loose),
        "window_start": scenario.optimise.window[0],
        "window_end": scenario.optimise.window[1],
        "judged": len(networks),
        "training_reached": int((networks["training_mse"] <= networks["paper_mse"]).sum()),
        "held_out_reached": int((networks["held_out_mse"] <= networks["paper_mse"]).sum()),
        "printed": int(verdicts.isin(("agrees", "differs")).sum()),
        "printed_agree": int((verdicts == "agrees").sum()),
        "crank_length": best["crank_length"],
        "rod_length": best["rod_length"],
        "networks_reduction": best["rms_reduction"],
        "simulation_reduction": again.loc["window", "frozen_reduction"],
    } | {
        f"{stretch}_{column}": float(again.loc[stretch, column])
        for stretch in ("window", "settled")
        for column in ("reduction", "reduction_low", "reduction_high")
    }


def headline(table: pd.DataFrame) -> str:
    """The result of all scenarios in one line."""
    if table.empty:
        return "No lengths satisfy the constraints in any scenario"
    return (
        f"In {len(table)} scenarios the RMS error of the transmission angle "
        f"{format_falls(100.0 * table['window_reduction'])} at the lengths found, simulated again"
    )


def overview_page(table: pd.DataFrame) -> Page:
    """The page of the `table` overview; links are relative to the folder of results."""
    spec = FIGURES["resimulation"]
    figures = [
        FigureBlock(f"{name}/figures/resimulation", f"{spec.title}: {name}", small=True)
        for name in table["scenario"]
    ]
    blocks = (
        *side_by_side(table),
        Heading("Gain when simulated again"),
        Paragraph(spec.caption),
        *figures,
    )
    return Page(headline(table), blocks, subject=TITLE, footer=written_today(), width="100rem")


def side_by_side(table: pd.DataFrame) -> list[Block]:
    if table.empty:
        return []
    rows = map(_cells, table.itertuples(index=False))
    return [Paragraph(_TEXT), TableBlock.of(rows, "lrrllrrrrrrrrr"), *_by_count(table)]


def _cells(row) -> dict[str, str | Link]:
    window, learned = np.degrees([row.window_start, row.window_end]), f"of {row.judged}"
    return {
        "scenario": Link(row.scenario, f"{row.scenario}/summary.html"),
        "simulated again, window [%]": _spread(row, "window_reduction"),
        "simulated again, settled [%]": _spread(row, "settled_reduction"),
        "loose joints (journal on)": row.loose,
        "drive": row.drive,
        "friction, largest": f"{row.friction:g}",
        "window [deg]": "{:.0f}-{:.0f}".format(*window),
        "crank [mm]": f"{1e3 * row.crank_length:.3f}",
        "rod [mm]": f"{1e3 * row.rod_length:.3f}",
        "networks, frozen [%]": f"{100 * row.networks_reduction:.2f}",
        "simulation, frozen [%]": f"{100 * row.simulation_reduction:.2f}",
        "training MSE reached": f"{row.training_reached} {learned}" if row.judged else "–",
        "held-out MSE reached": f"{row.held_out_reached} {learned}" if row.judged else "–",
        "other printed numbers that agree": (
            f"{row.printed_agree} of {row.printed}" if row.printed else "–"
        ),
    }


def _spread(row, name: str) -> str:
    ends = "found" if name == "found_reduction" else name
    low, high = getattr(row, f"{ends}_low"), getattr(row, f"{ends}_high")
    return (
        f"{100 * getattr(row, name):.2f} ({format_range(f'{100 * low:.2f}', f'{100 * high:.2f}')})"
    )


def _by_count(table: pd.DataFrame) -> Iterator[Block]:
    """Scenarios that differ only in their loose joints, by number of loose joints."""
    for _, rows in table.groupby("family", sort=False):
        if rows["loose_joints"].nunique() < 2:
            continue
        cells = (
            {
                "loose joints": str(row.loose_joints),
                "scenario": row.scenario,
                "joints": ", ".join(joint.partition(" (")[0] for joint in row.loose.split(", ")),
                "simulated again, window [%]": _spread(row, "found_reduction"),
                "simulated again, settled [%]": f"{100 * row.found_settled:.2f}",
                "error before [deg]": f"{np.degrees(row.found_original_error):.4f}",
                "after [deg]": f"{np.degrees(row.found_error):.4f}",
            }
            for row in rows.sort_values("loose_joints", kind="stable").itertuples()
        )
        yield Heading("By number of loose joints")
        yield Paragraph(
            "These scenarios differ only in their loose joints. RMS reductions, simulated again,"
            " at the lengths that the genetic algorithm finds with the motion of the same"
            f" simulation. {joints_claim(rows)['sentence']}"
        )
        yield TableBlock.of(cells, "rllrrrr")
