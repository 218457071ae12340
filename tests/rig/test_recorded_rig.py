"""What every real rig has: zeros of its own in every run, a lag, steps, time stamps that are off,
an unsteady crank."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.campaign.analyse import analyse
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.noise import estimate_noise
from jointgap.identification.problem import Noise, Problem
from jointgap.rig.model import build_model
from jointgap.rig.read_files import read_measurements
from tests.rig import recorded_rig
from tests.rig.recorded_rig import NUISANCE, Rig
from tests.rig.rigs import read, rig

ZEROS = {"zeros_deg": (-1.6, 4.1), "position_zeros": (0.012, 0.011), "rpm": (60.0, 90.0)}
QUIET = Rig(jitter=0.0, noise=1e-9, step_deg=1e-6, seconds=8.0, **ZEROS)
"""A rig with nothing to scatter: two runs, the second held out."""
SHORT = Rig(
    rpm=(55.0, 80.0, 110.0, 75.0), zeros_deg=(-1.6, 4.1, 2.2, 1.3), position_zeros=(0.0121,) * 4
)
"""Three runs and one held out, with everything that a rig adds."""
LAGGING = NUISANCE | {"encoder_lag": "20 ms"}
MOTOR = {"stall_torque": 40.0, "no_load_speed": 50.0, "inertia": 0.02}
FINE = {"crank_angle": {"resolution": 1e-5}}
ZERO = {"encoder_zero": "5 deg"}


def model_of(folder, own: Rig, seed=0, **over):
    loaded = recorded_rig.campaign(folder, own, over, seed)
    return build_model(loaded, read_measurements(loaded))


def off(model, run, **values) -> float:
    """Root mean square error of a model's slider position [m]."""
    series = next(s for s in model.series if s.run == run)
    return float(
        np.sqrt(np.nanmean((read(model, run=run, **values)["slider_position"] - series.value) ** 2))
    )


# error of a smooth angle through 50 samples a second
@pytest.mark.parametrize("gaps, bound", [(0, 2e-5), (40, 5e-5)])
def test_the_model_agrees_with_closed_form_kinematics(tmp_path, gaps, bound):
    model = model_of(tmp_path, replace(QUIET, gaps=gaps), nuisance=LAGGING)
    assert np.isnan(model.series[0].value).sum() == gaps
    for run, values in zip(("r0", "r1"), QUIET.truth, strict=True):
        values = values | {"encoder_lag": QUIET.lag}
        assert off(model, run, **values) < bound
        for wrong in values:
            assert off(model, run, **values | {wrong: model.nominal(run)[wrong]}) > 1e-4


@pytest.mark.parametrize(
    "keys",
    [
        {"drive": "constant_speed", "sensors": FINE},
        {"drive": "measured_angle", "sensors": FINE},
        {"drive": "motor", "motor": MOTOR, "sensors": FINE},
        {"run": {"direction": "clockwise"}},
    ],
)
def test_the_encoder_zero_acts_as_the_encoder_offset_in_each_drive(keys):
    model = rig(nuisance=ZERO, **keys)
    plain, moved = read(model), read(model, encoder_zero=0.05)
    offset = read(model, ("encoder_offset", {"offset_rad": 0.05}))
    assert np.ptp(moved["slider_position"] - plain["slider_position"]) > 5e-3
    for channel in moved:
        assert moved[channel] == pytest.approx(
            offset[channel], abs=1e-9 * max(1.0, np.abs(offset[channel]).max())
        )
    zeros = {p.key: (p.nominal, p.high) for p in model.nuisances if p.name == "encoder_zero"}
    assert zeros == dict.fromkeys(
        ("encoder_zero@slow", "encoder_zero@fast"), (0.0, pytest.approx(math.radians(5)))
    )


def test_zeros_lengths_and_lag_are_recovered_by_a_fit(tmp_path):
    own = replace(SHORT, jitter=0.0)
    model = model_of(tmp_path, own, nuisance=LAGGING)
    result = fit_hypothesis(
        Problem(model, {s.key: Noise(np.full(s.value.shape, own.noise)) for s in model.series})
    )
    close = {
        "encoder_lag": 5e-4,
        "encoder_zero": math.radians(0.3),
        "slider_position_zero": 1e-3,
        "rod_length": 1e-3,
    }
    for run, values in enumerate(own.truth[:3]):
        for name, value in (values | {"encoder_lag": own.lag}).items():
            key = f"{name}@r{run}" if f"{name}@r{run}" in result.mapping else name
            assert result.mapping[key] == pytest.approx(value, abs=close.get(name, 3e-4)), key


def scatter(stated: float | None, **options):
    """The noise found in a position that scatters and whose time stamps are off, its rig, and the
    true rate."""
    own = Rig(**{"rpm": (80.0, 90.0), "noise": 2e-5, "seconds": 40.0} | options)
    rng, time = np.random.default_rng(5), np.arange(2000) / 50.0
    angle = own.angle(0, time)
    rate = np.gradient(own.position(angle), time)
    residual = rng.standard_normal(time.size) * own.noise + rate * own.jitter * rng.standard_normal(
        time.size
    )
    value = own.position(angle) + residual
    item = SimpleNamespace(
        series=[recorded_rig.series("r0", "slider_position", "m", value, time, angle, stated)]
    )
    return (
        estimate_noise(item, {("r0", "slider_position"): residual})["r0", "slider_position"],
        own,
        rate,
    )


@pytest.mark.parametrize(
    "stated, white, jitter",
    [
        *((stated, 2e-5, 0.7e-3) for stated in (None, 0.7e-3)),
        *((stated, white, 1e-4) for stated in (None, 1e-4) for white in (1e-7, 1e-6, 3e-6)),
    ],
)
def test_jitter_of_time_stamps_increases_noise_with_the_rate(stated, white, jitter):
    noise, own, rate = scatter(stated, noise=white, jitter=jitter)
    # a ten-thousandth of the variation of the position, nearly a sine
    floor = 1e-4 * own.crank / math.sqrt(2.0)
    assert noise.sd == pytest.approx(
        np.hypot(max(white, floor), jitter * rate), rel=0.25, abs=white
    )
    assert not any("no noise" in remark for remark in noise.remarks)
    assert any("time jitter" in remark for remark in noise.remarks) == (stated is None)


def sensors(**more):
    columns = {"time": ("t", "s"), "crank_angle": ("theta", "deg"), "slider_position": ("x", "mm")}
    return {
        name: {"column": column, "unit": unit} | more.get(name, {})
        for name, (column, unit) in columns.items()
    }


def test_an_unsteady_crank_is_reported_and_a_coarse_encoder_is_not(tmp_path):
    steady, uneven = (
        [remark for remark in read_measurements(own).remarks if "within a turn" in remark]
        for own in (
            recorded_rig.campaign(tmp_path, replace(QUIET, **changes), {"drive": "constant_speed"})
            for changes in (
                {"step_deg": 2.0, "unsteady": 0.0},
                {"step_deg": 0.09, "jitter": 0.7e-3},
            )
        )
    )
    assert not steady and len(uneven) == 2
    assert all("constant_speed" in remark and "measured_angle" in remark for remark in uneven)
    reason = float(uneven[0].split("by ±")[1].split(" %")[0])
    # the first order and the second's crests
    assert reason == pytest.approx(100 * 0.12 * 1.3, rel=0.25)


@pytest.mark.slow  # a complete campaign, some 45 s
@pytest.mark.parametrize("name", ["encoder_lag", "encoder_zeros"])
def test_the_encoder_lag_or_zeros_of_six_runs_are_named(tmp_path, name):
    own = replace(Rig(), lag=0.0 if name == "encoder_zeros" else Rig.lag)
    nuisance = {key: value for key, value in NUISANCE.items() if key != "encoder_zero" or own.lag}
    result = analyse(recorded_rig.write(tmp_path, own, {"nuisance": nuisance}), tmp_path / "found")
    (effect,) = result["effects"]
    assert (result["verdict"], effect["name"]) == ("named", name)
    zeros = [f"zero_rad@r{run}" for run in range(5)]
    true = (
        {"lag_s": own.lag}
        if own.lag
        else dict(zip(zeros, map(math.radians, own.zeros_deg), strict=False))
    )
    for parameter, value in true.items():
        low, high = effect["parameters"][parameter]["interval_90"]
        slack = 1e-4 if own.lag else 5e-4
        assert low - slack < value < high + slack
    assert result["gap"]["confirm"]["after"] < 1.3
