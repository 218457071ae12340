"""What Flores and co-authors report of their slider-crank is seen here too; see docs/simulation.md."""

import math

import numpy as np
import pytest

from tests.independent.published import CLEARANCE, CRANK, ROD, SAMPLES, SPEED, ideal, mechanism, run

IDEAL_PEAK = CRANK * SPEED**2 * (1 + CRANK / ROD)
"""Largest acceleration of the slider without clearance [m/s^2], at the outer dead centre."""


@pytest.fixture(scope="module")
def published():
    return run(revolutions=3)


def settled(members=4, speed=SPEED, **changed) -> dict[str, float]:
    """Means over slightly different starts, of the second revolution."""
    clearance = changed.get("clearance", CLEARANCE)
    found = []
    for seed in range(members):
        scatter = np.random.default_rng(seed).normal(0.0, 0.01 * clearance, 2)
        samples = run(2, speed, [0.0, 0.0, *scatter], **changed).iloc[SAMPLES:]
        without = ideal(samples["crank_angle"].to_numpy(), speed)
        deviation = {name: samples[name].to_numpy() - without[name].to_numpy() for name in without}
        rms = {name: float(np.sqrt(np.mean(values**2))) for name, values in deviation.items()}
        found.append(
            {
                "peak acceleration": samples["slider_acceleration"].abs().max(),
                "peak torque": samples["crank_torque"].abs().max(),
                "in contact": float((samples["piston_pin_mode"] != "flight").mean()),
                **rms,
            }
        )
    return {name: float(np.mean([one[name] for one in found])) for name in found[0]}


def test_the_journal_flies_hits_and_stays_in_contact_by_turns(published):
    assert set(published["piston_pin_mode"]) == {"flight", "impact", "contact"}
    assert set(published["crank_pin_mode"]) == {"ideal"}


def test_the_slider_keeps_its_velocity_while_the_journal_flies(published):
    """The steps in the published velocity curves: nothing but the joint pushes the slider."""
    flies = published["piston_pin_mode"] == "flight"
    assert 0.05 < flies.mean() < 0.5
    assert (published["slider_acceleration"][flies] == 0).all()
    whole = (flies & flies.shift(fill_value=False)).to_numpy()
    assert np.abs(np.diff(published["slider_velocity"]))[whole[1:]].max() < 1e-12


def test_accelerations_and_crank_torque_have_peaks_many_times_those_of_ideal_joints(published):
    without = ideal(published["crank_angle"])["slider_acceleration"].abs().max()
    assert without == pytest.approx(IDEAL_PEAK)
    assert published["slider_acceleration"].abs().max() > 5 * without
    assert published["slider_acceleration"].abs().median() < without  # peaks, and quiet in between
    assert published["crank_torque"].abs().max() > 5 * published["crank_torque"].abs().median()


def test_the_smaller_the_clearance_the_nearer_to_ideal_joints():
    found = [settled(clearance=clearance) for clearance in (0.5e-3, 0.2e-3, 0.1e-3, 0.01e-3)]
    for name in ("peak acceleration", "peak torque", "slider_position", "slider_velocity", "slider_acceleration"):
        values = [one[name] for one in found]
        assert values == sorted(values, reverse=True), name
    assert found[-1]["peak acceleration"] < 1.05 * IDEAL_PEAK
    contact = [one["in contact"] for one in found]
    assert contact == sorted(contact)


def test_exudyn_gives_the_same_motion():
    pytest.importorskip("exudyn", reason="needs Exudyn: scripts/set-up peers")
    from jointgap.config import Simulate
    from jointgap.dynamics.simulation import simulate
    from tests.independent.cases import POSITIONS
    from validation.exudyn import SliderCrank

    made, peer = mechanism(), SliderCrank(mechanism(), SPEED)
    options = Simulate(speed=SPEED, revolutions=1, samples_per_revolution=4, tolerance=1e-15)
    ours = simulate(made, options).samples[POSITIONS].to_numpy()
    for quarter, bound in ((1, 1e-11), (2, 1e-10)):
        end = quarter * math.pi / 2 / SPEED
        assert np.abs(peer.advance(end, 1e-12, longest=1e-5) - ours[quarter]).max() < bound
