"""The page with what each stage reads and writes, and the rules that run them, agree with the records of the stages."""

import re

from benchmarks.project import ROOT, run
from jointgap.scenario.stages import SCENARIO_STAGES


def test_the_page_is_what_the_records_say():
    done = run(ROOT, "scripts/workflow-page")
    assert done.returncode == 0, done.stderr
    assert (ROOT / "docs/workflow.md").read_text(encoding="utf-8") == done.stdout


def test_every_stage_of_a_scenario_has_its_rule_or_is_asked_for_by_one():
    rules = "".join(path.read_text() for path in (ROOT / "workflow/rules").glob("*.smk"))
    names = set(re.findall(r"^(?:use rule scenario_stage as|rule) (\w+)", rules, re.MULTILINE))
    assert {name.replace("-", "_") for name in SCENARIO_STAGES} - {"report"} <= names
    assert 'digest_of("report")' in rules
