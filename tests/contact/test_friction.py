"""Friction laws: shape of the coefficient over sliding speed, and LuGre's bristles."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.contact.friction import bristle_rate, friction_coefficient
from tests.motion.laws import JointParameters, joint

MU, STATIC, SPEED, DEAD_BAND, STRIBECK = 0.2, 0.35, 1e-2, 2e-3, 5e-2
BRISTLES = {"bristle_stiffness": 1e5, "bristle_damping": 30.0, "viscous_friction": 25.0}
VALUES = {
    "friction": MU,
    "friction_speed": SPEED,
    "dead_band_speed": DEAD_BAND,
    "static_friction": STATIC,
    "stribeck_speed": STRIBECK,
    **BRISTLES,
}


def rubbing(law: str) -> JointParameters:
    return joint(friction_law=FRICTION_LAWS[law].code, **VALUES)


def coefficients(law: str, *speeds) -> np.ndarray:
    """Over `speeds`, or over 101 of them between two."""
    speeds = np.linspace(*speeds, 101) if len(speeds) == 2 else speeds[0]
    return np.array(
        [friction_coefficient(rubbing(law), float(speed), 0.0) for speed in np.atleast_1d(speeds)]
    )


def slid(law: JointParameters, speed, *times: float) -> np.ndarray:
    """Deflection of bristles [m] and energy taken up per normal force [m], (2, n), at times [s] of
    a sliding at `speed(t)`.
    """

    def slope(t, state):
        return bristle_rate(law, speed(t), state[0]), friction_coefficient(
            law, speed(t), state[0]
        ) * speed(t)

    settings = {"rtol": 1e-9, "atol": (1e-15, 1e-15), "max_step": times[0] / 200}
    return solve_ivp(slope, (0, times[-1]), (0, 0), "Radau", t_eval=times, **settings).y


@pytest.mark.parametrize("law", [law for law in FRICTION_LAWS if law != "lugre"])
def test_the_coefficient_is_odd_dissipative_and_kinetic_at_high_speed(law):
    speeds = np.geomspace(1e-7, 10, 200)
    forward, backward = (coefficients(law, sign * speeds) for sign in (1, -1))
    np.testing.assert_array_equal(forward, -backward)
    assert (forward >= 0).all() and coefficients(law, 0.0) == 0
    assert coefficients(law, 100.0) == pytest.approx(MU, rel=1e-12)


@pytest.mark.parametrize("law, share", [("coulomb", math.tanh(1)), ("threlfall", 1 - math.exp(-3))])
def test_coulomb_and_threlfall_reach_known_shares_at_the_friction_speed(law, share):
    rising = coefficients(law, 0, 30 * SPEED)
    assert (np.diff(rising) >= 0).all() and rising.max() <= MU
    assert coefficients(law, SPEED) == pytest.approx(share * MU, rel=1e-14)


def test_ambrosio_has_dead_band_ramp_and_plateau():
    assert not coefficients("ambrosio", -DEAD_BAND, DEAD_BAND).any()
    np.testing.assert_allclose(
        coefficients("ambrosio", DEAD_BAND, SPEED), np.linspace(0, MU, 101), atol=1e-15
    )
    assert (coefficients("ambrosio", SPEED, 1) == MU).all()


def test_bengisu_akay_peaks_at_the_static_coefficient():
    law = "bengisu_akay"
    assert coefficients(law, SPEED) == STATIC
    assert (np.diff(coefficients(law, 0, SPEED)) > 0).all()
    assert (np.diff(coefficients(law, SPEED, 1)) < 0).all()
    decayed = coefficients(law, SPEED + 2 * STRIBECK) - MU
    assert decayed == pytest.approx((STATIC - MU) * math.exp(-2), rel=1e-13)


@pytest.mark.parametrize("speed", (-2.0, 1e-4, 0.01))
def test_steady_bristles_follow_the_stribeck_curve(speed):
    law = rubbing("lugre")
    # a path of many times the bristles' bend
    (bristle,), _ = slid(law, lambda _: speed, 2e-4 / abs(speed))
    steady = math.copysign(MU + (STATIC - MU) * math.exp(-((speed / STRIBECK) ** 2)), speed)
    assert bristle == pytest.approx(steady / BRISTLES["bristle_stiffness"], rel=1e-7)
    force = friction_coefficient(law, speed, bristle)
    assert force == pytest.approx(steady + BRISTLES["viscous_friction"] * speed, rel=1e-6)


@pytest.mark.parametrize(
    "law, stroke", [("coulomb", 1e-6), ("bengisu_akay", 1e-6), ("ambrosio", 1e-4), ("lugre", 1e-6)]
)
def test_a_cycle_dissipates_energy(law, stroke):
    """To and fro from rest, the first and the later cycles; what bent bristles store can only make
    it more."""
    assert BRISTLES["bristle_damping"] * (STATIC - MU) <= BRISTLES["viscous_friction"] * MU
    rate = 40 * math.tau
    bristle, work = slid(
        rubbing(law), lambda t: stroke / 2 * rate * math.sin(rate * t), 1 / 40, 2 / 40
    )
    assert (work >= BRISTLES["bristle_stiffness"] * bristle**2 / 2 - 1e-15).all()
    assert 0.0 < work[0] < work[1]
