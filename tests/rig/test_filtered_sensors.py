"""Sensors that remove the mean or read means: a first-order high-pass, and a counter's mean over
its gate time."""

from math import tau
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.config.channels import CHANNELS as UNITS
from jointgap.rig import sensors
from tests.rig.campaigns import model_of, samples, written
from tests.rig.rigs import mechanism, read, rig

FRICTION = 4.0  # N
READ = ("time", "crank_angle", "crank_torque", "slider_acceleration")
SPEEDS = {"slow": 120.0, "mid": 320.0, "fast": 200.0}  # rpm
PER_TURN, FINE, TURNS = 80, 960, 8


def filtered(values: np.ndarray, speed: float, response) -> np.ndarray:
    """The samples (n,) of one revolution after a filter with a frequency response over rad/s."""
    orders = np.fft.rfft(values)
    return np.fft.irfft(orders * response(speed * np.arange(orders.size)), values.size)


def high_pass(corner: float):
    return lambda w: 1j * w / (1j * w + tau * corner)


def behind(folder: Path, response=None, channel: str = "crank_torque", **keys) -> Path:
    """A campaign of an ideal rig with Coulomb friction, one `channel` of which is read behind a
    filter."""
    hidden = {"name": "slider_coulomb_friction", "parameters": {"force_N": FRICTION}}
    rng, runs = np.random.default_rng(7), {}
    for run, rpm in SPEEDS.items():
        speed = rpm * tau / 60.0
        motion = samples(hidden, speed=speed, revolutions=2, samples_per_revolution=FINE).iloc[
            FINE : 2 * FINE
        ]
        time = np.arange(PER_TURN * TURNS) * (60.0 / rpm / PER_TURN)
        angle = motion["crank_angle"].iloc[0] + speed * time
        table = pd.DataFrame(
            {"time": time, "crank_angle": angle + 1e-3 * rng.standard_normal(time.size)}
        )
        for name in READ[2:]:
            values = motion[name].to_numpy()
            if response is not None and name == channel:
                values = filtered(values, speed, response)
            true = np.interp(
                speed * time / tau % 1.0, np.arange(FINE + 1) / FINE, np.append(values, values[0])
            )
            table[name] = true + 0.01 * true.std() * rng.standard_normal(true.size)
        runs[run] = speed, table
    return written(folder, runs, **keys)


@pytest.mark.parametrize("corner, first", [(0.5, "rest"), (0.5, "cycle"), (1e-4, "cycle")])
def test_a_high_pass_of_periodic_motion_starts_in_steady_state(corner, first):
    interval, cycle = 1e-3, 0.4
    time = np.arange(5000) * interval
    wave = 3.0 + np.cos(tau / cycle * time - 0.3)
    result = sensors.high_passed(wave, interval, cycle if first == "cycle" else 0.0, corner)
    gain = high_pass(corner)(tau / cycle)
    expected = np.real(gain * np.exp(1j * (tau / cycle * time - 0.3)))
    settled = time > (0.0 if first == "cycle" else 4.0)
    assert result[settled] == pytest.approx(expected[settled], abs=1e-4)
    if first == "rest":
        assert result[0] == 0.0


def test_an_average_is_the_mean_over_the_previous_gate():
    time = np.arange(3000) * 1e-3
    result = sensors.averaged(2.0 + np.sin(9.0 * time), 1e-3, 0.0, 0.05)
    mean = 2.0 + (np.cos(9.0 * (time - 0.05)) - np.cos(9.0 * time)) / (9.0 * 0.05)
    assert result[60:] == pytest.approx(mean[60:], abs=1e-9)
    assert result[0] == pytest.approx(2.0)


@pytest.mark.parametrize("gate", [0.05, 1.7, 500.0])
def test_an_average_of_periodic_motion_includes_turns_before_the_record(gate):
    time, cycle = np.arange(1001) * 1e-3, 0.5
    result = sensors.averaged(2.0 + np.sin(tau / cycle * time), 1e-3, cycle, gate)
    w = tau / cycle
    assert result == pytest.approx(
        2.0 + (np.cos(w * (time - gate)) - np.cos(w * time)) / (w * gate), abs=1e-6
    )


@pytest.mark.parametrize("drive", ["constant_speed", "measured_angle"])
def test_a_stated_high_pass_or_average_has_its_frequency_response(drive):
    name, options = (
        "crank_torque",
        {"drive": drive, "sensors": {"crank_angle": {"resolution": 1e-6}}},
    )

    def with_key(**key):
        return rig(mechanism(), READ, **options | {"sensors": options["sensors"] | {name: key}})

    plain = rig(mechanism(), READ, **options)
    speed, true = plain.plans["slow"].samples.speed, read(plain)[name]
    fault = read(plain, (f"sensor_high_pass:{name}", {"corner_Hz": 0.5}))[name]
    assert read(with_key(high_pass="0.5 Hz"))[name] == pytest.approx(fault, abs=1e-6 * np.std(true))
    for key, response in (
        ({"high_pass": "0.5 Hz"}, high_pass(0.5)),
        ({"average": "20 ms"}, lambda w: np.exp(-0.01j * w) * np.sinc(0.01 * w / np.pi)),
    ):
        result = read(with_key(**key))[name][:-1]  # two turns
        assert result == pytest.approx(
            filtered(true[:-1], 0.5 * speed, response), abs=5e-3 * np.std(true)
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("channel", "corner"), [("slider_acceleration", 0.5), ("crank_torque", 0.05)]
)
def test_a_high_pass_and_friction_are_named(tmp_path, channel, corner):
    verdict = analyse(behind(tmp_path, high_pass(corner), channel), tmp_path / "results")
    effects = {
        (effect["name"], effect["site"]): effect["parameters"] for effect in verdict["effects"]
    }
    assert verdict["verdict"] == "named"
    assert effects.keys() == {("slider_coulomb_friction", "slider"), ("sensor_high_pass", channel)}
    for (size,), true in zip(
        (own.values() for own in effects.values()), (FRICTION, corner), strict=True
    ):
        assert size["interval_90"][0] < true < size["interval_90"][1]
    # at a fortieth of the speed there is little but the mean
    assert effects["sensor_high_pass", channel]["corner_Hz"]["value"] == pytest.approx(
        corner, rel=0.05 if corner > 0.1 else 0.2
    )
    assert effects["slider_coulomb_friction", "slider"]["force_N"]["value"] == pytest.approx(
        FRICTION, rel=0.05
    )
    assert verdict["gap"]["confirm"]["after"] < 1.1


def swinging(folder: Path, late: float = 0.0, gate: float = 0.0) -> Path:
    """A campaign of an ideal rig with Coulomb friction whose crank speed swings; the torque is in a
    second file whose clock is `late`, or the speed is a counter's mean over a `gate`, held.
    """
    hidden = [
        {"name": "slider_coulomb_friction", "parameters": {"force_N": FRICTION}},
        {"name": "speed_fluctuation", "parameters": {"ratio": 0.1, "order": 1}},
    ]
    rng, runs = np.random.default_rng(11), {}
    for run, rpm in SPEEDS.items():
        motion = samples(
            *hidden, speed=rpm * tau / 60.0, revolutions=TURNS + 3, samples_per_revolution=FINE
        )
        time = motion["time"].iloc[FINE] + np.arange(PER_TURN * TURNS) * (60.0 / rpm / PER_TURN)
        true = {name: np.interp(time, motion["time"], motion[name]) for name in READ[1:3]}
        true["crank_angle"] += 1e-3 * rng.standard_normal(time.size)
        if gate:
            ends = gate * np.floor(time / gate - 0.37) + 0.37 * gate
            angles = [
                np.interp(at, motion["time"], motion["crank_angle"]) for at in (ends - gate, ends)
            ]
            true["crank_speed"] = np.round((angles[1] - angles[0]) / gate, 2)
        true["crank_torque"] += 0.01 * true["crank_torque"].std() * rng.standard_normal(time.size)
        runs[run] = rpm * tau / 60.0, pd.DataFrame({"time": time - time[0], **true})
    keys = {"drive": "measured_angle"}
    if gate:
        channels = {
            name: {"column": name, "unit": UNITS[name]} for name in (*READ[:3], "crank_speed")
        }
        channels["crank_speed"]["average"] = gate
        keys["channels"] = channels
    path = written(folder, runs, **keys)
    if late:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        for run in content["runs"]:
            table = pd.read_csv(folder / run["file"])
            second = table[["time", "crank_torque"]].iloc[3:-2:2]
            second.assign(time=second["time"] + late).to_csv(
                folder / f"other_{run['id']}.csv", index=False
            )
            table.drop(columns="crank_torque").to_csv(folder / run["file"], index=False)
            run["file"] = [run["file"], f"other_{run['id']}.csv"]
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("how", [{"gate": 0.05}, {"late": 0.0123}])
def test_friction_is_named_with_a_counter_or_a_second_clock(tmp_path, how):
    verdict = analyse(swinging(tmp_path, **how), tmp_path / "results")
    (effect,) = verdict["effects"]
    (size,) = effect["parameters"].values()
    assert (verdict["verdict"], effect["name"]) == ("named", "slider_coulomb_friction")
    assert size["value"] == pytest.approx(FRICTION, rel=0.05)
    assert size["interval_90"][0] < FRICTION < size["interval_90"][1]
    assert verdict["gap"]["confirm"]["after"] < 1.1
    for run in ("slow", "mid") if "late" in how else ():
        offset = verdict["nuisances"][f"clock_offset@{run}"]
        assert offset["value"] == pytest.approx(how["late"], abs=5.0 * offset["sd"] + 1e-5)


def test_the_offset_of_a_second_clock_is_found_within_half_a_revolution(tmp_path):
    model = model_of(swinging(tmp_path, late=-0.06))
    for run in SPEEDS:
        (offset,) = (p for p in model.nuisances if p.key == f"clock_offset@{run}")
        turn = 60.0 / SPEEDS[run]
        true = (-0.06 + 0.5 * turn) % turn - 0.5 * turn
        assert offset.low < true < offset.high and offset.high - offset.low < 0.2 * turn
        late = model.simulate(run, model.nominal(run) | {"clock_offset": 0.0})["crank_torque"]
        shifted = model.simulate(run, model.nominal(run) | {"clock_offset": 2.0 * turn / PER_TURN})[
            "crank_torque"
        ]
        assert shifted[1:] == pytest.approx(late[:-1], abs=2e-3 * np.std(late))
