"""Files of settings mean what they say, in YAML and in JSON, or are refused with the place and the
mend."""

import json
import re

import pytest

from jointgap.config import parse_options, read_yaml
from jointgap.core.errors import InputError
from tests.catalogue import each, refused


@pytest.fixture
def content_of(tmp_path):
    """What a file with this content holds; a refusal is one line."""

    def read(content: str | bytes, name: str = "mine.yaml"):
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        try:
            return read_yaml(tmp_path / name)
        except InputError as error:
            assert len(str(error).splitlines()) == 1
            raise

    return read


def test_a_key_that_is_given_twice_is_refused_with_both_lines(content_of):
    cases = [
        ("a: 1\nb: 2\na: 3\n", "a", 1, 3),
        ("a: {x: 1,\n  x: 2}\n", "x", 1, 2),
        ("a: {x: 1, x: 2}\n", "x", 1, 1),
        (
            "runs:\n  - {id: slow, role: identify}\n  - id: fast\n    speed: 1\n    id: slow\n",
            "id",
            3,
            5,
        ),
        ("1: a\n'1': b\n", "1", 1, 2),
        ("a: &a {x: 1}\nb:\n  <<: *a\n  <<: *a\n", "<<", 3, 4),
    ]
    words = "the key '{}' is a duplicate, in lines {} and {}"
    refused(content_of, [(text, words.format(*places)) for text, *places in cases])
    assert content_of("a: &a {x: 1, y: 2}\nb: {<<: *a, x: 3}\n")["b"] == {
        "x": 3,
        "y": 2,
    }  # laid over an alias's


def test_what_readers_of_yaml_take_for_different_things_is_refused(content_of):
    def told(written):
        place = rf", line 2, column 4: {re.escape(written)} differs between YAML versions; "
        with pytest.raises(
            InputError, match=rf'{place}write a plain.*"{re.escape(written)}" in quotation marks'
        ):
            content_of(f"a: 1\nb: {written}\n")
        with pytest.raises(InputError, match="quotation marks"):
            content_of(f"{written}: 1\n")

    each(told, "0600 -0600 08 1_000 10:30 1:30.5 0x10 0x_ 0b1 0o17 yes On no OFF".split())


COMMAS = [
    ("{m: 2,4 kg, n: 1}", "2,4 kg", "2.4 kg"),
    ("{m: -2,4}", "-2,4", "-2.4"),
    ("{m: 0,05}", "0,05", "0.05"),
]
COMMAS += [
    ("[0,3, 0,9]", "0,3", "0.3"),
    ("[0,3 mm, 0,9 mm]", "0,3 mm", "0.3 mm"),
    ("[5, 0,9]", "0,9", "0.9"),
]


def test_a_decimal_comma_in_braces_or_brackets_is_refused_where_it_is_certain(content_of):
    words = "line 1 ~ {} has a decimal comma, which separates entries here; write {}"
    refused(content_of, [(f"a: {text}\n", words.format(*numbers)) for text, *numbers in COMMAS])
    lists = {
        "[0,3]": [0, 3],
        "[1,2,3, 4]": [1, 2, 3, 4],
        "[1,2,\n  3,4]": [1, 2, 3, 4],
        "[x1,2, 3]": ["x1", 2, 3],
    }
    for text, content in (
        lists | {"{1: 1,2: 2}": {1: 1, 2: 2}, "{1: 0.1,2: 0.2}": {1: 0.1, 2: 0.2}}
    ).items():
        assert content_of(f"a: {text}\n")["a"] == content


def test_what_is_unmistakable_is_read_as_written(content_of):
    text = """
    numbers: [0, -5, +7, 1.5, .5, 1.0e-9, 1e-9]
    truths: [true, False]
    nothing: [null, ~, ]
    texts: ["0600", 'on', y, n, 7 mm, 2026-03-01, 0b69ab5f569c, 0o9a, 0xy]
    """
    assert content_of(text) == {
        "numbers": [0, -5, 7, 1.5, 0.5, 1e-9, "1e-9"],
        "truths": [True, False],
        "nothing": [None, None],
        "texts": ["0600", "on", "y", "n", "7 mm", "2026-03-01", "0b69ab5f569c", "0o9a", "0xy"],
    }
    assert content_of(json.dumps({"a": [1e-9, "\ttab"]}, indent="\t"), "mine.json") == {
        "a": [1e-9, "\ttab"]
    }


UNREADABLE = [
    (f"a: {'9' * 5000}\n", "is not YAML"),
    (f"a: {'[' * 50_000}", "is not YAML"),
    ("a: !!python/object:os.system x\n", "is not YAML: could not determine a constructor"),
    ("a: !!int x\n", "is not YAML"),
    ("[a]: 1\n", "line 1, column 1: is not YAML: found unhashable key"),
    ("a: 1\nb: \x07\n", "is not YAML"),
    ("", ": is empty; write a mapping"),
    ("# nothing yet\n", ": is empty; write a mapping"),
    *((text, ": has no keys; write a mapping") for text in ("just a text\n", "- 1\n", "5\n")),
    (b"a: 1\nb: caf\xe9\n", ": is not text in UTF-8 (byte 11); save the file as UTF-8"),
    (b"\xff\xfe\x00", ": is not text in UTF-8"),
    ("crank: {length: 1 m\nrod: [", ", line 2, column 4: is not YAML"),
    ("a: 1\n---\nb: 2\n", ", line 2, column 1: is not YAML"),
]


def test_a_file_that_is_no_mapping_in_yaml_or_json_is_refused_by_name(content_of, tmp_path):
    refused(content_of, UNREADABLE, starts=str(tmp_path / "mine.yaml"))
    for path, why in ((tmp_path, "Is a directory"), (tmp_path / "none.yaml", "No such file")):
        with pytest.raises(InputError, match=rf"{path}: cannot be read \({why}"):
            read_yaml(path)
    nested, digits = f'{{"a": {"[" * 200_000}{"]" * 200_000}}}', f'{{"a": {"9" * 5000}}}'
    texts = [(text, "is not JSON") for text in (nested, digits, '{"a": ')]
    texts.append(('{"a": 1, "b": {"x": 1, "x": 2}}', "the key 'x' is a duplicate"))
    refused(lambda text: content_of(text, "mine.json"), texts)
    refused(parse_options, texts, starts="--options: ")


def test_a_configuration_where_one_scenario_is_needed_is_refused_with_the_way_to_take_one_out(
    tmp_path,
):
    (tmp_path / "mine.yaml").write_text(
        "scenarios: {mine: {mechanism: erkaya2009}}", encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"several scenarios.* --scenario NAME"):
        parse_options(str(tmp_path / "mine.yaml"))
