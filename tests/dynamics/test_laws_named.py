"""Every law that the simulation knows can be asked for in a mechanism file, and no other."""

from typing import get_args

from jointgap.config.joint_config import FrictionLaw, Law
from jointgap.dynamics import LAWS
from jointgap.dynamics.model.friction import FRICTION_LAWS


def test_the_configuration_names_the_laws_that_the_simulation_knows():
    assert set(get_args(Law)) == {*LAWS, "penalty"}
    assert set(get_args(FrictionLaw)) == set(FRICTION_LAWS)
