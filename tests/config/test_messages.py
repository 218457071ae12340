"""Errors repeat what a user wrote, on one line, without obeying it."""

import pickle

import pytest

from jointgap.config import resolve
from jointgap.core.errors import InputError
from tests.catalogue import each, refused
from tests.config.mechanisms import PAPER

OBEYED = [
    "\x1b[31m",
    "\n",
    "\r",
    "\x00",
    "\x85",
    "\N{RIGHT-TO-LEFT OVERRIDE}",
    "\N{LINE SEPARATOR}",
]


def test_signs_that_a_terminal_obeys_are_written_out_and_letters_of_all_scripts_stay():
    def written_out(sign):
        (line,) = str(InputError(f"mine.yaml: unknown key 'a{sign}b'; remove it")).splitlines()
        assert repr(sign)[1:-1] in line and sign not in line

    each(written_out, OBEYED)
    assert str(InputError("mine.yaml: über, 杆, שלום")) == "mine.yaml: über, 杆, שלום"


def test_an_error_is_the_same_in_another_process_and_never_fills_pages():
    error = InputError("mine.yaml: one", "mine.yaml: two")
    assert str(pickle.loads(pickle.dumps(error))) == str(error) == "mine.yaml: one\nmine.yaml: two"
    for sign in ("7", "\x0b"):
        (line,) = str(
            InputError(f"mine.yaml: speed = '{sign * 10**6}' is no number; correct it")
        ).splitlines()
        assert len(line) < 2000
        assert line.startswith("mine.yaml: speed = '") and line.endswith(
            "' is no number; correct it"
        )
    boxes = {f"b{n}": {"crank_length": "x"} for n in range(60)}
    with pytest.raises(InputError) as caught:
        resolve({"mechanism": str(PAPER), "optimise": {"boxes": boxes}, "scenarios": {"one": {}}})
    lines = str(caught.value).splitlines()
    assert len(lines) <= 21 and "and 100 more" in lines[-1]


def test_every_line_names_the_configuration_and_the_scenario():
    def told(over):
        try:
            resolve({"mechanism": str(PAPER), "scenarios": {"one": {}}} | over, source="mine.yaml")
        except InputError as error:
            assert all(line.startswith("mine.yaml") for line in str(error).splitlines())
            raise

    drive = {"kind": "measured", "file": "nowhere.csv"}
    contacts = {"contacts": {1: {"restitution": 0.5}}, "joints": {"crank_pin": {"contact": "stel"}}}
    cases = [
        ({"a\nb": 1}, "a\\nb"),
        (
            {"simulate": {"drive": drive}},
            "mine.yaml, scenario one: simulate.drive.file: no file 'nowhere.csv'",
        ),
        ({"mechanism": {"base": str(PAPER)} | contacts}, "mechanism.contacts.1 = 1: must be text"),
    ]
    # a section that is left to its defaults has to go with the others
    cases.append(
        ({"scenarios": {"one": {"simulate": {"revolutions": 3}}}}, "mine.yaml, scenario one: ")
    )
    effects = {"mechanism": {"base": str(PAPER), "effects": [{"name": 7}]}}
    cases.append((effects, "mechanism.effects.0.name =  ~ no such effect"))
    refused(told, cases)
