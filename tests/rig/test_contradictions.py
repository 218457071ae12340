"""Channels that cannot be those of the mechanism are told before any fit, each for what is wrong
with it."""

import numpy as np
import pytest
import yaml
from scipy.signal import butter, sosfilt, sosfiltfilt

from jointgap.config import Simulate
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.kinematics import ideal_channels
from jointgap.rig.read_files import read_measurements
from jointgap.rig.simulate_run import channels_at
from tests.catalogue import each
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


def counted(rpm, counts, turns=6.0):
    """A sound run whose encoder counts its `counts` a turn."""
    frame = measured(rpm, noise=0.01, turns=turns, count=round(90 * turns))
    return frame.assign(theta=np.floor(counts * (0.048 + rpm / 60 * frame.t)))


@pytest.fixture
def found(tmp_path):
    """Measurements of a rig, sound where no other table is given; it may lack some channels."""

    def read(over=OVER, without=(), **tables):
        path = write_rig(
            tmp_path,
            over,
            **{run: measured(rpm) for run, rpm in RUNS.items() if run not in tables},
            **tables,
        )
        content = yaml.safe_load(path.read_text())
        content["channels"] = {
            name: own for name, own in content["channels"].items() if name not in without
        }
        path.write_text(yaml.safe_dump(content))
        return read_measurements(load_campaign(path))

    return read


def rows(measurements):
    return {(one.run, one.channel, one.other, one.kind) for one in measurements.contradictions}


def both(channel, kind, other=""):
    return {(run, channel, other, kind) for run in RUNS}


def in_both(**given):
    return {run: measured(rpm, **given) for run, rpm in RUNS.items()}


def stretched(frame, factor):
    return frame.assign(t=factor * frame.t)


def at_speeds(*rpm):
    return {
        "runs": [
            run | {"speed": f"{own} rpm"} for run, own in zip(CAMPAIGN["runs"], rpm, strict=True)
        ]
    }


def test_the_ideal_channels_are_those_of_the_simulation_without_clearance():
    ideal = mechanism(joints={name: {"loose": False} for name in ("crank_pin", "piston_pin")})
    angle = np.linspace(0.0, 6.0, 50)
    for speed in (20.0, 60.0):
        simulated = channels_at(
            parameters(ideal, Simulate(speed=speed, tolerance=1e-9)), angle, 1e-9
        )
        exact = ideal_channels(paper(), angle, speed)
        for name in exact:
            assert np.abs(simulated[name] - exact[name]).max() < 1e-9 * np.ptp(exact[name]), name


def test_a_sound_campaign_with_friction_is_not_remarked(found, tmp_path):
    listed = mechanism_with(tmp_path, "slider_coulomb_friction", force_N=5.0)
    white = {
        run: frame.assign(
            M=frame.M + 2.0 * np.random.default_rng([7, RUNS[run]]).normal(size=len(frame))
        )
        for run, frame in in_both(turns=6.0).items()
    }
    cases = [
        (OVER, in_both(noise=0.05)),
        (OVER | listed, {"slow": measured(200, 0.1), "fast": measured(600, 0.01)}),
        (OVER | {"runs": ONE_RUN}, {"slow": measured(200, turns=6.0)}),
        (OVER, white),  # which hides the slow run's torque
    ]

    def sound(over, tables):
        assert found(over, **tables).remarks == ()

    each(sound, cases)


def test_torque_and_acceleration_with_swapped_columns_are_both_named(found):
    channels = OVER["channels"] | {"slider_acceleration": {"column": "M", "unit": "m/s^2"}}
    channels["crank_torque"] = {"column": "slider_acceleration", "unit": "N*m", "noise": 0.02}
    told, names = found({"channels": channels}), ("crank_torque", "slider_acceleration")
    assert rows(told) == both(names[0], "swapped", names[1]) | both(names[1], "swapped", names[0])
    (remark,) = told.remarks
    assert "crank_torque and slider_acceleration are swapped" in remark


def test_a_turned_sign_or_a_wrong_unit_is_reported_for_its_channel_alone(found):
    def told_alone(column, factor, kind, words):
        channel = {"M": "crank_torque"}.get(column, column)
        told = found(**in_both(**{column: factor}))
        assert rows(told) == both(channel, kind) and any(
            words.format(channel) in remark for remark in told.remarks
        )

    cases = [
        (column, -1.0, "sign", "{} has the opposite sign")
        for column in ("slider_acceleration", "M", "guide_force")
    ]
    each(told_alone, [*cases, ("slider_acceleration", 1 / 9.81, "scale", "did you mean 'g_n'")])
    acceleration = {"slider_acceleration": OVER["channels"]["slider_acceleration"] | {"sign": -1}}
    told = found({"channels": OVER["channels"] | acceleration})
    assert (
        rows(told) == both("slider_acceleration", "sign")
        and "remove the channel's sign: -1" in told.remarks[0]
    )


def test_an_encoder_whose_zero_is_off_is_reported_with_the_angle_unless_it_lies_within_the_bounds_listed(
    found,
):
    def told(slow, fast):
        read = found(slow=measured(200, turned=slow), fast=measured(600, turned=fast))
        assert rows(read) == both("crank_angle", "phase") and len(read.remarks) == (
            1 if slow == fast else 2
        )
        assert [np.degrees(one.phase) for one in read.contradictions] == pytest.approx(
            [slow, fast], abs=2.0
        )

    each(told, [(170.0, 170.0), (50.0, -50.0)])

    def within(slow, fast, bound):
        over, other = OVER | {"nuisance": {"encoder_zero": bound}}, measured(600, turned=fast)
        assert found(over, slow=measured(200, turned=slow), fast=other).remarks == ()
        beyond = found(over, slow=measured(200, turned=120), fast=other)
        assert rows(beyond) == {("slow", "crank_angle", "", "phase")}

    each(within, [(50, -50, "60 deg"), (80, -80, "90 deg")])


def test_a_channel_from_another_runs_file_is_named_in_that_run(found):
    for noise in (0.0, 0.4):
        slow, fast = measured(200, turns=4.0), measured(600)
        slow["M"] = fast["M"] = fast["M"] + noise * fast["M"].std() * np.random.default_rng(
            2
        ).normal(size=len(fast))
        told = found(slow=slow, fast=fast)
        assert rows(told) == {("slow", "crank_torque", "", "unrelated")}
        assert "crank_torque has the samples of run fast" in told.remarks[0]


def test_stretched_times_are_distinguished_from_a_wrong_speed(found):
    time = {("slow", "time", "", "time")}
    for factor in (0.8, 1.4):
        told = found(slow=stretched(measured(200), factor))
        assert rows(told) == time and [one.doubtful for one in told.contradictions] == [True]
        assert rows(found(OVER | at_speeds(200 * factor, 600))) == {("slow", "time", "", "speed")}
    faster = at_speeds(
        178, 535
    )  # in both runs, where times and angles agree: a remark but no doubt
    told, undecided = found(OVER | faster), found(faster, ["crank_torque"])
    assert rows(told) == both("time", "speed") and len(undecided.contradictions) == 2
    assert not any(one.doubtful for one in (*told.contradictions, *undecided.contradictions))
    no_encoder, force_alone = (
        ["crank_angle"],
        ["crank_angle", "slider_position"],
    )  # speeds are those of the channels
    slow = stretched(measured(200), 1.3)
    assert rows(found(without=no_encoder)) == set()
    assert (
        rows(found(without=no_encoder, slow=slow))
        == rows(found({}, force_alone, slow=slow))
        == time
    )


def test_counts_of_another_encoder_are_told_by_the_period_of_the_other_channels(found):
    def read(stated, counts, without=(), turns=6.0):
        encoder = {"unit": "counts", "counts_per_turn": stated, "noise": None}
        over = {"channels": {**OVER["channels"], "crank_angle": encoder}}
        return found(
            over, without, **{run: counted(rpm, counts, turns) for run, rpm in RUNS.items()}
        )

    def is_told(stated, counts, without=(), turns=6.0):
        told = read(stated, counts, without, turns)
        assert rows(told) == both("crank_angle", "scale") and all(
            one.stops for one in told.contradictions
        )
        remark = f"repeat every {counts / stated:.4g} turn of crank_angle"
        assert any(
            remark in one and f"counts_per_turn: {counts} instead of {stated}" in one
            for one in told.remarks
        )

    each(
        is_told,
        [(4096, 4000), (1024, 1000, ["slider_acceleration", "time"]), (2000, 2048, (), 12.0)],
    )
    sound = [(4096, 4096)]
    each(lambda *given: pytest.fail() if read(*given).contradictions else None, sound)
    for stated, counts in ((360, 1440), (1440, 360)):
        with pytest.raises(InputError, match=f"counts_per_turn is {stated}: did you mean {counts}"):
            read(stated, counts)


def test_a_turn_is_not_doubted_where_the_motion_does_not_repeat_every_turn(found):
    """Half orders of a four-stroke engine, vibration at a frequency of its own, motion that never
    repeats."""

    def is_sound(make):
        tables = {
            run: make(measured(rpm, turns=8.0, count=720), rpm / 30 * np.pi)
            for run, rpm in RUNS.items()
        }
        assert not any("repeat every" in remark for remark in found(**tables).remarks)

    def added(other):
        def make(frame, speed):
            names = [*UNITS, "M"]
            return frame.assign(
                **{name: frame[name] + frame[name].std() * other(frame.t, speed) for name in names}
            )

        return make

    def cycles(time, speed):  # impacts of random size
        rng, turn = np.random.default_rng(4), (speed * time / np.pi).astype(int)
        return 2.0 * rng.standard_normal(turn.max() + 1)[turn] * np.sin(9.0 * speed * time)

    others = [lambda t, w, order=order: 2.0 * np.cos(order * w * t) for order in (0.5, 1.1)]
    each(lambda other: is_sound(added(other)), [*others, cycles])


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


def mechanism_with(folder, name, **parameters):
    """File of the paper's mechanism that lists one effect."""
    content = yaml.safe_load(PAPER.read_text(encoding="utf-8"))
    content["effects"] = [{"name": name, "parameters": parameters}]
    (folder / "listed.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return {"mechanism": str(folder / "listed.yaml")}


ONE_RUN = [{"id": "slow", "file": "slow.csv", "speed": "200 rpm", "role": "split"}]
NEAR = at_speeds(200, 220)
TORQUE_ALONE = ["crank_angle", "slider_position"]


def test_a_load_is_taken_neither_for_wrong_times_nor_for_a_fault_of_a_force_sensor(found):
    tables = {run: with_load(rpm, constant=800.0) for run, rpm in RUNS.items()}
    assert found({}, TORQUE_ALONE, **tables).remarks == ()  # the torque, without an encoder

    def at_near_speeds(load):
        tables = {"slow": with_load(200, **load), "fast": with_load(220, **load)}
        for runs, without in (({"runs": ONE_RUN}, ()), (NEAR, ["slider_position"])):
            assert found(runs, without, **tables).remarks == ()

    each(at_near_speeds, [{"spring": 3000.0}, {"damping": 80.0}, {"constant": 300.0}])
    loaded = {run: with_load(rpm, constant=20.0) for run, rpm in (("slow", 200), ("fast", 220))}
    thousandth = {
        run: frame.assign(M=1e-3 * frame.M) for run, frame in loaded.items()
    }  # no load makes that
    assert rows(found(NEAR, **thousandth)) == both("crank_torque", "scale")


def test_nothing_is_reported_of_times_where_no_channel_can_be_compared_or_speeds_are_two_percent_off(
    found, tmp_path
):
    listed = mechanism_with(tmp_path, "slider_coulomb_friction", force_N=5.0)
    assert found(listed, TORQUE_ALONE).remarks == ()
    speed = {"channels": {"crank_speed": {"column": "w", "unit": "rad/s"}}}
    tables = {
        run: frame.assign(w=RUNS[run] * np.pi / 30 + 0.1 * np.sin(frame.t * RUNS[run] * np.pi / 30))
        for run, frame in in_both().items()
    }
    assert found(speed, [*TORQUE_ALONE, "crank_torque"], **tables).remarks == ()
    long = stretched(with_load(200, turns=60.0, count=2400), 1.02)
    assert found({}, ["crank_angle", "crank_torque"], slow=long).remarks == ()


def test_a_stated_speed_that_is_off_is_remarked_with_the_measured_one(tmp_path):
    for rpm, remarked in ((202, False), (220, True)):
        remarks = read_rig(tmp_path, at_speeds(rpm, 600), **in_both()).remarks
        assert (
            any("mean speed is 200" in one and f"{rpm} rpm" in one for one in remarks) == remarked
        ), remarks


@pytest.mark.parametrize(("filter_", "direction"), [("causal", 1), ("zero_phase", -1)])
def test_a_channel_behind_a_stated_low_pass_is_not_remarked(tmp_path, filter_, direction):
    tables, step = {}, 1e-4
    for run, rpm in RUNS.items():
        frame, speed = measured(rpm, turns=6.0), rpm * np.pi / 30
        time = np.arange(-int(2400 / rpm / step), int(2400 / rpm / step)) * step
        exact = ideal_channels(paper(), direction * (0.3 + speed * time), direction * speed)
        sections, run_through = (
            butter(4, 7.0, fs=1 / step, output="sos"),
            {"causal": sosfilt}.get(filter_, sosfiltfilt),
        )
        seen = exact | {"slider_acceleration": run_through(sections, exact["slider_acceleration"])}
        for name in UNITS:
            level = np.interp(frame.t, time, seen[name])
            frame[name] = level + 0.02 * level.std() * np.random.default_rng(1).normal(
                size=len(frame)
            )
        frame["theta"] *= direction
        frame["x"] = 1e3 * np.interp(frame.t, time, exact["slider_position"])
        tables[run] = frame.assign(M=np.interp(frame.t, time, exact["crank_torque"]))
    turning = {1: "counter_clockwise", -1: "clockwise"}[direction]
    runs = [own | {"direction": turning} for own in CAMPAIGN["runs"]]
    stated = OVER["channels"]["slider_acceleration"] | {"bandwidth": "7 Hz", "filter": filter_}
    filtered = {"runs": runs, "channels": OVER["channels"] | {"slider_acceleration": stated}}
    assert read_rig(tmp_path, filtered, **tables).remarks == ()
    unstated = rows(read_rig(tmp_path, {"runs": runs} | OVER, **tables))
    assert {channel for _, channel, _, _ in unstated} == {"slider_acceleration"}


def test_a_speed_that_a_listed_effect_lets_fluctuate_is_not_remarked(tmp_path):
    def fluctuating(rpm):
        frame, speed = table(rpm, turns=5.0), rpm * np.pi / 30
        angle = 0.3 + speed * frame.t
        angle = (angle + 0.025 * np.sin(2 * angle)).to_numpy()
        channels = ideal_channels(paper(), angle, speed)
        return frame.assign(theta=np.degrees(angle) % 360, x=1e3 * channels["slider_position"])

    tables = {run: fluctuating(rpm) for run, rpm in RUNS.items()}
    listed = mechanism_with(tmp_path, "speed_fluctuation", ratio=0.05, order=2)
    assert read_rig(tmp_path, listed, **tables).remarks == ()
    assert any("the speed varies" in remark for remark in read_rig(tmp_path, **tables).remarks)
