"""A four-stroke engine's crank repeats after two turns: its half orders are found and named."""

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.config import Simulate
from jointgap.dynamics.simulation import simulate
from jointgap.rig.model import build_model
from jointgap.rig.recording import Measurements
from tests.slider_crank.rigs import CHANNELS, campaign, mechanism, recorded

READ = ("time", "crank_angle", "slider_acceleration", "crank_torque")
FLUCTUATING = {"name": "speed_fluctuation", "parameters": {"ratio": 0.025, "order": 0.5, "phase_rad": 0.6}}
PERIODIC = {"name": "crank_periodic_torque", "parameters": {"torque_N_m": 3.0, "order": 1.5, "phase_rad": 0.6}}


def labelled(own, label: str):
    model = build_model(own, recorded_of(own))
    return next(one for one in model.candidates if one.label == label)


def recorded_of(own) -> Measurements:
    return recorded(own, kept=4)


def test_half_orders_are_candidates_of_one_run_alone():
    # of several runs nobody knows in which of the two turns each began
    several = campaign(mechanism(), READ)
    alone = several.model_copy(update={"runs": (several.runs[0].model_copy(update={"role": "split"}),)})
    for label, lowest in (("speed_fluctuation", 1.0), ("crank_periodic_torque", 3.0)):
        order = {p.name: p for p in labelled(several, label).coordinates}["order"]
        assert (min(order.tried), min(np.diff(order.tried))) == (lowest, 1.0)
        order = {p.name: p for p in labelled(alone, label).coordinates}["order"]
        assert min(order.tried) == 0.5
        assert 2.5 in order.tried


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [FLUCTUATING, PERIODIC], ids=lambda one: one["name"])
def test_a_half_order_is_named(tmp_path, hidden):
    truth = campaign(mechanism(effects=[hidden]), READ)
    seen = simulate(truth.mechanism, Simulate(speed=60.0, revolutions=14, samples_per_revolution=90)).samples
    seen, rng = seen.iloc[2 * 90 :], np.random.default_rng(4)
    table = pd.DataFrame({"t": seen["time"] - seen["time"].iloc[0], "theta": seen["crank_angle"]})
    table["theta"] += np.deg2rad(0.05) * rng.standard_normal(len(seen))
    for channel in READ[2:]:
        noise = 0.01 * seen[channel].std() * rng.standard_normal(len(seen))
        table[CHANNELS[channel]["column"]] = seen[channel] + noise
    table.to_csv(tmp_path / "run.csv", index=False)
    content = {
        "name": "engine",
        "mechanism": mechanism(),
        "runs": [{"id": "run", "file": "run.csv", "speed": 60.0, "role": "split"}],
        "channels": {name: CHANNELS[name] for name in READ},
        "nuisance": {"slider_mass": "5%"},
    }
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump(content))
    found = analyse(tmp_path / "campaign.yaml", tmp_path / "results")
    assert found["verdict"] == "named"
    (effect,) = found["effects"]
    assert effect["name"] == hidden["name"]
    for parameter, value in hidden["parameters"].items():
        assert effect["parameters"][parameter]["value"] == pytest.approx(value, rel=0.03)
