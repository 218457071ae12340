"""What README.md and the tutorials print can be typed: files are written, commands and code are run, page by page.

A `make` of a workflow takes minutes: that its target exists and that the files it is given can be used is tested here;
what the workflow does then has tests of its own.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import jointgap as jg
from jointgap.config import load_mechanism, read_yaml, resolve
from jointgap.config.load import load_campaign

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PAGES = [
    str(page.relative_to(ROOT))
    for page in (ROOT / "README.md", *sorted((ROOT / "docs/tutorial").glob("*.md")))
    if BLOCK.search(page.read_text(encoding="utf-8"))
]
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A folder that has what a clone has and that may be written to."""
    for name in ("config", "examples"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / ".venv/bin").mkdir(parents=True)
    for name in ("jointgap", "python"):
        (tmp_path / ".venv/bin" / name).symlink_to(Path(sys.executable).parent / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    return tmp_path


def results_of_the_workflow(page: str) -> None:
    """Small stand-ins for the results that a page's code reads, with the columns that a workflow gives them."""
    if page.endswith("first_simulation.md"):
        Path("results/smoke/simulate").mkdir(parents=True)
        motion = jg.simulate(jg.load_mechanism("erkaya2009"), speed="600 rpm", revolutions=1)
        motion.events.to_parquet("results/smoke/simulate/events.parquet")
    if page.endswith("many_designs.md"):
        designs = {"clearance": [3e-5, 5e-5], "friction": [0.03, 0.1], "piston_pin_peak_force": [1.0, 2.0]}
        Path("results/compressor_sweep/sweep/designs").mkdir(parents=True)
        pd.DataFrame(designs | {"reason": None}).to_parquet("results/compressor_sweep/sweep/designs/part.parquet")


def written(text: str) -> None:
    """A block of YAML becomes the file that its first line names, and can be read as what it is."""
    name = re.match(r"# ([\w./-]+\.yaml)", text)
    if name is None:
        return
    path = Path(name[1])
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")
    content = read_yaml(path)
    if "scenarios" in content:
        assert resolve(content, (Path(),), name[1])
    elif "runs" in content:
        assert load_campaign(path).runs
    else:
        assert load_mechanism(path).crank.length > 0


def commands(language: str, text: str) -> list[str]:
    """What is typed: lines after ``$`` of a console, all lines of a shell block; comments taken away."""
    lines = text.splitlines()
    typed = [line[2:] for line in lines if line.startswith("$ ")] if language == "console" else lines
    return [command for line in typed if (command := line.split("  #")[0].strip())]


def typed(command: str) -> None:
    words = shlex.split(command)
    given = dict(word.split("=", 1) for word in words if re.match(r"[A-Z]+=", word))
    if words[0] == "git":
        assert words[1] == "clone"
    elif "make" in words:
        targets = [word for word in words if "=" not in word and word != "make"]
        assert targets and set(targets) <= TARGETS, command
        if "CONFIG" in given:
            assert resolve(read_yaml(given["CONFIG"]), (Path(), Path(given["CONFIG"]).parent), given["CONFIG"])
        if "CAMPAIGN" in given:
            assert all((Path(given["CAMPAIGN"]).parent / run.file).is_file()
                       for run in load_campaign(given["CAMPAIGN"]).runs)  # fmt: skip
    elif words not in (["source", ".venv/bin/activate"], [".venv/bin/python"]) and words[0] != "cd":
        done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, env=os.environ, check=False)
        assert done.returncode == 0, f"{command}: {done.stderr}"


SLOW = ("docs/tutorial/own_data.md",)


@pytest.mark.parametrize("page", [pytest.param(page, marks=[pytest.mark.slow] * (page in SLOW)) for page in PAGES])
def test_every_block_of_a_page_does_what_it_prints(page, clone):
    names: dict = {}
    results_of_the_workflow(page)
    for language, text in BLOCK.findall((ROOT / page).read_text(encoding="utf-8")):
        if language == "yaml":
            written(text)
        elif language == "python":
            exec(compile(text, page, "exec"), names)
        elif language in ("", "sh", "console"):
            for command in commands(language, text):
                typed(command)
        else:
            assert language == "text", f"{page}: a block of {language} is not tested"
