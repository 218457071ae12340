"""The workflow away from home: on a cluster, inside another workflow, through the catalogue's entry."""

import json
import re

import pytest
import yaml

from benchmarks.project import ROOT, run

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


@pytest.mark.slow  # each job starts a Snakemake of its own: minutes
def test_smoke_runs_through_a_cluster_executor_with_the_same_results(smoke, fresh_project):
    submit = fresh_project / "tests/workflow/submit.sh"
    done = run(
        fresh_project,
        *["snakemake", "--configfile", "config/smoke.yaml", "--workflow-profile", "workflow/profiles/slurm"],
        *["--executor", "cluster-generic", "--cluster-generic-submit-cmd", f"'{submit}'", "--jobs", "2"],
        *["--seconds-between-status-checks", "1"],
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    assert "Submitted job" in done.stdout + done.stderr
    for path in (smoke.folder / "results/smoke").rglob("*.parquet"):
        there = fresh_project / path.relative_to(smoke.folder)
        assert there.read_bytes() == path.read_bytes(), there


def test_another_workflow_uses_the_rules_with_its_own_configuration(tmp_path):
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


def test_the_snakefile_at_the_top_asks_for_the_same_jobs_as_the_workflow_where_the_catalogue_looks_for_it():
    plans = [
        run(ROOT, "snakemake", *chosen, "--dry-run", "--forceall", "--quiet", "rules", "--cores", "1")
        for chosen in ((), ("--snakefile", "workflow/Snakefile"))
    ]
    assert all(plan.returncode == 0 for plan in plans), plans[1].stderr
    counts = [dict(re.findall(r"^(\w+) +(\d+)$", plan.stdout, re.MULTILINE)) for plan in plans]
    assert counts[0].pop("everything") == counts[1].pop("all") == "1"
    assert counts[0] == counts[1] != {}
