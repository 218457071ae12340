"""Channels that cannot be those of the mechanism are told before any fit, each for what is wrong with it."""

import numpy as np
import pytest
import yaml
from scipy.signal import butter, sosfilt, sosfiltfilt

from jointgap.config.load import load_campaign
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.kinematics import SPEED_POWERS, ideal_channels
from jointgap.rig.read_files import read_measurements
from tests.config.mechanisms import PAPER, paper
from tests.recordings.rig import CAMPAIGN, read_rig, samples, table, write_rig

UNITS = {
    "slider_acceleration": "m/s^2",
    "rod_angular_velocity": "rad/s",
    "guide_force": "N",
}
OVER = {"channels": {name: {"column": name, "unit": unit} for name, unit in UNITS.items()}}
SPEED = {200: 200 * np.pi / 30, 600: 600 * np.pi / 30}


def measured(rpm, noise=0.03, seed=1, friction=5.0, turns=3.0, **factors):
    """Columns of a run of ideal joints with noise and 5 N of friction at the slider."""
    rng = np.random.default_rng([seed, rpm])
    frame, si = table(rpm, turns=turns), samples(rpm, turns=turns)
    channels = ideal_channels(paper(), si["crank_angle"], SPEED[rpm])
    lost = friction * np.sign(channels["slider_velocity"])
    channels["crank_torque"] = channels["crank_torque"] + lost * channels["slider_velocity"] / SPEED[rpm]
    frame["M"] = channels["crank_torque"]
    for name in UNITS:
        frame[name] = channels[name]
    for column in frame.columns[2:]:
        frame[column] = factors.get(column, 1.0) * frame[column] + noise * frame[column].std() * rng.normal(
            size=len(frame)
        )
    return frame


def found(folder, slow=None, fast=None, over=None):
    slow = measured(200) if slow is None else slow
    fast = measured(600) if fast is None else fast
    return read_rig(folder, over or OVER, slow=slow, fast=fast)


def rows(measurements):
    return {(one.run, one.channel, one.other, one.kind) for one in measurements.contradictions}


def both(channel, kind, other=""):
    return {(run, channel, other, kind) for run in ("slow", "fast")}


def test_the_ideal_channels_are_those_of_the_simulation_without_clearance():
    from jointgap.config import Simulate
    from jointgap.core.schema import TRAJECTORY
    from jointgap.rig.simulate_run import channels_at

    mechanism = paper()
    joints = {name: joint.model_copy(update={"loose": False}) for name, joint in dict(mechanism.joints).items()}
    ideal = mechanism.model_copy(update={"joints": type(mechanism.joints)(**joints)})
    angle = np.linspace(0.0, 6.0, 50)
    for speed in (20.0, 60.0):
        p = parameters(ideal, Simulate(speed=speed, tolerance=1e-9))
        simulated, exact = channels_at(p, angle, 1e-9), ideal_channels(mechanism, angle, speed)
        assert set(SPEED_POWERS) <= set(TRAJECTORY.names)
        for name in SPEED_POWERS:
            assert np.abs(simulated[name] - exact[name]).max() < 1e-9 * np.ptp(exact[name]), name


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_sound_campaign_with_friction_is_not_remarked(tmp_path, noise):
    assert found(tmp_path, measured(200, noise), measured(600, noise)).remarks == ()


def test_torque_and_acceleration_with_swapped_columns_are_both_named(tmp_path):
    over = {"channels": OVER["channels"] | {"slider_acceleration": {"column": "M", "unit": "m/s^2"}}}
    over["channels"]["crank_torque"] = {"column": "slider_acceleration", "unit": "N*m", "noise": 0.02}
    told = found(tmp_path, over=over)
    expected = both("crank_torque", "swapped", "slider_acceleration")
    assert rows(told) == expected | both("slider_acceleration", "swapped", "crank_torque")
    (remark,) = told.remarks
    assert "crank_torque and slider_acceleration are swapped" in remark


@pytest.mark.parametrize("channel", ["slider_acceleration", "crank_torque", "guide_force"])
def test_a_turned_sign_is_told_for_its_channel_alone(tmp_path, channel):
    column = {"crank_torque": "M"}.get(channel, channel)
    told = found(tmp_path, measured(200, **{column: -1.0}), measured(600, **{column: -1.0}))
    assert rows(told) == both(channel, "sign")
    assert any(f"{channel} has the opposite sign" in remark for remark in told.remarks)


def test_an_acceleration_in_the_wrong_unit_is_told_with_the_one_that_fits(tmp_path):
    factors = {"slider_acceleration": 1 / 9.81}
    told = found(tmp_path, measured(200, **factors), measured(600, **factors))
    assert rows(told) == both("slider_acceleration", "scale")
    assert any("did you mean 'g_n'" in remark for remark in told.remarks)


@pytest.mark.parametrize("degrees", [90.0, -60.0, 170.0])
def test_an_encoder_whose_zero_is_off_is_told_with_the_angle(tmp_path, degrees):
    slow, fast = (frame.assign(theta=(frame.theta + degrees) % 360) for frame in (measured(200), measured(600)))
    told = found(tmp_path, slow, fast)
    assert rows(told) == both("crank_angle", "phase")
    assert np.degrees(told.contradictions[0].phase) == pytest.approx(degrees, abs=2.0)


@pytest.mark.parametrize("noise", [0.0, 0.4])
def test_a_channel_from_another_runs_file_is_told_in_that_run(tmp_path, noise):
    slow, fast = measured(200, turns=4.0), measured(600)
    slow["M"] = fast["M"] = fast["M"] + noise * fast["M"].std() * np.random.default_rng(2).normal(size=len(fast))
    told = found(tmp_path, slow, fast)
    assert rows(told) == {("slow", "crank_torque", "", "unrelated")}
    assert "crank_torque has the samples of run fast" in told.remarks[0]


@pytest.mark.parametrize("factor", [0.8, 1.4])
def test_stretched_times_are_told_apart_from_a_wrong_speed(tmp_path, factor):
    slow = measured(200)
    slow["t"] *= factor
    assert rows(found(tmp_path, slow)) == {("slow", "time", "", "time")}
    speeds = [
        {"id": "slow", "file": "slow.csv", "speed": f"{200 * factor} rpm", "role": "identify"},
        {"id": "fast", "file": "fast.csv", "speed": "600 rpm", "role": "confirm"},
    ]
    assert rows(found(tmp_path, over=OVER | {"runs": speeds})) == {("slow", "time", "", "speed")}


def without(folder, channels, over=None, **tables):
    """The measurements of a rig that lacks some `channels`."""
    path = write_rig(folder, over or OVER, **tables)
    content = yaml.safe_load(path.read_text())
    content["channels"] = {name: own for name, own in content["channels"].items() if name not in channels}
    path.write_text(yaml.safe_dump(content))
    return read_measurements(load_campaign(path))


@pytest.mark.parametrize(("factor", "expected"), [(1.0, set()), (1.3, {("slow", "time", "", "time")})])
def test_without_an_encoder_the_speed_is_that_at_which_channels_repeat(tmp_path, factor, expected):
    slow = measured(200)
    slow["t"] *= factor
    assert rows(without(tmp_path, ["crank_angle"], slow=slow, fast=measured(600))) == expected


def test_times_are_doubted_without_an_encoder_where_a_force_alone_repeats_at_another_speed(tmp_path):
    slow = measured(200)
    slow["t"] *= 1.3
    told = without(tmp_path, ["crank_angle", "slider_position"], {"name": "rig-a"}, slow=slow, fast=measured(600))
    assert rows(told) == {("slow", "time", "", "time")}


def with_load(rpm, constant=0.0, spring=0.0, damping=0.0, turns=5.0, count=240):
    """Columns of a run with a load on the slider: a force [N], a spring [N/m] and a damper [N s/m]."""
    si, speed = samples(rpm, turns=turns, count=count), rpm * np.pi / 30
    channels = ideal_channels(paper(), si["crank_angle"], speed)
    position, velocity = channels["slider_position"], channels["slider_velocity"]
    load = constant - spring * (position - position.mean()) - damping * velocity
    torque = channels["crank_torque"] - load * velocity / speed
    noise = np.random.default_rng([3, int(rpm)]).normal(size=torque.size)
    return table(rpm, turns=turns, count=count).assign(M=torque + 0.02 * torque.std() * noise)


@pytest.mark.parametrize("newtons", [50.0, 100.0, 200.0, 400.0, 800.0])
def test_a_load_is_not_taken_for_wrong_times_where_the_torque_alone_is_measured_without_an_encoder(tmp_path, newtons):
    slow, fast = (with_load(rpm, constant=newtons) for rpm in (200, 600))
    assert without(tmp_path, ["crank_angle", "slider_position"], {"name": "rig-a"}, slow=slow, fast=fast).remarks == ()


def mechanism_with(folder, name, **parameters):
    """File of the paper's mechanism that lists one effect."""
    content = yaml.safe_load(PAPER.read_text(encoding="utf-8"))
    content["effects"] = [{"name": name, "parameters": parameters}]
    (folder / "listed.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return {"mechanism": str(folder / "listed.yaml")}


def test_nothing_is_told_of_times_where_no_channel_can_be_compared(tmp_path):
    listed = mechanism_with(tmp_path, "slider_coulomb_friction", force_N=5.0)
    tables = {"slow": measured(200), "fast": measured(600)}
    assert without(tmp_path, ["crank_angle", "slider_position"], listed, **tables).remarks == ()
    tables = {
        run: frame.assign(w=rpm * np.pi / 30 + 0.1 * np.sin(frame.t * rpm * np.pi / 30))
        for rpm, (run, frame) in zip((200, 600), tables.items(), strict=True)
    }
    speed = {"channels": {"crank_speed": {"column": "w", "unit": "rad/s"}}}
    left = ["crank_angle", "slider_position", "crank_torque"]
    assert without(tmp_path, left, speed, **tables).remarks == ()


def test_the_stated_speed_may_be_two_percent_off_in_a_long_record_without_an_encoder(tmp_path):
    slow = with_load(200, turns=60.0, count=4800)
    slow["t"] *= 1.02
    told = without(tmp_path, ["crank_angle", "crank_torque"], {"name": "rig-a"}, slow=slow, fast=measured(600))
    assert told.remarks == ()


ONE_RUN = [{"id": "slow", "file": "slow.csv", "speed": "200 rpm", "role": "split"}]
NEAR = [
    {"id": "slow", "file": "slow.csv", "speed": "200 rpm", "role": "identify"},
    {"id": "fast", "file": "fast.csv", "speed": "220 rpm", "role": "confirm"},
]


@pytest.mark.parametrize("load", [{"spring": 800.0}, {"spring": 3000.0}, {"damping": 80.0}, {"constant": 300.0}])
@pytest.mark.parametrize("runs", [ONE_RUN, NEAR])
def test_a_load_is_not_taken_for_a_fault_of_a_force_sensor_where_speeds_are_near(tmp_path, load, runs):
    tables = {"slow": with_load(200, **load), "fast": with_load(220, **load)}
    assert read_rig(tmp_path, {"runs": runs}, **tables).remarks == ()
    left = ["slider_position"]
    assert without(tmp_path, left, {"runs": runs}, **tables).remarks == ()


def test_a_factor_that_no_load_makes_is_told_of_a_force_at_near_speeds_too(tmp_path):
    def thousandth(rpm):
        frame = with_load(rpm, constant=20.0)
        return frame.assign(M=1e-3 * frame.M)

    told = read_rig(tmp_path, {"runs": NEAR}, slow=thousandth(200), fast=thousandth(220))
    assert rows(told) == both("crank_torque", "scale")


@pytest.mark.parametrize("filter_", ["causal", "zero_phase"])
@pytest.mark.parametrize("direction", [1, -1])
def test_a_channel_behind_a_stated_low_pass_is_not_remarked(tmp_path, filter_, direction):
    tables = {}
    for run, rpm in (("slow", 200), ("fast", 600)):
        frame, speed = measured(rpm, turns=6.0), rpm * np.pi / 30
        step = 1e-4
        time = np.arange(-int(40 * 60 / rpm / step), int(40 * 60 / rpm / step)) * step
        exact = ideal_channels(paper(), direction * (0.3 + speed * time), direction * speed)
        sections = butter(4, 7.0, fs=1 / step, output="sos")
        run_through = sosfilt if filter_ == "causal" else sosfiltfilt
        for name in UNITS:
            level = np.interp(frame.t, time, exact[name])
            if name == "slider_acceleration":
                level = np.interp(frame.t, time, run_through(sections, exact[name]))
            frame[name] = level + 0.02 * level.std() * np.random.default_rng(1).normal(size=len(frame))
        frame["theta"], frame["x"] = (
            direction * frame["theta"],
            1e3 * np.interp(frame.t, time, exact["slider_position"]),
        )
        frame["M"] = np.interp(frame.t, time, exact["crank_torque"])
        tables[run] = frame
    channels = OVER["channels"] | {
        "slider_acceleration": OVER["channels"]["slider_acceleration"] | {"bandwidth": "7 Hz", "filter": filter_}
    }
    turning = {1: "counter_clockwise", -1: "clockwise"}[direction]
    runs = [own | {"direction": turning} for own in CAMPAIGN["runs"]]
    assert read_rig(tmp_path, {"channels": channels, "runs": runs}, **tables).remarks == ()
    del channels["slider_acceleration"]["bandwidth"], channels["slider_acceleration"]["filter"]
    assert {
        channel for _, channel, _, _ in rows(read_rig(tmp_path, {"channels": channels, "runs": runs}, **tables))
    } == {"slider_acceleration"}


def test_white_noise_that_hides_the_slow_run_is_not_taken_for_another_runs_channel(tmp_path):
    slow, fast = (
        frame.assign(M=frame.M + 2.0 * np.random.default_rng([7, rpm]).normal(size=len(frame)))
        for rpm, frame in ((200, measured(200, turns=6.0)), (600, measured(600, turns=6.0)))
    )
    assert found(tmp_path, slow, fast).remarks == ()


def turned(rpm, degrees):
    frame = measured(rpm)
    return frame.assign(theta=(frame.theta + degrees) % 360)


@pytest.mark.parametrize(("slow", "fast", "bound"), [(50, 50, "60 deg"), (50, -50, "60 deg"), (80, -80, "90 deg")])
def test_a_zero_of_the_encoder_within_the_bounds_that_are_listed_is_not_remarked(tmp_path, slow, fast, bound):
    over = OVER | {"nuisance": {"encoder_zero": bound}}
    assert found(tmp_path, turned(200, slow), turned(600, fast), over).remarks == ()
    beyond = found(tmp_path, turned(200, 120), turned(600, fast), over)
    assert rows(beyond) == {("slow", "crank_angle", "", "phase")}


def test_zeros_of_the_encoder_that_differ_are_told_run_by_run(tmp_path):
    told = found(tmp_path, turned(200, 50), turned(600, -50))
    assert rows(told) == both("crank_angle", "phase")
    assert [np.degrees(one.phase) for one in told.contradictions] == pytest.approx([50.0, -50.0], abs=2.0)
    assert len(told.remarks) == 2


def test_a_wrong_speed_is_a_remark_but_no_doubt_where_times_and_angles_agree(tmp_path):
    speeds = [own | {"speed": f"{rpm} rpm"} for own, rpm in zip(CAMPAIGN["runs"], (178, 535), strict=True)]
    told = found(tmp_path, over=OVER | {"runs": speeds})
    assert rows(told) == both("time", "speed")
    assert not any(one.doubtful for one in told.contradictions)
    undecided = without(tmp_path, ["crank_torque"], {"runs": speeds}, slow=measured(200), fast=measured(600))
    assert len(undecided.contradictions) == 2
    assert not any(one.doubtful for one in undecided.contradictions)
    slow = measured(200)
    slow["t"] *= 1.3
    assert [one.doubtful for one in found(tmp_path, slow).contradictions] == [True]


def test_a_sign_that_should_not_have_been_stated_is_to_be_removed(tmp_path):
    channels = OVER["channels"] | {"slider_acceleration": OVER["channels"]["slider_acceleration"] | {"sign": -1}}
    told = found(tmp_path, over={"channels": channels})
    assert rows(told) == both("slider_acceleration", "sign")
    assert "remove the channel's sign: -1" in told.remarks[0]


def test_a_mechanism_with_a_listed_effect_and_unequal_noise_is_not_remarked(tmp_path):
    listed = mechanism_with(tmp_path, "slider_coulomb_friction", force_N=5.0)
    assert found(tmp_path, measured(200, 0.1), measured(600, 0.01), OVER | listed).remarks == ()


def test_a_single_run_is_not_remarked(tmp_path):
    assert found(tmp_path, measured(200, turns=6.0), over=OVER | {"runs": ONE_RUN}).remarks == ()


def test_a_speed_that_a_listed_effect_lets_fluctuate_is_not_remarked(tmp_path):
    def fluctuating(rpm):
        frame, speed = table(rpm, turns=5.0), rpm * np.pi / 30
        angle = 0.3 + speed * frame.t
        angle = (angle + 0.025 * np.sin(2 * angle)).to_numpy()
        channels = ideal_channels(paper(), angle, speed)
        return frame.assign(theta=np.degrees(angle) % 360, x=1e3 * channels["slider_position"])

    tables = {"slow": fluctuating(200), "fast": fluctuating(600)}
    listed = mechanism_with(tmp_path, "speed_fluctuation", ratio=0.05, order=2)
    assert read_rig(tmp_path, listed, **tables).remarks == ()
    assert any("the speed varies" in remark for remark in read_rig(tmp_path, **tables).remarks)


def test_a_clipped_channel_is_in_the_table_too(tmp_path):
    slow = measured(200)
    slow["M"] = slow["M"].clip(upper=slow["M"].quantile(0.9))
    assert rows(found(tmp_path, slow)) == {("slow", "crank_torque", "", "clipped")}
