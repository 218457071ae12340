"""The workflow as a module of another workflow, and in other folders."""

import json
import re

import pytest
import yaml

from benchmarks.project import ROOT, run
from jointgap.campaign.stages import CAMPAIGN_STAGES

pytestmark = pytest.mark.integration

OUTER = """
configfile: "outer.yaml"


module paper:
    snakefile:
        {snakefile!r}
    config:
        config["mechanism_study"]


use rule * from paper as paper_*


rule study:
    default_target: True
    input:
        rules.paper_simulate.output.trajectory.replace("{{scenario}}", "mine"),
    output:
        "study.txt",
    shell:
        "jointgap describe {{input:q}} > {{output:q}}"
"""


def test_another_workflow_uses_the_rules(tmp_path):
    own = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    own["run"] = ["mine"]
    own["scenarios"] = {"mine": {"description": "50 rpm faster", "simulate": {"speed": "650 rpm"}}}
    folder = tmp_path / "another workflow"
    folder.mkdir()
    (folder / "outer.yaml").write_text(json.dumps({"mechanism_study": own}))
    (folder / "Snakefile").write_text(OUTER.format(snakefile=str(ROOT / "workflow/Snakefile")))
    done = run(folder, "snakemake", "--cores", "1")
    assert done.returncode == 0, done.stderr
    assert "crank_angle" in (folder / "study.txt").read_text()


def planned(*options, folder=ROOT) -> dict[str, str]:
    """Jobs by rule in a dry run."""
    done = run(folder, *options)
    assert done.returncode == 0, done.stderr
    return dict(re.findall(r"^(\w+) +(\d+)$", done.stdout, re.MULTILINE))


def test_both_snakefiles_plan_the_same_jobs():
    options = ("--dry-run", "--forceall", "--quiet", "rules", "--cores", "1")
    top, inner = (
        planned("snakemake", *more, *options)
        for more in ((), ("--snakefile", "workflow/Snakefile"))
    )
    assert top.pop("everything") == inner.pop("all") == "1"
    assert top == inner != {}


def test_an_interrupted_campaign_resumes_in_any_folder(fresh_project, tmp_path):
    text = (ROOT / "config/campaigns/demonstration.yaml").read_text()
    text = text.replace("name: demonstration", "name: own")
    own = tmp_path / "our rig's data/plan.yaml"
    own.parent.mkdir()
    own.write_text(text.replace("../mechanisms", str(ROOT / "config/mechanisms")))
    (own.parent / "demonstration").symlink_to(ROOT / "config/campaigns/demonstration")
    for table in CAMPAIGN_STAGES["measure"].outputs():
        place = fresh_project / "results/campaigns/own" / table
        place.parent.mkdir(parents=True, exist_ok=True)
        place.touch()
    command = ["make", "--old-file=set-up", "campaign", f"CAMPAIGN={own}"]
    jobs = planned(*command, "ARGS=--dry-run", folder=fresh_project)
    remaining = {"identify", "show", "track", "report"}
    assert {
        name.removeprefix("campaign_") for name in jobs if name.startswith("campaign_")
    } == remaining
    own.write_text(own.read_text().replace("role: confirm", "role: confrim"))
    done = run(fresh_project, *command)
    said = done.stdout + done.stderr
    assert done.returncode != 0 and "Traceback" not in said
    assert re.search(rf"{re.escape(str(own))}: .*role.*confirm", said)
