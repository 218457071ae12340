"""A sensor that is late: by a pure delay, by a first-order lag, or by what the data cannot tell."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.campaign.sentences import answer
from jointgap.config import Simulate, load_mechanism
from jointgap.config.load import load_campaign
from jointgap.dynamics.simulation import simulate
from jointgap.identification.baseline import recalibrate
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.preflight import preflight
from jointgap.identification.screening import SensitivityRegression, simulate_sensitivities
from jointgap.rig.model import SliderCrankModel, build_model
from jointgap.rig.read_files import read_measurements
from jointgap.rig.sensors import lagged
from tests.identification.test_law_family import asked
from tests.identification.toy import stated_noise
from tests.slider_crank.rigs import campaign, mechanism, recorded
from tests.slider_crank.test_library import MECHANISM

SCHEMA = json.loads(Path("workflow/schemas/verdict.schema.json").read_text(encoding="utf-8"))
SPEEDS = {"slow": 170.0, "mid": 310.0, "fast": 450.0}  # rpm
UNITS = {"crank_angle": "rad", "crank_torque": "N*m", "slider_acceleration": "m/s^2"}
STEP = 2e-4  # s
FRICTION = 2.5  # N


def written(folder: Path, delay: float = 0.0, lag: float = 0.0, friction: float = FRICTION, noise: float = 4e-3):
    """A campaign of an ideal rig with Coulomb friction whose torque sensor is late by `delay` and `lag` [s]; `noise` is
    a share of what a channel varies by.
    """
    hidden = [{"name": "slider_coulomb_friction", "parameters": {"force_N": friction}}] if friction else []
    (folder / "base.yaml").write_text(yaml.safe_dump(MECHANISM))
    (folder / "true.yaml").write_text(yaml.safe_dump({**MECHANISM, "effects": hidden}))
    truth, rng, runs = load_mechanism(folder / "true.yaml"), np.random.default_rng(3), []
    channels = {name: {"column": name, "unit": unit, "noise": {}} for name, unit in UNITS.items()}
    for run, rpm in SPEEDS.items():
        options = Simulate(speed=rpm * np.pi / 30, revolutions=6, samples_per_revolution=1440)
        motion = simulate(truth, options).samples
        time = np.arange(0.0, motion["time"].iloc[-1], STEP)
        true = {name: np.interp(time, motion["time"], motion[name]) for name in UNITS}
        torque = lagged(true["crank_torque"], STEP, lag) if lag else true["crank_torque"]
        true["crank_torque"] = np.interp(time - delay, time, torque)
        kept = slice(round(2 * 60.0 / rpm / STEP), None, round(60.0 / rpm / 90 / STEP))
        table = pd.DataFrame({"t": time[kept] - time[kept][0]})
        for name, values in true.items():
            sd = 1e-3 if name == "crank_angle" else noise * float(values[kept].std())
            channels[name]["noise"][run] = sd
            table[name] = values[kept] + sd * rng.standard_normal(values[kept].size)
        table.to_csv(folder / f"{run}.csv", index=False)
        role = "confirm" if run == "fast" else "identify"
        runs.append({"id": run, "file": f"{run}.csv", "speed": f"{rpm} rpm", "role": role})
    content = {
        "name": "late-sensor",
        "mechanism": "base.yaml",
        "drive": "constant_speed",
        "runs": runs,
        "channels": {"time": {"column": "t", "unit": "s"}, **channels},
        "nuisance": {"slider_mass": "5%", "rod_mass": "5%"},
    }
    (folder / "campaign.yaml").write_text(yaml.safe_dump(content))
    return folder / "campaign.yaml"


def model_of(folder: Path, **rig) -> SliderCrankModel:
    """The analyst's model of a rig as of `written`."""
    loaded = load_campaign(written(folder, **rig))
    return build_model(loaded, read_measurements(loaded))


def within(fit, label: str, parameter: str, true: float) -> bool:
    """Whether what is true is within three standard errors of a parameter of an effect."""
    place = [p.key for p in fit.parameters].index(f"{label}.{parameter}")
    return abs(fit.values[place] - true) < 3.0 * float(np.sqrt(fit.covariance()[place, place]))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "parameter"), [("delay", "delay_s"), ("lag", "lag_s")])
def test_of_a_lag_and_a_delay_the_true_one_is_named_with_the_friction_beside_it(tmp_path, name, parameter):
    decision, families = asked(model_of(tmp_path, **{name: 2.2e-3}))
    label = f"sensor_{name}:crank_torque"
    assert decision.verdict == "named"
    assert {candidate.label for candidate in decision.chosen.hypothesis} == {"slider_coulomb_friction", label}
    assert within(decision.chosen, label, parameter, 2.2e-3)
    assert within(decision.chosen, "slider_coulomb_friction", "force_N", FRICTION)
    (family,) = (one for one in families if one.effect == label)
    assert family.alone


@pytest.mark.slow
def test_a_delay_so_short_that_a_lag_reads_the_same_is_named_as_either(tmp_path):
    verdict = analyse(written(tmp_path, delay=4e-4, friction=0.0, noise=0.01), tmp_path / "results")
    jsonschema.validate(json.loads((tmp_path / "results" / "verdict.json").read_text(encoding="utf-8")), SCHEMA)
    assert verdict["verdict"] == "named"
    (effect,) = verdict["effects"]
    (family,) = effect["families"]
    assert family["law"] == "sensor_lag_and_delay" and family["named"]
    assert family["interval_99"] == [0.0, 1.0]
    assert "a lag or a delay of the sensor of crank torque" in answer(verdict)


def test_a_channel_with_one_of_the_two_is_offered_neither_beside_it(tmp_path):
    model = model_of(tmp_path, delay=2.2e-3)
    base = recalibrate(model, stated_noise(model))
    lag = next(one for one in model.candidates if one.label == "sensor_lag:crank_torque")
    few = [one for one in model.candidates if one.sensor]
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences, few)
    found = fit_hypothesis(base.problem, (lag,), differences=base.differences)
    about = simulate_sensitivities(base.problem, found, base.differences, few)
    for beside in (sensitivities.about(found), about):
        labels = {sensitivity.candidate.label for sensitivity in beside.entries}
        assert not labels & {"sensor_lag:crank_torque", "sensor_delay:crank_torque"}
        assert {"sensor_gain:crank_torque", "sensor_delay:slider_acceleration"} <= labels
    for pair in SensitivityRegression(sensitivities).pairs():
        assert len({one.site for one in pair.hypothesis if one.name in ("sensor_lag", "sensor_delay")}) == sum(
            one.name in ("sensor_lag", "sensor_delay") for one in pair.hypothesis
        )


def test_preflight_counts_the_two_of_one_channel_as_alike():
    own = campaign(mechanism(), ("time", "crank_angle", "crank_torque", "guide_force"))
    model = build_model(own)
    model.candidates = tuple(one for one in model.candidates if one.name in ("sensor_lag", "sensor_delay"))
    found = preflight(model)
    assert found.cosines.loc["sensor_lag:crank_torque", "sensor_delay:crank_torque"] > 0.99
    pairs = [{f"sensor_{name}:{site}" for name in ("lag", "delay")} for site in ("crank_torque", "guide_force")]
    assert [set(group) for group in found.merged] == pairs


@pytest.mark.parametrize("sensor", [{}, {"bandwidth": "50 Hz"}])
def test_a_delay_shifts_a_reading_in_time_and_a_share_of_it_the_lagged_one(sensor):
    own = campaign(mechanism(), sensors={"slider_acceleration": sensor})
    measurements = recorded(own)
    model, step = build_model(own, measurements), float(np.diff(measurements.runs["slow"].time)[0])
    by_label = {one.label: one for one in model.candidates}
    lag, delay = (by_label[f"sensor_{name}:slider_acceleration"] for name in ("lag", "delay"))
    law = delay.families[0].law

    def read(*effects):
        return model.simulate("slow", model.nominal("slow"), effects)["slider_acceleration"]

    delayed, lagging = read((delay, {"delay_s": 3 * step})), read((lag, {"lag_s": step}))
    both = read((law, {"late_s": 4 * step, "delay_share": 0.75}))
    assert delayed[3:] == pytest.approx(read()[:-3], abs=1e-9)
    assert both[3:] == pytest.approx(lagging[:-3], abs=1e-9)


def test_sensors_that_are_late_by_one_time_are_an_encoder_that_is_ahead():
    keys = {"drive": "measured_angle", "sensors": {"crank_angle": {"resolution": 1e-5}}}
    own = campaign(mechanism(), ("time", "crank_angle", "crank_torque", "slider_acceleration"), **keys)
    model = build_model(own, recorded(own))
    by_label = {one.label: one for one in model.candidates}
    ahead = [(by_label["encoder_lag"], {"lag_s": -1e-3})]
    late = [(by_label[f"sensor_delay:{channel}"], {"delay_s": 1e-3}) for channel in UNITS if channel != "crank_angle"]
    one, other = (model.simulate("slow", model.nominal("slow"), effects) for effects in (ahead, late))
    for channel, values in one.items():
        assert values == pytest.approx(other[channel], abs=1e-6 * np.std(values))
    assert by_label["encoder_lag"].coordinates[0].low < -1e-3
