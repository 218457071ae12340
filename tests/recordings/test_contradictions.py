"""Channels that cannot be those of the mechanism are told before any fit, each for what is wrong with it."""

import numpy as np
import pytest

from jointgap.dynamics.model.compile_parameters import parameters
from jointgap.mechanism.ideal_channels import SPEED_POWERS, ideal_channels
from tests.config.mechanisms import paper
from tests.recordings.rig import read_rig, samples, table

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
    from jointgap.dynamics.solver.sampling import COLUMNS
    from jointgap.slider_crank.channel_kinematics import channels_at

    mechanism = paper()
    joints = {name: joint.model_copy(update={"loose": False}) for name, joint in dict(mechanism.joints).items()}
    ideal = mechanism.model_copy(update={"joints": type(mechanism.joints)(**joints)})
    angle = np.linspace(0.0, 6.0, 50)
    for speed in (20.0, 60.0):
        p = parameters(ideal, Simulate(speed=speed, tolerance=1e-9))
        simulated, exact = channels_at(p, angle, 1e-9), ideal_channels(mechanism, angle, speed)
        assert set(SPEED_POWERS) <= {column.name for column in COLUMNS}
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


def test_a_channel_from_another_runs_file_is_told_in_that_run(tmp_path):
    slow = measured(200)
    slow["M"] = measured(600, turns=5.0)["M"]
    assert rows(found(tmp_path, slow)) == {("slow", "crank_torque", "", "unrelated")}


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


def test_without_an_encoder_the_speed_is_that_at_which_channels_repeat(tmp_path):
    import yaml

    from jointgap.config.load import load_campaign
    from jointgap.recordings import read_measurements
    from tests.recordings.rig import write_rig

    def told(factor):
        slow = measured(200)
        slow["t"] *= factor
        path = write_rig(tmp_path, OVER, slow=slow, fast=measured(600))
        content = yaml.safe_load(path.read_text())
        del content["channels"]["crank_angle"]
        path.write_text(yaml.safe_dump(content))
        return rows(read_measurements(load_campaign(path)))

    assert told(1.0) == set()
    assert told(1.3) == {("slow", "time", "", "time")}


def test_a_clipped_channel_is_in_the_table_too(tmp_path):
    slow = measured(200)
    slow["M"] = slow["M"].clip(upper=slow["M"].quantile(0.9))
    assert rows(found(tmp_path, slow)) == {("slow", "crank_torque", "", "clipped")}
