"""Tables and printed summary of a preflight."""

import numpy as np
import pandas as pd

from benchmarks.project import ROOT
from jointgap.campaign import plan
from jointgap.config.load import load_campaign
from jointgap.core import parquet, schema
from jointgap.identification.preflight import Preflight

ROWS = [
    ("slider_coulomb_friction", "force_N", 0.0787, "N", 0.98, False, True),
    ("rod_flexibility", "frequency_Hz", 157.2, "", 50.0, True, True),
    ("sensor_bias:crank_torque", "bias", 0.0084, "N*m", 0.1, False, True),
    ("crank_unbalance", "unbalance_kg_m", np.nan, "kg*m", np.nan, False, False),
    ("gas_pressure", "force_N", np.nan, "N", np.nan, False, False),
]
COLUMNS = ["label", "parameter", "smallest_detectable", "unit", "typical", "falls", "detectable"]
FOUND = Preflight(
    effects=pd.DataFrame(ROWS, columns=COLUMNS),
    cosines=pd.DataFrame(),
    merged=[],
    undetectable=["crank_unbalance"],
    failed={"gas_pressure": "the slider jams"},
    sizes={},
    assumed=("crank_torque in run slow: 0.0042 N m, 2 % of its variation",),
)
CAMPAIGN = load_campaign(ROOT / "config/campaigns/demonstration.yaml")


def test_sizes_have_units_and_failures_are_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(plan, "preflight", lambda *given: FOUND)
    frames = plan.preflight_tables(CAMPAIGN, 0.01)
    for name, table in (("detectable", schema.DETECTABLE), ("confusability", schema.CONFUSABILITY)):
        parquet.write(table, frames[name], tmp_path / name)
        frames[name] = parquet.read(table, tmp_path / name)
    frames["advice"] = pd.DataFrame(columns=["change", "newly_detectable", "separated", "gain"])
    lines = plan.preflight_summary(**frames).splitlines()
    for shown in (
        "  Coulomb friction of the slider: 0.0787 N",
        # the direction in which it shows
        "  bending of the rod: natural frequency of the mode up to 157.2 Hz",
        "  a bias of the sensor of crank torque: 0.0084 N m",
        "Not detectable with these runs: an unbalance of the crank",
        "  crank torque in run slow: 0.0042 N m, 2 % of its variation",
    ):
        assert shown in lines
    assert any("Detectability unknown" in line and "the slider jams" in line for line in lines)
    assert plan.undetectable(frames["detectable"]) == ["crank_unbalance"]


def test_further_runs_are_called_by_their_speed():
    further = plan.extended(CAMPAIGN).runs[len(CAMPAIGN.runs) :]
    assert [run.id for run in further] == ["at 75 rpm", "at 600 rpm"]
