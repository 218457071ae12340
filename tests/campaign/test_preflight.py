"""What a preflight found, as its tables hold it and as it is printed."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.project import ROOT
from jointgap import tables
from jointgap.campaign import preflight
from jointgap.campaign.tables_of_identification import undetectable
from jointgap.config.load import load_campaign
from jointgap.identification.advice import Preflight

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
    assumed=("crank_torque in run slow: 0.0042 N*m, 2 % of what it varies by",),
)
NO_ADVICE = pd.DataFrame(columns=["change", "newly_detectable", "separated", "gain"])


@pytest.fixture
def planned(tmp_path, monkeypatch):
    """Tables of `FOUND`, written and read again."""
    monkeypatch.setattr(preflight, "preflight", lambda *given: FOUND)
    frames = preflight.preflight_tables(load_campaign(ROOT / "config/campaigns/demonstration.yaml"), 0.01)
    for name, table in (("detectable", tables.DETECTABLE), ("confusability", tables.CONFUSABILITY)):
        tables.write(table, frames[name], tmp_path / name)
        frames[name] = tables.read(table, tmp_path / name)
    return frames


def test_sizes_stand_with_their_unit_in_the_direction_in_which_they_show(planned):
    said = preflight.in_words(planned["detectable"], planned["confusability"], NO_ADVICE).splitlines()
    assert said[1:5] == [
        "  slider_coulomb_friction: force_N 0.0787 N",
        "  rod_flexibility: frequency_Hz up to 157 Hz",
        "  harmonic_force: force_N 0.0567 N",
        "  sensor_bias:crank_torque: bias 0.0084 N*m",
    ]


def test_what_could_not_be_simulated_is_not_called_undetectable(planned):
    said = preflight.in_words(planned["detectable"], planned["confusability"], NO_ADVICE).splitlines()
    assert "Not detectable at any size within bounds: crank_unbalance" in said
    assert "Could not be simulated, so what size shows is not known: gas_pressure (the slider jams)" in said


def test_a_verdict_says_nothing_of_what_cannot_be_seen_or_simulated(planned):
    assert undetectable(planned["detectable"]) == ["crank_unbalance", "gas_pressure"]


def test_the_noise_that_was_assumed_is_printed(planned):
    frames = (planned["confusability"], NO_ADVICE)
    lines = preflight.in_words(planned["detectable"], *frames).splitlines()
    assert lines[-2:] == ["Assumed noise, where the campaign states none:", f"  {FOUND.assumed[0]}"]
    assert "ssumed" not in preflight.in_words(planned["detectable"].assign(assumed=""), *frames)


def test_a_further_run_takes_no_name_that_a_run_has():
    campaign = load_campaign(ROOT / "config/campaigns/demonstration.yaml")
    named = campaign.model_copy(
        update={"runs": (campaign.runs[0].model_copy(update={"id": "600_rpm"}), *campaign.runs[1:])}
    )
    assert [run.id for run in preflight.extended(named).runs] == ["600_rpm", "mid", "fast", "75_rpm", "further_600_rpm"]
