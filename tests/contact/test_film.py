"""Oil film: quadrature of the pressure, classical short-bearing results, laws of mechanics."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from jointgap.contact.normal_force import film_force, film_integrals
from tests.motion.laws import JointParameters, joint

VISCOSITY, LENGTH, CLEARANCE, THINNEST, RADIUS = 0.04, 5e-3, 1e-4, 1e-6, 7e-3
ECCENTRICITIES = (0.1, 0.5, 0.9)
LOAD = VISCOSITY * RADIUS * LENGTH**3 / CLEARANCE**2  # times a rate: force


def oiled(side=-1.0) -> JointParameters:
    """Journal of 7 mm on the partner (`side` -1) or on the body (+1)."""
    radii = (RADIUS + CLEARANCE, RADIUS)[:: -int(side)]
    film = {"film_viscosity": VISCOSITY, "film_length": LENGTH}
    film |= {"film_clearance": CLEARANCE, "film_least": THINNEST}
    radii = {"body_radius": radii[0], "partner_radius": radii[1]}
    return joint(side=side, clearance=CLEARANCE - THINNEST, **radii, **film)


def random_motions(count=200, widest=0.98):
    """Clearance vectors, their rates and both angular velocities."""
    random = np.random.default_rng(5)
    radius = CLEARANCE * widest * np.sqrt(random.uniform(size=count))
    angle = random.uniform(0, 7, count)
    rates = random.normal(size=(4, count)) * np.array([[0.01], [0.01], [100], [100]])
    rates[:2, : count // 5] = 0
    rates[2:, -count // 5 :] = 0
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), *rates])


def pressure(phi, ex, ey, vx, vy, body_rate, partner_rate, side):
    """Pressure of the short bearing's Reynolds equation halfway along it [Pa]."""
    # the journal as seen from the bearing
    jx, jy, jvx, jvy = (side * number for number in (ex, ey, vx, vy))
    thickness = CLEARANCE - jx * np.cos(phi) - jy * np.sin(phi)
    around = jx * np.sin(phi) - jy * np.cos(phi)
    in_time = -jvx * np.cos(phi) - jvy * np.sin(phi)
    source = 6 * VISCOSITY * ((body_rate + partner_rate) * around + 2 * in_time)
    return -source / thickness**3 * LENGTH**2 / 8


def test_the_force_is_the_integral_of_positive_pressure():
    phi, step = np.linspace(0, 2 * np.pi, 40000, endpoint=False, retstep=True)
    for motion in random_motions(20, widest=0.8):
        # A parabola along the axis, two thirds of its middle in the mean; on the journal it pushes
        # inwards.
        push = np.maximum(pressure(phi, *motion, -1.0), 0) * 2 / 3 * LENGTH * RADIUS * step
        on_journal = np.array([-(push * np.cos(phi)).sum(), -(push * np.sin(phi)).sum()])
        np.testing.assert_allclose(
            film_force(oiled(), *motion)[:2], -on_journal, atol=1e-6 * np.hypot(*on_journal)
        )


@pytest.mark.parametrize(
    "eccentricity, angle",
    [(0.0, 3.0), (0.3, -2.0), (0.8, math.pi), (0.95, 1.8), (0.9999, 3.0), (0.9999, 2.5)],
)
def test_closed_form_integrals_agree_with_quadrature(eccentricity, angle):
    """Also on the thick side, where terms of 1 / s^5 cancel."""
    a, b = eccentricity * math.cos(angle), eccentricity * math.sin(angle)

    def integral(power):
        def part(x):
            thickness = 1 - a * math.cos(x) - b * math.sin(x)
            return math.cos(x) ** (2 - power) * math.sin(x) ** power / thickness**3

        near_the_peak = [math.copysign(math.pi / 2 - width, b) for width in (0.3, 0.03)]
        settings = {"points": near_the_peak, "epsabs": 1e-13, "epsrel": 1e-11, "limit": 400}
        return quad(part, -math.pi / 2, math.pi / 2, **settings)[0]

    found = film_integrals(a, b, math.sqrt(1 - eccentricity**2))
    assert found[0] == pytest.approx(integral(0), rel=1e-9)
    assert found[1] == pytest.approx(integral(1), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("eccentricity", ECCENTRICITIES)
def test_a_rotating_journal_has_ocvirks_load_and_attitude(eccentricity):
    rate = 150.0
    fx, fy, *_ = film_force(
        oiled(), eccentricity * CLEARANCE, 0.0, 0.0, 0.0, 0.4 * rate, 0.6 * rate
    )
    rest = 1 - eccentricity**2
    factor = math.sqrt(math.pi**2 * rest + 16 * eccentricity**2)
    size = LOAD * rate * eccentricity / (4 * rest**2) * factor
    assert math.hypot(fx, fy) == pytest.approx(size, rel=1e-13)
    assert fy / -fx == pytest.approx(math.pi * math.sqrt(rest) / (4 * eccentricity), rel=1e-13)
    assert fx < 0  # back to the centre


@pytest.mark.parametrize("eccentricity", (0.0, *ECCENTRICITIES))
def test_squeezing_in_and_out_sums_to_the_full_film(eccentricity):
    speed, e = 0.02, eccentricity * CLEARANCE
    inwards, outwards = (
        film_force(oiled(), e, 0.0, sign * speed, 0.0, 0.0, 0.0)[0] for sign in (1, -1)
    )
    shape = math.pi * (1 + 2 * eccentricity**2) / (1 - eccentricity**2) ** 2.5
    full_film = LOAD / CLEARANCE * speed * shape
    assert outwards - inwards == pytest.approx(full_film, rel=1e-12)
    assert inwards < 0 < outwards


@pytest.mark.parametrize("eccentricity", (0.0, 0.4, 0.9))
def test_shear_is_petroffs_couple(eccentricity):
    thinness = quad(lambda phi: 1 / (1 - eccentricity * math.cos(phi)), 0, 2 * math.pi)[0]
    couple = VISCOSITY * RADIUS**3 * LENGTH / CLEARANCE * thinness * 80.0
    # Opposite rates: the film is sheared, but not drawn in.
    fx, fy, on_body, on_partner = film_force(
        oiled(), eccentricity * CLEARANCE, 0.0, 0.0, 0.0, 40.0, -40.0
    )
    assert (fx, fy) == (0, 0)
    assert on_body == pytest.approx(-couple, rel=1e-9)
    assert on_partner == pytest.approx(couple, rel=1e-9)


@pytest.mark.parametrize("side, widest", [(-1.0, 0.98), (1.0, 1.3)])
def test_a_film_dissipates_keeps_angular_momentum_and_is_symmetric(side, widest):
    for motion in random_motions(300, widest):
        fx, fy, on_body, on_partner = film_force(oiled(side), *motion)
        powers = np.array([fx, fy, on_body, on_partner]) * motion[2:]
        assert np.isfinite(powers).all() and powers.sum() < 1e-12 * np.abs(powers).sum()
        turning = motion[0] * fy - motion[1] * fx
        assert on_body + on_partner == pytest.approx(-turning, rel=1e-9, abs=1e-12)
        still = film_force(oiled(side), *motion[:4], *[motion[4:].mean()] * 2)  # without shear
        # acts halfway between the centres
        assert still[2] == pytest.approx(-turning / 2, rel=1e-9, abs=1e-12)
        exchanged = film_force(oiled(-side), *-motion[:4], motion[5], motion[4])
        np.testing.assert_allclose(exchanged, (-fx, -fy, on_partner, on_body), rtol=1e-12)
