"""Contact laws against the impact's closed form, the penalty form against its limits."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from jointgap.config import hertz_stiffness
from jointgap.dynamics.contact import (
    LAWS,
    PULL_FAR_OFF,
    delivered_restitution,
    exact_restitution,
    normal_force,
    penalty_restitution,
    pushing_margin,
    smooth_step,
)
from tests.dynamics.laws import joint

RESTITUTIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
MASS, STIFFNESS, SPEED = 0.7, 3.6e10, 0.5

# What each published law delivers for 0.1, 0.3, 0.5, 0.7, 0.9, from the literature on restitution in contact models.
PUBLISHED = {
    "hunt_crossley": (0.516, 0.581, 0.663, 0.768, 0.909),
    "lankarani_nikravesh": (0.665, 0.684, 0.725, 0.796, 0.913),
    "lee_wang": (0.687, 0.739, 0.799, 0.869, 0.952),
    "herbert_mcwhannell": (0.491, 0.520, 0.594, 0.723, 0.901),
    "gonthier": (0.101, 0.304, 0.488, 0.670, 0.876),
    "zhiying_qishao": (0.217, 0.327, 0.483, 0.680, 0.896),
    "flores": (0.069, 0.256, 0.470, 0.683, 0.894),
    "hu_guo": (0.074, 0.271, 0.488, 0.697, 0.900),
    "carvalho_martins": (0.129, 0.304, 0.500, 0.700, 0.900),
    "exact_restitution": (0.1, 0.3, 0.5, 0.7, 0.9),
}

# Exponent, c_max [N s/m], d_max [m]: from hardly damped to overdamped, the step passed through and not; the elastic
# impact of the tests is 13 to 16 um deep.
PENALTIES = [
    (exponent, damping, depth)
    for exponent in (1.0, 1.5, 2.2)
    for damping in (1e2, 3e3, 5e4)
    for depth in (1e-7, 1e-5, 1e-4)
]


def elastic_depth(exponent: float) -> float:
    """Largest penetration [m] of an elastic impact; the stiffness is the one with 1 kN at 10 um for every exponent."""
    return ((exponent + 1) * MASS * SPEED**2 / (2 * stiffness_of(exponent))) ** (1 / (exponent + 1))


def stiffness_of(exponent: float) -> float:
    return 1e3 / 1e-5**exponent


def free_impact(law, damping_factor: float = 0.0) -> tuple[float, float]:
    """Rebound over approach speed and largest penetration [m] of a free mass that meets a fixed pin."""

    def slope(_, state):
        return state[1], -max(normal_force(law, state[0], state[1], damping_factor), 0.0) / MASS

    def ends(_, state):
        return state[0]

    def turns(_, state):
        return state[1]

    ends.terminal, ends.direction = True, -1
    # Steps of a microsecond at most: a long one in free flight would miss that a force comes back.
    run = solve_ivp(
        slope, (0, 1), (0, SPEED), "DOP853", events=(ends, turns), rtol=1e-12, atol=(1e-18, 1e-13), max_step=1e-6
    )
    return -run.y[1, -1] / SPEED, run.y_events[1][0][0]


@pytest.mark.parametrize("restitution", RESTITUTIONS)
@pytest.mark.parametrize("law", LAWS)
def test_rebound_and_depth_of_a_free_impact_obey_the_closed_form(law, restitution):
    chi = LAWS[law](restitution)
    rebound, deepest = free_impact(joint(damping=chi, stiffness=STIFFNESS), chi / SPEED)
    assert rebound == pytest.approx(delivered_restitution(chi), rel=1e-8)
    # chi (1 + e) = ln((1 + chi) / (1 - chi e)), written without the quotient that loses its digits as chi e nears 1
    assert 1 - chi * rebound == pytest.approx((1 + chi) * math.exp(-chi * (1 + rebound)), abs=1e-8)
    energy = STIFFNESS / MASS * deepest**2.5 / 2.5
    assert energy == pytest.approx(SPEED**2 * (1 / chi - math.log1p(chi) / chi**2), rel=1e-8)


@pytest.mark.parametrize("restitution", RESTITUTIONS)
def test_the_exact_law_delivers_what_is_asked_for_whatever_the_exponent(restitution):
    chi = exact_restitution(restitution)
    for exponent in (1.0, 10 / 9, 1.5, 2.0):
        law = joint(damping=chi, stiffness=stiffness_of(exponent), exponent=exponent)
        assert free_impact(law, chi / SPEED)[0] == pytest.approx(restitution, rel=1e-8)


def test_the_exact_root_has_its_known_values():
    found = [exact_restitution(restitution) for restitution in (0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95)]
    np.testing.assert_allclose(found, (9.998, 3.087, 1.4328, 0.6348, 0.3732, 0.1665, 0.0789), rtol=6e-4)


@pytest.mark.parametrize("law", LAWS)
def test_each_law_delivers_the_restitution_that_is_published_for_it(law):
    delivered = [delivered_restitution(LAWS[law](asked)) for asked in (0.1, 0.3, 0.5, 0.7, 0.9)]
    np.testing.assert_allclose(delivered, PUBLISHED[law], atol=6e-4)


@pytest.mark.parametrize("restitution", (1e-3, 0.02, 0.5, 0.99, 0.999999))
def test_root_and_delivered_restitution_undo_each_other_at_the_ends_of_their_range(restitution):
    assert delivered_restitution(exact_restitution(restitution)) == pytest.approx(restitution, rel=1e-9)


def test_without_dissipation_all_of_the_speed_comes_back():
    assert delivered_restitution(0.0) == 1.0
    assert free_impact(joint())[0] == pytest.approx(1.0, rel=1e-9)
    assert penalty_restitution(STIFFNESS, 1.5, 0.0, 1e-4, MASS, SPEED) == pytest.approx(1.0, rel=1e-8)


def test_hertz_stiffness_of_8_in_7_mm_steel_is_the_known_one():
    steel = SimpleNamespace(youngs_modulus=207e9, poisson_ratio=0.3)
    loose = SimpleNamespace(journal_radius=0.007, bearing_radius=0.008, clearance=0.001, contact=steel)
    assert hertz_stiffness(loose) == pytest.approx(3.59e10, rel=1e-3)


def test_the_smooth_step_leaves_both_levels_flat_and_is_halfway_in_the_middle():
    x, width = np.linspace(-1, 4, 501), 1e-6
    y = np.array([smooth_step(value, 1.0, -2.0, 3.0, 6.0) for value in x])
    assert (y[x <= 1] == -2).all() and (y[x >= 3] == 6).all() and (np.diff(y) >= 0).all()
    assert smooth_step(2.0, 1.0, -2.0, 3.0, 6.0) == 2.0
    mirrored = np.array([smooth_step(4 - value, 1.0, -2.0, 3.0, 6.0) for value in x])
    np.testing.assert_allclose(y + mirrored, 4.0, atol=1e-13)
    for end in (1.0, 3.0):
        rise = smooth_step(end + width, 1.0, -2.0, 3.0, 6.0) - smooth_step(end - width, 1.0, -2.0, 3.0, 6.0)
        assert abs(rise / width) < 1e-4


@pytest.mark.parametrize(("exponent", "damping", "depth"), PENALTIES)
def test_the_penalty_forms_restitution_is_that_of_an_impact_under_its_force(exponent, damping, depth):
    stiffness = stiffness_of(exponent)
    law = joint(stiffness=stiffness, exponent=exponent, penalty_damping=damping, penalty_depth=depth)
    rebound, deepest = free_impact(law)
    told = penalty_restitution(stiffness, exponent, damping, depth, MASS, SPEED)
    assert told == pytest.approx(rebound, abs=1e-8)
    assert 0 < rebound < 1 and deepest < elastic_depth(exponent)


@pytest.mark.parametrize("exponent", (1.0, 1.5, 2.2))
def test_more_penalty_damping_gives_less_rebound(exponent):
    stiffness = stiffness_of(exponent)
    rebounds = [
        penalty_restitution(stiffness, exponent, damping, 5e-6, MASS, SPEED) for damping in np.geomspace(1, 1e6, 13)
    ]
    assert 1 > rebounds[0] > 0.99 and (np.diff(rebounds) < 0).all() and rebounds[-1] > 0


@pytest.mark.parametrize("share", (0.05, 0.3, 0.9, 1.5))
def test_a_linear_penalty_contact_with_a_thin_step_is_the_spring_and_dashpot_that_never_pull(share):
    # T. Schwager and T. Poeschel, Granular Matter 9 (2007): they part when the force vanishes, not the penetration.
    stiffness = 1e8
    decay, natural = share * math.sqrt(stiffness / MASS) / 2, math.sqrt(stiffness / MASS)
    swing = math.sqrt(natural**2 - decay**2)
    exact = math.exp(-decay / swing * math.atan2(2 * decay * swing, decay**2 - swing**2))
    thin = 1e-9 * SPEED / natural
    assert penalty_restitution(stiffness, 1.0, 2 * MASS * decay, thin, MASS, SPEED) == pytest.approx(exact, abs=1e-7)


@pytest.mark.parametrize("depth_ratio", (0.1, 0.7, 3.0))
@pytest.mark.parametrize("exponent", (1.0, 1.5, 2.2))
def test_weak_penalty_damping_takes_its_work_along_the_elastic_path(exponent, depth_ratio):
    stiffness, deepest, damping = stiffness_of(exponent), elastic_depth(exponent), 0.02

    def power(x):
        share = min(x / depth_ratio, 1)
        return damping * share**2 * (3 - 2 * share) * math.sqrt(1 - x ** (exponent + 1))

    corner = [depth_ratio] if depth_ratio < 1 else None
    work = 2 * deepest * SPEED * quad(power, 0, 1, points=corner, epsabs=0)[0]
    rebound = penalty_restitution(stiffness, exponent, damping, depth_ratio * deepest, MASS, SPEED)
    assert MASS / 2 * SPEED**2 * (1 - rebound**2) == pytest.approx(work, rel=1e-4)


@pytest.mark.parametrize(("exponent", "damping", "depth"), PENALTIES)
def test_the_margin_is_positive_where_the_penalty_force_pushes_and_negative_where_it_would_pull(
    exponent, damping, depth
):
    law = joint(stiffness=stiffness_of(exponent), exponent=exponent, penalty_damping=damping, penalty_depth=depth)
    for penetration in np.geomspace(1e-8, 1e-3, 41):
        for rate in (-9.7, -0.31, -1.3e-3, 0.0, 0.2):
            force = normal_force(law, penetration, rate, math.nan)
            margin, _ = pushing_margin(law, penetration, rate, 0.0, math.nan, 0.0)
            assert margin == PULL_FAR_OFF or np.sign(margin) == np.sign(force)
            assert force > 0 or margin < PULL_FAR_OFF


@pytest.mark.parametrize(("exponent", "damping", "depth"), PENALTIES)
def test_the_penalty_margins_rate_is_its_derivative_over_time(exponent, damping, depth):
    law = joint(stiffness=stiffness_of(exponent), exponent=exponent, penalty_damping=damping, penalty_depth=depth)
    rate, curvature = -0.3, 700.0
    for penetration in (0.31 * depth, 0.83 * depth, 2.7 * depth):
        step = 1e-4 * penetration

        def margin(time, penetration=penetration):
            motion = penetration + rate * time + curvature * time**2 / 2, rate + curvature * time, curvature
            return pushing_margin(law, *motion, math.nan, 0.0)

        before, here, after = (margin(time) for time in (-step / abs(rate), 0.0, step / abs(rate)))
        assert here[1] == pytest.approx((after[0] - before[0]) / (2 * step / abs(rate)), rel=1e-5)


def test_the_margin_of_a_restitution_law_is_what_is_missing_until_its_force_vanishes():
    law = joint(damping=0.8)
    margin, its_rate = pushing_margin(law, 1e-5, -0.1, 42.0, 0.4 / 0.8, 0.0)
    assert normal_force(law, 1e-5, -0.1 - margin, 0.8 / 0.4) == pytest.approx(0.0, abs=1e-9)
    assert margin > 0 and its_rate == 42.0


def test_a_contact_that_cannot_pull_has_a_constant_margin():
    assert pushing_margin(joint(), 1e-5, -3.0, 42.0, 0.0, 0.0) == (1.0, 0.0)
    penalty = joint(penalty_damping=1e3, penalty_depth=1e-4)
    for penetration in (-1e-5, 0.0, 1e-300, 1e-12):  # apart, or so little in contact that hardly anything damps
        assert pushing_margin(penalty, penetration, -3.0, 42.0, 0.0, 0.0) == (PULL_FAR_OFF, 0.0)
