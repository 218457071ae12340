"""A stage runs again if code, data or a table that it depends on has changed."""

import re
import shutil
from dataclasses import replace

import pytest

from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.core import code_digest
from jointgap.core.schema import TABLES
from jointgap.designs.stages import DESIGN_STAGES
from jointgap.scenario.stages import SCENARIO_STAGES

STAGES = {**SCENARIO_STAGES, **DESIGN_STAGES, **CAMPAIGN_STAGES}


@pytest.fixture
def changed_stages(tmp_path, monkeypatch):
    """A function: the stages whose digest changes with an edit of a copy of the package."""
    shutil.copytree(code_digest._ROOT, tmp_path / "jointgap")
    monkeypatch.setattr(code_digest, "_ROOT", tmp_path / "jointgap")
    caches = [item for item in vars(code_digest).values() if hasattr(item, "cache_clear")]

    def digests():
        for function in caches:
            function.cache_clear()
        return {name: stage.digest for name, stage in STAGES.items()}

    before = digests()

    def edited(file):
        path = tmp_path / "jointgap" / file
        path.write_text(path.read_text() + "# edited\n")
        after = digests()
        changed = {name for name, digest in after.items() if digest != before[name]}
        before.update(after)
        return changed

    yield edited
    monkeypatch.undo()
    digests()


def test_an_edit_reruns_the_stages_of_packages_that_import_it_and_no_others(changed_stages):
    assert changed_stages("app/cli.py") == set()
    networks = changed_stages("networks/network.py")
    assert {"surrogate", "kinematics", "optimise", "track"} <= networks
    assert not networks & {"simulate", "explore", "measure", "identify"}
    assert changed_stages("paper/printed.yaml") >= {"surrogate", "compare"}
    assert changed_stages("core/templates/page.html.j2") == set(STAGES)
    figures = changed_stages("scenario/figures.py")
    assert {"figures", "summarise"} <= figures and not figures & {"simulate", "surrogate"}
    assert "show" in (figures := changed_stages("campaign/figures.py"))
    assert not figures & {"measure", "identify"}
    assert changed_stages("designs/sensitivity.py") == {"sensitivity", "track-sweep"}


def test_helpers_of_the_same_module_and_types_in_annotations_count():
    assert "def _study(" in code_digest.source_of("designs.stages", "sensitivity")
    simulate = code_digest.source_of("scenario.stages", "simulate")
    assert "def simulate" in simulate and "def optimise" not in simulate
    assert "campaign.state" in code_digest.dependencies("campaign.stages", "measure")[0]


def test_a_changed_column_reruns_the_stages_that_use_its_table(monkeypatch):
    before = {name: stage.digest for name, stage in STAGES.items()}
    for name in ("gaps", "sweep_designs"):
        column, *columns = TABLES[name].columns
        changed = replace(TABLES[name], columns=(replace(column, unit="furlong"), *columns))
        monkeypatch.setitem(TABLES, name, changed)

    def current(tables):
        return tuple(replace(TABLES[table.name], path=table.path) for table in tables)

    stages = {
        name: replace(stage, reads=current(stage.reads), writes=current(stage.writes))
        for name, stage in STAGES.items()
    }
    code_digest.code_digest.cache_clear()
    changed = {name for name, stage in stages.items() if stage.digest != before[name]}
    code_digest.code_digest.cache_clear()
    assert {"identify", "sweep-designs"} <= changed
    assert not changed & {"simulate", "surrogate", "optimise"}


def test_digests_are_short_stable_and_different():
    digests = [stage.digest for stage in STAGES.values()]
    assert digests == [stage.digest for stage in STAGES.values()]
    assert len(set(digests)) == len(digests)
    assert all(re.fullmatch("[0-9a-f]{12}", digest) for digest in digests)
