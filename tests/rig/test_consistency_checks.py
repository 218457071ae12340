"""Channels that contradict the mechanism are reported before any fit, each with its fault."""

import numpy as np
import pytest
import yaml
from scipy.signal import butter, sosfilt, sosfiltfilt

from jointgap.config import Simulate
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.motion.ideal import ideal_channels
from jointgap.motion.slider_crank import model_of
from jointgap.rig.read_files import read_measurements
from jointgap.rig.simulate_run import channels_at
from tests.config.mechanisms import PAPER, mechanism
from tests.rig.recorded_files import CAMPAIGN, paper, read_rig, samples, table, write_rig

UNITS = {"slider_acceleration": "m/s^2", "rod_angular_velocity": "rad/s", "guide_force": "N"}
OVER = {"channels": {name: {"column": name, "unit": unit} for name, unit in UNITS.items()}}
RUNS = {"slow": 200, "fast": 600}


def measured(rpm, noise=0.03, seed=1, friction=5.0, turns=3.0, count=240, turned=0.0, **factors):
    """Columns of a run of ideal joints with noise and 5 N of friction at the slider, and the
    encoder's zero off."""
    rng, speed = np.random.default_rng([seed, rpm]), rpm * np.pi / 30
    frame, si = table(rpm, turns=turns, count=count), samples(rpm, turns=turns, count=count)
    channels = ideal_channels(paper(), si["crank_angle"], speed)
    lost = friction * np.sign(channels["slider_velocity"])
    frame["M"] = channels["crank_torque"] + lost * channels["slider_velocity"] / speed
    for name in UNITS:
        frame[name] = channels[name]
    for column in frame.columns[2:]:
        frame[column] *= factors.get(column, 1.0)
        frame[column] += noise * frame[column].std() * rng.normal(size=len(frame))
    return frame.assign(theta=(frame.theta + turned) % 360)


@pytest.fixture
def read(tmp_path):
    """Measurements of a rig without some channels; runs without a table are sound."""

    def read(over=OVER, without=(), **tables):
        sound = {run: measured(rpm) for run, rpm in RUNS.items() if run not in tables}
        path = write_rig(tmp_path, over, **sound, **tables)
        content = yaml.safe_load(path.read_text())
        for name in without:
            content["channels"].pop(name, None)
        path.write_text(yaml.safe_dump(content))
        return read_measurements(load_campaign(path))

    return read


def rows(measurements):
    return {(item.run, item.channel, item.other, item.kind) for item in measurements.contradictions}


def both(channel, kind, partner=""):
    return {(run, channel, partner, kind) for run in RUNS}


def in_both(**changes):
    return {run: measured(rpm, **changes) for run, rpm in RUNS.items()}


def at_speeds(*rpm):
    runs = zip(CAMPAIGN["runs"], rpm, strict=True)
    return {"runs": [run | {"speed": f"{speed} rpm"} for run, speed in runs]}


def mechanism_with(folder, name, **parameters):
    """File of the paper's mechanism that lists one effect."""
    content = yaml.safe_load(PAPER.read_text(encoding="utf-8"))
    content["effects"] = [{"name": name, "parameters": parameters}]
    (folder / "listed.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return {"mechanism": str(folder / "listed.yaml")}


ONE_RUN = {"runs": [{"id": "slow", "file": "slow.csv", "speed": "200 rpm", "role": "split"}]}
TORQUE_ALONE = ["crank_angle", "slider_position"]


@pytest.mark.parametrize("speed", [20.0, 60.0])
def test_the_ideal_channels_are_those_of_the_simulation_without_clearance(speed):
    ideal = mechanism(joints={name: {"loose": False} for name in ("crank_pin", "piston_pin")})
    angle = np.linspace(0.0, 6.0, 50)
    simulated = channels_at(model_of(ideal, Simulate(speed=speed, tolerance=1e-9)), angle, 1e-9)
    for name, exact in ideal_channels(paper(), angle, speed).items():
        assert np.abs(simulated[name] - exact).max() < 1e-9 * np.ptp(exact), name


def test_a_sound_campaign_with_friction_has_no_remark(read, tmp_path):
    listed = mechanism_with(tmp_path, "slider_coulomb_friction", force_N=5.0)
    assert read(OVER, **in_both(noise=0.05)).remarks == ()
    assert read(OVER | listed, slow=measured(200, 0.1), fast=measured(600, 0.01)).remarks == ()
    assert read(OVER | ONE_RUN, slow=measured(200, turns=6.0)).remarks == ()


def test_swapped_columns_are_reported_for_both_channels(read):
    channels = OVER["channels"] | {"slider_acceleration": {"column": "M", "unit": "m/s^2"}}
    channels["crank_torque"] = {"column": "slider_acceleration", "unit": "N*m", "noise": 0.02}
    measurements = read({"channels": channels})
    names = "crank_torque", "slider_acceleration"
    assert rows(measurements) == both(names[0], "swapped", names[1]) | both(
        names[1], "swapped", names[0]
    )
    (remark,) = measurements.remarks
    assert "crank_torque and slider_acceleration are swapped" in remark


@pytest.mark.parametrize(
    "column, factor, kind, words",
    [
        ("slider_acceleration", -1.0, "sign", "slider_acceleration has the opposite sign"),
        ("M", -1.0, "sign", "crank_torque has the opposite sign"),
        ("guide_force", -1.0, "sign", "guide_force has the opposite sign"),
        ("slider_acceleration", 1 / 9.81, "scale", "did you mean 'g_n'"),
    ],
)
def test_a_wrong_sign_or_unit_is_reported_for_its_channel_alone(read, column, factor, kind, words):
    measurements = read(**in_both(**{column: factor}))
    assert rows(measurements) == both({"M": "crank_torque"}.get(column, column), kind)
    assert any(words in remark for remark in measurements.remarks)


@pytest.mark.parametrize("slow, fast", [(170.0, 170.0), (50.0, -50.0)])
def test_a_large_encoder_zero_is_reported_with_its_angle(read, slow, fast):
    measurements = read(slow=measured(200, turned=slow), fast=measured(600, turned=fast))
    assert rows(measurements) == both("crank_angle", "phase")
    phases = [np.degrees(item.phase) for item in measurements.contradictions]
    assert phases == pytest.approx([slow, fast], abs=2.0)


def test_an_encoder_zero_within_its_listed_bounds_is_not_reported(read):
    over, fast = OVER | {"nuisance": {"encoder_zero": "60 deg"}}, measured(600, turned=-50)
    assert read(over, slow=measured(200, turned=50), fast=fast).remarks == ()
    beyond = read(over, slow=measured(200, turned=120), fast=fast)
    assert rows(beyond) == {("slow", "crank_angle", "", "phase")}


def test_a_channel_from_the_file_of_another_run_is_reported_in_that_run(read):
    slow, fast = measured(200, turns=4.0), measured(600)
    slow["M"] = fast["M"]
    measurements = read(slow=slow, fast=fast)
    assert rows(measurements) == {("slow", "crank_torque", "", "unrelated")}
    assert "crank_torque has the samples of run fast" in measurements.remarks[0]


def test_stretched_times_are_distinguished_from_a_wrong_speed(read):
    def stretched(factor):
        return measured(200).assign(t=lambda frame: factor * frame.t)

    time = {("slow", "time", "", "time")}
    for factor in (0.8, 1.4):
        measurements = read(slow=stretched(factor))
        assert rows(measurements) == time and measurements.contradictions[0].doubtful
        assert rows(read(OVER | at_speeds(200 * factor, 600))) == {("slow", "time", "", "speed")}
    # in both runs, where times and angles agree: a remark but no doubt
    faster = read(OVER | at_speeds(178, 535))
    assert rows(faster) == both("time", "speed")
    assert not any(item.doubtful for item in faster.contradictions)
    # without encoder the speed is that of the channels
    assert rows(read(without=["crank_angle"])) == set()
    assert rows(read(without=["crank_angle"], slow=stretched(1.3))) == time
    assert rows(read({}, TORQUE_ALONE, slow=stretched(1.3))) == time


@pytest.mark.parametrize(
    "stated, counts, without", [(4096, 4000, []), (1024, 1000, ["slider_acceleration", "time"])]
)
def test_counts_of_another_encoder_are_found_by_the_period_of_the_channels(
    read, stated, counts, without
):
    measurements = read(*encoder(stated, without), **counted(counts))
    assert rows(measurements) == both("crank_angle", "scale")
    assert all(item.stops for item in measurements.contradictions)
    (remark,) = measurements.remarks
    assert f"repeat every {counts / stated:.4g} turn of crank_angle" in remark
    assert f"counts_per_turn: {counts} instead of {stated}" in remark


def encoder(counts_per_turn, without=()):
    channel = {"unit": "counts", "counts_per_turn": counts_per_turn, "noise": None}
    return {"channels": {**OVER["channels"], "crank_angle": channel}}, without


def counted(counts, turns=6.0):
    """Sound runs whose encoder counts its `counts` a turn."""
    tables = {}
    for run, rpm in RUNS.items():
        frame = measured(rpm, noise=0.01, turns=turns, count=round(90 * turns))
        tables[run] = frame.assign(theta=np.floor(counts * (0.048 + rpm / 60 * frame.t)))
    return tables


def test_right_counts_are_not_reported_and_edges_of_lines_are_proposed(read):
    assert read(*encoder(4096), **counted(4096)).contradictions == ()
    with pytest.raises(InputError, match="counts_per_turn is 360: did you mean 1440"):
        read(*encoder(360), **counted(1440))


@pytest.mark.parametrize("order", [0.5, 1.1])
def test_half_orders_and_vibration_do_not_make_the_turn_doubtful(read, order):
    tables = {}
    for run, rpm in RUNS.items():
        frame = measured(rpm, turns=8.0, count=720)
        wave = 2.0 * np.cos(order * rpm * np.pi / 30 * frame.t)
        channels = {name: frame[name] + frame[name].std() * wave for name in (*UNITS, "M")}
        tables[run] = frame.assign(**channels)
    assert not any("repeat every" in remark for remark in read(**tables).remarks)


def with_load(rpm, constant=0.0, spring=0.0, damping=0.0, turns=5.0, count=240):
    """Columns of a run with a load on the slider: a force [N], a spring [N/m] and a damper [N
    s/m]."""
    si, speed = samples(rpm, turns=turns, count=count), rpm * np.pi / 30
    channels = ideal_channels(paper(), si["crank_angle"], speed)
    position, velocity = channels["slider_position"], channels["slider_velocity"]
    load = constant - spring * (position - position.mean()) - damping * velocity
    torque = channels["crank_torque"] - load * velocity / speed
    noise = np.random.default_rng([3, int(rpm)]).normal(size=torque.size)
    return table(rpm, turns=turns, count=count).assign(M=torque + 0.02 * torque.std() * noise)


@pytest.mark.parametrize("load", [{"spring": 3000.0}, {"damping": 80.0}, {"constant": 300.0}])
def test_a_load_is_not_reported_as_wrong_times_or_as_a_fault_of_the_torque_sensor(read, load):
    tables = {"slow": with_load(200, **load), "fast": with_load(220, **load)}
    assert read(ONE_RUN, **tables).remarks == ()
    assert read(at_speeds(200, 220), ["slider_position"], **tables).remarks == ()


def test_a_factor_that_no_load_explains_is_reported(read):
    tables = {run: with_load(rpm, constant=20.0) for run, rpm in (("slow", 200), ("fast", 220))}
    thousandth = {run: frame.assign(M=1e-3 * frame.M) for run, frame in tables.items()}
    assert rows(read(at_speeds(200, 220), **thousandth)) == both("crank_torque", "scale")


def test_a_stated_speed_that_is_off_is_remarked_with_the_measured_one(tmp_path):
    for rpm, is_remarked in ((202, False), (220, True)):
        remarks = read_rig(tmp_path, at_speeds(rpm, 600), **in_both()).remarks
        text = "mean speed is 200 rpm, but the run's speed is"
        assert any(f"{text} {rpm} rpm" in remark for remark in remarks) == is_remarked


@pytest.mark.parametrize(("phase", "side"), [("causal", 1), ("zero_phase", -1)])
def test_a_channel_behind_a_stated_low_pass_has_no_remark(tmp_path, phase, side):
    tables, step = {}, 1e-4
    sections = butter(4, 7.0, fs=1 / step, output="sos")
    low_pass = {"causal": sosfilt, "zero_phase": sosfiltfilt}[phase]
    for run, rpm in RUNS.items():
        frame, speed = measured(rpm, turns=6.0), rpm * np.pi / 30
        time = np.arange(-int(2400 / rpm / step), int(2400 / rpm / step)) * step
        exact = ideal_channels(paper(), side * (0.3 + speed * time), side * speed)
        exact["slider_acceleration"] = low_pass(sections, exact["slider_acceleration"])
        for name in UNITS:
            noise = np.random.default_rng(1).normal(size=len(frame))
            values = np.interp(frame.t, time, exact[name])
            frame[name] = values + 0.02 * values.std() * noise
        frame["theta"] *= side
        frame["x"] = 1e3 * np.interp(frame.t, time, exact["slider_position"])
        tables[run] = frame.assign(M=np.interp(frame.t, time, exact["crank_torque"]))
    direction = {1: "counter_clockwise", -1: "clockwise"}[side]
    runs = {"runs": [run | {"direction": direction} for run in CAMPAIGN["runs"]]}
    channel = OVER["channels"]["slider_acceleration"] | {"bandwidth": "7 Hz", "filter": phase}
    filtered = {"channels": OVER["channels"] | {"slider_acceleration": channel}}
    assert read_rig(tmp_path, runs | filtered, **tables).remarks == ()
    unstated = rows(read_rig(tmp_path, runs | OVER, **tables))
    assert {name for _, name, _, _ in unstated} == {"slider_acceleration"}


def test_a_speed_that_varies_by_a_listed_effect_has_no_remark(tmp_path):
    tables = {}
    for run, rpm in RUNS.items():
        frame, speed = table(rpm, turns=5.0), rpm * np.pi / 30
        angle = 0.3 + speed * frame.t
        angle = (angle + 0.025 * np.sin(2 * angle)).to_numpy()
        position = ideal_channels(paper(), angle, speed)["slider_position"]
        tables[run] = frame.assign(theta=np.degrees(angle) % 360, x=1e3 * position)
    listed = mechanism_with(tmp_path, "speed_fluctuation", ratio=0.05, order=2)
    assert read_rig(tmp_path, listed, **tables).remarks == ()
    assert any("the speed varies" in remark for remark in read_rig(tmp_path, **tables).remarks)


def test_a_run_with_all_samples_of_another_one_is_reported(read):
    same_speed, copy = at_speeds(200, 200), measured(200)
    measurements = read(OVER | same_speed, slow=copy, fast=copy)
    copied = {row[1] for row in rows(measurements) if row[3] == "unrelated"}
    assert copied == {"slider_position", "crank_torque", *UNITS}
