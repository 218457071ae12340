"""Comparison of the scenarios of a run: table `overview` and its page."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.config.scenario_results import ScenarioResults
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
from jointgap.paper.compare import variant_optimum
from jointgap.scenario.figures import FIGURES

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
    rows = [
        _row(frames, scenario) | variant
        for name, (frames, scenario) in loaded.items()
        if (variant := variant_optimum(name, scenario, frames["optimise_resimulated"])) is not None
    ]
    return pd.DataFrame(rows, columns=None if rows else OVERVIEW.names)


def _row(frames: Mapping[str, pd.DataFrame], scenario: Scenario) -> dict:
    errors = frames["fit_errors"].query("region == 'all' and model == 'network'")
    errors = errors[(errors["seed"] == scenario.surrogate.seeds[0]) & errors["paper_mse"].notna()]
    verdicts = frames["comparison"].query("kind == 'number'")["verdict"]
    point = f"networks_{next(iter(scenario.optimise.boxes))}_genetic"
    optimum = frames["optimise_optima"].set_index("point").loc[point]
    gains = frames["optimise_resimulated"].query("measure == 'rms'").set_index(["point", "stretch"])
    gains = gains.loc[point]
    applied = scenario.mechanism.applied()
    row = {
        "drive": scenario.simulate.drive.kind,
        "friction": max(applied.joint(joint).contact.friction for joint in applied.loose),
        "window_start": scenario.optimise.window[0],
        "window_end": scenario.optimise.window[1],
        "judged": len(errors),
        "training_reached": int((errors["training_mse"] <= errors["paper_mse"]).sum()),
        "held_out_reached": int((errors["held_out_mse"] <= errors["paper_mse"]).sum()),
        "printed": int(verdicts.isin(("agrees", "differs")).sum()),
        "printed_agree": int((verdicts == "agrees").sum()),
        "crank_length": optimum["crank_length"],
        "rod_length": optimum["rod_length"],
        "networks_reduction": optimum["rms_reduction"],
        "simulation_reduction": gains.loc["window", "frozen_reduction"],
    }
    for stretch in ("window", "settled"):
        for column in ("reduction", "reduction_low", "reduction_high"):
            row[f"{stretch}_{column}"] = float(gains.loc[stretch, column])
    return row


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
    cells = map(_cells, table.itertuples(index=False))
    return [Paragraph(_TEXT), TableBlock.of(cells, "lrrllrrrrrrrrr")]


def _cells(row) -> dict[str, str | Link]:
    start, end = np.degrees([row.window_start, row.window_end])

    def share(count: int, total: int) -> str:
        return f"{count} of {total}" if total else "–"

    def spread(stretch: str) -> str:
        median, low, high = (
            f"{100 * getattr(row, f'{stretch}_reduction{column}'):.2f}"
            for column in ("", "_low", "_high")
        )
        return f"{median} ({format_range(low, high)})"

    return {
        "scenario": Link(row.scenario, f"{row.scenario}/summary.html"),
        "simulated again, window [%]": spread("window"),
        "simulated again, settled [%]": spread("settled"),
        "loose joints (journal on)": row.loose,
        "drive": row.drive,
        "friction, largest": f"{row.friction:g}",
        "window [deg]": f"{start:.0f}-{end:.0f}",
        "crank [mm]": f"{1e3 * row.crank_length:.3f}",
        "rod [mm]": f"{1e3 * row.rod_length:.3f}",
        "networks, frozen [%]": f"{100 * row.networks_reduction:.2f}",
        "simulation, frozen [%]": f"{100 * row.simulation_reduction:.2f}",
        "training MSE reached": share(row.training_reached, row.judged),
        "held-out MSE reached": share(row.held_out_reached, row.judged),
        "other printed numbers that agree": share(row.printed_agree, row.printed),
    }
