"""Files that go from one command of the blind trials to the next, where they are not what they should be."""

import pytest
from click.testing import CliRunner

from jointgap.app.cli import cli
from jointgap.core.errors import InputError
from jointgap.trials.batches import listed_trials, read_trial_records
from jointgap.trials.score import score_batches


def test_a_list_that_is_not_there_is_named_with_the_command_that_writes_it(tmp_path):
    places = ("--listed", "batch.txt", "--campaigns", ".", "--verdicts", ".", "--found", "found.json")
    with pytest.raises(
        InputError, match=r"batch.txt: cannot be read .*correct --listed, or run `jointgap blind-conceal`"
    ):
        CliRunner().invoke(cli, ["blind-analyse", *places], catch_exceptions=False)


def test_a_list_gives_the_campaigns_that_are_there_and_no_others(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "batch.txt").write_text("a\n")
    assert listed_trials(tmp_path / "batch.txt", tmp_path) == ["a"]
    (tmp_path / "batch.txt").write_text("a\nb\n")
    with pytest.raises(InputError, match=r"lists the campaign b, which is not in .*; correct --campaigns"):
        listed_trials(tmp_path / "batch.txt", tmp_path)


@pytest.mark.parametrize("missing", ["truth", "found"])
def test_a_truth_or_a_verdict_that_is_not_there_is_named_with_its_option(tmp_path, missing):
    paths = {name: tmp_path / f"{name}.json" for name in ("truth", "found")}
    for name in paths.keys() - {missing}:
        paths[name].write_text("[]")
    with pytest.raises(
        InputError, match=rf"{missing}\.json: cannot be read .*correct --{missing}, or run `jointgap blind-"
    ):
        score_batches([paths["truth"]], [paths["found"]])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b'[{"id": "a"', "is not JSON .*run `jointgap blind-analyse` again"),
        (b'{"id": "a"}', "is no list of trials; give --found a file that `jointgap blind-analyse` wrote"),
        (b'[{"name": "a"}]', "is no list of trials"),
        (b"\xff\xfe", r"is not text in UTF-8 \(byte 0\)"),
    ],
)
def test_a_file_that_holds_no_trials_is_refused_with_what_should_be_given(tmp_path, content, words):
    (tmp_path / "found.json").write_bytes(content)
    with pytest.raises(InputError, match=rf"found\.json: {words}"):
        read_trial_records(tmp_path / "found.json", "--found", "blind-analyse")
