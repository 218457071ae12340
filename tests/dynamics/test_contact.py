"""Contact laws against the impact's closed form."""

import math

import numpy as np
import pytest

from jointgap.dynamics.contact import LAWS, delivered_restitution, exact_restitution, hertz_stiffness
from jointgap.dynamics.parameters import JointParameters, Parameters
from jointgap.dynamics.simulate import run_march
from tests.dynamics.cases import mechanism

RESTITUTIONS = (0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95)
MASS, STIFFNESS, CLEARANCE, SPEED = 0.7, 3.6e10, 1e-3, 0.5

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


def free_impact(damping: float, exponent: float = 1.5) -> tuple[float, float, float]:
    """Rebound over approach speed, largest penetration and approach speed of a free mass that meets a fixed pin."""
    joint = JointParameters(CLEARANCE, 0.008, 0.007, -1.0, STIFFNESS, exponent, damping, 0.0, 1.0)
    p = Parameters(
        crank_length=0.0,
        crank_mass=1.0,
        crank_mass_centre=0.0,
        rod_inverse_mass=1 / MASS,
        rod_inverse_inertia=1.0,
        rod_to_crank_end=0.0,
        rod_to_piston_end=1.0,
        slider_mass=1.0,
        slider_inverse_mass=1.0,
        slider_offset=0.0,
        gravity_x=0.0,
        gravity_y=0.0,
        speed=1.0,
        start_angle=0.0,
        crank_pin=joint,
        piston_pin=joint._replace(clearance=10.0),
    )
    start = np.array([0.0, 0.0, 0.0, 1.0, 0.6 * SPEED, 0.8 * SPEED, 0.0, 0.0])
    events = run_march(p, start, np.array([0.0, 4.0 * CLEARANCE / SPEED]), 1e-14).events
    (begin, _, _, approach), (end, *_) = events[:2]
    times = np.concatenate(([0.0], np.linspace(begin, end, 4001), [1.2 * end]))
    run = run_march(p, start, times, 1e-14)
    depth = np.hypot(run.states[1:-1, 0], run.states[1:-1, 1]) - CLEARANCE
    top = int(depth.argmax())
    before, peak, after = depth[top - 1 : top + 2]
    deepest = peak + (after - before) ** 2 / (8 * (2 * peak - after - before))
    return math.hypot(*run.states[-1, 4:6]) / approach, deepest, approach


@pytest.mark.parametrize("restitution", RESTITUTIONS)
@pytest.mark.parametrize("law", LAWS)
def test_rebound_and_depth_of_a_free_impact_obey_the_closed_form(law, restitution):
    chi = LAWS[law](restitution)
    rebound, deepest, approach = free_impact(chi)
    assert approach == pytest.approx(SPEED, rel=1e-12)
    assert rebound == pytest.approx(delivered_restitution(chi), rel=1e-6)
    # chi (1 + e) = ln((1 + chi) / (1 - chi e)), written without the quotient that loses its digits as chi e nears 1
    assert 1 - chi * rebound == pytest.approx((1 + chi) * math.exp(-chi * (1 + rebound)), abs=1e-6)
    energy = STIFFNESS / MASS * deepest**2.5 / 2.5
    assert energy == pytest.approx(approach**2 * (1 / chi - math.log1p(chi) / chi**2), rel=1e-6)


def test_the_exact_law_delivers_what_is_asked_for():
    for restitution in RESTITUTIONS:
        assert free_impact(exact_restitution(restitution))[0] == pytest.approx(restitution, rel=1e-6)


def test_the_exact_law_holds_for_other_exponents_too():
    for exponent in (1.0, 10 / 9, 2.0):
        assert free_impact(exact_restitution(0.5), exponent)[0] == pytest.approx(0.5, rel=1e-6)


def test_the_exact_root_has_its_known_values():
    found = [exact_restitution(restitution) for restitution in RESTITUTIONS]
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
    assert free_impact(0.0)[0] == pytest.approx(1.0, rel=1e-9)


def test_hertz_stiffness_of_8_in_7_mm_steel_is_the_known_one():
    assert hertz_stiffness(mechanism().crank_pin) == pytest.approx(3.59e10, rel=1e-3)
