"""The positioning axis: force balances, synthetic and real data."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from examples.emps.__main__ import force_error
from examples.emps.effects import STROKE
from examples.emps.model import ADDRESS, AVERAGED, CYCLE, FILES, SAMPLE_TIME, Emps
from examples.naming import estimates, name
from jointgap.core.errors import InputError

pytestmark = pytest.mark.integration

LOOP = {"gtau": 35.0, "kp": 160.0, "kv": 240.0}
VALUES = {"mass": 95.0, "viscous": 200.0}
SPEED = 0.01  # m/s
SAMPLES = 2 * CYCLE * AVERAGED + AVERAGED  # two cycles and a bit, without which no noise is found


def write(folder: Path, reference: np.ndarray, volts=None) -> Emps:
    """The axis with both files holding one reference, and the voltages of each run."""
    for run, file in FILES.items():
        vir = np.zeros(reference.size) if volts is None else volts[run]
        savemat(folder / file, {**LOOP, "qg": reference, "qm": reference, "vir": vir})
    return Emps(folder)


@pytest.fixture
def ramp(tmp_path) -> Emps:
    """Motion at constant speed."""
    return write(tmp_path, SPEED * SAMPLE_TIME * np.arange(SAMPLES))


def force(model: Emps, **sizes):
    """Drive force with effects, by label with their values; others as in the first start."""
    known = {candidate.label: candidate for candidate in model.candidates}
    values = {
        label: {p.name: at.get(p.name, p.nominal) for p in known[label].coordinates}
        for label, at in sizes.items()
    }
    return model.simulated_force(
        "reference", VALUES, [(known[label], at) for label, at in values.items()]
    )


def test_at_constant_speed_the_drive_balances_the_resistance(ramp):

    cases = [
        ("slider_coulomb_friction", {"force_N": 20.0}, 20.0),
        ("slider_constant_force", {"force_N": 3.0}, -3.0),
        ("slider_quadratic_drag", {"drag_N_s2_m2": 4000.0}, 4000.0 * SPEED**2),
    ]
    for label, at, resistance in cases:
        assert force(ramp, **{label: at})[-1] == pytest.approx(
            VALUES["viscous"] * SPEED + resistance, rel=1e-6
        )
    last = force(ramp, slider_spring={"stiffness_N_m": 100.0, "rest_position_m": STROKE / 2})[-1]
    slide = (
        SPEED * SAMPLE_TIME * (SAMPLES - 1)
        - (SPEED + last / LOOP["gtau"] / LOOP["kv"]) / LOOP["kp"]
    )
    assert last == pytest.approx(VALUES["viscous"] * SPEED + 100.0 * (slide - STROKE / 2), abs=0.02)


def test_dry_friction_holds_the_slide(tmp_path):
    model = write(tmp_path, np.where(np.arange(SAMPLES) < 100, 0.0, 1e-6))
    # of the full step, with the slide at rest
    drive = LOOP["gtau"] * LOOP["kv"] * LOOP["kp"] * 1e-6
    found = force(model, slider_coulomb_friction={"force_N": 1.01 * drive})
    np.testing.assert_allclose(found[100:], drive, rtol=1e-12)


def test_missing_data_are_refused_with_their_address(tmp_path, monkeypatch):
    monkeypatch.delenv("JOINTGAP_EMPS", raising=False)
    for given in ((), (tmp_path,)):
        with pytest.raises(InputError, match=ADDRESS):
            Emps(*given)
    for file in FILES.values():
        savemat(tmp_path / file, {"gtau": 1.0})
    with pytest.raises(InputError, match=f"'kp'.*{ADDRESS}"):
        Emps(tmp_path)


@pytest.mark.parametrize(
    "truth",
    [
        {},
        {"slider_coulomb_friction": {"force_N": 20.0}, "slider_constant_force": {"force_N": 3.0}},
        # at an end of the stroke
        {"slider_spring": {"stiffness_N_m": 40.0, "rest_position_m": 0.0}},
    ],
    ids=lambda truth: " and ".join(truth) or "nothing",
)
def test_effects_in_synthetic_data_are_named(tmp_path, truth):
    phase = 2 * np.pi * np.arange(3 * CYCLE * AVERAGED) / (CYCLE * AVERAGED)
    reference = STROKE / 2 * (1.0 - np.cos(phase) + 0.1 * (1.0 - np.cos(5 * phase)))
    rng, clean = np.random.default_rng(7), force(write(tmp_path, reference), **truth)
    # 3 N on every sample
    volts = {run: (clean + rng.normal(0.0, 3.0, clean.size)) / LOOP["gtau"] for run in FILES}
    found = name(write(tmp_path, reference, volts))
    assert found.decision.verdict == ("named" if truth else "parameters_only"), (
        found.decision.because
    )
    assert set(found.names) == set(truth)
    if not truth:
        assert found.chosen.mapping == pytest.approx(VALUES, rel=0.01)
    for label, at in truth.items():
        for coordinate, value in at.items():
            assert found.chosen.mapping[f"{label}.{coordinate}"] == pytest.approx(
                value, rel=0.05, abs=0.01
            )
    if "slider_spring" in truth:
        start = "slider_spring.rest_position_m"
        (line,) = (line for line in estimates(found.chosen) if line.startswith(start))
        low, high = map(float, re.search(r"interval (\S+) to (\S+)", line).groups())
        # the interval ends there
        assert low == pytest.approx(0.0, abs=1e-3) and 1e-4 < high < STROKE / 10


@pytest.mark.skipif(
    not os.environ.get("JOINTGAP_EMPS"), reason=f"needs the EMPS data of {ADDRESS} in JOINTGAP_EMPS"
)
def test_published_friction_and_a_constant_force_explain_most_of_the_real_data():
    model = Emps()
    found = name(model)
    # a gap of 7 remains on the held-out run
    assert found.decision.verdict == "unexplained", found.decision.because
    assert set(found.names) == {"slider_coulomb_friction", "slider_constant_force"}
    assert found.chosen.mapping["slider_coulomb_friction.force_N"] == pytest.approx(20.4, rel=0.05)
    assert found.chosen.mapping["viscous"] == pytest.approx(203.0, rel=0.05)
    assert 0.17 < force_error(model, "pulses", found.base.base) < 0.18
    assert force_error(model, "pulses", found.chosen) < 0.06
