"""Changed code makes its stage run again: the digest of a stage covers every module that its work
imports."""

import re
from dataclasses import replace

from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.core import stage as stage_module
from jointgap.core.schema import TABLES
from jointgap.core.stage import closure, code_digest, code_of
from jointgap.designs.stages import DESIGN_STAGES
from jointgap.scenario.stages import SCENARIO_STAGES

ALL = {**SCENARIO_STAGES, **DESIGN_STAGES, **CAMPAIGN_STAGES}
SURROGATES = {"scenario.results", "scenario.trained", "networks.network"}
COVERED = {
    "kinematics": SURROGATES,
    "optimise": SURROGATES,
    "figures": SURROGATES | {"scenario.figures", "scenario.animation"},  # imported by name
    "surrogate": {"dynamics.simulation"},  # a finer one of its own
    "noise": {"campaign.state", "rig.model"},  # named in an annotation alone
    "conclude": {"campaign.figures"},
    "track-sweep": {"designs.sweep", "designs.sensitivity", "designs.optimise_robust"},
}


def test_a_stage_depends_on_all_code_that_its_work_imports_and_on_none_of_its_neighbours():
    for stage, modules in COVERED.items():
        assert modules <= code_of(ALL[stage].function)[1], stage
    assert "samples_per_revolution" in code_of(SCENARIO_STAGES["surrogate"].function)[0]
    assert "identification.problem" in closure("campaign.state")  # imports inside functions count
    own, modules = code_of(SCENARIO_STAGES["simulate"].function)
    assert "def simulate" in own and "def optimise" not in own and "_MOTION = " in own
    assert not {
        name for name in modules if name.startswith(("networks.", "lengths", "scenario.figures"))
    }
    shown = (
        "core.plot",
        "core.page",
        "networks",
    )  # how designs are shown is no code that measures them
    modules = code_of(ALL["sweep-designs"].function)[1]
    assert not {
        name
        for name in modules
        if name.startswith(shown) or name.endswith(("_page", "_figures", "growth"))
    }
    rooms = {name.partition(".")[0] for name in closure("dynamics.simulation")}
    assert not rooms & {
        "campaign",
        "scenario",
        "paper",
        "networks",
        "lengths",
        "rig",
        "designs",
        "app",
    }


def test_a_changed_column_makes_the_stages_run_again_that_read_or_write_its_table(monkeypatch):
    def changed(*tables):
        """Stages whose digest changes with a column of these tables."""
        before = {name: stage.digest for name, stage in ALL.items()}
        for name in tables:
            first, *others = TABLES[name].columns
            monkeypatch.setitem(
                TABLES,
                name,
                replace(TABLES[name], columns=(replace(first, unit="furlong"), *others)),
            )

        def swapped(given):
            return tuple(
                TABLES[one.name].at(one.path) if one.name in tables else one for one in given
            )

        for cached in (code_digest, stage_module._tables_of):
            cached.cache_clear()
        after = {
            name: replace(stage, reads=swapped(stage.reads), writes=swapped(stage.writes)).digest
            for name, stage in ALL.items()
        }
        monkeypatch.undo()
        for cached in (code_digest, stage_module._tables_of):
            cached.cache_clear()
        return {name for name in ALL if after[name] != before[name]}

    # of which the last one is written by a function further down
    assert {"simulate", "surrogate", "optimise", "figures", "sweep-designs"} <= changed(
        "trajectory", "sweep_designs"
    )
    of_a_campaign = changed("gaps")
    assert "confirm" in of_a_campaign and not of_a_campaign & {"simulate", "surrogate", "optimise"}


def test_a_digest_is_short_and_stable_and_differs_between_stages():
    digests = [stage.digest for stage in ALL.values()]
    assert digests == [stage.digest for stage in ALL.values()] and len(set(digests)) == len(digests)
    assert all(re.fullmatch("[0-9a-f]{12}", digest) for digest in digests)
