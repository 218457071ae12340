"""Contact laws compared with closed forms and limits."""

import math
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointgap.config import hertz_stiffness
from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.config.mechanism import Contact, Law
from jointgap.contact.normal_force import (
    LAWS,
    delivered_restitution,
    exact_restitution,
    normal_force,
    penalty_restitution,
)
from tests.motion.laws import joint

MASS, STIFFNESS, SPEED = 0.7, 3.6e10, 0.5

# Restitution of each published law for 0.1, 0.3, 0.5, 0.7, 0.9, from the literature.
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

# Exponent, c_max [N s/m], d_max [m]: from hardly damped to overdamped, the step passed through and
# not; the elastic impact of the tests is 13 to 16 um deep.
PENALTIES = [(1.0, 1e2, 1e-4), (1.0, 5e4, 1e-7), (1.5, 5e4, 1e-4), (2.2, 3e3, 1e-5)]


def stiffness_of(exponent: float) -> float:
    """With 1 kN at 10 um."""
    return 1e3 / 1e-5**exponent


def free_impact(law, damping_factor: float = 0.0) -> tuple[float, float]:
    """Rebound over approach speed and largest penetration [m] of a free mass on a fixed pin."""

    def slope(_, state):
        return state[1], -max(normal_force(law, state[0], state[1], damping_factor), 0.0) / MASS

    def ends(_, state):
        return state[0]

    ends.terminal, ends.direction = True, -1
    # a long step would miss a force that comes back
    settings = {"rtol": 1e-12, "atol": (1e-18, 1e-13), "max_step": 1e-6}
    run = solve_ivp(
        slope, (0, 1), (0, SPEED), "DOP853", events=(ends, lambda _, state: state[1]), **settings
    )
    return -run.y[1, -1] / SPEED, run.y_events[1][0][0]


@pytest.mark.parametrize(
    "law, restitution",
    [*((law, 0.3) for law in LAWS), ("exact_restitution", 0.1), ("lankarani_nikravesh", 0.95)],
)
def test_rebound_and_depth_of_a_free_impact_obey_the_closed_form(law, restitution):
    chi = LAWS[law](restitution)
    rebound, deepest = free_impact(joint(damping=chi, stiffness=STIFFNESS), chi / SPEED)
    assert rebound == pytest.approx(delivered_restitution(chi), rel=1e-8)
    # chi (1 + e) = ln((1 + chi) / (1 - chi e)), written without the quotient that loses its digits
    # as chi e nears 1
    assert 1 - chi * rebound == pytest.approx((1 + chi) * math.exp(-chi * (1 + rebound)), abs=1e-8)
    energy = STIFFNESS / MASS * deepest**2.5 / 2.5
    assert energy == pytest.approx(SPEED**2 * (1 / chi - math.log1p(chi) / chi**2), rel=1e-8)


@pytest.mark.parametrize("restitution, exponent", [(0.1, 1.0), (0.5, 1.5), (0.95, 2.0)])
def test_the_exact_law_delivers_the_requested_restitution(restitution, exponent):
    chi = exact_restitution(restitution)
    law = joint(damping=chi, stiffness=stiffness_of(exponent), exponent=exponent)
    assert free_impact(law, chi / SPEED)[0] == pytest.approx(restitution, rel=1e-8)


@pytest.mark.parametrize("law", LAWS)
def test_each_law_delivers_its_published_restitution(law):
    delivered = [delivered_restitution(LAWS[law](asked)) for asked in (0.1, 0.3, 0.5, 0.7, 0.9)]
    np.testing.assert_allclose(delivered, PUBLISHED[law], atol=6e-4)


@pytest.mark.parametrize("restitution", (1e-3, 0.02, 0.5, 0.99, 0.999999))
def test_requested_and_delivered_restitution_are_inverse(restitution):
    assert delivered_restitution(exact_restitution(restitution)) == pytest.approx(
        restitution, rel=1e-9
    )


def test_without_dissipation_the_rebound_is_elastic():
    assert delivered_restitution(0.0) == 1.0
    assert free_impact(joint())[0] == pytest.approx(1.0, rel=1e-9)
    assert penalty_restitution(STIFFNESS, 1.5, 0.0, 1e-4, MASS, SPEED) == pytest.approx(
        1.0, rel=1e-8
    )


def test_hertz_stiffness_of_8_in_7_mm_steel():
    steel = SimpleNamespace(youngs_modulus=207e9, poisson_ratio=0.3)
    loose = SimpleNamespace(
        journal_radius=0.007, bearing_radius=0.008, clearance=0.001, contact=steel
    )
    assert hertz_stiffness(loose) == pytest.approx(3.59e10, rel=1e-3)


@pytest.mark.parametrize("exponent, damping, depth", PENALTIES)
def test_the_penalty_restitution_is_that_of_an_integrated_impact(exponent, damping, depth):
    stiffness = stiffness_of(exponent)
    law = joint(
        stiffness=stiffness, exponent=exponent, penalty_damping=damping, penalty_depth=depth
    )
    rebound, deepest = free_impact(law)
    computed = penalty_restitution(stiffness, exponent, damping, depth, MASS, SPEED)
    assert computed == pytest.approx(rebound, abs=1e-8)
    # depth without damping
    elastic = ((exponent + 1) * MASS * SPEED**2 / (2 * stiffness)) ** (1 / (exponent + 1))
    assert 0 < rebound < 1 and deepest < elastic


@pytest.mark.parametrize("share", (0.05, 0.9, 1.5))
def test_a_linear_penalty_contact_is_a_spring_and_dashpot_without_tension(share):
    # T. Schwager and T. Poeschel, Granular Matter 9 (2007): they part when the force vanishes, not
    # the penetration.
    stiffness = 1e8
    decay, natural = share * math.sqrt(stiffness / MASS) / 2, math.sqrt(stiffness / MASS)
    swing = math.sqrt(natural**2 - decay**2)
    exact = math.exp(-decay / swing * math.atan2(2 * decay * swing, decay**2 - swing**2))
    thin = 1e-9 * SPEED / natural
    assert penalty_restitution(
        stiffness, 1.0, 2 * MASS * decay, thin, MASS, SPEED
    ) == pytest.approx(exact, abs=1e-7)


def test_configuration_and_simulation_have_the_same_laws():
    assert set(get_args(Law)) == {*LAWS, "penalty"}
    assert get_args(Contact.model_fields["friction_law"].annotation) == tuple(FRICTION_LAWS)
