"""Progress of long computations."""

import sys

from jointgap.app import cli
from jointgap.app.cli import progress_shown
from jointgap.core.progress import progress_listener, report_progress, with_progress


def test_a_loop_reports_its_progress_before_the_first_item_and_after_each():
    heard = []
    with progress_listener(lambda *report: heard.append(report)):
        assert list(with_progress("ab", "letters")) == ["a", "b"]
    report_progress("letters", 1)  # nobody listens
    assert heard == [("letters", 0, 2), ("letters", 1, 2), ("letters", 2, 2), ("letters", 2, 2)]


def test_a_log_gets_a_line_a_minute(monkeypatch, capsys):
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


def test_a_terminal_gets_one_line_that_is_removed_before_the_result(monkeypatch, capsys):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(cli, "_SECONDS_ON_A_TERMINAL", 0.0)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress_shown():
        for _ in with_progress(range(3), "fits of effects"):
            pass
    shown = capsys.readouterr().err
    assert "fits of effects: 2 of 3" in shown and shown.endswith("\r\x1b[K")
