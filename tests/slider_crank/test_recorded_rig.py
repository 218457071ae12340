"""What every real rig has: zeros of its own in every run, a lag, steps, time stamps that are off, an unsteady crank."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.campaign.analyse import analyse
from jointgap.core.errors import InputError
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.noise import estimate_noise, noise_of_model
from jointgap.identification.problem import Noise, Problem
from jointgap.rig.model import build_model
from jointgap.rig.read_files import read_measurements
from tests.slider_crank import recorded_rig
from tests.slider_crank.recorded_rig import Rig
from tests.slider_crank.rigs import campaign, mechanism, recorded

QUIET = Rig(
    jitter=0.0, noise=1e-9, step_deg=1e-6, zeros_deg=(-1.6, 4.1), position_zeros=(0.012, 0.011), rpm=(60.0, 90.0)
)
"""A rig with nothing to scatter: two runs, the second held out."""
MOTOR = {"stall_torque": 40.0, "no_load_speed": 50.0, "inertia": 0.02}


def model_of(folder, rig: Rig, **over):
    own = recorded_rig.campaign(folder, rig, over)
    return build_model(own, read_measurements(own))


def read(model, run: str, effects=(), **values: float) -> dict[str, np.ndarray]:
    chosen = {c.label: c for c in model.candidates}
    return model.simulate(run, model.nominal(run) | values, [(chosen[name], own) for name, own in effects])


def true_values(rig: Rig, run: int) -> dict[str, float]:
    return {
        "encoder_zero": math.radians(rig.zeros_deg[run]),
        "slider_position_zero": rig.position_zeros[run],
        "slider_offset": rig.offset,
        "crank_length": rig.crank,
        "rod_length": rig.rod,
    }


def test_with_zeros_offset_lengths_and_lag_as_they_are_the_model_reads_what_closed_form_kinematics_say(tmp_path):
    model = model_of(tmp_path, QUIET, nuisance=recorded_rig.NUISANCE | {"encoder_lag": "20 ms"})
    for number, run in enumerate(("r0", "r1")):
        values = true_values(QUIET, number) | {"encoder_lag": QUIET.lag}
        away = read(model, run, **values)["slider_position"] - model.series[number].value
        assert np.sqrt(np.mean(away**2)) < 2e-5  # what a smooth angle through 50 samples a second leaves
        for wrong in values:
            worse = read(model, run, **values | {wrong: model.nominal(run)[wrong]})["slider_position"]
            assert np.sqrt(np.mean((worse - model.series[number].value) ** 2)) > 1e-4


@pytest.mark.parametrize("drive", ["constant_speed", "measured_angle", "motor"])
def test_the_encoders_zero_acts_in_every_drive_as_the_candidate_that_all_runs_share(drive):
    given = {"motor": MOTOR} if drive == "motor" else {}
    sensors = {"crank_angle": {"resolution": 1e-5}}
    own = campaign(mechanism(), drive=drive, sensors=sensors, nuisance={"encoder_zero": "5 deg"}, **given)
    model = build_model(own, recorded(own))
    plain, moved = read(model, "slow"), read(model, "slow", encoder_zero=0.05)
    offset = read(model, "slow", [("encoder_offset", {"offset_rad": 0.05})])
    assert np.ptp(moved["slider_position"] - plain["slider_position"]) > 5e-3
    for channel in moved:
        assert moved[channel] == pytest.approx(offset[channel], abs=1e-9 * max(1.0, np.abs(offset[channel]).max()))
    zeros = [p for p in model.nuisances if p.name == "encoder_zero"]
    assert [(p.key, p.nominal, p.high) for p in zeros] == [
        (f"encoder_zero@{run}", 0.0, pytest.approx(math.radians(5))) for run in ("slow", "fast")
    ]


def test_a_zero_in_each_run_is_a_candidate_where_it_is_no_nuisance():
    sensors = {"crank_angle": {"resolution": 1e-5}}
    own = campaign(mechanism(), drive="measured_angle", sensors=sensors, run={"role": "split"})
    model = build_model(own, recorded(own))
    zeros = next(c for c in model.candidates if c.label == "encoder_zeros")
    assert zeros.amplitudes == ("zero_rad@slow", "zero_rad@fast")
    moved = read(model, "slow", [("encoder_zeros", {"zero_rad": 0.05})])
    offset = read(model, "slow", [("encoder_offset", {"offset_rad": 0.05})])
    for channel in moved:
        np.testing.assert_array_equal(moved[channel], offset[channel])
    listed = campaign(mechanism(), sensors=sensors, run={"role": "split"}, nuisance={"encoder_zero": "5 deg"})
    assert "encoder_zeros" not in {c.label for c in build_model(listed, recorded(listed)).candidates}


def test_in_a_single_run_for_fitting_a_zero_of_its_own_is_no_candidate_beside_the_offset():
    own = campaign(mechanism(), sensors={"crank_angle": {"resolution": 1e-5}})
    labels = {c.label for c in build_model(own, recorded(own)).candidates}
    assert "encoder_offset" in labels
    assert "encoder_zeros" not in labels


@pytest.mark.slow
def test_zeros_that_differ_from_run_to_run_are_named_where_nobody_listed_them(tmp_path):
    rig = replace(Rig(), lag=0.0)
    nuisance = {key: value for key, value in recorded_rig.NUISANCE.items() if key != "encoder_zero"}
    found = analyse(recorded_rig.write(tmp_path, rig, {"nuisance": nuisance}), tmp_path / "results")
    assert [effect["name"] for effect in found["effects"]] == ["encoder_zeros"]
    for run in range(5):
        low, high = found["effects"][0]["parameters"][f"zero_rad@r{run}"]["interval_90"]
        assert low - 5e-4 < math.radians(rig.zeros_deg[run]) < high + 5e-4
    assert found["gap"]["confirm"]["after"] < 1.3


def test_the_zero_of_a_clockwise_cranks_encoder_has_the_files_sign():
    own = campaign(mechanism(), run={"direction": "clockwise"}, nuisance={"encoder_zero": "5 deg"})
    model = build_model(own, recorded(own))
    moved = read(model, "slow", encoder_zero=0.05)
    offset = read(model, "slow", [("encoder_offset", {"offset_rad": 0.05})])
    assert moved["slider_position"] == pytest.approx(offset["slider_position"], abs=1e-12)


def test_speed_and_first_angle_are_no_nuisances_where_the_measured_angle_drives(tmp_path):
    model = model_of(tmp_path, QUIET)
    assert {p.name for p in model.nuisances} == set(recorded_rig.NUISANCE)
    assert all(
        np.ptp(read(model, "r0", **{p.name: p.high})["slider_position"] - read(model, "r0")["slider_position"]) > 1e-6
        for p in model.nuisances
        if p.run == "r0" and p.name == "encoder_zero"
    )


def test_an_encoder_that_lags_reads_less_by_the_speed_times_the_lag():
    own = campaign(mechanism(), nuisance={"encoder_lag": "5 ms"})
    model = build_model(own, recorded(own))
    late = read(model, "slow", encoder_lag=2e-3)
    early = read(model, "slow", [("encoder_offset", {"offset_rad": -2e-3 * model.nominal("slow")["speed"]})])
    assert late["crank_angle"] == pytest.approx(read(model, "slow")["crank_angle"], abs=1e-9)
    assert late["slider_position"] == pytest.approx(early["slider_position"], abs=1e-9)


def test_a_lag_of_the_driving_angle_is_a_candidate_that_stands_for_its_nuisance(tmp_path):
    plain, listed = model_of(tmp_path, QUIET), model_of(tmp_path, QUIET, nuisance={"encoder_lag": "5 ms"})
    of = [next(c for c in model.candidates if c.label == "encoder_lag") for model in (plain, listed)]
    assert [dict(c.replaces) for c in of] == [{}, {"encoder_lag": "lag_s"}]
    moved = read(plain, "r0", [("encoder_lag", {"lag_s": 4e-3})])["slider_position"]
    assert moved == pytest.approx(read(listed, "r0", encoder_lag=4e-3)["slider_position"], abs=1e-12)


def test_zeros_lengths_and_lag_are_fitted_to_what_they_are_and_the_held_out_runs_own_zero_too(tmp_path):
    rig = Rig(rpm=(55.0, 80.0, 110.0, 75.0), zeros_deg=(-1.6, 4.1, 2.2, 1.3), position_zeros=(0.0121,) * 4, jitter=0.0)
    model = model_of(tmp_path, rig, nuisance=recorded_rig.NUISANCE | {"encoder_lag": "20 ms"})
    noise = {s.key: Noise(np.full(s.value.shape, rig.noise)) for s in model.series}
    fit = fit_hypothesis(Problem(model, noise))
    assert fit.mapping["encoder_lag"] == pytest.approx(rig.lag, abs=5e-4)
    for run in range(3):
        for name, value in true_values(rig, run).items():
            key = f"{name}@r{run}" if f"{name}@r{run}" in fit.mapping else name
            close = {"encoder_zero": math.radians(0.3), "slider_position_zero": 1e-3, "rod_length": 1e-3}.get(
                name, 3e-4
            )
            assert fit.mapping[key] == pytest.approx(value, abs=close)


def scatter(stated: float | None, **options):
    """The noise of a position that scatters by 0.02 mm and by time stamps that are 0.7 ms off, and its truth."""
    rig = Rig(**{"rpm": (80.0, 90.0), "noise": 2e-5, "seconds": 40.0} | options)
    rng, time = np.random.default_rng(5), np.arange(2000) / 50.0
    angle = rig.angle(0, time)
    rate = np.gradient(rig.position(angle), time)
    white = rng.standard_normal(time.size) * rig.noise
    residual = white + rate * rig.jitter * rng.standard_normal(time.size)

    value = rig.position(angle) + residual
    one = SimpleNamespace(series=[recorded_rig.series("r0", "slider_position", "m", value, time, angle, stated)])
    return estimate_noise(one, {("r0", "slider_position"): residual})["r0", "slider_position"], rig, rate


@pytest.mark.parametrize("jitter", [None, 0.7e-3])
def test_noise_grows_with_a_channels_rate_as_time_stamps_make_it(jitter):
    noise, rig, rate = scatter(jitter)
    assert noise.sd == pytest.approx(np.hypot(rig.noise, rig.jitter * rate), rel=0.25, abs=2e-5)
    assert any("time stamps" in remark for remark in noise.remarks) == (jitter is None)


@pytest.mark.parametrize("stated", [None, 1e-4])
@pytest.mark.parametrize("white", [1e-7, 1e-6, 3e-6])
def test_jitter_counts_though_the_white_part_is_less_than_a_sensor_can_have(white, stated):
    noise, rig, rate = scatter(stated, noise=white, jitter=1e-4)
    floor = 1e-4 * rig.crank / math.sqrt(2.0)  # a ten-thousandth of what the position varies by, a sine or nearly so
    assert noise.sd == pytest.approx(np.hypot(max(white, floor), rig.jitter * rate), rel=0.25)
    assert not any("no noise" in remark for remark in noise.remarks)
    assert any("time stamps" in remark for remark in noise.remarks) == (stated is None)


def test_what_cycles_show_of_a_noise_that_grows_is_its_root_mean_square():
    noise, rig, rate = scatter(None)
    assert noise.estimated_sd == pytest.approx(np.sqrt(np.mean(rig.noise**2 + (rig.jitter * rate) ** 2)), rel=0.1)


def test_noise_that_does_not_grow_with_the_rate_is_one_number():
    noise, rig, _ = scatter(None, jitter=0.0)
    assert np.ptp(noise.sd) == 0.0
    assert noise.sd[0] == pytest.approx(rig.noise, rel=0.1)


@pytest.mark.parametrize("turns", [6, 60])
def test_the_floor_of_an_encoders_noise_does_not_grow_with_the_record(turns):
    time = np.arange(50 * turns) / 50.0
    angle = math.tau * time
    one = SimpleNamespace(series=[recorded_rig.series("r0", "crank_angle", "rad", angle, time, angle, None)])
    key = ("r0", "crank_angle")
    bare = estimate_noise(one, {key: np.zeros(time.size)})[key]
    assert math.degrees(bare.sd[0]) < 0.011
    assert "differences" not in bare.source
    one.series = [replace(one.series[0], resolution=math.radians(0.09))]
    stepped = estimate_noise(one, {key: np.zeros(time.size)})[key]
    assert math.degrees(stepped.sd[0]) == pytest.approx(0.09 / math.sqrt(12), rel=1e-6)
    assert stepped.source == "the sensor's steps"


def test_resolution_and_stated_noise_are_two_noises_and_jitter_a_third(tmp_path):
    sensors = {
        "time": {"column": "t", "unit": "s", "jitter": "0.7 ms"},
        "crank_angle": {"column": "theta", "unit": "deg", "resolution": 0.09},
        "slider_position": {"column": "x", "unit": "mm", "noise": 0.06},
    }
    model = model_of(tmp_path, QUIET, channels=sensors)
    series = model.series[0]
    assert series.jitter == pytest.approx(0.7e-3)
    predicted = model.simulate("r0", model.nominal("r0"))["slider_position"]
    noise = estimate_noise(
        model, {s.key: s.value - model.simulate(s.run, model.nominal(s.run))[s.channel] for s in model.series}
    )[series.key]
    rate = np.gradient(predicted, series.time)
    assert noise.sd == pytest.approx(np.hypot(6e-5, 0.7e-3 * rate), rel=1e-6)


def test_an_unsteady_crank_under_constant_speed_is_remarked_with_its_size(tmp_path):
    rig = replace(QUIET, step_deg=0.09, jitter=0.7e-3, unsteady=0.12)
    own = recorded_rig.campaign(tmp_path, rig, {"drive": "constant_speed"})
    remarks = [remark for remark in read_measurements(own).remarks if "constant_speed" in remark]
    assert len(remarks) == 2
    assert all("within a turn" in remark and "measured_angle" in remark for remark in remarks)
    told = float(remarks[0].split("by ")[1].split(" %")[0])
    assert told == pytest.approx(100 * 0.12 * 1.3, rel=0.25)  # the first order and the second's crests


def test_a_steady_crank_with_a_coarse_encoder_is_not_called_unsteady(tmp_path):
    rig = replace(QUIET, step_deg=2.0, unsteady=0.0)
    own = recorded_rig.campaign(tmp_path, rig, {"drive": "constant_speed"})
    assert not [r for r in read_measurements(own).remarks if "within a turn" in r]


def test_a_sensor_that_reads_backwards_needs_no_other_file_but_a_sign(tmp_path):
    own = recorded_rig.campaign(tmp_path, QUIET)
    channels = {name: one.model_dump(exclude_none=True) for name, one in own.channels.items()}
    turned = recorded_rig.campaign(
        tmp_path, QUIET, {"channels": channels | {"slider_position": {"column": "x", "unit": "mm", "sign": -1}}}
    )
    plain, back = (read_measurements(one).runs["r0"].channels["slider_position"] for one in (own, turned))
    assert (back == -plain).all()


@pytest.mark.parametrize(
    ("channel", "over", "words"),
    [
        ("time", {"sign": -1}, "time.sign does not apply"),
        ("slider_position", {"sign": 2}, "sign = 2"),
        ("slider_position", {"jitter": "1 ms"}, "slider_position.jitter does not apply"),
    ],
)
def test_signs_and_jitter_that_mean_nothing_are_refused(tmp_path, channel, over, words):
    columns = {"time": ("t", "s"), "crank_angle": ("theta", "deg"), "slider_position": ("x", "mm")}
    channels = {name: {"column": column, "unit": unit} for name, (column, unit) in columns.items()}
    channels[channel] |= over
    with pytest.raises(InputError, match=words):
        recorded_rig.campaign(tmp_path, QUIET, {"channels": channels})


def test_an_amount_is_a_nuisances_bounds_either_way(tmp_path):
    own = recorded_rig.campaign(tmp_path, QUIET)
    assert own.bounds("encoder_zero", 0.0) == pytest.approx((-math.radians(6), math.radians(6)))
    assert own.bounds("crank_length", 0.05) == pytest.approx((0.0485, 0.0515))
    assert own.idle_nuisances == ()
    with pytest.raises(InputError, match="encoder_zero = '-3 deg': must be greater than 0"):
        recorded_rig.campaign(tmp_path, QUIET, {"nuisance": {"encoder_zero": "-3 deg"}})


def test_gaps_in_both_channels_are_no_data_and_cost_nothing_else(tmp_path):
    rig = replace(QUIET, gaps=40)
    model = model_of(tmp_path, rig, nuisance=recorded_rig.NUISANCE | {"encoder_lag": "20 ms"})
    value = model.series[0].value
    assert np.isnan(value).sum() == 40
    away = read(model, "r0", **true_values(rig, 0), encoder_lag=rig.lag)["slider_position"] - value
    assert np.sqrt(np.nanmean(away**2)) < 5e-5


SHORT = Rig(rpm=(55.0, 80.0, 110.0, 75.0), zeros_deg=(-1.6, 4.1, 2.2, 1.3), position_zeros=(0.0121,) * 4)
"""Three runs and one held out, with everything that a rig adds."""


@pytest.mark.slow  # eight campaigns, each fitted from nominal
def test_intervals_of_lengths_hold_the_truth_where_the_offset_is_free(tmp_path):
    inside = []
    for seed in range(1, 9):
        own = recorded_rig.campaign(
            tmp_path, SHORT, {"nuisance": recorded_rig.NUISANCE | {"encoder_lag": "20 ms"}}, seed
        )
        model = build_model(own, read_measurements(own))
        fit = fit_hypothesis(Problem(model, noise_of_model(model)))
        sd = np.sqrt(np.diag(np.linalg.inv(fit.jacobian.T @ fit.jacobian)))
        sds = {p.key: one for p, one in zip(fit.parameters, sd, strict=True)}
        true = {"crank_length": SHORT.crank, "rod_length": SHORT.rod, "slider_offset": SHORT.offset}
        inside += [abs(fit.mapping[key] - value) < 1.645 * sds[key] for key, value in true.items()]
    assert np.mean(inside) >= 0.8  # of 24, of which nine in ten should be


@pytest.mark.slow  # a whole campaign, some 45 s
def test_six_runs_as_recorded_are_named_by_the_lag_with_zeros_as_parameters_and_a_small_held_out_gap(tmp_path):
    rig = Rig()
    document = analyse(recorded_rig.write(tmp_path, rig), tmp_path / "found")
    assert document["verdict"] == "named"
    assert [effect["name"] for effect in document["effects"]] == ["encoder_lag"]
    low, high = document["effects"][0]["parameters"]["lag_s"]["interval_90"]
    assert low - 1e-4 < rig.lag < high + 1e-4
    assert document["gap"]["confirm"]["after"] < 1.3
    for run in range(5):
        zero = document["nuisances"][f"encoder_zero@r{run}"]["value"]
        assert math.degrees(zero) == pytest.approx(rig.zeros_deg[run], abs=0.15)
    assert not {key for key in document["nuisances"] if key.startswith(("speed", "first_angle"))}
