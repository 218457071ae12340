"""How far long work has come is told to who listens, and shown on the standard error output."""

import sys

from jointgap.app import cli
from jointgap.app.cli import progress_shown
from jointgap.core.progress import progress_listener, report_progress, with_progress


def test_a_followed_loop_tells_before_the_first_item_and_after_each():
    heard = []
    with progress_listener(lambda *told: heard.append(told)):
        assert list(with_progress("ab", "letters")) == ["a", "b"]
    report_progress("letters", 1)  # who no longer listens is told nothing
    assert heard == [("letters", 0, 2), ("letters", 1, 2), ("letters", 2, 2), ("letters", 2, 2)]


def test_a_log_gets_a_line_now_and_then(monkeypatch, capsys):
    clock = iter([0.0, 1.0, 61.0, 62.0, 200.0])
    monkeypatch.setattr(cli.time, "monotonic", lambda: next(clock))
    with progress_shown():
        for done in (1, 2, 3):
            report_progress("fits of effects", done, 9)
        report_progress("simulated runs", 4)
    assert (
        capsys.readouterr().err
        == "jointgap: fits of effects: 2 of 9\njointgap: simulated runs: 4\n"
    )


def test_a_terminal_gets_bars_that_leave_nothing_behind(monkeypatch, capsys):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(cli, "_SECONDS_OF_SILENCE", -1.0)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress_shown():
        for _ in with_progress(range(3), "fits of effects"):
            print("an answer")
    shown = capsys.readouterr()
    assert shown.out == "an answer\n" * 3
    assert "fits of effects" in shown.err and "/3" in shown.err
