"""What the motion must be, whatever the contact: free flight, symmetries, limits, and what is undefined."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.dynamics.parallel import simulate_ensemble
from jointgap.dynamics.simulation import simulate
from tests.dynamics.cases import CENTRE, CRANK, PINS, ROD, SPEED, integrated, mechanism, options


def test_until_the_first_impact_the_rod_flies_straight_and_turns_evenly():
    samples = simulate(mechanism(), options(samples_per_revolution=3600)).samples
    free = samples[samples.crank_angle < np.radians(6.2)]
    rate = -CRANK * SPEED / ROD
    lift = CRANK * SPEED + CENTRE * rate
    np.testing.assert_allclose(free.rod_position_x, CRANK + CENTRE, atol=1e-15)
    np.testing.assert_allclose(free.rod_position_y, lift * free.time, atol=1e-15)
    np.testing.assert_allclose(free.rod_angle, rate * free.time, atol=1e-15)
    np.testing.assert_allclose(free.slider_position, CRANK + ROD, atol=1e-15)
    forces = [f"{pin}_{force}" for pin in PINS for force in ("normal_force", "friction_force", "force_x", "force_y")]
    forces += ["guide_force", "guide_moment"]
    assert (free[forces] == 0).all(axis=None)


def test_it_hits_first_at_the_crank_pin_where_free_flight_ends():
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


def test_gravity_bends_the_free_flight():
    samples = simulate(mechanism(gravity=True), options(samples_per_revolution=3600)).samples
    free = samples[samples.crank_angle < np.radians(6)]
    fallen = CRANK * SPEED / 2 * free.time - free.rod_position_y
    np.testing.assert_allclose(fallen, 9.80665 * free.time**2 / 2, atol=1e-15)


def test_without_friction_it_does_not_matter_who_carries_the_bearing():
    degrees = np.arange(0, 61)
    _, pins = integrated(mechanism(), degrees)
    for journals in (("rod", "slider"), ("crank", "rod"), ("rod", "rod")):
        _, other = integrated(mechanism(journals=journals), degrees)
        np.testing.assert_array_equal(other.states, pins.states)


def test_with_friction_it_does():
    degrees = np.arange(0, 61)
    _, pins = integrated(mechanism(friction=0.2), degrees)
    for journals in (("rod", "slider"), ("crank", "rod")):
        _, other = integrated(mechanism(friction=0.2, journals=journals), degrees)
        assert np.abs(other.states - pins.states)[:, :4].max() > 1e-5


def test_directions_are_undefined_only_where_the_centres_coincide():
    run = simulate(mechanism(friction=0.05), options(samples_per_revolution=3600))
    samples = run.samples
    directions = [f"gamma{joint}{dots}" for joint in (2, 3) for dots in ("", "_dot", "_ddot")]
    assert samples.loc[0, directions].isna().all()
    pivot = [name for name in samples if name.startswith("gamma1")]
    assert samples[pivot].isna().all(axis=None)  # that joint is ideal
    assert samples.loc[0, ["r2", "r3", "r2_dot", "r3_dot"]].eq(0).all()
    # the centres part with their relative acceleration: the pin's towards the pivot, the piston's not at all but by the
    # rod's turning
    rate = CRANK * SPEED / ROD
    assert samples.loc[0, "r2_ddot"] == pytest.approx(CRANK * SPEED**2 + CENTRE * rate**2, rel=1e-12)
    assert samples.loc[0, "r3_ddot"] == pytest.approx((ROD - CENTRE) * rate**2, rel=1e-12)
    assert samples.drop(index=0, columns=pivot).notna().all(axis=None)
    assert np.abs(np.diff(samples.gamma2[1:])).max() < 1
    assert np.abs(np.diff(samples.gamma3[1:])).max() < 1


def test_the_tables_take_what_a_simulation_gives(tmp_path):
    run = simulate(mechanism(friction=0.05), options())
    for table, frame in ((schema.TRAJECTORY, run.samples), (schema.EVENTS, run.events)):
        parquet.write(table, frame, tmp_path / "table.parquet")
        assert parquet.read(table, tmp_path / "table.parquet").equals(frame)


def test_directions_do_not_depend_on_how_often_they_are_looked_at():
    made = mechanism(restitution=0.9, law="exact_restitution")  # long flights, close to the centre at times
    _, fine = integrated(made, np.arange(0, 36001) / 50, 1e-10)
    _, coarse = integrated(made, np.arange(0, 721, 90), 1e-10)
    seldom, often = coarse.directions[1:, :2], fine.directions[1:, :2]
    np.testing.assert_allclose(seldom, fine.directions[4500::4500, :2], atol=1e-9)
    unwrapped = np.unwrap(often, axis=0)
    np.testing.assert_allclose(often - often[0], unwrapped - unwrapped[0], atol=1e-9)


def test_contact_forces_never_pull_and_vanish_apart():
    run = simulate(mechanism(restitution=0.3), options(samples_per_revolution=36000))
    for number, name in ((2, "crank_pin"), (3, "piston_pin")):
        force, r = run.samples[f"{name}_normal_force"], run.samples[f"r{number}"]
        assert (force >= 0).all()
        assert (force[r < 1e-3] == 0).all()
        assert force.max() > 1e3


def test_impacts_and_separations_alternate_in_each_joint():
    events = simulate(mechanism(), options(revolutions=2)).events
    assert events.time.is_monotonic_increasing
    for _, one in events.groupby("joint"):
        assert (one.event == np.resize(["impact", "separation"], len(one))).all()
        assert (one.approach_speed.notna() == (one.event == "impact")).all()
        assert (one.approach_speed.dropna() > 0).all()


def test_an_ensemble_holds_the_runs_of_its_perturbed_starts():
    made, wanted = mechanism(friction=0.1), options(samples_per_revolution=90)
    starts = np.random.default_rng(3).normal(scale=1e-7, size=(3, 4))
    starts[0] = 0
    ensemble = simulate_ensemble(made, wanted, starts)
    for perturbation, states in zip(starts, ensemble.states, strict=True):
        samples = simulate(made, wanted, perturbation).samples
        np.testing.assert_allclose(samples.r2, np.hypot(*states[:, :2].T), rtol=1e-15)
        np.testing.assert_array_equal(samples.crank_angle, ensemble.crank_angle)
    assert ensemble.transmission_angle.shape == (3, 91)
    vector = ensemble.states[1, 0] - ensemble.states[0, 0]
    assert 1e-8 < np.abs(vector[:4]).max() < 1e-6


@pytest.mark.parametrize(
    ("perturbation", "says"),
    [
        ((2e-3, 0, 0, 0), "crank pin"),
        ((0, 0, 0, 1e-3), "piston pin"),
        ((0, 0, 0, 0, 1e-4, 0), "crank pivot.*ideal"),
        ((0, 0, 0), "four"),
        ((np.nan, 0, 0, 0), "four"),
    ],
)
def test_a_start_in_contact_or_without_sense_is_refused(perturbation, says):
    with pytest.raises(InputError, match=says):
        simulate(mechanism(), options(), perturbation)
