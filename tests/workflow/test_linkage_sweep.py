"""`make sweep CONFIG=mine.yaml` with a linkage."""

import pandas as pd
import pytest
import yaml

from benchmarks.project import run

pytestmark = pytest.mark.integration

SIMULATE = {"speed": "120 rpm", "revolutions": 1, "samples_per_revolution": 180}
SWEEP = {
    "number": 64,
    "parameters": {
        "clearance": {"from": "0.02 mm", "to": "0.1 mm"},
        "bodies.rocker.length": {"from": "240 mm", "to": "260 mm"},
    },
}
OWN = {"mechanism": "four_bar", "simulate": SIMULATE | {"tolerance": "1e-9 m"}, "sweep": SWEEP}


def test_a_linkage_is_swept_and_make_run_refuses_it(fresh_project):
    scenarios = {"mine": OWN | {"sensitivity": {}}}
    (fresh_project / "mine.yaml").write_text(yaml.safe_dump({"scenarios": scenarios}))
    command = ("make", "--old-file=set-up", "CONFIG=mine.yaml", "CORES=2")
    done = run(fresh_project, *command, "sweep")
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    results = fresh_project / "results/mine"
    assert len(pd.read_parquet(results / "sweep/designs")) == 64
    assert "swing of the rocker" in (results / "sensitivity/summary.md").read_text()
    refused = run(fresh_project, *command, "run")
    assert "scenario mine: mechanism: is a general linkage" in refused.stdout + refused.stderr
