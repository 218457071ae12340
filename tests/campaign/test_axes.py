"""Results of a clockwise crank have the axes and signs of its files."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.project import ROOT
from jointgap.campaign import tables as axes
from jointgap.campaign.augment import force_difference
from jointgap.config import Mechanism, load_mechanism

pytestmark = pytest.mark.integration


def spans(*pairs):
    rows = pd.DataFrame(pairs, columns=["start_deg", "end_deg"])
    return rows.assign(run="slow", channel="crank_angle", mean=1.0)


def test_windows_and_residuals_of_a_clockwise_run_are_those_of_its_file():
    found = axes.spans_in_file_convention(
        spans((20.0, 150.0), (350.0, 10.0), (0.0, 360.0), (340.0, 360.0)), {"slow"}
    )
    places = [tuple(row) for row in found[["start_deg", "end_deg"]].to_numpy()]
    assert places == [(210.0, 340.0), (350.0, 10.0), (0.0, 360.0), (0.0, 20.0)]
    assert (
        found["mean"] == -1.0
    ).all()  # an angle that reads too much reads too little in the mirror
    own = spans((20.0, 150.0))
    pd.testing.assert_frame_equal(axes.spans_in_file_convention(own, {"fast"}), own)
    torque = own.assign(channel="crank_torque")
    assert axes.spans_in_file_convention(torque, {"slow"})["mean"].iloc[0] == 1.0
    columns = ("measured", "base", "augmented", "whitened_base", "whitened_augmented")
    frame = pd.DataFrame(
        {"run": ["slow", "slow"], "channel": ["crank_angle", "crank_torque"], "crank_angle": 2.0}
    )
    found = axes.residuals_in_file_convention(frame.assign(**dict.fromkeys(columns, 3.0)), {"slow"})
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
        return force_difference(*models, {"slow": 20.0}, clockwise)

    keys = ["body", "crank_angle"]
    plain = forces(0.02, ()).sort_values(keys, ignore_index=True)
    turned = forces(-0.02, ("slow",))
    turned["crank_angle"] = 2.0 * np.pi - turned["crank_angle"]
    turned = turned.sort_values(keys, ignore_index=True)
    assert {*plain["body"]} == {"slider", "crank"}
    np.testing.assert_allclose(turned["crank_angle"], plain["crank_angle"], atol=1e-12)
    for body, column, sign, bound in (
        ("slider", "velocity", 1.0, 1e-12),
        ("slider", "force", 1.0, 1e-9),
        ("crank", "torque", -1.0, 1e-12),
    ):
        values, mirrored = (
            each.loc[each["body"] == body, column].to_numpy(float) for each in (plain, turned)
        )
        np.testing.assert_allclose(mirrored, sign * values, atol=bound)
        assert np.abs(values).max() > 0.1
