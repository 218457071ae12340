"""What is hidden is what the truth says, and as large as was asked for."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import yaml

from jointgap.config import EFFECTS, Mechanism
from jointgap.config.load import load_campaign, validate
from jointgap.core.errors import InputError
from jointgap.core.joints import PINS
from jointgap.rig.read_files import read_measurements
from jointgap.rig.simulate_run import with_nuisances
from validation.calibrate import GAP_TOLERANCE, SIZING_NUMERICS, Calibrator, calibrate_size
from validation.effects import DRAWN_APART, LISTED, OFF_LIST, InjectedEffect
from validation.hide import ar1_noise, draw_trial, idle_effects, make_trial, parameters_beyond_nominal
from validation.plan import CLEARANCES, EXUDYN_EFFECTS, TARGET_GAPS, TrialPlan, TrialSet, first_trials, plan_trials
from validation.rig import (
    CrankRun,
    draw_rig,
    faulty_reading,
    noise_free_readings,
    simulate_signals,
    with_drawn_contact,
    with_unmeasured,
)

SET = TrialSet(seed=3, single=60, nothing=50, pairs=10, off_list=11, exudyn=4)
WHIRLING = 1
"""Number of a trial whose first contact makes the pin whirl."""

KINDS = ("single", "nothing", "pair", "off_list")
MORE = SET.model_copy(update={"clearances": 24, "exudyn_loose": 16})


@pytest.fixture(scope="module")
def rig():
    made = draw_rig(np.random.default_rng(4), "ideal")
    return made, Calibrator(made)


@pytest.fixture(scope="module")
def loose_rig():
    return draw_rig(np.random.default_rng(4), "loose")


def test_every_effect_of_the_catalogue_but_formulas_and_the_faults_of_sensors_can_be_hidden():
    names = {name.partition(":")[0] for name in LISTED}
    physical = {name for name in EFFECTS if not name.startswith("discovered")}
    # drawn as the torque ripple, so that sets made before it was an effect of the catalogue stay as they are; what both
    # pins share is drawn within its range alone; families are drawn as their members; a measured load is known
    friction = {"slider_stribeck_friction", "slider_position_friction", "crank_angle_friction"}
    families = friction | {"slider_power_drag", "slider_nonlinear_spring"}
    beyond = families | {"common_pin_friction", "pin_restitution", "common_pin_restitution"}
    assert names == physical - {"crank_periodic_torque", "slider_force_table"} - beyond | {
        *("encoder_offset", "sensor_bias", "sensor_gain", "sensor_lag", "sensor_delay"),
    }
    assert set(EXUDYN_EFFECTS) <= set(LISTED)
    assert not names & set(OFF_LIST)


def test_a_torque_ripple_is_the_periodic_torque_of_the_catalogue():
    made = draw_rig(np.random.default_rng(4), "ideal")
    scales = made.scales({"crank_torque": 1.0})
    effect = OFF_LIST["torque_ripple"](scales, np.random.default_rng(1))
    assert (effect.name, effect.site, effect.listed) == ("crank_periodic_torque", "crank_pivot", True)
    (entry,) = effect.in_file(0.2)
    assert EFFECTS["crank_periodic_torque"].model_validate(entry).parameters.torque_N_m == 0.2


def test_a_set_holds_what_it_says_and_its_names_tell_nothing():
    found = plan_trials(SET)
    kinds = [plan.kind for plan in found]
    assert {kind: kinds.count(kind) for kind in set(kinds)} == {
        "single": 60, "nothing": 50, "pair": 10, "off_list": 11, "exudyn": 4,
    }  # fmt: skip
    assert found == plan_trials(SET)
    assert len({plan.id for plan in found}) == len(found)
    assert all(len(plan.id) == 12 and int(plan.id, 16) >= 0 for plan in found)
    assert {plan.size for plan in found if plan.kind != "nothing"} == set(TARGET_GAPS)
    loose = [plan for plan in found if plan.base != "ideal" and plan.kind != "exudyn"]
    assert len(loose) >= 0.5 * (len(found) - 4)
    assert sum(plan.base == "chaotic" for plan in found) >= 5
    assert first_trials(SET) == found
    assert first_trials(SET, 2) == found[:2]


@pytest.mark.parametrize("count", [0, 136, 2.0, "2", True])
def test_a_part_of_a_set_that_is_not_there_is_told(count):
    with pytest.raises(InputError, match="whole number from 1 to 135"):
        first_trials(SET, count)


def test_every_effect_of_the_list_is_hidden_about_as_often():
    names = [plan.effects[0] for plan in plan_trials(SET) if plan.kind == "single"]
    counts = [names.count(name) for name in LISTED if name not in DRAWN_APART]
    assert max(counts) - min(counts) <= 1


def test_delays_are_single_effects_beside_those_that_a_set_draws_without_them():
    plain, more = (plan_trials(chosen) for chosen in (SET, SET.model_copy(update={"delays": 8})))
    delayed = [plan for plan in more if plan.effects == ("sensor_delay",)]
    assert len(delayed) == 8 and {plan.size for plan in delayed} == set(TARGET_GAPS)
    rest = [(plan.kind, plan.base, plan.size, plan.effects) for plan in more if plan not in delayed]
    assert sorted(rest) == sorted((plan.kind, plan.base, plan.size, plan.effects) for plan in plain)


def test_what_other_kinds_draw_does_not_depend_on_clearances_and_on_loose_joints_in_exudyn():
    drawn, others = (
        {(plan.kind, plan.base, plan.size, plan.effects) for plan in plan_trials(chosen) if plan.kind in KINDS}
        for chosen in (SET, MORE)
    )
    assert drawn == others


def test_clearances_are_hidden_in_joints_that_are_ideal_in_the_model_and_in_loose_ones():
    hidden = [plan for plan in plan_trials(MORE) if plan.kind == "clearance"]
    assert sorted(plan.effects[0] for plan in hidden) == sorted(8 * CLEARANCES)
    loosened = [plan for plan in hidden if plan.loose]
    assert {plan.loose for plan in loosened} <= set(PINS)
    assert all(plan.base != "ideal" and plan.effects == (f"{plan.loose}_clearance",) for plan in loosened)
    assert 3 <= len(loosened) <= 8
    assert sum(plan.base == "ideal" for plan in hidden) >= 8


def test_exudyn_moves_loose_joints_with_nothing_hidden_and_with_an_effect():
    plans = [plan for plan in plan_trials(MORE) if plan.kind == "exudyn"]
    before = [plan for plan in plan_trials(SET) if plan.kind == "exudyn"]
    assert len(plans) == 16 + len(before)
    assert sum(not plan.effects for plan in plans) == 4
    ideal = [plan for plan in plans if plan.base == "ideal"]
    assert sum(plan.effects[0] in CLEARANCES for plan in ideal) == len(ideal) - len(before)  # loose in the truth
    assert {plan.base for plan in plans} == {"ideal", "loose"}


@pytest.mark.integration
def test_the_contact_of_a_joint_that_the_model_has_as_ideal_is_drawn_and_sealed(tmp_path):
    plan = TrialPlan("0123456789ab", 3, "single", "ideal", 5.0, ("piston_pin_clearance",))
    (effect,) = make_trial(plan, 5, tmp_path / "a")["effects"]
    (other,) = make_trial(plan, 6, tmp_path / "b")["effects"]
    assert list(effect["parameters"]) == [
        "clearance_m", "restitution", "friction", "stiffness_factor", "damping_factor",
    ]  # fmt: skip
    assert all(effect["parameters"][key] != other["parameters"][key] for key in effect["parameters"])
    assert 0.3 <= effect["parameters"]["restitution"] <= 0.9
    assert 0.0 <= effect["parameters"]["friction"] <= 0.3
    assert 1 / 3 <= effect["parameters"]["stiffness_factor"] <= 3.0


@pytest.mark.integration
def test_a_joint_that_becomes_loose_does_not_whirl():
    plan = TrialPlan("0123456789ab", WHIRLING, "clearance", "ideal", 1.5, ("crank_pin_clearance",))
    draw = draw_trial(plan, *(np.random.default_rng([20261125, stream, plan.number]) for stream in (1, 2, 4)))
    ((hidden, size),) = draw.effects
    assert draw.gaps[0] < 2.0
    slippery = hidden.parameters(size)["friction"]
    sticky = replace(hidden, parameters=lambda size: hidden.parameters(size) | {"friction": 0.3, "restitution": 0.84})
    assert slippery < 0.2
    assert draw.calibrator.gap([(sticky, sticky.first)]) > 50.0


def test_the_contact_of_a_joint_that_is_loose_already_is_that_of_the_file(loose_rig):
    for joint in PINS:
        effect = LISTED[f"{joint}_clearance"](loose_rig.scales({}), np.random.default_rng(0))
        drawn = with_drawn_contact(loose_rig, effect, np.random.default_rng(0)).parameters(1e-4)
        assert (list(drawn) == ["clearance_m"]) == (joint in loose_rig.loose), joint


@pytest.mark.parametrize("name", ["slider_coulomb_friction", "gravity", "crank_viscous_friction", "sensor_gain"])
def test_the_gap_is_what_was_asked_for(rig, name):
    made, calibrator = rig
    one = LISTED[name](made.scales(calibrator.spread()), np.random.default_rng(0))
    for target in TARGET_GAPS:
        size, gap = calibrate_size(calibrator, one, target)
        if size < one.most:
            assert gap == pytest.approx(target, rel=2 * GAP_TOLERANCE)
        assert calibrator.gap([(one, size)]) == gap


def test_nothing_hidden_leaves_the_gap_of_the_noise(rig):
    assert rig[1].gap([]) == 1.0


def test_other_numerics_leave_a_gap_where_an_effect_rests_on_them(rig):
    made, calibrator = rig
    friction = LISTED["slider_coulomb_friction"](made.scales(calibrator.spread()), np.random.default_rng(1))
    hidden = [(friction, 20 * friction.first)]

    def gap(effects, numerics) -> float:
        readings = {
            run: noise_free_readings(made.true, made.runs[run], numerics, tuple(made.sensors), effects)
            for run in made.identify_runs
        }
        return calibrator.numerics_gap(effects, readings)

    assert gap(hidden, SIZING_NUMERICS) == 1.0
    assert 1.0 < gap(hidden, replace(SIZING_NUMERICS, sign_factor=3.0))
    assert gap([], replace(SIZING_NUMERICS, sign_factor=3.0)) == pytest.approx(1.0, abs=1e-6)


def test_what_a_nuisance_can_take_up_is_no_gap(rig):
    made, calibrator = rig
    heavier = LISTED["added_slider_mass"](made.scales(calibrator.spread()), None)
    low, high = made.nuisance_bounds["slider_mass"]
    within = 0.9 * (high - made.nuisance_values["slider_mass"])
    assert calibrator.gap([(heavier, within)]) < 1.02
    assert (
        calibrator.gap([(heavier, within + 5 * (high - low))])
        > calibrator.gap([(heavier, within + (high - low))])
        > 1.02
    )


def test_sensors_err_as_their_faults_say(rig):
    made, calibrator = rig
    run, turn = next(iter(made.runs.items()))
    channel = next(iter(made.sensors))
    true = calibrator.base.get(run) or noise_free_readings(made.true, turn, SIZING_NUMERICS, [channel])
    times = turn.times
    assert faulty_reading("sensor_bias", {"bias": 2.0}, true[channel], times) == pytest.approx(true[channel] + 2.0)
    assert faulty_reading("sensor_gain", {"gain_error": 0.1}, true[channel], times) == pytest.approx(
        1.1 * true[channel]
    )
    assert np.ptp(faulty_reading("saturation", {"saturation": 0.3}, true[channel], times)) == pytest.approx(
        0.7 * np.ptp(true[channel])
    )


def test_a_slow_sensor_lags_behind_a_slow_signal_by_its_time(rig):
    made, _ = rig
    lag = LISTED["sensor_lag"](made.scales(dict.fromkeys(made.sensors, 1.0)), np.random.default_rng(0))
    speed, channel = 20.0, lag.sensor
    times = np.linspace(0.0, 0.3, 200)
    late = 1e-4  # the lag of a signal much slower than it is a delay, to the second order
    seen = noise_free_readings(made.true, CrankRun(speed, 1.0, times), SIZING_NUMERICS, [channel], [(lag, late)])[
        channel
    ]
    delayed = noise_free_readings(made.true, CrankRun(speed, 1.0 - speed * late, times), SIZING_NUMERICS, [channel])[
        channel
    ]
    true = noise_free_readings(made.true, CrankRun(speed, 1.0, times), SIZING_NUMERICS, [channel])[channel]
    assert np.abs(seen - delayed).max() < 0.02 * np.abs(seen - true).max()


def test_a_late_logger_stores_what_was_true_earlier(rig):
    made, _ = rig
    delay = LISTED["sensor_delay"](made.scales(dict.fromkeys(made.sensors, 1.0)), np.random.default_rng(0))
    times = np.linspace(0.0, 0.3, 301)
    seen, true = (
        noise_free_readings(made.true, CrankRun(20.0, 1.0, times), SIZING_NUMERICS, [delay.sensor], effects)
        for effects in ([(delay, 2e-3)], [])
    )
    assert seen[delay.sensor][2:] == pytest.approx(true[delay.sensor][:-2], rel=1e-6, abs=1e-6)
    assert seen["crank_angle"] == pytest.approx(true["crank_angle"])


def test_noise_with_a_memory_has_the_variance_and_the_correlation_it_should_have():
    seen = ar1_noise(np.random.default_rng(0), 200_000, 0.7)
    assert seen.var() == pytest.approx(1.0, rel=0.02)
    assert np.mean(seen[1:] * seen[:-1]) == pytest.approx(0.7, rel=0.02)


def test_a_campaign_can_be_read_and_tells_nothing_of_the_truth(tmp_path):
    plan = TrialPlan("0123456789ab", 3, "single", "ideal", 5.0, ("slider_spring",))
    truth = make_trial(plan, 5, tmp_path / plan.id)
    assert truth == make_trial(plan, 5, tmp_path / "again")
    json.dumps(truth, allow_nan=False)
    folder = tmp_path / plan.id
    content = yaml.safe_load((folder / "campaign.yaml").read_text())
    assert content["name"] == plan.id
    assert yaml.safe_load((folder / "mechanism.yaml").read_text())["effects"] == []
    for file in folder.iterdir():
        assert file.stat().st_mtime == 1_577_836_800
        assert b"spring" not in file.read_bytes()
    measured = read_measurements(load_campaign(folder / "campaign.yaml"))
    assert set(measured.runs) == {"run1", "run2", "run3"}
    assert measured.runs[truth["confirm"]].held_out.all()
    assert set(measured.runs["run1"].channels) == set(truth["channels"])


def test_a_share_of_the_cranks_follow_the_angle_that_was_read_and_all_else_of_a_set_stays():
    plain, more = (plan_trials(chosen) for chosen in (MORE, MORE.model_copy(update={"measured_angle": 0.33})))
    assert [replace(plan, measured_angle=False) for plan in more] == plain
    assert not any(plan.measured_angle for plan in plain)
    able = [plan for plan in more if plan.kind != "wiring" and "speed_fluctuation" not in plan.effects]
    assert sum(plan.measured_angle for plan in more) == round(0.33 * len(able))
    assert all(plan in able for plan in more if plan.measured_angle)


@pytest.mark.integration
def test_a_crank_that_follows_the_angle_read_has_an_encoder_with_its_noise_or_its_steps(tmp_path):
    stated = set()
    for number in range(4):
        plan = TrialPlan("0123456789ab", number, "nothing", "ideal", 0.0, (), measured_angle=True)
        truth = make_trial(plan, 5, tmp_path / str(number))
        assert truth["drive"] == "measured_angle"
        own = load_campaign(tmp_path / str(number) / "campaign.yaml")
        encoder = own.channels["crank_angle"]
        assert own.drive == "measured_angle"
        assert "speed" not in own.nuisance
        stated |= {key for key in ("noise", "resolution") if getattr(encoder, key)}
        angle = read_measurements(own).runs["run1"].crank_angle
        if encoder.resolution:
            steps = angle / (encoder.resolution * own.factor("crank_angle"))
            np.testing.assert_allclose(np.diff(steps), np.round(np.diff(steps)), atol=1e-3)
    assert stated == {"noise", "resolution"}


def test_a_mass_that_is_added_to_one_not_exactly_known_counts_from_the_file(tmp_path):
    plan = TrialPlan("0123456789ab", 2, "single", "ideal", 5.0, ("added_slider_mass",))
    truth = make_trial(plan, 11, tmp_path)
    file = yaml.safe_load((tmp_path / "mechanism.yaml").read_text())
    draw = draw_trial(plan, *(np.random.default_rng([11, stream, plan.number]) for stream in (1, 2, 4)))
    made, ((hidden, size),) = draw.rig, draw.effects
    (stated,) = truth["effects"]
    off = truth["nuisances"]["slider_mass"] - file["slider"]["mass"]
    assert stated["parameters"]["mass_kg"] == pytest.approx(hidden.parameters(size)["mass_kg"] + off, rel=1e-12)
    assert abs(off) > 1e-4
    lengths = InjectedEffect("link_length_error", "crank, rod", lambda size: {"rod_m": size}, 1e-4, 0.02)
    known = parameters_beyond_nominal(made, lengths, 1e-3)
    assert list(known) == ["rod_m", "crank_m"]
    assert known["rod_m"] == 1e-3 + made.true["rod"]["length"] - made.nominal["rod"]["length"]


def test_an_effect_is_idle_where_it_is_a_parameter_within_its_stated_range_or_where_another_overwrites_it(tmp_path):
    plan = TrialPlan("0123456789ab", 2, "single", "ideal", 5.0, ("added_slider_mass",))
    assert make_trial(plan, 11, tmp_path)["effects"][0]["idle"] is False
    file = tmp_path / "campaign.yaml"
    mass = yaml.safe_load((tmp_path / "mechanism.yaml").read_text())["slider"]["mass"]
    low, high = yaml.safe_load(file.read_text())["nuisance"]["slider_mass"]

    def added(whole):
        return {"name": "added_slider_mass", "site": "slider", "parameters": {"mass_kg": whole - mass}}

    ends = [low - 1e-6, low + 1e-6, high - 1e-6, high + 1e-6]
    assert [idle_effects(file, [added(end)])[0] for end in ends] == [False, True, True, False]
    friction = {"name": "pin_friction", "site": "crank_pin", "parameters": {"coefficient": 0.3}}
    clearance = {"name": "crank_pin_clearance", "site": "crank_pin", "parameters": {"clearance_m": 1e-5}}
    stating = clearance | {"parameters": {"clearance_m": 1e-5, "friction": 0.1}}
    assert idle_effects(file, [friction, clearance]) == [False, False]
    assert idle_effects(file, [friction, stating]) == [True, False]
    assert idle_effects(file, [friction]) == [False]
    assert idle_effects(file, []) == []


def test_readings_are_the_truth_with_its_effect_and_noise(tmp_path):
    plan = TrialPlan("0123456789ab", 3, "single", "ideal", 5.0, ("slider_spring",))
    rng = np.random.default_rng([5, 1, plan.number])
    draw = draw_trial(plan, rng, np.random.default_rng(0), np.random.default_rng(0))
    made, hidden = draw.rig, draw.effects
    make_trial(plan, 5, tmp_path)
    measured = read_measurements(load_campaign(tmp_path / "campaign.yaml"))
    for run, recording in measured.runs.items():
        clean = noise_free_readings(made.true, made.runs[run], made.numerics, list(made.sensors), hidden)
        for channel, sensor in made.sensors.items():
            off = recording.channels[channel] - clean[channel]
            assert np.nanstd(off) == pytest.approx(sensor.noise_share * clean[channel].std(), rel=0.3), (run, channel)


def test_runs_with_loose_joints_begin_at_angles_of_their_own_and_nothing_else_of_the_rig_depends_on_it(loose_rig):
    one, other = (with_unmeasured(loose_rig, np.random.default_rng(seed)) for seed in (1, 2))
    starts = {(crank.start_angle, crank.settling) for rig in (one, other) for crank in rig.runs.values()}
    assert len(starts) == 6
    assert all(0.0 <= angle < 2 * math.pi and 12 <= turns <= 16 for angle, turns in starts)
    for drawn in (one, other):
        assert replace(drawn, runs=loose_rig.runs, true=None, nuisance_values=None) == replace(
            loose_rig, true=None, nuisance_values=None
        )
        for run, crank in drawn.runs.items():
            own = loose_rig.runs[run]
            assert (crank.speed, crank.phase) == (own.speed, own.phase)
            assert crank.times is own.times


def test_where_no_joint_is_loose_neither_start_nor_damping_changes_the_rig(rig):
    assert with_unmeasured(rig[0], np.random.default_rng(1)) is rig[0]


def test_the_drawn_damping_of_a_lasting_contact_is_the_nuisance_that_a_fit_would_call_it(loose_rig):
    drawn = with_unmeasured(loose_rig, np.random.default_rng(1))
    values = {f"lasting_damping_{joint}": drawn.nuisance_values[f"lasting_damping_{joint}"] for joint in drawn.loose}
    assert all(0.0 < abs(value) <= math.log(4.0) for value in values.values())
    assert drawn.nominal == loose_rig.nominal
    true, undrawn = (validate(Mechanism, rig.true, "a rig") for rig in (drawn, loose_rig))
    fitted = with_nuisances(undrawn, values)
    for joint in drawn.loose:
        contact = true.joint(joint).contact
        assert contact.reference_speed == pytest.approx(fitted.joint(joint).contact.reference_speed, rel=1e-12)
        assert contact.friction == undrawn.joint(joint).contact.friction
        assert contact.restitution == undrawn.joint(joint).contact.restitution


def test_readings_of_loose_joints_depend_on_the_drawn_damping_beyond_what_numerics_change(loose_rig):
    drawn = with_unmeasured(loose_rig, np.random.default_rng(1))
    run = next(iter(loose_rig.runs.values()))
    finer = replace(SIZING_NUMERICS, tolerance=0.1 * SIZING_NUMERICS.tolerance)
    torque, finer_torque, drawn_torque = (
        simulate_signals(content, run, numerics)["crank_torque"]
        for content, numerics in (
            (loose_rig.true, SIZING_NUMERICS),
            (loose_rig.true, finer),
            (drawn.true, SIZING_NUMERICS),
        )
    )
    assert np.std(drawn_torque - torque) > 10.0 * np.std(finer_torque - torque)


def test_a_run_passes_its_phase_at_time_zero_wherever_it_began(loose_rig):
    times = np.linspace(0.0, 0.1, 20)
    for angle, settling in ((0.0, 4), (5.0, 4), (2.0, 6)):
        run = CrankRun(30.0, 1.0, times, start_angle=angle, settling=settling)
        signals = simulate_signals(loose_rig.true, run, SIZING_NUMERICS)
        assert signals["crank_angle"] == pytest.approx(1.0 + 30.0 * times, abs=1e-9)
