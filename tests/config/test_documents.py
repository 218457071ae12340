"""Files of settings mean what they say, in YAML and in JSON, or are refused with the place and the mend."""

import json
import time

import pytest

from jointgap.config import parse_options, read_yaml
from jointgap.core.errors import InputError


@pytest.fixture
def refusal(tmp_path):
    """Why a content is refused: one line, within two seconds."""

    def of(content: str | bytes, name: str = "mine.yaml") -> str:
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        start = time.process_time()
        with pytest.raises(InputError) as caught:
            read_yaml(file)
        assert time.process_time() - start < 2.0
        message = str(caught.value)
        assert message.startswith(str(file)) and len(message.splitlines()) == 1
        return message.removeprefix(str(file))

    return of


@pytest.fixture
def content_of(tmp_path):
    def read(text: str, name: str = "mine.yaml"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return read_yaml(tmp_path / name)

    return read


@pytest.mark.parametrize(
    ("text", "key", "lines"),
    [
        ("a: 1\nb: 2\na: 3\n", "a", (1, 3)),
        ("a: {x: 1,\n  x: 2}\n", "x", (1, 2)),
        ("runs:\n  - {id: slow, role: identify}\n  - id: fast\n    speed: 1\n    id: slow\n", "id", (3, 5)),
        ("1: a\n'1': b\n", "1", (1, 2)),
        ("1: a\n1.0: b\n", "1.0", (1, 2)),
        ("a: &a {x: 1}\nb:\n  <<: *a\n  <<: *a\n", "<<", (3, 4)),
    ],
)
def test_a_key_that_is_given_twice_is_refused_with_both_lines(refusal, text, key, lines):
    assert f"the key '{key}' is given twice, in line {lines[0]} and in line {lines[1]}" in refusal(text)


def test_a_key_may_be_laid_over_that_of_an_alias(content_of):
    assert content_of("a: &a {x: 1, y: 2}\nb: {<<: *a, x: 3}\n")["b"] == {"x": 3, "y": 2}


@pytest.mark.parametrize(
    ("written", "mend"),
    [
        ("0600", "write 600, or"),
        ("-0600", "write -600, or"),
        ("-0", "write a plain decimal number, or"),
        ("1_000", "write 1000, or"),
        ("10:30", "write a plain decimal number, or"),
        ("1:30.5", "write a plain decimal number, or"),
        ("0x10", "write a plain decimal number, or"),
        ("0x_", "write a plain decimal number, or"),
        ("0b1", "write a plain decimal number, or"),
        ("yes", "write true, or"),
        ("On", "write true, or"),
        ("no", "write false, or"),
        ("OFF", "write false, or"),
    ],
)
def test_what_readers_of_yaml_take_for_different_things_is_refused(refusal, written, mend):
    message = refusal(f"a: 1\nb: {written}\n")
    assert f", line 2, column 4: {written} is one thing to some programs and another to others; {mend}" in message
    assert f'"{written}" in quotation marks' in message
    assert "quotation marks" in refusal(f"{written}: 1\n")


def test_what_is_unmistakable_is_read_as_written(content_of):
    text = """
    numbers: [0, -5, +7, 1.5, .5, 1.0e-9, 1e-9, 08]
    truths: [true, False]
    nothing: [null, ~, ]
    texts: ["0600", 'on', y, n, =, 7 mm, 2026-03-01]
    """
    assert content_of(text) == {
        "numbers": [0, -5, 7, 1.5, 0.5, 1e-9, "1e-9", "08"],
        "truths": [True, False],
        "nothing": [None, None],
        "texts": ["0600", "on", "y", "n", "=", "7 mm", "2026-03-01"],
    }


def test_a_day_that_there_is_not_is_refused(refusal):
    assert ", line 1, column 7: '2024-02-30' is no day" in refusal("date: 2024-02-30\n")


BILLION_LAUGHS = "a: &a [1, 1]\n" + "".join(
    f"{key}: &{key} [{', '.join([f'*{before}'] * 10)}]\n" for before, key in zip("abcdefgh", "bcdefghi", strict=True)
)
BILLION_MERGES = "a: &a {x: 1}\n" + "".join(
    f"{key}: &{key} {{<<: [{', '.join([f'*{before}'] * 10)}]}}\n"
    for before, key in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"a: {'9' * 5000}\n", "line 1, column 4: a number of 5000 digits is too large"),
        (f"a: 0x{'9' * 5000}\n", "line 1, column 4: a number of 5002 digits is too large"),
        (f"a: {'[' * 500}{']' * 500}\n", "line 1, column 53: is nested more than 50 deep"),
        ("\n".join(" " * depth + "a:" for depth in range(500)), "line 50, column 50: is nested more than 50 deep"),
        (f"a: {'[' * 50_000}", "is nested more than 50 deep"),
        (BILLION_LAUGHS, "line 5, column 4: holds more than 20000 keys and values"),
        (BILLION_MERGES, "line 5, column 12: holds more than 20000 keys and values"),
        (f"a: [{'1, ' * 30_000}]", "holds more than 20000 keys and values"),
        (f"a: {'x' * 300_000}", "has more than 200000 bytes"),
        ("a: &a [*a]\n", "line 1, column 8: *a stands within itself"),
        ("a: !!python/object:os.system x\n", "the tag tag:yaml.org,2002:python/object:os.system is not read"),
        ("a: !!int x\n", "the tag tag:yaml.org,2002:int is not read"),
        ("[a]: 1\n", "line 1, column 1: a key must be a text or a number"),
        ('a: "\\ud800"\n', "line 1, column 4: holds the character #xd800"),
        ("a: 1\nb: \x07\n", "line 2: holds the character #x0007"),
    ],
    ids=lambda text: ascii(text[:30]),
)
def test_what_would_end_in_a_traceback_or_in_no_memory_is_refused(refusal, text, words):
    assert words in refusal(text)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ": is empty; write a mapping"),
        (b"# nothing yet\n", ": is empty; write a mapping"),
        (b"just a text\n", ": holds text and no keys; write a mapping"),
        (b"- 1\n", ": holds a list and no keys; write a mapping"),
        (b"5\n", ": holds a number and no keys; write a mapping"),
        (b"a: 1\nb: caf\xe9\n", ", line 2: is not text in UTF-8 (byte 11); save the file as UTF-8"),
        (b"\xff\xfe\x00", ", line 1: is not text in UTF-8"),
        (b"crank: {length: 1 m\nrod: [", ", line 2, column 4: is not YAML"),
        (b"a: 1\n---\nb: 2\n", ", line 2, column 1: is not YAML"),
    ],
)
def test_a_file_that_holds_no_mapping_is_refused_by_name(refusal, content, words):
    assert refusal(content).startswith(words)


def test_a_folder_and_a_file_that_is_not_there_are_refused(tmp_path):
    for path, why in ((tmp_path, "Is a directory"), (tmp_path / "none.yaml", "No such file")):
        with pytest.raises(InputError, match=rf"{path}: cannot be read \({why}"):
            read_yaml(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"a": 1, "b": {"x": 1, "x": 2}}', "the key 'x' is given twice"),
        (f'{{"a": {"[" * 20_000}{"]" * 20_000}}}', "is nested more than 50 deep"),
        (f'{{"a": {"[" * 60}{"]" * 60}}}', "is nested more than 50 deep"),
        (f'{{"a": {"9" * 5000}}}', "a number of 5000 digits is too large"),
        ('{"a": NaN}', "holds NaN"),
        ('{"a": ["\\ud800"]}', "holds the character #xd800"),
        ('{"\\u0000": 1}', "holds the character #x0000"),
        ('{"a": ', "is not JSON"),
    ],
    ids=lambda text: text[:30],
)
def test_a_json_text_is_read_as_strictly(refusal, text, words):
    assert words in refusal(text, "mine.json")
    with pytest.raises(InputError, match=f"^--options: .*{words}"):
        parse_options(text)


def test_a_json_file_is_read_as_json(content_of):
    assert content_of(json.dumps({"a": [1e-9, "\ttab"]}, indent="\t"), "mine.json") == {"a": [1e-9, "\ttab"]}


@pytest.mark.parametrize("text", ["{mass: 0,19 kg, x: 1}", "{mass: 0,19}", "{x: 1, mass: -0,19kg}", "{mass: 0,02}"])
def test_a_decimal_comma_between_braces_is_refused_with_the_number_that_is_meant(tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(f"crank: {text}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"line 1, column \d+: the comma in -?0,.* ends the value; write -?0\.\d"):
        read_yaml(path)


def test_a_comma_between_whole_numbers_of_a_list_is_none(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("{a: [0, 19], b: 1, 2: 3}\n", encoding="utf-8")
    assert read_yaml(path) == {"a": [0, 19], "b": 1, 2: 3}


def test_a_configuration_where_one_scenario_is_needed_is_refused_with_the_way_to_take_one_out(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("scenarios: {mine: {mechanism: erkaya2009}}", encoding="utf-8")
    with pytest.raises(InputError, match=r"holds scenarios, and one is needed.* --scenario NAME"):
        parse_options(str(path))
