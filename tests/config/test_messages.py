"""Error messages: one line per error, without control characters."""

import pickle

import pytest

from jointgap.config import resolve
from jointgap.core.errors import InputError
from tests.config.mechanisms import PAPER

CONTROL = ["\x1b[31m", "\n", "\x00", "\x85", "\N{RIGHT-TO-LEFT OVERRIDE}", "\N{LINE SEPARATOR}"]


@pytest.mark.parametrize("sign", CONTROL)
def test_control_characters_are_escaped(sign):
    (line,) = str(InputError(f"mine.yaml: unknown key 'a{sign}b'; remove it")).splitlines()
    assert repr(sign)[1:-1] in line and sign not in line


def test_letters_of_all_scripts_stay():
    assert str(InputError("mine.yaml: über, 杆, שלום")) == "mine.yaml: über, 杆, שלום"


def test_an_error_survives_pickling_and_is_short():
    error = InputError("mine.yaml: one", "mine.yaml: two")
    assert str(pickle.loads(pickle.dumps(error))) == str(error) == "mine.yaml: one\nmine.yaml: two"
    for sign in ("7", "\x0b"):
        line = str(InputError(f"mine.yaml: speed = '{sign * 10**6}' is no number; correct it"))
        assert len(line) < 2000 and line.startswith("mine.yaml: speed = '")
        assert line.endswith("' is no number; correct it")
    boxes = {f"b{n}": {"crank_length": "x"} for n in range(60)}
    with pytest.raises(InputError) as error:
        resolve({"mechanism": str(PAPER), "optimise": {"boxes": boxes}, "scenarios": {"one": {}}})
    lines = str(error.value).splitlines()
    assert len(lines) <= 21 and "and 100 more" in lines[-1]


def over_paper(**keys) -> dict:
    return {"mechanism": {"base": str(PAPER)} | keys}


@pytest.mark.parametrize(
    "over, words",
    [
        ({"a\nb": 1}, r"a\\nb"),
        ({"simulate": {"drive": {"kind": "measured", "file": "none.csv"}}}, "no file 'none.csv'"),
        (over_paper(contacts={1: {"restitution": 0.5}}), "mechanism.contacts.1 = 1: must be text"),
        (over_paper(effects=[{"name": 7}]), "mechanism.effects.0.name = .*no such effect"),
        ({"scenarios": {"one": {"simulate": {"revolutions": 3}}}}, "mine.yaml, scenario one: "),
    ],
)
def test_every_line_names_the_file(over, words):
    config = {"mechanism": str(PAPER), "scenarios": {"one": {}}} | over
    with pytest.raises(InputError, match=words) as error:
        resolve(config, source="mine.yaml")
    assert all(line.startswith("mine.yaml") for line in str(error.value).splitlines())
