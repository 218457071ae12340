"""Files of settings mean what they say, in YAML and in JSON, or are refused with the place and the mend."""

import json

import pytest

from jointgap.config import parse_options, read_yaml
from jointgap.core.errors import InputError


@pytest.fixture
def refusal(tmp_path):
    """Why a content is refused: one line."""

    def of(content: str | bytes, name: str = "mine.yaml") -> str:
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        with pytest.raises(InputError) as caught:
            read_yaml(file)
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
        ("a: {x: 1, x: 2}\n", "x", (1, 1)),
        ("runs:\n  - {id: slow, role: identify}\n  - id: fast\n    speed: 1\n    id: slow\n", "id", (3, 5)),
        ("1: a\n'1': b\n", "1", (1, 2)),
        ("a: &a {x: 1}\nb:\n  <<: *a\n  <<: *a\n", "<<", (3, 4)),
    ],
)
def test_a_key_that_is_given_twice_is_refused_with_both_lines(refusal, text, key, lines):
    assert f"the key '{key}' is given twice, in line {lines[0]} and in line {lines[1]}" in refusal(text)


def test_a_key_may_be_laid_over_that_of_an_alias(content_of):
    assert content_of("a: &a {x: 1, y: 2}\nb: {<<: *a, x: 3}\n")["b"] == {"x": 3, "y": 2}


@pytest.mark.parametrize("name", ["0b69ab5f569c", "0o9a", "0xy"])
def test_a_name_that_only_begins_like_a_number_of_another_base_is_a_text(content_of, name):
    assert content_of(f"name: {name}\n") == {"name": name}


@pytest.mark.parametrize("written", "0600 -0600 08 1_000 10:30 1:30.5 0x10 0x_ 0b1 0o17 yes On no OFF".split())
def test_what_readers_of_yaml_take_for_different_things_is_refused(refusal, written):
    message = refusal(f"a: 1\nb: {written}\n")
    assert (
        f", line 2, column 4: {written} is one thing to some programs and another to others; write a plain" in message
    )
    assert f'"{written}" in quotation marks' in message
    assert "quotation marks" in refusal(f"{written}: 1\n")


def test_what_is_unmistakable_is_read_as_written(content_of):
    text = """
    numbers: [0, -5, +7, 1.5, .5, 1.0e-9, 1e-9]
    truths: [true, False]
    nothing: [null, ~, ]
    texts: ["0600", 'on', y, n, 7 mm, 2026-03-01]
    """
    assert content_of(text) == {
        "numbers": [0, -5, 7, 1.5, 0.5, 1e-9, "1e-9"],
        "truths": [True, False],
        "nothing": [None, None],
        "texts": ["0600", "on", "y", "n", "7 mm", "2026-03-01"],
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"a: {'9' * 5000}\n", "is not YAML"),
        (f"a: {'[' * 50_000}", "is not YAML"),
        ("a: !!python/object:os.system x\n", "is not YAML: could not determine a constructor"),
        ("a: !!int x\n", "is not YAML"),
        ("[a]: 1\n", "line 1, column 1: is not YAML: found unhashable key"),
        ("a: 1\nb: \x07\n", "is not YAML"),
    ],
    ids=lambda text: ascii(text[:30]),
)
def test_what_would_end_in_a_traceback_is_refused(refusal, text, words):
    assert words in refusal(text)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ": is empty; write a mapping"),
        (b"# nothing yet\n", ": is empty; write a mapping"),
        (b"just a text\n", ": holds no keys; write a mapping"),
        (b"- 1\n", ": holds no keys; write a mapping"),
        (b"5\n", ": holds no keys; write a mapping"),
        (b"a: 1\nb: caf\xe9\n", ": is not text in UTF-8 (byte 11); save the file as UTF-8"),
        (b"\xff\xfe\x00", ": is not text in UTF-8"),
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
        (f'{{"a": {"[" * 200_000}{"]" * 200_000}}}', "is not JSON"),
        (f'{{"a": {"9" * 5000}}}', "is not JSON"),
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


def test_a_configuration_where_one_scenario_is_needed_is_refused_with_the_way_to_take_one_out(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("scenarios: {mine: {mechanism: erkaya2009}}", encoding="utf-8")
    with pytest.raises(InputError, match=r"holds scenarios, and one is needed.* --scenario NAME"):
        parse_options(str(path))
