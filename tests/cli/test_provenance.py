"""Changed code makes its stage run again: the digest of a stage covers every module that decides what it writes."""

import re
from pathlib import Path

import pytest

import jointgap
from jointgap.provenance import CODE, code_digest

PACKAGE = Path(jointgap.__file__).parent
SHARED = {"config", "errors", "tables"}  # what they say reaches a stage as options, or as columns of its own tables


def imported(part):
    """Modules and folders of the package that the sources of `part` import."""
    place = PACKAGE / part
    sources = place.rglob("*.py") if place.is_dir() else [place]
    names = {name for file in sources for name in re.findall(r"from jointgap\.(\w+)", file.read_text(encoding="utf-8"))}
    return {name if (PACKAGE / name).is_dir() else f"{name}.py" for name in names - SHARED}


@pytest.mark.parametrize("stage", sorted(CODE))
def test_a_digest_covers_what_the_sources_of_its_stage_import(stage):
    named = {part.partition("/")[0] for part in CODE[stage]}  # a folder of which files are listed has been thought of
    missing = {name for part in CODE[stage] for name in imported(part)} - named
    assert not missing


@pytest.mark.parametrize("stage", ["kinematics", "optimise", "figures"])
def test_stages_that_evaluate_surrogates_depend_on_their_code(stage):
    assert {"results.py", "surrogate"} <= set(CODE[stage])


def test_what_conceals_blind_trials_is_covered_file_by_file():
    asked, seen = ["conceal"], set()
    while asked:
        name = asked.pop()
        seen.add(name)
        text = (PACKAGE / f"blind/{name}.py").read_text(encoding="utf-8")
        asked += set(re.findall(r"from jointgap\.blind\.(\w+)", text)) - seen
    assert {f"blind/{name}.py" for name in seen} <= set(CODE["blind_conceal"])


def test_a_digest_is_short_and_stable_and_differs_between_stages():
    digests = [code_digest(stage) for stage in CODE]
    assert digests == [code_digest(stage) for stage in CODE]
    assert len(set(digests)) == len(digests)
    assert all(re.fullmatch("[0-9a-f]{12}", digest) for digest in digests)
