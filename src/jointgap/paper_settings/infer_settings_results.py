"""What the paper did not say, written to a folder: tables, figures, the nearest scenario and the page."""

from pathlib import Path

import pandas as pd
import yaml

from jointgap import tables
from jointgap.config import Scenario
from jointgap.core import plot
from jointgap.core.page import to_html, to_markdown
from jointgap.paper_settings.infer_settings import InferredSettings
from jointgap.paper_settings.infer_settings_figures import draw
from jointgap.paper_settings.infer_settings_page import NEAREST_FILE, page
from jointgap.tables.infer_settings_tables import INFERRED_DESIGNS_PATH, INFERRED_TABLES, inferred_designs

NEAREST_NAME = "nearest_settings"
"""What the nearest scenario is called in its file."""


_SAMPLING = ("revolutions", "samples_per_revolution", "tolerance")
"""Keys of `simulate` that a sweep may have coarser than a scenario needs them."""


def write_results(found: InferredSettings, training: pd.DataFrame, scenario: Scenario, folder: Path) -> str:
    """Write tables, figures, scenario and page into a `folder`; gives the page as Markdown."""
    frames = (found.numbers, found.settings, training)
    places = {
        folder / Path(table.path).name: (table, frame) for table, frame in zip(INFERRED_TABLES, frames, strict=True)
    }
    designs = inferred_designs(axis.column for axis in found.designs.axes)
    places[folder / Path(INFERRED_DESIGNS_PATH).name] = (designs, found.nearest[list(designs.names)])
    pages, figures = (folder / "summary.html", folder / "summary.md"), folder / "figures"
    tables.check_writable(*places, *pages, folder / NEAREST_FILE)
    figures.mkdir(exist_ok=True)
    drawn = {path for name, drawing in draw(found) for path in plot.save(drawing, figures / name)}
    for path in set(figures.iterdir()) - drawn:
        path.unlink()
    for path, (table, frame) in places.items():
        tables.write(table, frame, path)
    tables.write_text(folder / NEAREST_FILE, nearest_configuration(found, scenario))
    shown = page(found, training)
    text = to_markdown(shown)
    tables.write_text(pages[0], to_html(shown, figures))
    tables.write_text(pages[1], text)
    return text


def nearest_configuration(found: InferredSettings, scenario: Scenario) -> str:
    """A configuration, YAML, of the nearest settings that a scenario can hold; a comment alone where there are none."""
    chosen = found.nearest_scenario
    if chosen is None:
        return "# No design counts the RMS over the first revolution, as the optimum of a scenario does.\n"
    made = found.designs.scenario({axis.key: chosen[axis.key] for axis in found.designs.axes})
    content = made.model_dump(mode="json", include={"mechanism", "simulate"}, exclude_none=True, by_alias=True)
    for key in _SAMPLING:
        content["simulate"].pop(key, None)
    window = found.designs.counting(chosen).window
    content["description"] = (
        f"The nearest settings to all of the paper's printed numbers: design {int(chosen['design'])} of a sweep, in "
        f"which none is more than {100 * chosen['farthest']:.2g} % off."
    )
    content["optimise"] = {"window": list(window)}
    content["surrogate"] = {"iterations": found.options.iterations, "seeds": [found.options.seed]}
    return yaml.safe_dump({"run": [NEAREST_NAME], "scenarios": {NEAREST_NAME: content}}, sort_keys=False)
