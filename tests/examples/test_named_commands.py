"""Commands in the documentation exist, and those without other tests run."""

import importlib.util
import re
import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest

import validation.__main__ as trials
from benchmarks.project import ROOT, run
from examples import demonstration
from jointgap.app.cli import cli

PAGES = {
    path: path.read_text(encoding="utf-8")
    for path in sorted(
        {*ROOT.glob("*.md"), *(ROOT / "config").glob("*.md"), *ROOT.glob("*/**/*.md")}
    )
    if not {".venv", ".cache", "results", "node_modules"} & set(path.relative_to(ROOT).parts)
}
BLOCK, SPAN = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE), re.compile(r"`([^`\n]+)`")


def named(pattern: str) -> set[str]:
    """Matches of a pattern in code blocks and inline code."""
    found = set()
    for text in PAGES.values():
        blocks = "\n".join(BLOCK.findall(text)).splitlines()
        code = [line.strip().removeprefix("$ ") for line in blocks] + SPAN.findall(
            BLOCK.sub("", text)
        )
        found |= {name for line in code for name in re.findall(pattern, line)}
    return found


def test_documented_commands_exist():
    targets = set(
        re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    )
    verbs = {name for name in vars(trials) if not name.startswith("_")}

    modules, scripts = named(r"\bpython -m ([\w.]+)"), named(r"(?<![\w/.])scripts/([\w-]+)")
    cases = [
        (named(r"(?:^|[A-Z]=\S+ )make (?:[A-Z]+=\S+ )*([a-z][a-z-]+)"), targets),
        (named(r"^(?:\.venv/bin/)?jointgap ([a-z][a-z-]+)"), set(cli.commands)),
        (named(r"^(?:\.venv/bin/)?jointgap new ([a-z]+)"), set(cli.commands["new"].commands)),
        (modules, {name for name in modules if importlib.util.find_spec(name)}),
        (scripts, {path.name for path in (ROOT / "scripts").iterdir()}),
        (named(r"python -m validation ([a-z]+)"), verbs),
    ]
    for found, known in cases:
        assert found and found <= known, found - known


def test_shell_scripts_are_valid():
    scripts = [
        path
        for path in (ROOT / "scripts").iterdir()
        if path.read_bytes().startswith(b"#!/usr/bin/env bash")
    ]
    for path in scripts:
        subprocess.run(["bash", "-n", path], check=True)


def test_demonstration_data_are_written_as_shipped(tmp_path, monkeypatch):
    shutil.copytree(ROOT / "config", tmp_path / "config")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(demonstration, "SETTLED", 1)
    monkeypatch.setattr(
        demonstration, "HIDDEN", {"demonstration": demonstration.HIDDEN["demonstration"]}
    )
    demonstration.main()
    for name in ("slow", "mid", "fast"):
        written, shipped = (
            pd.read_csv(place / f"config/campaigns/demonstration/{name}.csv")
            for place in (tmp_path, ROOT)
        )
        assert list(written) == list(shipped) and len(written) == pytest.approx(len(shipped), abs=2)
        assert np.std(written["torque_Nm"]) == pytest.approx(np.std(shipped["torque_Nm"]), rel=0.1)


@pytest.mark.slow
def test_setup_compiles_and_benchmarks_have_help(tmp_path):
    commands = [("python", str(ROOT / "scripts/compile-once"))]
    commands += [("python", "-m", name, "--help") for name in ("benchmarks", "benchmarks.sweep")]
    for command in commands:
        done = run(ROOT, *command)
        assert done.returncode == 0, done.stderr
