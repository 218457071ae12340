"""Changed code makes its stage run again: the digest of a stage covers every module that its work imports."""

import re

import pytest

from jointgap.provenance import ENTRY_MODULES, closure, code_digest, expanded


def modules_of(stage):
    return {name for entry in ENTRY_MODULES[stage] for module in expanded(entry) for name in closure(module)}


@pytest.mark.parametrize("stage", ["kinematics", "optimise", "figures"])
def test_stages_that_evaluate_surrogates_depend_on_their_code(stage):
    assert {"results", "surrogate.evaluate"} <= modules_of(stage)


def test_imports_inside_functions_count():
    assert "slider_crank.model_from_campaign" in closure("campaign.stages")


def test_the_dynamics_do_not_depend_on_what_stands_above_them():
    rooms = {name.partition(".")[0] for name in closure("dynamics.simulation")}
    assert not rooms & {"campaign", "trials", "figures", "paper", "surrogate", "optimise", "track", "cli", "sweep"}


def test_nothing_of_the_product_imports_the_trials():
    stages = [stage for stage in ENTRY_MODULES if not stage.startswith("blind_")]
    names = {name for stage in stages for name in modules_of(stage)}
    assert not {name for name in names if name.startswith("trials")}


def test_a_digest_is_short_and_stable_and_differs_between_stages():
    digests = [code_digest(stage) for stage in ENTRY_MODULES]
    assert digests == [code_digest(stage) for stage in ENTRY_MODULES]
    assert len(set(digests)) == len(digests)
    assert all(re.fullmatch("[0-9a-f]{12}", digest) for digest in digests)
