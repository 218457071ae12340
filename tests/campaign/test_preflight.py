"""What a preflight found, as its tables hold it and as it is printed."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.project import ROOT
from jointgap.campaign import plan
from jointgap.config.load import load_campaign
from jointgap.core import parquet, schema
from jointgap.identification.preflight import Preflight

FOUND = Preflight(
    effects=pd.DataFrame(
        [
            ("slider_coulomb_friction", "force_N", 0.0787, "N", 0.98, False, True),
            ("rod_flexibility", "frequency_Hz", 157.2, "", 50.0, True, True),
            ("harmonic_force", "force_N", 0.0567, "", 0.6, False, True),
            ("sensor_bias:crank_torque", "bias", 0.0084, "N*m", 0.1, False, True),
            ("crank_unbalance", "unbalance_kg_m", np.nan, "kg*m", np.nan, False, False),
            ("gas_pressure", "force_N", np.nan, "N", np.nan, False, False),
        ],
        columns=["label", "parameter", "smallest_detectable", "unit", "typical", "falls", "detectable"],
    ),
    cosines=pd.DataFrame(),
    merged=[],
    undetectable=["crank_unbalance"],
    failed={"gas_pressure": "the slider jams"},
    sizes={},
    assumed=("crank_torque in run slow: 0.0042 N m, 2 % of what it varies by",),
)
NO_ADVICE = pd.DataFrame(columns=["change", "newly_detectable", "separated", "gain"])


@pytest.fixture
def planned(tmp_path, monkeypatch):
    """Tables of `FOUND`, written and read again."""
    monkeypatch.setattr(plan, "preflight", lambda *given: FOUND)
    frames = plan.preflight_tables(load_campaign(ROOT / "config/campaigns/demonstration.yaml"), 0.01)
    for name, table in (("detectable", schema.DETECTABLE), ("confusability", schema.CONFUSABILITY)):
        parquet.write(table, frames[name], tmp_path / name)
        frames[name] = parquet.read(table, tmp_path / name)
    return frames | {"advice": NO_ADVICE}


def test_sizes_stand_with_their_unit_in_the_direction_in_which_they_show(planned):
    said = plan.preflight_in_words(**planned).splitlines()
    assert said[1:5] == [
        "  Coulomb friction of the slider: 0.0787 N",
        "  bending of the rod: natural frequency of the mode up to 157.2 Hz",
        "  a force on the slider that swings at a frequency of its own: amplitude 0.0567 N",
        "  a bias of the sensor of crank torque: 0.0084 N m",
    ]


def test_what_could_not_be_simulated_is_not_called_undetectable(planned):
    said = plan.preflight_in_words(**planned).splitlines()
    assert "Not detectable at any size within bounds: an unbalance of the crank" in said
    gas = "the pressure of a closed gas volume on the slider"
    assert f"Could not be simulated, so what size shows is not known: {gas} (the slider jams)" in said


def test_a_verdict_says_nothing_of_what_cannot_be_seen_or_simulated(planned):
    assert plan.undetectable(planned["detectable"]) == ["crank_unbalance", "gas_pressure"]


def test_the_noise_that_was_assumed_is_printed(planned):
    lines = plan.preflight_in_words(**planned).splitlines()
    assert lines[-2:] == [
        "Assumed noise, where the campaign states none:",
        "  crank torque in run slow: 0.0042 N m, 2 % of what it varies by",
    ]
    assert "ssumed" not in plan.preflight_in_words(**planned | {"detectable": planned["detectable"].assign(assumed="")})


def test_a_further_run_takes_no_name_that_a_run_has():
    campaign = load_campaign(ROOT / "config/campaigns/demonstration.yaml")
    named = campaign.model_copy(
        update={"runs": (campaign.runs[0].model_copy(update={"id": "600_rpm"}), *campaign.runs[1:])}
    )
    assert [run.id for run in plan.extended(named).runs] == ["600_rpm", "mid", "fast", "75_rpm", "further_600_rpm"]
