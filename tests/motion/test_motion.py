"""Motion independent of the contact law."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from jointgap.core.errors import InputError
from jointgap.motion.simulation import integrate_to_angles
from jointgap.motion.slider_crank import simulate
from tests.motion.cases import (
    ALL,
    CENTRE,
    CRANK,
    MOTOR,
    PINS,
    ROD,
    SPEED,
    effect,
    integrated,
    mechanism,
    options,
)


def test_before_the_first_impact_the_rod_flies_freely():
    samples = simulate(mechanism(), options(samples_per_revolution=3600)).samples
    free = samples[samples.crank_angle < np.radians(6.2)]
    rate = -CRANK * SPEED / ROD
    lift = CRANK * SPEED + CENTRE * rate
    np.testing.assert_allclose(free.rod_position_x, CRANK + CENTRE, atol=1e-15)
    np.testing.assert_allclose(free.rod_position_y, lift * free.time, atol=1e-15)
    np.testing.assert_allclose(free.rod_angle, rate * free.time, atol=1e-15)
    np.testing.assert_allclose(free.slider_position, CRANK + ROD, atol=1e-15)
    kinds = ("normal_force", "friction_force", "force_x", "force_y")
    forces = [f"{pin}_{kind}" for pin in PINS for kind in kinds] + ["guide_force", "guide_moment"]
    assert (free[forces] == 0).all(axis=None)


def test_the_first_impact_is_where_free_flight_ends():
    def gap(angle):
        time = angle / SPEED
        turned = -CRANK * SPEED / ROD * time
        x = CRANK + CENTRE - CENTRE * math.cos(turned) - CRANK * math.cos(angle)
        y = (CRANK * SPEED / 2) * time - CENTRE * math.sin(turned) - CRANK * math.sin(angle)
        return math.hypot(x, y) - 1e-3

    first = simulate(mechanism(), options()).events.iloc[0]
    assert (first.joint, first.event) == ("crank_pin", "impact")
    assert math.degrees(first.crank_angle) == pytest.approx(6.2, abs=0.05)
    assert first.crank_angle == pytest.approx(brentq(gap, 0.05, 0.2, xtol=1e-16), abs=1e-11)


@pytest.mark.parametrize(
    "start, message",
    [
        ((2e-3, 0, 0, 0), "crank pin"),
        ((0, 0, 0, 1e-3), "piston pin"),
        ((0, 0, 0, 0, 1e-4, 0), "crank pivot.*ideal"),
        ((np.nan, 0, 0, 0), "four"),
    ],
)
def test_a_start_in_contact_is_refused(start, message):
    with pytest.raises(InputError, match=message):
        simulate(mechanism(), options(), start)


@pytest.mark.parametrize("loose, offset", [(PINS, 0.05), (("crank_pin",), 0.0), (ALL, 0.0)])
def test_with_vanishing_clearance_the_motion_becomes_ideal(loose, offset, worst):
    distances = []
    for clearance in (1e-3, 1e-4, 1e-5):
        made = mechanism(friction=0.1, clearance=clearance, loose=loose, offset=offset)
        samples = simulate(made, options(tolerance=1e-11)).samples
        rise = offset - CRANK * np.sin(samples.crank_angle)
        slider = CRANK * np.cos(samples.crank_angle) + np.sqrt(ROD**2 - rise**2)
        apart = samples.r1.max() + samples.r2.max() + samples.r3.max()
        assert apart < len(loose) * (clearance + 1e-4)  # the surfaces give way by less than that
        distances.append(np.abs(samples.slider_position - slider).max())
        assert distances[-1] < 1.1 * apart
        assert np.abs(samples.rod_angle - np.arcsin(rise / ROD)).max() < 1.1 * apart / ROD
    # the distance is proportional to the clearance, down to the penetration
    assert distances[0] > 5 * distances[1] > 25 * distances[2]
    worst("distance from the ideal slider at c = 10 um [m]", distances[-1], 5e-5)


@pytest.mark.parametrize(
    "effects, keys, drive",
    [
        ([], {"loose": ALL, "friction": 0.1}, {"drive": MOTOR}),
        ([effect("speed_fluctuation", ratio=0.1, order=2, phase_rad=0.5)], {}, {}),
    ],
)
def test_the_motion_is_the_same_from_another_start(effects, keys, drive, worst):
    made, degrees = mechanism(*effects, **keys), np.arange(0, 45.5, 0.5)
    model, run = integrated(made, degrees, 1e-14, start_angle=0.3, **drive)
    _, later = integrated(made, degrees, 1e-14, start_angle=0.3 + 2 * np.pi, **drive)
    vectors = slice(2 * len(model.loose))
    deviation = np.abs(later.states - run.states)[:, vectors].max()
    worst("start one turn later, 45 deg [m]", deviation, 1e-10)
    on_the_way = np.flatnonzero((run.modes == 0).all(axis=1) & (degrees > 12))[0]
    angles = 0.3 + np.radians(degrees[on_the_way:])
    model.drive.start_angle = angles[0]
    rest = integrate_to_angles(model, run.states[on_the_way], angles, 1e-14)
    deviation = np.abs(rest.states - run.states[on_the_way:])[:, vectors].max()
    worst("start on the way, 45 deg [m]", deviation, 1e-10)
    assert rest.times[-1] == pytest.approx(run.times[-1] - run.times[on_the_way], rel=1e-12)
