"""A four-stroke engine's crank repeats after two turns: its half orders are found and named."""

import numpy as np
import pytest

from jointgap.campaign.analyse import analyse
from jointgap.rig.model import build_model
from tests.rows import each
from tests.slider_crank.campaigns import samples, written
from tests.slider_crank.rigs import campaign, chosen, mechanism, recorded

READ = ("time", "crank_angle", "slider_acceleration", "crank_torque")


@each("label, lowest", [("speed_fluctuation", 1.0), ("crank_periodic_torque", 3.0)])
def test_half_orders_are_candidates_of_one_run_alone(label, lowest):
    # of several runs nobody knows in which of the two turns each began
    several = campaign(mechanism(), READ)
    alone = several.model_copy(update={"runs": (several.runs[0].model_copy(update={"role": "split"}),)})
    of_several, of_one = (
        next(p for p in chosen(build_model(own, recorded(own, kept=4)), label).coordinates if p.name == "order").tried
        for own in (several, alone)
    )
    assert (min(of_several), min(np.diff(of_several))) == (lowest, 1.0)
    assert min(of_one) == 0.5 and 2.5 in of_one


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("speed_fluctuation", {"ratio": 0.025, "order": 0.5, "phase_rad": 0.6}),
        ("crank_periodic_torque", {"torque_N_m": 3.0, "order": 1.5, "phase_rad": 0.6}),
    ],
)
def test_a_half_order_is_named(tmp_path, name, parameters):
    hidden, rng = {"name": name, "parameters": parameters}, np.random.default_rng(4)
    seen = samples(hidden, mechanism=mechanism(), speed=60.0, revolutions=14, samples_per_revolution=90)
    table = seen.iloc[2 * 90 :][[*READ]].copy()
    table["crank_angle"] += np.deg2rad(0.05) * rng.standard_normal(len(table))
    for channel in READ[2:]:
        table[channel] += 0.01 * table[channel].std() * rng.standard_normal(len(table))
    found = analyse(written(tmp_path, {"run": (60.0, table)}, mechanism()), tmp_path / "results")
    (effect,) = found["effects"]
    assert (found["verdict"], effect["name"]) == ("named", name)
    for parameter, value in parameters.items():
        assert effect["parameters"][parameter]["value"] == pytest.approx(value, rel=0.03)
