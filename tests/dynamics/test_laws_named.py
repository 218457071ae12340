"""Every law that the simulation knows can be asked for in a mechanism file, and no other."""

from typing import get_args

from jointgap.config.friction_laws import FRICTION_KEYS, FRICTION_LAWS
from jointgap.config.mechanism import Contact, Law
from jointgap.dynamics.contact import LAWS


def test_the_configuration_names_the_laws_that_the_simulation_knows():
    assert set(get_args(Law)) == {*LAWS, "penalty"}
    assert get_args(Contact.model_fields["friction_law"].annotation) == tuple(FRICTION_LAWS)


def test_every_friction_law_has_its_own_code_and_every_parameter_a_law_that_reads_it():
    assert sorted(law.code for law in FRICTION_LAWS.values()) == list(range(len(FRICTION_LAWS)))
    assert {key for law in FRICTION_LAWS.values() for key in law.reads} == set(FRICTION_KEYS)
