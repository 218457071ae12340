"""A sensor that is late: by a pure delay, by a first-order lag, or by what the data cannot tell."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pandas as pd
import pytest

from jointgap.campaign.analyse import analyse
from jointgap.campaign.sentences import answer
from jointgap.identification.baseline import recalibrate
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.preflight import preflight
from jointgap.identification.screening import SensitivityRegression, simulate_sensitivities
from jointgap.rig.model import build_model
from jointgap.rig.sensors import lagged
from tests.identification.test_law_family import asked
from tests.identification.toy import stated_noise
from tests.rows import each
from tests.slider_crank.campaigns import model_of, samples, written
from tests.slider_crank.rigs import campaign, chosen, mechanism, read, rig

READ = ("crank_angle", "crank_torque", "slider_acceleration")
STEP = 2e-4  # s
FRICTION = 2.5  # N


def late(folder: Path, delay: float = 0.0, lag: float = 0.0, friction: float = FRICTION, noise: float = 4e-3) -> Path:
    """A campaign of an ideal rig with Coulomb friction whose torque sensor is late by `delay` and `lag` [s]; `noise` is
    a share of what a channel varies by.
    """
    hidden = [{"name": "slider_coulomb_friction", "parameters": {"force_N": friction}}] if friction else []
    rng, runs, stated = np.random.default_rng(3), {}, {name: {} for name in READ}
    for run, rpm in {"slow": 170.0, "mid": 310.0, "fast": 450.0}.items():
        motion = samples(*hidden, speed=rpm * np.pi / 30, revolutions=6, samples_per_revolution=1440)
        time = np.arange(0.0, motion["time"].iloc[-1], STEP)
        true = {name: np.interp(time, motion["time"], motion[name]) for name in READ}
        torque = lagged(true["crank_torque"], STEP, lag) if lag else true["crank_torque"]
        true["crank_torque"] = np.interp(time - delay, time, torque)
        kept = slice(round(2 * 60.0 / rpm / STEP), None, round(60.0 / rpm / 90 / STEP))
        table = pd.DataFrame({"time": time[kept]})
        for name, values in true.items():
            stated[name][run] = sd = 1e-3 if name == "crank_angle" else noise * float(values[kept].std())
            table[name] = values[kept] + sd * rng.standard_normal(values[kept].size)
        runs[run] = rpm * np.pi / 30, table
    return written(folder, runs, noise=stated, nuisance={"slider_mass": "5%", "rod_mass": "5%"})


@pytest.mark.slow
@pytest.mark.parametrize(("name", "parameter"), [("delay", "delay_s"), ("lag", "lag_s")])
def test_of_a_lag_and_a_delay_the_true_one_is_named_with_the_friction_beside_it(tmp_path, name, parameter):
    decision, families = asked(model_of(late(tmp_path, **{name: 2.2e-3})))
    label, fit = f"sensor_{name}:crank_torque", decision.chosen
    assert decision.verdict == "named"
    assert {candidate.label for candidate in fit.hypothesis} == {"slider_coulomb_friction", label}
    keys, errors = [p.key for p in fit.parameters], np.sqrt(np.diag(fit.covariance()))
    for key, true in {f"{label}.{parameter}": 2.2e-3, "slider_coulomb_friction.force_N": FRICTION}.items():
        assert abs(fit.mapping[key] - true) < 3.0 * errors[keys.index(key)]
    (family,) = (one for one in families if one.effect == label)
    assert family.alone


@pytest.mark.slow
def test_a_delay_so_short_that_a_lag_reads_the_same_is_named_as_either(tmp_path):
    verdict = analyse(late(tmp_path, delay=4e-4, friction=0.0, noise=0.01), tmp_path / "results")
    schema = json.loads(Path("workflow/schemas/verdict.schema.json").read_text(encoding="utf-8"))
    jsonschema.validate(json.loads((tmp_path / "results" / "verdict.json").read_text(encoding="utf-8")), schema)
    (effect,) = verdict["effects"]
    (family,) = effect["families"]
    assert verdict["verdict"] == "named" and family["named"]
    assert (family["law"], family["interval_99"]) == ("sensor_lag_and_delay", [0.0, 1.0])
    assert "a lag or a delay of the sensor of crank torque" in answer(verdict)


def test_a_channel_with_one_of_the_two_is_offered_neither_beside_it(tmp_path):
    model = model_of(late(tmp_path, delay=2.2e-3))
    base = recalibrate(model, stated_noise(model))
    few = [one for one in model.candidates if one.sensor]
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences, few)
    lag = chosen(model, "sensor_lag:crank_torque")
    found = fit_hypothesis(base.problem, (lag,), differences=base.differences)
    about = simulate_sensitivities(base.problem, found, base.differences, few)
    for beside in (sensitivities.about(found), about):
        labels = {sensitivity.candidate.label for sensitivity in beside.entries}
        assert not labels & {"sensor_lag:crank_torque", "sensor_delay:crank_torque"}
        assert {"sensor_gain:crank_torque", "sensor_delay:slider_acceleration"} <= labels
    for pair in SensitivityRegression(sensitivities).pairs():
        sites = [one.site for one in pair.hypothesis if one.name in ("sensor_lag", "sensor_delay")]
        assert len(set(sites)) == len(sites)


def test_preflight_counts_the_two_of_one_channel_as_alike():
    model = build_model(campaign(mechanism(), ("time", "crank_angle", "crank_torque", "guide_force")))
    model.candidates = tuple(one for one in model.candidates if one.name in ("sensor_lag", "sensor_delay"))
    found = preflight(model)
    assert found.cosines.loc["sensor_lag:crank_torque", "sensor_delay:crank_torque"] > 0.99
    pairs = [{f"sensor_{name}:{site}" for name in ("lag", "delay")} for site in ("crank_torque", "guide_force")]
    assert [set(group) for group in found.merged] == pairs


@each("sensor", [{}, {"bandwidth": "50 Hz"}])
def test_a_delay_shifts_a_reading_in_time_and_a_share_of_it_the_lagged_one(sensor):
    name, model = "slider_acceleration", rig(sensors={"slider_acceleration": sensor})
    step = float(np.diff(model.series[0].time)[0])
    law = chosen(model, f"sensor_delay:{name}").families[0].law
    delayed, lagging = (
        read(model, (f"sensor_{fault}:{name}", values))[name]
        for fault, values in (("delay", {"delay_s": 3 * step}), ("lag", {"lag_s": step}))
    )
    both = model.simulate("slow", model.nominal("slow"), [(law, {"late_s": 4 * step, "delay_share": 0.75})])[name]
    assert delayed[3:] == pytest.approx(read(model)[name][:-3], abs=1e-9)
    assert both[3:] == pytest.approx(lagging[:-3], abs=1e-9)


def test_sensors_that_are_late_by_one_time_are_an_encoder_that_is_ahead():
    model = rig(None, ("time", *READ), drive="measured_angle", sensors={"crank_angle": {"resolution": 1e-5}})
    ahead = read(model, ("encoder_lag", {"lag_s": -1e-3}))
    late_ones = read(model, *((f"sensor_delay:{channel}", {"delay_s": 1e-3}) for channel in READ[1:]))
    for channel, values in ahead.items():
        assert values == pytest.approx(late_ones[channel], abs=1e-6 * np.std(values))
    assert chosen(model, "encoder_lag").coordinates[0].low < -1e-3
