"""Motion at the samples: where revolutions repeat one stands for all, and next to no change changes next to nothing."""

from itertools import chain, repeat

import numpy as np
import pytest

from jointgap.dynamics.integrate import beginning
from jointgap.dynamics.simulation import integrate_on, integrate_to_angles, start_state
from jointgap.rig import simulate_run as motion
from jointgap.rig.drives import constant_speed_run, measured_drive
from jointgap.rig.model import build_model
from jointgap.rig.sampling import planned_grid
from jointgap.rig.simulate_run import with_effects
from tests.slider_crank.rigs import campaign, mechanism, recorded

TURN = 2 * np.pi
TOLERANCE = motion.TOLERANCE
SEEN = ("slider_acceleration", "crank_torque", "guide_force", "frame_force_y")


def driven(loose, effects=(), **keys):
    own = campaign(mechanism(loose, effects=effects), **keys)
    plan = build_model(own, recorded(own, kept=5)).plans["slow"]
    mechanism_ = with_effects(own.mechanism, ()).applied()
    return constant_speed_run(mechanism_, plan, {}, 0.0, TOLERANCE)


def integrated(p, angles):
    """Every sample of the record simulated, one after the other."""
    result = integrate_to_angles(p, start_state(p), np.append(p.drive.start_angle, angles), TOLERANCE)
    return {name: values[1:] for name, values in result.observed(p).items()} | {"time": result.times[1:]}


def apart(one, other):
    return max(np.sqrt(np.mean((one[name] - other[name]) ** 2)) / np.std(other[name]) for name in SEEN)


def over_noise(one, other):
    """Length of the change, over a noise of 1 % of what the channel varies by."""
    return np.sqrt(sum(np.sum((one[name] - other[name]) ** 2) / (0.01 * np.std(one[name])) ** 2 for name in SEEN))


def seen_at(run):
    return motion.channels_at(run.numbers, run.angles, TOLERANCE, change=over_noise)


@pytest.mark.parametrize(("size", "count", "kept"), [(50, 120, 50), (121, 120, 120), (1000, 120, 120)])
def test_revolutions_are_compared_at_samples_spread_over_the_crank_angle(size, count, kept):
    angles = np.random.default_rng(0).permutation(np.linspace(0.0, TURN, size))
    places = motion._spread(angles, count)
    assert np.unique(places).size == places.size == kept
    assert np.diff(angles[places]).min() > 0.0
    assert np.diff(angles[places]).max() <= 2.0 * TURN / (kept - 1)


@pytest.fixture
def ends(monkeypatch):
    """How many revolutions from the start each simulation ends; each goes on where the one before ended."""
    found = []

    def counted(p, progress, angles, *settings):
        found.append((angles[-1] - p.drive.start_angle) / TURN)
        return integrate_on(p, progress, angles, *settings)

    monkeypatch.setattr(motion, "integrate_on", counted)
    return found


@pytest.mark.parametrize(("loose", "length"), [(("piston_pin",), 4), (("crank_pin", "piston_pin"), 5)])
def test_one_settled_revolution_stands_for_the_record(loose, length, ends):
    run = driven(loose)
    ends.clear()
    found = seen_at(run)
    assert ends[-1] == pytest.approx(length, abs=0.1)
    later = integrated(run.numbers, np.sort(run.angles) + 6 * TURN)  # long after the start nothing else is seen
    assert apart(found, later) < 2e-3
    assert found["crank_angle"] == pytest.approx(run.angles)
    assert found["time"] == pytest.approx((run.angles - run.numbers.drive.start_angle) / run.numbers.drive.speed)


def test_a_force_with_a_frequency_of_its_own_is_simulated_throughout(ends):
    effect = {"name": "harmonic_force", "parameters": {"force_N": 20.0, "frequency_Hz": 7.3, "phase_rad": 0.0}}
    run = driven(("piston_pin",), [effect])
    ends.clear()
    found = seen_at(run)
    assert len(ends) == 1 and ends[0] > 6.5
    assert apart(found, integrated(run.numbers, run.angles)) < 1e-6


def test_a_motion_that_does_not_repeat_is_simulated_throughout(ends):
    own = campaign(mechanism(("crank_pin", "piston_pin"), friction=0.0))
    plan = build_model(own, recorded(own)).plans["slow"]
    run = constant_speed_run(own.mechanism.applied(), plan, {}, 0.0, TOLERANCE)
    ends.clear()
    found = seen_at(run)
    later = integrated(run.numbers, run.angles + 11 * TURN)  # it begins after two revolutions
    assert ends[-2] == pytest.approx(13.0, abs=0.1)
    assert apart(found, later) < 1e-6
    assert found["crank_angle"] == pytest.approx(run.angles)


def test_an_integration_that_goes_on_is_the_one_that_never_stopped():
    p = driven(("crank_pin", "piston_pin")).numbers
    angles = p.drive.start_angle + np.sort(np.random.default_rng([3, 1]).uniform(0.0, 4 * TURN, 300))
    whole = integrate_to_angles(p, start_state(p), np.append(p.drive.start_angle, angles), TOLERANCE)
    progress, steps = beginning(p, *start_state(p), 0.0), 0
    for begin, end in ((0, 1), (1, 2), (2, 100), (100, 300)):
        part, progress = integrate_on(p, progress, angles[begin:end], TOLERANCE)
        for name in ("times", "states", "auxiliary_states", "modes", "approaches", "begins", "directions"):
            np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[1 + begin : 1 + end])
        steps += part.steps
    assert 0 <= steps - whole.steps < 20  # the step that holds the last sample is made again


def test_a_revolution_stands_for_the_record_only_if_what_is_read_has_settled(ends):
    """Its ends may agree where its impacts still differ from those of the revolution before."""
    run = driven(("piston_pin",))
    for still, length in ((0, 4.0), (1, 5.0), (2, 6.0)):
        changes = chain([2.0] * still, repeat(0.0))
        ends.clear()
        motion.channels_at(run.numbers, run.angles, TOLERANCE, change=lambda one, other, rest=changes: next(rest))
        assert ends[-1] == pytest.approx(length, abs=0.1)


def test_a_motion_that_does_not_settle_is_simulated_as_long_as_the_record_from_where_it_should_have(ends):
    """One revolution of it says too little: features of the true motion would not be met."""
    run = driven(("crank_pin", "piston_pin"))
    recorded = np.ptp(run.angles) / TURN
    ends.clear()
    found = motion.channels_at(run.numbers, run.angles, TOLERANCE, change=lambda one, other: 2.0)
    assert recorded > 1.0
    assert ends[-1] - 12.0 == pytest.approx(recorded, abs=1.0)
    assert found["time"] == pytest.approx((run.angles - run.numbers.drive.start_angle) / run.numbers.drive.speed)


@pytest.mark.parametrize("turned", [0.0, 0.2, 1.0, np.pi])
@pytest.mark.parametrize("decay", [0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("away", [0.5, 0.9, 1.1, 2.0, 20.0])
def test_a_mode_that_rings_has_settled_when_it_is_near_its_limit_and_no_longer_moves(away, decay, turned):
    """With revolutions that are a point on a spiral: its distance to the centre and to the point before are known."""
    z = decay * np.exp(1j * turned)
    spiral = [{"x": np.array([10.0 + w.real, -3.0 + w.imag])} for w in (away / z**2, away / z, away + 0.0j)]

    def distance(one, other):
        return float(np.linalg.norm(one["x"] - other["x"]))

    near = away < 1.0 and abs(away - away / z) < 1.0
    assert motion.has_settled(*spiral, distance) == near


def ringing(damping_ratio):
    """A motion whose rod rings some ten and a half times a revolution, without clearance."""
    parameters = {"frequency_Hz": 10.5 * 30.0 / TURN, "damping_ratio": damping_ratio}
    return driven((), [{"name": "rod_flexibility", "parameters": parameters}])


def test_a_rod_that_rings_for_long_is_left_to_ring_before_a_revolution_stands_for_the_record(ends):
    run = ringing(0.01)  # seven time constants of its decay take eleven revolutions and more
    back = round((run.angles.min() - run.numbers.drive.start_angle) / TURN)
    ends.clear()
    found = motion.channels_at(run.numbers, run.angles, TOLERANCE, change=over_noise)
    assert back > 10
    assert ends[-1] == pytest.approx(back + 1.0, abs=0.1)
    later = integrated(run.numbers, np.sort(run.angles) + 40 * TURN)
    assert over_noise(found, later) < 1.0


def test_a_rod_that_has_not_rung_down_is_simulated_throughout_though_each_revolution_changes_little(ends):
    run = ringing(1e-3)
    ends.clear()
    found = motion.channels_at(run.numbers, run.angles, TOLERANCE, change=lambda one, other: over_noise(one, other) / 6)
    assert ends[-1] > ends[-2] + 4.0
    later = ends[-1] * TURN - (run.angles.max() - run.numbers.drive.start_angle)
    assert apart(found, integrated(run.numbers, run.angles + later)) < 1e-6


def test_a_record_from_the_start_shows_how_the_motion_settles(ends):
    run = driven(("piston_pin",), run={"start": "dead_centre"})
    ends.clear()
    found = seen_at(run)
    assert len(ends) == 1
    assert apart(found, integrated(run.numbers, run.angles)) < 1e-6


def test_a_film_answers_smoothly_to_a_mass():
    effect = {
        "name": "lubricated_joint",
        "site": "piston_pin",
        "parameters": {"viscosity_Pa_s": 0.05, "length_m": 0.014},
    }
    own = campaign(mechanism(("piston_pin",), effects=[effect]))
    plan = build_model(own, recorded(own)).plans["slow"]
    model, seen = own.mechanism.applied(), []
    for share in (0.0, 1e-8):
        heavier = model.model_copy(
            update={"slider": model.slider.model_copy(update={"mass": model.slider.mass * (1 + share)})}
        )
        run = constant_speed_run(heavier, plan, {}, 0.0, motion.tolerance_for(heavier))
        seen.append(motion.channels_at(run.numbers, run.angles, motion.tolerance_for(heavier)))
    assert apart(*seen) < 2e-3  # a tenth of a noise of 2 %


def test_an_even_record_is_led_in_and_out_at_every_speed():
    """The sample that ends a revolution comes to lie on the one that begins the next, but for rounding."""
    speeds = np.pi / 30 * np.concatenate([np.arange(30.0, 601.0, 10.0), np.geomspace(10.0, 6000.0, 20), [106.9, 500.0]])
    for speed in speeds:
        drive = measured_drive(planned_grid(speed, 0.3, True, 2, 24), 0.0, None, 1)
        assert np.diff(drive.table[:, 0]).min() > 0.9 * TURN / speed / 24
        np.testing.assert_allclose(drive.table[:, 5], speed, rtol=1e-6)
        assert drive.begin == pytest.approx(TURN / speed)
