"""The notebooks of the documentation."""

import re
from pathlib import Path
from runpy import run_path

import nbformat
import pytest

ROOT = Path(__file__).parents[2]
FILES = {file.stem: file for file in sorted((ROOT / "docs/notebooks").glob("*.ipynb"))}
SCRIPT = run_path(str(ROOT / "scripts/notebooks"))
MOST_BYTES = 400_000
NUMBER = re.compile(r"[-+]?[0-9][0-9,]*\.?[0-9]*(?:e[-+]?[0-9]+)?")


def outputs(notebook):
    return [output for cell in notebook.cells for output in cell.get("outputs", ())]


def texts(notebook):
    return [output.get("text") or output["data"]["text/plain"] for output in outputs(notebook)]


def numbers(text):
    return [float(number.replace(",", "")) for number in NUMBER.findall(text)]


def test_stored_outputs_belong_to_the_code():
    for name, file in FILES.items():
        stored = nbformat.read(file, as_version=4)
        assert stored.metadata["digest_of_code"] == SCRIPT["digest"](stored), (
            f"run: scripts/in-venv scripts/notebooks {name}"
        )
        assert not [output for output in outputs(stored) if output.get("name") == "stderr"], name
        assert any("image/png" in output.get("data", {}) for output in outputs(stored)), name
        assert file.stat().st_size < MOST_BYTES and "/tmp/" not in file.read_text(
            encoding="utf-8"
        ), name


@pytest.mark.integration
@pytest.mark.parametrize(
    "name",
    [
        name if name == "first_simulation" else pytest.param(name, marks=pytest.mark.slow)
        for name in FILES
    ],
)
def test_a_notebook_reproduces_its_outputs(name):
    stored, again = nbformat.read(FILES[name], as_version=4), SCRIPT["run"](FILES[name])
    assert [sorted(each.get("data", ())) for each in outputs(again)] == [
        sorted(each.get("data", ())) for each in outputs(stored)
    ]
    for now, before in zip(texts(again), texts(stored), strict=True):
        assert NUMBER.sub("#", now).split() == NUMBER.sub("#", before).split()
        # processors round differently
        assert numbers(now) == pytest.approx(numbers(before), rel=0.02)
