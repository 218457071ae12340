"""Other numerics are as good as the usual ones: another smooth form of the same friction, and a tighter tolerance."""

from types import SimpleNamespace

import pytest

from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.dynamics.model.friction import coulomb, threlfall
from jointgap.joints import JOINTS
from jointgap.slider_crank.run_simulation import NUMERICS, other_numerics

SPEED = 1e-3  # m/s, of the usual law


def joints(law: str) -> SimpleNamespace:
    """What a simulation holds of the joints, all with the same friction law."""
    made = {name: SimpleNamespace(friction_law=FRICTION_LAWS[law].code, friction_speed=SPEED) for name in JOINTS}
    return SimpleNamespace(**made)


def test_the_other_friction_law_has_the_same_slope_at_zero_speed_and_the_same_end():
    other = joints("coulomb")
    tolerance, change = other_numerics(1)
    change(other)
    assert tolerance == 1.0
    for name in JOINTS:
        joint = getattr(other, name)
        assert joint.friction_law == FRICTION_LAWS["threlfall"].code
        assert joint.friction_speed == pytest.approx(3.0 * SPEED, rel=1e-12)
        slow = 1e-6 * SPEED
        assert threlfall(slow, 0.1, joint.friction_speed) == pytest.approx(coulomb(slow, 0.1, SPEED), rel=1e-5)
        assert threlfall(100.0 * SPEED, 0.1, joint.friction_speed) == coulomb(100.0 * SPEED, 0.1, SPEED)


@pytest.mark.parametrize("law", [name for name in FRICTION_LAWS if name != "coulomb"])
def test_a_law_that_is_stated_stays_as_it_is(law):
    other = joints(law)
    other_numerics(1)[1](other)
    assert other == joints(law)


def test_the_last_numerics_are_a_tenth_of_the_tolerance_with_all_else_the_same():
    other = joints("coulomb")
    tolerance, change = other_numerics(len(NUMERICS))
    change(other)
    assert (tolerance, other) == (0.1, joints("coulomb"))


def test_the_usual_numerics_change_nothing():
    other = joints("coulomb")
    tolerance, change = other_numerics(0)
    change(other)
    assert (tolerance, other) == (1.0, joints("coulomb"))
