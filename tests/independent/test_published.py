"""Results reported by Flores and co-authors; see docs/simulation.md."""

import math

import numpy as np
import pytest

from tests.independent.published import CRANK, ROD, SPEED, mechanism, run

IDEAL_PEAK = CRANK * SPEED**2 * (1 + CRANK / ROD)
"""Largest acceleration of the slider without clearance [m/s^2], at the outer dead centre."""


@pytest.fixture(scope="module")
def published():
    return run(revolutions=3)


def test_the_journal_alternates_between_flight_impact_and_contact(published):
    assert set(published["piston_pin_mode"]) == {"flight", "impact", "contact"}
    assert set(published["crank_pin_mode"]) == {"ideal"}


def test_the_slider_keeps_its_velocity_in_flight(published):
    """The steps in the published velocity curves: nothing but the joint pushes the slider."""
    flies = published["piston_pin_mode"] == "flight"
    assert 0.05 < flies.mean() < 0.5
    assert (published["slider_acceleration"][flies] == 0).all()
    inside = (flies & flies.shift(fill_value=False)).to_numpy()
    assert np.abs(np.diff(published["slider_velocity"]))[inside[1:]].max() < 1e-12


def test_accelerations_and_torque_have_peaks_far_above_the_ideal(published):
    without = IDEAL_PEAK
    assert published["slider_acceleration"].abs().max() > 5 * without
    assert published["slider_acceleration"].abs().median() < without  # peaks, and quiet in between
    assert published["crank_torque"].abs().max() > 5 * published["crank_torque"].abs().median()


def test_exudyn_gives_the_same_motion():
    pytest.importorskip("exudyn", reason="needs Exudyn: scripts/set-up peers")
    from jointgap.config import Simulate
    from jointgap.motion.slider_crank import simulate
    from tests.independent.cases import POSITIONS
    from validation.exudyn import SliderCrank

    made, peer = mechanism(), SliderCrank(mechanism(), SPEED)
    options = Simulate(speed=SPEED, revolutions=1, samples_per_revolution=4, tolerance=1e-15)
    ours = simulate(made, options).samples[POSITIONS].to_numpy()
    for quarter, bound in ((1, 1e-11), (2, 1e-10)):
        end = quarter * math.pi / 2 / SPEED
        assert np.abs(peer.advance(end, 1e-12, longest=1e-5) - ours[quarter]).max() < bound
