"""`make run CONFIG=mine.yaml`: somebody's own mechanism, with networks and the paper only where they are asked for."""

import json

import pytest
import yaml

from benchmarks.project import ROOT, run

pytestmark = pytest.mark.integration

OWN = {
    "mechanism": str(ROOT / "config/mechanisms/compressor.yaml"),
    "simulate": {"speed": "1450 rpm", "revolutions": 2, "samples_per_revolution": 1800, "tolerance": "1e-9 m"},
    "surrogate": {
        "iterations": 20,
        "seeds": [0],
        "clearance_sampling": 10,
        "regularised_neurons": 20,
        "regularised_iterations": 10,
    },
    "optimise": {
        "genetic": {"population": 8, "generations": 3},
        "ensemble": {"members": 3, "settled_revolution": 2},
    },
    "figures": {"animation_frames": 6},
}


def made(project, **keys):
    """The folder of results of the mechanism, run with these keys."""
    file = project / "mine.yaml"
    file.write_text(yaml.safe_dump({"scenarios": {"mine": OWN}, **keys}))
    done = run(project, "make", "--old-file=set-up", "run", "CONFIG=mine.yaml", "CORES=2")
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    return project / "results/mine"


def test_an_own_mechanism_is_optimised_without_networks_and_without_the_paper(fresh_project):
    results = made(fresh_project)
    known = json.loads((results / "summary.json").read_text())
    assert known["headline"].startswith("Crank 25.0 mm")
    assert (results / "optimise/resimulated.parquet").is_file() and (results / "figures/valley.png").is_file()
    assert not (results / "surrogate").exists() and not list(results.glob("comparison*"))


def test_one_command_gives_the_whole_chain_where_it_is_asked_for(fresh_project):
    results = made(fresh_project, networks=True, paper=True)
    assert len(list(results.glob("surrogate/*/history.parquet"))) == 8
    assert (results / "comparison.html").is_file() and (results / "figures/held_out.png").is_file()
