"""Friction laws: shape of the coefficient over sliding speed, and LuGre's bristles."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.dynamics.friction import bristle_rate, friction_coefficient
from tests.dynamics.laws import JointParameters, joint
from tests.rows import each

MU, STATIC, SPEED, DEAD_BAND, STRIBECK = 0.2, 0.35, 1e-2, 2e-3, 5e-2
VELOCITY_LAWS = [law for law in FRICTION_LAWS if law != "lugre"]
BRISTLES = {"bristle_stiffness": 1e5, "bristle_damping": 30.0, "viscous_friction": 25.0}


def rubbing(law: str, **changed) -> JointParameters:
    values = {
        "friction": MU,
        "friction_speed": SPEED,
        "dead_band_speed": DEAD_BAND,
        "static_friction": STATIC,
        "stribeck_speed": STRIBECK,
    }
    return joint(**{"friction_law": FRICTION_LAWS[law].code, **values, **changed})


def coefficients(law: JointParameters, speeds) -> np.ndarray:
    return np.array([friction_coefficient(law, float(speed), 0.0) for speed in speeds])


def slid(law: JointParameters, speed, end: float) -> tuple[float, float]:
    """Bristles' deflection [m] at the `end` [s] of a sliding at `speed(t)`, and energy taken up per normal force
    [m].
    """

    def slope(t, state):
        return bristle_rate(law, speed(t), state[0]), friction_coefficient(law, speed(t), state[0]) * speed(t)

    run = solve_ivp(slope, (0, end), (0, 0), "Radau", rtol=1e-9, atol=(1e-15, 1e-15), max_step=end / 200)
    return tuple(run.y[:, -1])


def stribeck_curve(speed: float) -> float:
    return MU + (STATIC - MU) * math.exp(-((speed / STRIBECK) ** 2))


@each("law", VELOCITY_LAWS)
def test_the_coefficient_is_odd_opposes_sliding_and_is_the_kinetic_one_when_fast(law):
    speeds = np.geomspace(1e-7, 10, 200)
    forward, backward = (coefficients(rubbing(law), sign * speeds) for sign in (1, -1))
    np.testing.assert_array_equal(forward, -backward)
    assert (forward >= 0).all() and friction_coefficient(rubbing(law), 0.0, 0.0) == 0
    assert friction_coefficient(rubbing(law), 100.0, 0.0) == pytest.approx(MU, rel=1e-12)


def test_coulomb_and_threlfall_rise_to_their_known_shares_at_the_friction_speed():
    speeds = np.linspace(0, 30 * SPEED, 3001)
    for law, share in (("coulomb", math.tanh(1)), ("threlfall", 1 - math.exp(-3))):
        rising = coefficients(rubbing(law), speeds)
        assert (np.diff(rising) >= 0).all() and rising.max() <= MU
        assert friction_coefficient(rubbing(law), SPEED, 0.0) == pytest.approx(share * MU, rel=1e-14)


def test_ambrosio_has_a_dead_band_a_straight_ramp_and_a_plateau():
    law = rubbing("ambrosio")
    assert not coefficients(law, np.linspace(-DEAD_BAND, DEAD_BAND, 11)).any()
    ramp = coefficients(law, np.linspace(DEAD_BAND, SPEED, 11))
    np.testing.assert_allclose(ramp, np.linspace(0, MU, 11), atol=1e-15)
    assert (coefficients(law, np.linspace(SPEED, 1, 11)) == MU).all()


def test_bengisu_and_akay_peak_at_the_static_coefficient_and_decay_with_the_stribeck_speed():
    law = rubbing("bengisu_akay")
    assert friction_coefficient(law, SPEED, 0.0) == STATIC
    assert (np.diff(coefficients(law, np.linspace(0, SPEED, 101))) > 0).all()
    assert (np.diff(coefficients(law, np.linspace(SPEED, 1, 101))) < 0).all()
    decayed = friction_coefficient(law, SPEED + 2 * STRIBECK, 0.0) - MU
    assert decayed == pytest.approx((STATIC - MU) * math.exp(-2), rel=1e-13)


@each("speed", (-2.0, 1e-4, 0.01))
def test_steady_sliding_of_bristles_is_on_the_stribeck_curve(speed):
    law = rubbing("lugre", **BRISTLES)
    bristle, _ = slid(law, lambda _: speed, 2e-4 / abs(speed))  # a path of many times the bristles' bend
    steady = math.copysign(stribeck_curve(speed), speed)
    assert bristle == pytest.approx(steady / BRISTLES["bristle_stiffness"], rel=1e-7)
    force = friction_coefficient(law, speed, bristle)
    assert force == pytest.approx(steady + BRISTLES["viscous_friction"] * speed, rel=1e-6)


@each("law, stroke", [("coulomb", 1e-6), ("bengisu_akay", 1e-6), ("ambrosio", 1e-4), ("lugre", 1e-6)])
def test_a_cycle_takes_up_energy(law, stroke):
    """To and fro from rest, the first and the later cycles; what bent bristles store can only make it more."""
    assert BRISTLES["bristle_damping"] * (STATIC - MU) <= BRISTLES["viscous_friction"] * MU
    pair, taken = rubbing(law, **BRISTLES), [0.0]
    for cycles in (1, 2):
        bristle, work = slid(pair, lambda t: stroke * math.pi * 40 * math.sin(2 * math.pi * 40 * t), cycles / 40)
        stored = BRISTLES["bristle_stiffness"] * bristle**2 / 2
        assert work >= stored - 1e-15
        taken.append(work)
    # Ambrosio's dead band takes up nothing; all else more with every cycle.
    within_dead_band = law == "ambrosio" and stroke * math.pi * 40 < DEAD_BAND
    assert taken == [0, 0, 0] if within_dead_band else (np.diff(taken) > 0).all()
