"""Only the scoring of the workflow reads the ground truth."""

import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

pytestmark = pytest.mark.integration

ROOT = Path(__file__).parents[2]


class Files(NamedTuple):
    """Inputs and outputs of a rule."""

    inputs: set[str]
    outputs: set[str]


@pytest.fixture(scope="module")
def rules() -> dict[str, Files]:
    """Every rule with its files, as Snakemake draws them."""
    run = dry_run("--filegraph")
    found = {}
    for node in re.findall(r"label=<<table.*?</table>>", run.stdout, re.DOTALL):
        inputs, _, outputs = node.partition("output &rarr;")
        paths = (
            set(re.findall(r'"monospace">(results/[^<]*)<', part)) for part in (inputs, outputs)
        )
        name = re.search(r'point-size="18">(\w+)<', node)[1]
        found[name] = Files(
            *({re.sub(r",(?:[^{}]|\{[^{}]*\})*", "", path) for path in part} for part in paths)
        )  # no constraints
    return found


def test_a_partial_set_is_named_in_its_score():
    shown = ("--dry-run", "--printshellcmds")
    printed = dry_run("trials=2", *shown).stdout
    assert printed.count("validation conceal") == 2
    assert "score 'small, the first 2 of 6 trials' " in printed
    limited = dry_run("trials=2", "seconds=90", *shown).stdout
    assert len(re.findall(r"verdicts/\w+\.json 90 >", limited)) == 2
    refused = dry_run("batches=1", *shown)
    assert "give `--config trials=N` for the first N trials" in refused.stdout + refused.stderr


def dry_run(*more: str) -> subprocess.CompletedProcess:
    command = [sys.executable, *"-m snakemake --snakefile workflow/blind/Snakefile".split()]
    command += ["--config", "set=small", *more, "--forceall", "--nolock"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)


def test_only_scoring_reads_the_ground_truth(rules):
    assert set(rules) == {"conceal", "analyse", "score", "blind"}
    for kind, wanted in (("inputs", {"score"}), ("outputs", {"conceal"})):
        assert {
            name for name, files in rules.items() if "/truth/" in str(getattr(files, kind))
        } == wanted
    assert rules["analyse"] == Files(
        {"results/blind/{set}/campaigns/{trial}"}, {"results/blind/{set}/verdicts/{trial}.json"}
    )
    text = (ROOT / "workflow/blind/Snakefile").read_text()
    analyse = text[text.index("rule analyse") : text.index("rule score")].lower()
    assert "truth" not in analyse
