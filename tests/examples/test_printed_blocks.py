"""Files, commands and code of README.md, the tutorials and some how-to pages are run in order and
their output is compared. Of a workflow and of `jointgap analyse` only targets and files are
checked: they take minutes."""

import contextlib
import io
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
from tests.command import jointgap

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PAGES = [
    str(page.relative_to(ROOT))
    for page in (
        ROOT / "README.md",
        *sorted((ROOT / "docs/tutorial").glob("*.md")),
        *(ROOT / "docs/how_to" / f"{name}.md" for name in ("mechanism_file", "known_loads")),
    )
    if BLOCK.search(page.read_text(encoding="utf-8"))
]
TARGETS = set(
    re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
)


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A writable folder with the content of a clone."""
    for name in ("config", "examples"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / ".venv/bin").mkdir(parents=True)
    for name in ("jointgap", "python"):
        (tmp_path / ".venv/bin" / name).symlink_to(Path(sys.executable).parent / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    return tmp_path


def results_of_the_workflow(page: str) -> None:
    """Small substitutes for workflow results that a page reads."""
    if page.endswith("first_simulation.md"):
        Path("results/smoke/simulate").mkdir(parents=True)
        motion = jg.simulate(jg.load_mechanism("erkaya2009"), speed="600 rpm", revolutions=1)
        motion.events.to_parquet("results/smoke/simulate/events.parquet")
    if page.endswith("many_designs.md"):
        designs = {"clearance": [3e-5, 5e-5], "friction": [0.03, 0.1]}
        designs["piston_pin_peak_force"] = [1.0, 2.0]
        Path("results/compressor_sweep/sweep/designs").mkdir(parents=True)
        pd.DataFrame(designs | {"reason": None}).to_parquet(
            "results/compressor_sweep/sweep/designs/part.parquet"
        )


def written(text: str) -> None:
    """Write a YAML block to the file in its first line, and read it."""
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
        assert load_mechanism(path)


def commands(language: str, text: str) -> list[tuple[str, list[str]]]:
    """Commands of a block, each with its printed lines."""
    found: list[tuple[str, list[str]]] = []
    for line in text.splitlines():
        if language == "console" and not line.startswith("$ "):
            found[-1][1].append(line)
        elif command := line.removeprefix("$ ").split("  #")[0].strip():
            found.append((command, []))
    return found


def check_campaign(path: str) -> None:
    campaign = load_campaign(path)
    assert all((campaign.folder / run.file).is_file() for run in campaign.runs)


def typed(command: str, shown: list[str]) -> None:
    """Run a command and compare its output with the page, up to ``...`` in a line."""
    words = shlex.split(command)
    given = dict(word.split("=", 1) for word in words if re.match(r"[A-Z]+=", word))
    if words[0] == "git":
        assert words[1] == "clone"
    elif "make" in words:
        targets = [word for word in words if "=" not in word and word != "make"]
        assert targets and set(targets) <= TARGETS, command
        if "CONFIG" in given:
            assert resolve(
                read_yaml(given["CONFIG"]), (Path(), Path(given["CONFIG"]).parent), given["CONFIG"]
            )
        if "CAMPAIGN" in given:
            check_campaign(given["CAMPAIGN"])
    elif words[0].endswith("jointgap") and words[1] == "analyse":
        check_campaign(words[2])
    elif words not in (["source", ".venv/bin/activate"], [".venv/bin/python"]) and words[0] != "cd":
        if re.fullmatch(r"(\.venv/bin/)?jointgap [^|<>&;$]*", command):  # quick in this process
            done = jointgap(*words[1:])
        else:
            done = subprocess.run(
                ["bash", "-c", command], capture_output=True, text=True, env=os.environ, check=False
            )
        assert done.returncode == 0, f"{command}: {done.stderr}"
        for line in shown:
            assert line.split("...")[0].strip() in done.stdout, command


SLOW = ("docs/tutorial/own_data.md",)


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=[pytest.mark.slow] * (page in SLOW)) for page in PAGES]
)
def test_documentation_blocks_run_and_print_what_they_show(page, clone):
    names: dict = {}
    printed = ""
    results_of_the_workflow(page)
    for language, text in BLOCK.findall((ROOT / page).read_text(encoding="utf-8")):
        if language == "yaml":
            written(text)
        elif language == "python":
            with contextlib.redirect_stdout(io.StringIO()) as output:
                exec(compile(text, page, "exec"), names)
            printed = output.getvalue()
        elif language in ("", "sh", "console"):
            for command, shown in commands(language, text):
                typed(command, shown)
        else:
            assert language == "text", f"{page}: a block of {language} is not tested"
            if printed:
                assert text == printed, page
            printed = ""
