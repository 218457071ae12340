"""A crank that turns clockwise: what a user reads has the axes and signs of the files."""

import json

import numpy as np
import pandas as pd
import pytest
import yaml

from benchmarks.project import ROOT
from jointgap.campaign import fits_on_disk as axes
from jointgap.campaign.augment import missing_force
from jointgap.config import Mechanism, load_mechanism

pytestmark = pytest.mark.integration


def spans(*pairs):
    rows = pd.DataFrame(pairs, columns=["start_deg", "end_deg"])
    return rows.assign(run="slow", channel="crank_angle", mean=1.0)


def test_windows_of_a_clockwise_run_lie_at_the_angles_of_its_file():
    found = axes.map_as_read(spans((20.0, 150.0), (350.0, 10.0), (0.0, 360.0), (340.0, 360.0)), {"slow"})
    places = [tuple(row) for row in found[["start_deg", "end_deg"]].to_numpy()]
    assert places == [(210.0, 340.0), (350.0, 10.0), (0.0, 360.0), (0.0, 20.0)]
    assert (found["mean"] == -1.0).all()  # an angle that reads too much reads too little in the mirror


def test_other_runs_and_the_signs_of_other_channels_stay():
    own = spans((20.0, 150.0))
    pd.testing.assert_frame_equal(axes.map_as_read(own, {"fast"}), own)
    torque = own.assign(channel="crank_torque")
    assert axes.map_as_read(torque, {"slow"})["mean"].iloc[0] == 1.0


def test_residuals_of_angles_are_those_of_the_file():
    columns = ("measured", "base", "augmented", "whitened_base", "whitened_augmented")
    frame = pd.DataFrame({"run": ["slow", "slow"], "channel": ["crank_angle", "crank_torque"], "crank_angle": 2.0})
    found = axes.residuals_as_read(frame.assign(**dict.fromkeys(columns, 3.0)), {"slow"})
    assert (found["crank_angle"] == -2.0).all()
    assert found[list(columns)].to_numpy().tolist() == [[-3.0] * 5, [3.0] * 5]


def test_the_missing_force_of_a_clockwise_run_is_the_mirror_image():
    data = load_mechanism(ROOT / "config/mechanisms/ideal_joints.yaml").model_dump()
    slider = data["slider"] | {"offset": 0.02}
    effects = [
        {"name": "slider_load_friction", "parameters": {"coefficient": 0.1}},
        {"name": "crank_coulomb_friction", "parameters": {"torque_N_m": 0.5}},
    ]

    def forces(offset, clockwise):
        base = data | {"slider": slider | {"offset": offset}}
        models = (Mechanism.model_validate(base | {"effects": own}) for own in ([], effects))
        return missing_force(*models, {"slow": 20.0}, clockwise)

    plain, turned = forces(0.02, ()), forces(-0.02, ("slow",)).iloc[::-1].reset_index(drop=True)
    np.testing.assert_allclose(turned["crank_angle"], 2.0 * np.pi - plain["crank_angle"], atol=1e-12)
    np.testing.assert_allclose(turned["slider_velocity"], plain["slider_velocity"], atol=1e-12)
    np.testing.assert_allclose(turned["slider_force"], plain["slider_force"], atol=1e-9)
    np.testing.assert_allclose(turned["crank_torque"], -plain["crank_torque"], atol=1e-12)
    assert plain["slider_force"].abs().max() > 0.1


@pytest.mark.slow
def test_the_clockwise_twin_of_a_campaign_has_the_same_verdict_at_mirrored_angles(tmp_path):
    from jointgap.campaign.analyse import analyse

    source = ROOT / "config/campaigns"
    plan = yaml.safe_load((source / "demonstration.yaml").read_text())
    for run in plan["runs"]:
        samples = pd.read_csv(source / run["file"])
        samples[["angle_deg", "torque_Nm"]] *= -1.0
        run |= {"file": f"{run['id']}.csv", "direction": "clockwise"}
        samples.to_csv(tmp_path / run["file"], index=False)
    mechanism = yaml.safe_load((source / plan["mechanism"]).read_text()) | {"gravity_direction": "90 deg"}
    (tmp_path / "twin.yaml").write_text(yaml.safe_dump(plan | {"mechanism": mechanism}))
    plain, twin = (
        analyse(path, tmp_path / name)
        for path, name in ((source / "demonstration.yaml", "plain"), (tmp_path / "twin.yaml", "twin"))
    )
    assert twin["verdict"] == plain["verdict"] == "named"
    assert twin["effects"][0]["parameters"]["force_N"]["value"] == pytest.approx(
        plain["effects"][0]["parameters"]["force_N"]["value"], rel=1e-6
    )
    for one, other in zip(twin["where"], plain["where"], strict=True):
        start, end = other["crank_angle_deg"]
        assert one["crank_angle_deg"] == [360.0 - end, 360.0 - start]
    assert twin["nuisances"]["first_angle@slow"]["value"] == pytest.approx(
        -plain["nuisances"]["first_angle@slow"]["value"]
    )
    assert json.loads((tmp_path / "twin/verdict.json").read_text())["where"] == twin["where"]
