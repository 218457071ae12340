"""The notebooks of the documentation run from top to bottom."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

pytestmark = pytest.mark.integration

FOLDER = Path(__file__).parents[2] / "docs/notebooks"
# The others run where the site is built too.
NAMES = [
    "first_simulation",
    *(pytest.param(name, marks=pytest.mark.slow) for name in ("own_mechanism", "own_data", "sweep")),
]


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_runs_and_shows_figures(name):
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": FOLDER}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not [output["text"] for output in outputs if output.get("name") == "stderr"]


def test_notebooks_are_stored_without_outputs():
    for path in FOLDER.glob("*.ipynb"):
        cells = nbformat.read(path, as_version=4).cells
        assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells), path.name
