"""Reading of YAML and JSON files."""

import json
import re

import pytest

from jointgap.config import parse_options, read_yaml
from jointgap.core.errors import InputError


@pytest.fixture
def read(tmp_path):
    """Read a file with this content; an error has one line and names the file."""

    def read(content: str | bytes, name: str = "mine.yaml"):
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        try:
            return read_yaml(tmp_path / name)
        except InputError as error:
            assert len(str(error).splitlines()) == 1 and str(error).startswith(str(tmp_path / name))
            raise

    return read


@pytest.mark.parametrize(
    "text, key, first_line, line",
    [
        ("a: 1\nb: 2\na: 3\n", "a", 1, 3),
        ("a: {x: 1, x: 2}\n", "x", 1, 1),
        ("runs:\n  - {id: slow}\n  - id: fast\n    speed: 1\n    id: slow\n", "id", 3, 5),
        ("1: a\n'1': b\n", "1", 1, 2),
        ("a: &a {x: 1}\nb:\n  <<: *a\n  <<: *a\n", "<<", 3, 4),
    ],
)
def test_a_duplicate_key_is_reported_with_both_lines(read, text, key, first_line, line):
    words = f"the key '{key}' is a duplicate, in lines {first_line} and {line}"
    with pytest.raises(InputError, match=words):
        read(text)


def test_an_alias_can_be_overridden(read):
    assert read("a: &a {x: 1, y: 2}\nb: {<<: *a, x: 3}\n")["b"] == {"x": 3, "y": 2}


@pytest.mark.parametrize(
    "value", "0600 -0600 08 1_000 10:30 1:30.5 0x10 0x_ 0b1 0o17 yes On no OFF".split()
)
def test_a_value_that_differs_between_yaml_versions_is_an_error(read, value):
    words = rf', line 2, column 4: {value} differs .*; write a plain.*"{value}" in quotation marks'
    with pytest.raises(InputError, match=words):
        read(f"a: 1\nb: {value}\n")
    with pytest.raises(InputError, match="quotation marks"):
        read(f"{value}: 1\n")


@pytest.mark.parametrize(
    "text, point",
    {
        "{m: 2,4 kg, n: 1}": "2.4",
        "{m: -2,4}": "-2.4",
        "{m: 0,05}": "0.05",
        "[0,3, 0,9]": "0.9",
        "[0,3 mm, 0,9 mm]": "0.3",
        "[5, 0,9]": "0.9",
    }.items(),
)
def test_a_decimal_comma_in_brackets_or_braces_is_an_error(read, text, point):
    comma = point.replace(".", ",")
    with pytest.raises(InputError, match=f"line 2: {comma} has a decimal comma.*write {point}"):
        read(f"# a\na: {text}\n")


@pytest.mark.parametrize(
    "text, content",
    {
        "[0,3]": [0, 3],
        "[1,2,3, 4]": [1, 2, 3, 4],
        "[1,2,\n  3,4]": [1, 2, 3, 4],
        "[x1,2, 3]": ["x1", 2, 3],
        "{1: 1,2: 2}": {1: 1, 2: 2},
        "{1: 0.1,2: 0.2}": {1: 0.1, 2: 0.2},
        "1  # not [0,3, 0,9]": 1,
        "'[0,3, 0,9]'": "[0,3, 0,9]",
    }.items(),
)
def test_other_commas_separate_entries(read, text, content):
    assert read(f"a: {text}\n")["a"] == content


def test_unambiguous_values_are_read_as_written(read):
    text = """
    numbers: [0, -5, +7, 1.5, .5, 1.0e-9, 1e-9]
    truths: [true, False]
    nothing: [null, ~, ]
    texts: ["0600", 'on', y, n, 7 mm, 2026-03-01, 0b69ab5f569c, 0o9a, 0xy]
    """
    assert read(text) == {
        "numbers": [0, -5, 7, 1.5, 0.5, 1e-9, "1e-9"],
        "truths": [True, False],
        "nothing": [None, None],
        "texts": ["0600", "on", "y", "n", "7 mm", "2026-03-01", "0b69ab5f569c", "0o9a", "0xy"],
    }
    numbers = {"a": [1e-9, "\ttab"]}
    assert read(json.dumps(numbers, indent="\t"), "mine.json") == numbers


@pytest.mark.parametrize(
    "content, words",
    [
        (f"a: {'9' * 5000}\n", "is not YAML"),
        (f"a: {'[' * 5_000}", "is not YAML"),
        ("a: !!python/object:os.system x\n", "is not YAML: could not determine a constructor"),
        ("[a]: 1\n", "line 1, column 1: is not YAML: found unhashable key"),
        ("a: 1\nb: \x07\n", "is not YAML"),
        ("# nothing yet\n", ": is empty; write a mapping"),
        ("- 1\n", ": has no keys; write a mapping"),
        (b"a: 1\nb: caf\xe9\n", r": is not text in UTF-8 \(byte 11\); save the file as UTF-8"),
        ("crank: {length: 1 m\nrod: [", ", line 2, column 4: is not YAML"),
        ("a: 1\n---\nb: 2\n", ", line 2, column 1: is not YAML"),
    ],
)
def test_a_file_that_is_not_a_mapping_in_yaml_is_an_error(read, content, words):
    with pytest.raises(InputError, match=words):
        read(content)


@pytest.mark.parametrize(
    "content, words",
    [
        (f'{{"a": {"[" * 200_000}{"]" * 200_000}}}', "is not JSON"),
        (f'{{"a": {"9" * 5000}}}', "is not JSON"),
        ('{"a": ', "is not JSON"),
        ('{"a": 1, "b": {"x": 1, "x": 2}}', "the key 'x' is a duplicate"),
    ],
)
def test_a_file_or_an_option_that_is_not_json_is_an_error(read, content, words):
    with pytest.raises(InputError, match=words):
        read(content, "mine.json")
    with pytest.raises(InputError, match=f"^--options: .*{words}"):
        parse_options(content)


def test_a_file_that_cannot_be_read_is_an_error(tmp_path):
    for path, reason in ((tmp_path, "Is a directory"), (tmp_path / "none.yaml", "No such file")):
        with pytest.raises(InputError, match=rf"{re.escape(str(path))}: cannot be read \({reason}"):
            read_yaml(path)
