"""A large encoder offset and an effect are both named, from closed-form data."""

import math

import numpy as np
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.campaign.verdict_json import read
from tests.config.mechanisms import PAPER
from tests.rig.recorded_files import CAMPAIGN, write_rig
from tests.rig.test_consistency_checks import measured

pytestmark = pytest.mark.slow

FRICTION, NOISE = 5.0, 0.03  # N; of the standard deviation of a channel: as of `measured`


@pytest.mark.parametrize("degrees", [90.0, -60.0])
def test_a_zero_that_is_far_off_and_friction_beside_it_are_both_named(tmp_path, degrees):
    tables = {}
    for run, rpm in (("slow", 200), ("fast", 600)):
        frame = measured(rpm, turns=4.0)[["t", "theta", "M", "slider_acceleration"]]
        tables[run] = frame.assign(theta=(frame.theta + degrees) % 360)
    channels = {
        name: CAMPAIGN["channels"][name] for name in ("time", "crank_angle", "crank_torque")
    }
    channels["slider_acceleration"] = {"column": "slider_acceleration", "unit": "m/s^2"}
    for name, column in (("crank_torque", "M"), ("slider_acceleration", "slider_acceleration")):
        channels[name] = channels[name] | {
            "noise": {run: NOISE * float(frame[column].std()) for run, frame in tables.items()}
        }
    mechanism = yaml.safe_load(PAPER.read_text(encoding="utf-8"))
    mechanism["joints"] = {
        name: joint | {"loose": False} for name, joint in mechanism["joints"].items()
    }
    (tmp_path / "ideal.yaml").write_text(yaml.safe_dump(mechanism), encoding="utf-8")
    path = write_rig(tmp_path, **tables)
    content = yaml.safe_load(path.read_text()) | {"channels": channels, "mechanism": "ideal.yaml"}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    analyse(path, tmp_path / "results")
    verdict = read(tmp_path / "results" / "verdict.json")
    assert verdict["doubted_channels"] == ["crank_angle"]
    assert verdict["verdict"] in ("named", "named_with_remaining_misfit"), verdict["because"]
    found = {effect["name"]: effect["parameters"] for effect in verdict["effects"]}
    assert set(found) == {"encoder_offset", "slider_coulomb_friction"}
    low, high = found["encoder_offset"]["offset_rad"]["interval_90"]
    assert math.degrees(np.mean((low, high))) == pytest.approx(degrees, abs=0.5)
    assert found["slider_coulomb_friction"]["force_N"]["value"] == pytest.approx(FRICTION, rel=0.05)
