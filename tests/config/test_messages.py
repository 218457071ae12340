"""Errors repeat what a user wrote, on one line, without obeying it."""

import pickle

import pytest

from jointgap.config import read_yaml, resolve
from jointgap.core.errors import InputError
from tests.config.mechanisms import PAPER


@pytest.mark.parametrize(
    "sign", ["\x1b[31m", "\n", "\r", "\x00", "\x85", "\N{RIGHT-TO-LEFT OVERRIDE}", "\N{LINE SEPARATOR}"]
)
def test_signs_that_a_terminal_obeys_are_written_out(sign):
    (line,) = str(InputError(f"mine.yaml: unknown key 'a{sign}b'; remove it")).splitlines()
    assert repr(sign)[1:-1] in line
    assert sign not in line


def test_letters_of_all_scripts_stay_as_they_are():
    assert str(InputError("mine.yaml: über, 杆, שלום")) == "mine.yaml: über, 杆, שלום"


def test_an_error_of_several_lines_is_the_same_in_another_process():
    error = InputError("mine.yaml: one", "mine.yaml: two")
    assert str(pickle.loads(pickle.dumps(error))) == str(error) == "mine.yaml: one\nmine.yaml: two"


def test_a_key_with_a_line_break_makes_no_line_of_its_own(tmp_path):
    (tmp_path / "mine.yaml").write_text('{"a\\nb": 1, scenarios: {one: {}}}')
    with pytest.raises(InputError) as caught:
        resolve(read_yaml(tmp_path / "mine.yaml"), source="mine.yaml")
    assert all(line.startswith("mine.yaml") for line in str(caught.value).splitlines())


def test_a_drive_whose_file_is_missing_names_the_configuration():
    drive = {"kind": "measured", "file": "nowhere.csv"}
    config = {"mechanism": str(PAPER), "simulate": {"drive": drive}, "scenarios": {"one": {}}}
    with pytest.raises(InputError, match=r"^mine\.yaml, scenario one: simulate\.drive\.file: no file 'nowhere\.csv'"):
        resolve(config, source="mine.yaml")


@pytest.mark.parametrize(
    "over",
    [
        {"surrogate": {"training_points": 362}},
        {"simulate": {"revolutions": 3}},
        {"optimise": {"ensemble": {"settled_revolution": 5}}},
    ],
)
def test_a_section_that_is_left_to_its_defaults_has_to_go_with_the_others(over):
    with pytest.raises(InputError, match=r"^mine\.yaml, scenario one: "):
        resolve({"mechanism": str(PAPER), "scenarios": {"one": over}}, source="mine.yaml")


@pytest.mark.parametrize("sign", ["7", "\x0b"])
def test_a_value_that_fills_pages_is_not_repeated_whole(sign):
    (line,) = str(InputError(f"mine.yaml: speed = '{sign * 10**6}' is no number; correct it")).splitlines()
    assert len(line) < 2000
    assert line.startswith("mine.yaml: speed = '")
    assert line.endswith("' is no number; correct it")


@pytest.mark.parametrize("name", [7, 1.5, True])
def test_a_kind_that_is_no_text_is_refused(name):
    config = {"mechanism": {"base": str(PAPER), "effects": [{"name": name}]}, "scenarios": {"one": {}}}
    with pytest.raises(InputError, match=r"mechanism\.effects\.0\.name = .*no such effect"):
        resolve(config, source="mine.yaml")


def test_contacts_whose_names_are_not_all_text_are_refused():
    mechanism = {
        "base": str(PAPER),
        "contacts": {1: {"restitution": 0.5}},
        "joints": {"crank_pin": {"contact": "stel"}},
    }
    with pytest.raises(InputError, match=r"mechanism\.contacts\.1 = 1: must be text"):
        resolve({"mechanism": mechanism, "scenarios": {"one": {}}}, source="mine.yaml")


def test_an_error_has_at_most_so_many_lines_as_one_reads():
    boxes = {f"b{n}": {"crank_length": "x"} for n in range(60)}
    with pytest.raises(InputError) as caught:
        resolve({"mechanism": str(PAPER), "optimise": {"boxes": boxes}, "scenarios": {"one": {}}})
    lines = str(caught.value).splitlines()
    assert len(lines) <= 21
    assert "and 100 more" in lines[-1]
