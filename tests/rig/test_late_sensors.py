"""A sensor that is late: by a pure delay or by a first-order lag."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.campaign.sentences import answer
from jointgap.campaign.state import CampaignState
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.noise import noise_of_model
from jointgap.identification.problem import Problem
from jointgap.rig.sensors import lagged
from tests.identification.test_law_family import asked
from tests.rig.campaigns import model_of, samples, written
from tests.rig.rigs import chosen, read, rig

READ = ("crank_angle", "crank_torque", "slider_acceleration")
STEP = 2e-4  # s
FRICTION = 2.5  # N
ROUNDED = {"unit": "turn/4000", "resolution": 1}


def late(folder: Path, delay: float = 0.0, lag: float = 0.0) -> Path:
    """A campaign of an ideal rig with Coulomb friction whose torque sensor is late by `delay` and
    `lag` [s]."""
    hidden = {"name": "slider_coulomb_friction", "parameters": {"force_N": FRICTION}}
    rng, runs, stated = np.random.default_rng(3), {}, {name: {} for name in READ}
    for run, rpm in {"slow": 170.0, "mid": 310.0, "fast": 450.0}.items():
        motion = samples(hidden, speed=rpm * np.pi / 30, revolutions=6, samples_per_revolution=1440)
        time = np.arange(0.0, motion["time"].iloc[-1], STEP)
        true = {name: np.interp(time, motion["time"], motion[name]) for name in READ}
        torque = lagged(true["crank_torque"], STEP, lag) if lag else true["crank_torque"]
        true["crank_torque"] = np.interp(time - delay, time, torque)
        kept = slice(round(2 * 60.0 / rpm / STEP), None, round(60.0 / rpm / 90 / STEP))
        table = pd.DataFrame({"time": time[kept]})
        for name, values in true.items():
            stated[name][run] = sd = (
                1e-3 if name == "crank_angle" else 4e-3 * float(values[kept].std())
            )
            table[name] = values[kept] + sd * rng.standard_normal(values[kept].size)
        runs[run] = rpm * np.pi / 30, table
    return written(folder, runs, noise=stated, nuisance={"slider_mass": "5%", "rod_mass": "5%"})


@pytest.mark.slow
@pytest.mark.parametrize(("name", "parameter"), [("delay", "delay_s"), ("lag", "lag_s")])
def test_a_lag_and_a_delay_are_distinguished(tmp_path, name, parameter):
    decision, families = asked(model_of(late(tmp_path, **{name: 2.2e-3})))
    label, fit = f"sensor_{name}:crank_torque", decision.chosen
    assert decision.verdict == "named"
    assert {candidate.label for candidate in fit.hypothesis} == {"slider_coulomb_friction", label}
    keys, errors = [p.key for p in fit.parameters], np.sqrt(np.diag(fit.covariance()))
    for key, true in {
        f"{label}.{parameter}": 2.2e-3,
        "slider_coulomb_friction.force_N": FRICTION,
    }.items():
        assert abs(fit.mapping[key] - true) < 3.0 * errors[keys.index(key)]
    (family,) = (item for item in families if item.effect == label)
    assert family.alone


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cut", "stated"), [(np.floor, {"counts_per_turn": 4000}), (np.round, ROUNDED)]
)
def test_a_delay_is_not_biased_by_the_steps_of_a_counter(tmp_path, cut, stated):
    """A counter truncates; counts that were rounded have a unit and a resolution."""
    path = late(tmp_path, delay=1.5e-3)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["channels"]["crank_angle"] = {"column": "crank_angle", **stated}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    for run in content["runs"]:
        table = pd.read_csv(tmp_path / run["file"])
        counts = cut(table["crank_angle"] * 4000 / math.tau)
        table.assign(crank_angle=counts).to_csv(tmp_path / run["file"], index=False)
    model = model_of(path)
    label = "sensor_delay:crank_torque"
    hypothesis = tuple(chosen(model, name) for name in ("slider_coulomb_friction", label))
    start = {"slider_coulomb_friction.force_N": 2.0, f"{label}.delay_s": 1e-3}
    result = fit_hypothesis(Problem(model, noise_of_model(model)), hypothesis, start)
    error = np.sqrt(result.covariance()[-1, -1])
    assert result.mapping[f"{label}.delay_s"] == pytest.approx(1.5e-3, abs=2.5 * error)


@pytest.mark.parametrize("sensor", [{}, {"bandwidth": "50 Hz"}])
def test_a_delay_shifts_the_reading_in_time(sensor):
    name, model = "slider_acceleration", rig(sensors={"slider_acceleration": sensor})
    step = float(np.diff(model.series[0].time)[0])
    law = chosen(model, f"sensor_delay:{name}").families[0].law
    delayed, lagging = (
        read(model, (f"sensor_{fault}:{name}", values))[name]
        for fault, values in (("delay", {"delay_s": 3 * step}), ("lag", {"lag_s": step}))
    )
    both = model.simulate(
        "slow", model.nominal("slow"), [(law, {"late_s": 4 * step, "delay_share": 0.75})]
    )[name]
    assert delayed[3:] == pytest.approx(read(model)[name][:-3], abs=1e-9)
    assert both[3:] == pytest.approx(lagging[:-3], abs=1e-9)


def test_with_one_channel_a_late_sensor_equals_an_early_encoder(tmp_path):
    """Against a measured angle either says the same: the position is late."""
    rng, runs = np.random.default_rng(4), {}
    for run, rpm in {"slow": 170.0, "mid": 310.0, "fast": 450.0}.items():
        motion = samples(speed=rpm * np.pi / 30, revolutions=6, samples_per_revolution=1440)
        time = np.arange(0.0, motion["time"].iloc[-1], STEP)
        true = {
            name: np.interp(time, motion["time"], motion[name])
            for name in ("crank_angle", "slider_position")
        }
        true["slider_position"] = np.interp(time - 2e-3, time, true["slider_position"])
        kept = slice(round(2 * 60.0 / rpm / STEP), None, round(60.0 / rpm / 90 / STEP))
        table = pd.DataFrame(
            {"time": time[kept]} | {name: values[kept] for name, values in true.items()}
        )
        runs[run] = rpm * np.pi / 30, table + rng.standard_normal(table.shape) * [0.0, 1e-3, 1e-4]
    path = written(tmp_path, runs, drive="measured_angle")
    document = analyse(path, tmp_path / "results")
    assert (document["verdict"], document["equivalent"]) == ("named", [])
    (fault,) = document["effects"]
    (second,) = fault["alternatives"]
    assert {fault["name"], second["name"]} == {"sensor_delay", "encoder_lag"}
    for late in (fault, second):
        (size,) = late["parameters"].values()
        assert abs(size["value"]) == pytest.approx(2e-3, abs=4 * size["sd"])
    assert "cannot show which" in answer(document)
    assert CampaignState(path, tmp_path / "results").outcome.twins  # from its files
