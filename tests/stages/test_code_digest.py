"""Changed code makes its stage run again: the digest of a stage covers every module that its work imports."""

import re
from dataclasses import replace

import pytest

from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.core import stage as stage_module
from jointgap.core.schema import TABLES
from jointgap.core.stage import closure, code_digest, code_of
from jointgap.designs.stages import DESIGN_STAGES
from jointgap.scenario.stages import SCENARIO_STAGES

ALL = {**SCENARIO_STAGES, **DESIGN_STAGES, **CAMPAIGN_STAGES}


def modules_of(stage):
    return code_of(ALL[stage].function)[1]


@pytest.mark.parametrize("stage", ["kinematics", "optimise", "figures"])
def test_stages_that_evaluate_surrogates_depend_on_their_code(stage):
    assert {"scenario.results", "scenario.trained", "networks.network"} <= modules_of(stage)


def test_the_fine_simulation_for_the_second_surrogate_is_part_of_its_stage():
    own, modules = code_of(SCENARIO_STAGES["clearance"].function)
    assert "clearance_sampling" in own and "dynamics.simulation" in modules


def test_a_stage_depends_on_its_own_function_and_on_none_of_its_neighbours():
    own, modules = code_of(SCENARIO_STAGES["simulate"].function)
    assert "def simulate" in own and "def optimise" not in own and "_MOTION = " in own
    assert not {name for name in modules if name.startswith(("networks.", "lengths", "scenario.figures"))}


def test_what_a_stage_is_given_counts_though_it_is_named_in_an_annotation_alone():
    assert {"campaign.state", "rig.model"} <= modules_of("noise")


def test_how_designs_are_shown_is_no_code_that_measures_them():
    shown = {name for name in modules_of("sweep-designs") if name.startswith(("core.plot", "core.page", "networks"))}
    shown |= {name for name in modules_of("sweep-designs") if name.endswith(("_page", "_figures", "growth"))}
    assert shown <= {"core.words"}


def test_imports_inside_functions_count():
    assert "identification.problem" in closure("campaign.state")


def test_figures_that_are_imported_by_name_count():
    assert {"scenario.figures", "scenario.animation"} <= modules_of("figures")
    assert "campaign.figures" in modules_of("conclude")


def test_what_is_published_of_a_sweep_depends_on_every_study():
    assert {"designs.sweep", "designs.sensitivity", "designs.optimise_robust"} <= modules_of("track-sweep")


def changed_by(table, monkeypatch):
    """Stages whose digest changes with a column of `table`."""
    before = {name: stage.digest for name, stage in ALL.items()}
    (first, *others) = TABLES[table].columns
    changed = replace(TABLES[table], columns=(replace(first, unit="furlong"), *others))

    def swapped(tables):
        return tuple(changed.at(one.path) if one.name == table else one for one in tables)

    monkeypatch.setitem(TABLES, table, changed)
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


def test_a_changed_column_makes_the_stages_run_again_that_read_or_write_its_table(monkeypatch):
    assert {"simulate", "surrogate", "optimise"} <= changed_by("trajectory", monkeypatch)
    assert changed_by("optimise_valley", monkeypatch) >= {"optimise", "figures"}


def test_a_changed_column_of_a_campaigns_table_simulates_no_scenario_again(monkeypatch):
    assert "confirm" in (changed := changed_by("gaps", monkeypatch)) and not changed & {
        "simulate",
        "surrogate",
        "optimise",
    }


def test_a_table_that_is_written_by_a_function_further_down_counts(monkeypatch):
    assert "sweep-designs" in changed_by("sweep_designs", monkeypatch)


def test_the_dynamics_do_not_depend_on_what_stands_above_them():
    rooms = {name.partition(".")[0] for name in closure("dynamics.simulation")}
    assert not rooms & {"campaign", "scenario", "paper", "networks", "lengths", "rig", "designs", "app"}


def test_a_digest_is_short_and_stable_and_differs_between_stages():
    digests = [stage.digest for stage in ALL.values()]
    assert digests == [stage.digest for stage in ALL.values()]
    assert len(set(digests)) == len(digests)
    assert all(re.fullmatch("[0-9a-f]{12}", digest) for digest in digests)
