"""Which jobs a scenario asks for follows from its loose joints."""

import re

import pytest
import yaml

from benchmarks.project import ROOT, run

pytestmark = pytest.mark.integration

IDEAL = {"crank_pin": {"loose": False}, "piston_pin": {"loose": False}}
JOINTS = {
    "none": (IDEAL, 0),
    "one": (IDEAL | {"crank_pivot": {"loose": True}}, 4),
    "two": ({}, 8),
    "three": ({"crank_pivot": {"loose": True}}, 12),
}


def planned(tmp_path, *names):
    """Jobs by rule in a dry run of scenarios with these joints."""
    configuration = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    configuration["run"] = list(names)
    configuration["campaigns"] = []
    configuration["scenarios"] = {
        name: {"mechanism": {"base": configuration["mechanism"], "joints": JOINTS[name][0]}} for name in names
    }
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(configuration))
    command = (
        "snakemake",
        "--configfile",
        str(tmp_path / "config.yaml"),
        "--dry-run",
        "--forceall",
        "--quiet",
        "rules",
    )
    done = run(ROOT, *command, "--cores", "1")
    assert done.returncode == 0, done.stderr
    return {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", done.stdout, re.MULTILINE)}


@pytest.mark.parametrize("name", ["one", "two", "three"])
def test_there_is_a_network_for_each_output_of_each_loose_joint(tmp_path, name):
    assert planned(tmp_path, name)["surrogate"] == JOINTS[name][1]


def test_a_scenario_without_loose_joints_is_simulated_and_animated_and_holds_up_no_other(tmp_path):
    alone = planned(tmp_path, "none")
    assert alone["simulate"] == alone["animate"] == 1 and set(alone) <= {
        "simulate",
        "animate",
        "everything",
        "total",
    }
    beside = planned(tmp_path, "none", "two", "one")
    assert (beside["simulate"], beside["surrogate"], beside["compare"], beside["overview"]) == (3, 12, 2, 1)
