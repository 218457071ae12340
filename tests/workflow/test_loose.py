"""Jobs of a scenario by its loose joints."""

import re

import pytest
import yaml

from benchmarks.project import ROOT, run

pytestmark = pytest.mark.integration

IDEAL = {"crank_pin": {"loose": False}, "piston_pin": {"loose": False}}
PIVOT = {"crank_pivot": {"loose": True}}
JOINTS = {"none": IDEAL, "one": IDEAL | PIVOT, "two": {}, "three": PIVOT}


def planned(tmp_path, *names):
    """Jobs by rule in a dry run of scenarios with these joints."""
    configuration = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    configuration |= {"run": list(names), "campaigns": []}
    configuration["scenarios"] = {
        name: {"mechanism": {"base": configuration["mechanism"], "joints": JOINTS[name]}}
        for name in names
    }
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(configuration))
    options = ["--configfile", str(tmp_path / "config.yaml"), "--dry-run", "--forceall"]
    options += ["--quiet", "rules"]
    done = run(ROOT, "snakemake", *options, "--cores", "1")
    assert done.returncode == 0, done.stderr
    return {
        rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", done.stdout, re.MULTILINE)
    }


def test_each_output_of_each_loose_joint_has_a_network(tmp_path):
    alone = planned(tmp_path, "none")
    assert alone["simulate"] == alone["animate"] == 1
    assert set(alone) <= {"simulate", "animate", "everything", "total"}
    assert planned(tmp_path, "one")["surrogate"] == 4
    together = planned(tmp_path, *JOINTS)
    wanted = {"simulate": 4, "surrogate": 4 + 8 + 12, "compare": 3, "overview": 1}
    assert {rule: together[rule] for rule in wanted} == wanted
