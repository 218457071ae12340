"""`make run CONFIG=mine.yaml` with a user's own mechanism."""

import json
import re

import pytest
import yaml

from benchmarks.project import ROOT, run

pytestmark = pytest.mark.integration

SIMULATE = {"speed": "1450 rpm", "revolutions": 2, "tolerance": "1e-9 m"}
SIMULATE["samples_per_revolution"] = 1800
GENETIC = {"population": 8, "generations": 3}
OWN = {
    "mechanism": str(ROOT / "config/mechanisms/compressor.yaml"),
    "simulate": SIMULATE,
    "optimise": {"genetic": GENETIC, "ensemble": {"members": 3, "settled_revolution": 2}},
    "figures": {"animation_frames": 6},
}


def make(project, *options, **keys):
    (project / "mine.yaml").write_text(yaml.safe_dump({"scenarios": {"mine": OWN}, **keys}))
    done = run(project, "make", "--old-file=set-up", "run", "CONFIG=mine.yaml", "CORES=2", *options)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    return done.stdout


def test_an_own_mechanism_is_optimised_without_networks_unless_requested(fresh_project):
    make(fresh_project)
    results = fresh_project / "results/mine"
    known = json.loads((results / "summary.json").read_text())
    assert known["headline"].startswith("Crank 25.00 mm")
    assert (results / "optimise/resimulated.parquet").is_file()
    assert (results / "figures/valley.png").is_file()
    assert not (results / "surrogate").exists() and not list(results.glob("comparison*"))
    planned = make(fresh_project, "ARGS=--dry-run", networks=True, paper=True)
    counts = dict(re.findall(r"^(\w+) +(\d+)$", planned, re.MULTILINE))
    assert (counts["surrogate"], counts["compare"]) == ("8", "1") and "simulate" not in counts
