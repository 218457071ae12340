"""A contact that lasts forgets the impact that it began with; a free impact does not notice."""

import numpy as np
import pytest

from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.contact import LAWS, damping_factor_at, elastic_duration, force_free_speed, pushing_margin
from jointgap.dynamics.integrate import EVENT, time_to_knot
from jointgap.dynamics.joints import CONTACT, FLIGHT
from jointgap.dynamics.runge_kutta import LINEAR, instant, room_for_stages, step
from jointgap.dynamics.simulation import integrate_to_angles, simulate, start_state
from tests.dynamics.cases import ALL, SPEED, free_impact, integrated, mechanism, options
from tests.dynamics.laws import faded_damping, impact_duration, joint

CHI, APPROACH = 0.8, 0.4
FADING = {"damping": CHI, "memory_time": 2e-3, "fading_time": 1e-3, "lasting_damping": CHI / 0.05}
LASTING = {"friction": 0.2, "friction_speed": 0.1}


@pytest.mark.parametrize("exponent", (1.0, 1.5, 2.2, 3.0))
@pytest.mark.parametrize("speed", (1e-3, 0.5))
def test_an_elastic_impact_lasts_as_long_as_the_balance_of_energy_says(exponent, speed):
    exact = impact_duration(3.6e10, exponent, 0.7, speed)
    assert elastic_duration(3.6e10, exponent, 0.7, speed) == pytest.approx(exact, rel=1e-9)


def test_with_hertz_it_is_the_known_number():
    modulus, radius = 1.1e11, 0.056  # K. L. Johnson, Contact Mechanics (1985), section 11.4
    known = 2.87 * (0.7**2 / (radius * modulus**2 * 0.5)) ** 0.2
    assert elastic_duration(4 / 3 * modulus * radius**0.5, 1.5, 0.7, 0.5) == pytest.approx(known, rel=2e-3)


def test_memory_and_fading_last_as_long_as_is_documented():
    p = parameters(mechanism(loose=ALL), options())
    for name, mass in {"crank_pin": 1.2212, "piston_pin": 1.2212, "crank_pivot": 1.5916}.items():
        numbers = getattr(p, name)
        duration = impact_duration(numbers.stiffness, 1.5, mass, 1e-3)
        assert numbers.memory_time == pytest.approx(2.5 * duration, rel=1e-9)
        assert numbers.fading_time == pytest.approx(2.5 * duration, rel=1e-9)
        assert numbers.lasting_damping == numbers.damping / 0.05


def test_the_published_form_and_the_penalty_form_never_fade():
    penalty = {"law": "penalty", "penalty_damping": 2e3, "penalty_depth": 1e-4}
    for made in (mechanism(memory="published"), mechanism(**penalty)):
        numbers = parameters(made, options()).crank_pin
        assert numbers.memory_time == np.inf
        assert damping_factor_at(numbers, APPROACH, 0.0, 1e6) == numbers.damping / APPROACH
        if numbers.damping > 0:
            assert force_free_speed(numbers, APPROACH, 0.0, 1e6) == (APPROACH / numbers.damping, 0.0)


@pytest.mark.parametrize("approach", (1e-3, 0.05, APPROACH, 10.0))
def test_the_damping_goes_over_as_a_smooth_step_of_ninth_order(approach):
    numbers, times = joint(**FADING), np.linspace(0.0, 4e-3, 401)
    found = [damping_factor_at(numbers, approach, 1.0, 1.0 + time) for time in times]
    np.testing.assert_allclose(found, faded_damping(numbers, approach, times), rtol=1e-11)
    assert set(found[:201]) == {CHI / approach} and set(found[301:]) == {CHI / 0.05}


def test_the_speed_at_which_the_force_vanishes_belongs_to_the_damping_and_its_rate_is_its_derivative():
    numbers, short = joint(**FADING), 1e-8
    for time in (1e-3, 2.1e-3, 2.5e-3, 2.9e-3, 3.5e-3):
        behind, here, ahead = (force_free_speed(numbers, APPROACH, 0.0, time + sign * short) for sign in (-1, 0, 1))
        assert here[0] == pytest.approx(1 / damping_factor_at(numbers, APPROACH, 0.0, time), rel=1e-14)
        assert here[1] == pytest.approx((ahead[0] - behind[0]) / (2 * short), rel=1e-6, abs=1e-6)


def test_the_margin_until_the_force_vanishes_follows_the_faded_damping():
    numbers, short, curvature = joint(**FADING), 1e-8, 42.0

    def margin(time):
        free = force_free_speed(numbers, APPROACH, 0.0, time)
        return pushing_margin(numbers, 1e-5, -0.01 + curvature * (time - 2.4e-3), curvature, *free)

    before, here, after = (margin(2.4e-3 + sign * short) for sign in (-1, 0, 1))
    assert here[0] == pytest.approx(-0.01 + 1 / faded_damping(numbers, APPROACH, 2.4e-3), rel=1e-12)
    assert here[1] == pytest.approx((after[0] - before[0]) / (2 * short), rel=1e-6)


@pytest.mark.parametrize("restitution", (0.1, 0.3, 0.5, 0.7, 0.9, 0.95))
@pytest.mark.parametrize("law", LAWS)
def test_a_free_impact_is_the_published_one_to_the_last_bit(law, restitution):
    by_form = [
        free_impact(mechanism(law=law, restitution=restitution, memory=memory), 0.773, 0.3)[1]
        for memory in ("published", "fading")
    ]
    np.testing.assert_array_equal(*by_form)


@pytest.mark.parametrize("law", LAWS)
def test_even_the_slowest_impact_of_all_that_moves_is_over_before_its_memory_fades(law):
    p, (impact, separation) = free_impact(mechanism(law=law, restitution=0.1), mass=1.2212, speed=1e-3)
    assert impact[EVENT.index("approach_speed")] == pytest.approx(1e-3, rel=1e-9)
    assert separation[EVENT.index("duration")] < p.crank_pin.memory_time


@pytest.mark.parametrize("restitution", (0.1, 0.3, 0.9))
@pytest.mark.parametrize("slower", (50, 90))
def test_so_is_one_ninety_times_slower_than_the_slowest_that_is_damped_as_itself(restitution, slower):
    made = mechanism(law="exact_restitution", restitution=restitution)
    p, (_, separation) = free_impact(made, mass=1.2212, speed=1e-3 / slower)
    assert separation[EVENT.index("duration")] < p.crank_pin.memory_time


@pytest.mark.parametrize(("restitution", "durations"), ((0.1, 2.0), (0.07, 2.4), (0.05, 2.9)))
def test_a_free_impact_that_hardly_rebounds_lasts_as_long_as_is_documented(restitution, durations):
    made = mechanism(law="exact_restitution", restitution=restitution, memory="published")
    p, (_, separation) = free_impact(made, mass=1.2212, speed=1e-3)
    elastic = impact_duration(p.crank_pin.stiffness, 1.5, 1.2212, 1e-3)
    assert separation[EVENT.index("duration")] / elastic == pytest.approx(durations, abs=0.05)


def test_motions_are_the_published_ones_to_the_last_bit_until_a_contact_lasts():
    published, fading = (
        integrated(mechanism(memory=memory, restitution=0.9), np.arange(0.0, 181.0))[1].events
        for memory in ("published", "fading")
    )
    p = parameters(mechanism(), options())
    rebounds = published[:, EVENT.index("duration")] < p.crank_pin.memory_time
    ends = published[:, EVENT.index("begins")] == 0
    lasting = published[ends & ~rebounds]
    until = min(lasting[:, EVENT.index("time")] - lasting[:, EVENT.index("duration")], default=np.inf)
    same = published[:, EVENT.index("time")] < until
    assert same.sum() >= 10
    np.testing.assert_array_equal(fading[: same.sum()], published[same])


@pytest.fixture(scope="module")
def lasting():
    """Parameters; instants where the fading of a lasting contact begins and ends; how long it takes [s]."""
    made = mechanism(**LASTING, loose=("crank_pin",))
    p, run = integrated(made, np.linspace(0.0, 90.0, 2), tolerance=1e-15)
    begin, approach = run.begins[-1, 0], run.approaches[-1, 0]
    knots = begin + p.crank_pin.memory_time + np.array([0.0, p.crank_pin.fading_time])
    assert run.modes[-1, 0] == CONTACT and knots[1] < run.times[-1]
    at = integrate_to_angles(p, start_state(p), SPEED * np.concatenate(([0.0], knots)), 1e-15)
    contact = (CONTACT, FLIGHT, FLIGHT), (approach, np.inf, np.inf), (begin, np.inf, np.inf)
    instants = [instant(p, at.times[i], tuple(at.states[i]), tuple(at.auxiliary_states[i]), *contact) for i in (1, 2)]
    return p, *instants, p.crank_pin.fading_time


def order(p, here, length, counts):
    """Order at which the velocities after `count` equal steps over `length` [s] converge."""

    def velocities(count):
        there = here
        for _ in range(count):
            y, x, _ = step(p, there, LINEAR, 0.0, length / count, room_for_stages())
            there = instant(p, there.time + length / count, y, x, here.modes, here.approaches, here.begins)
        return np.array(there.clearance_state)[4:]

    exact = velocities(8 * counts[-1])
    errors = [np.abs(velocities(count) - exact).max() for count in counts]
    return -np.polyfit(np.log(counts), np.log(errors), 1)[0]


def test_the_order_is_kept_while_memory_fades_and_after(lasting):
    p, begins, ends, length = lasting
    assert order(p, begins, length, (12, 16, 24)) > 7.5
    assert order(p, ends, length, (12, 16, 24)) > 7.5


def test_a_step_ends_where_fading_begins_and_where_it_ends(lasting):
    p, begins, ends, length = lasting
    assert time_to_knot(p, begins, 1e-15) == pytest.approx(length, rel=1e-9)
    assert time_to_knot(p, ends, 1e-15) == np.inf
    nearly = instant(
        p, begins.time - 1e-4, begins.clearance_state, begins.auxiliary_state, begins.modes, begins.approaches,
        begins.begins,
    )  # fmt: skip
    assert time_to_knot(p, nearly, 1e-15) == pytest.approx(1e-4, rel=1e-9)


def test_the_error_falls_with_the_tolerance_across_a_fade(worst):
    made, degrees = mechanism(**LASTING), np.arange(0.0, 90.1, 0.5)

    def vectors(tolerance):
        return integrated(made, degrees, tolerance)[1].states[:, :4]

    exact, tolerances = vectors(1e-15), 10.0 ** -np.arange(9, 14)
    errors = [np.abs(vectors(tolerance) - exact).max() for tolerance in tolerances]
    worst("error at tolerance 1e-12 m, 90 deg, across a fade [m]", errors[-2], 1e-10)
    assert 0.7 < np.polyfit(np.log10(tolerances), np.log10(errors), 1)[0] < 1.35


STARTS, SAMPLES = 18, 720


def settled(**contact) -> np.ndarray:
    """Slider acceleration and crank torque over one settled revolution, from 18 start angles: (18, 2, 720)."""
    found = []
    for start in range(STARTS):
        run = simulate(
            mechanism(friction=0.15, gravity=True, **contact),
            options(
                speed=10 * np.pi,
                start_angle=2 * np.pi * start / STARTS,
                revolutions=12,
                samples_per_revolution=SAMPLES,
                tolerance=1e-10,
            ),
        )
        last = run.samples[["slider_acceleration", "crank_torque"]].to_numpy()[-SAMPLES - 1 : -1].T
        found.append(np.roll(last, start * SAMPLES // STARTS, axis=1))
    return np.array(found)


def apart(motions: np.ndarray) -> np.ndarray:
    """Largest root mean square difference of each two motions over the standard deviation of the signal."""
    between = np.sqrt(((motions[:, None] - motions[None]) ** 2).mean(axis=-1))
    return (between / motions.std(axis=-1).mean(axis=0)).max(axis=-1)


def test_from_eighteen_start_angles_the_motion_settles_on_one(worst):
    worst("settled motions apart, over the signal's sd", apart(settled()).max(), 1e-4)


def test_as_published_the_start_decides_which_motion_it_settles_on():
    between = apart(settled(memory="published"))
    different = [i for i in range(STARTS) if (between[i, :i] > 1e-4).all()]
    assert len(different) >= 10 and between.max() > 5e-3


@pytest.mark.parametrize(("law", "restitution"), (("lankarani_nikravesh", 0.46), ("exact_restitution", 0.3)))
def test_a_coarse_tolerance_makes_no_more_steps_where_the_damping_is_published(law, restitution):
    made = mechanism(memory="published", law=law, restitution=restitution)
    coarse, finer = (simulate(made, options(tolerance=tolerance)).steps for tolerance in (1e-7, 1e-8))
    assert coarse <= 1.2 * finer
