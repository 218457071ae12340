"""A disk that is full, or a quota: the reason is told though the log has no room for it."""

import re
import subprocess

import pytest

from benchmarks.project import ROOT, environment

pytestmark = pytest.mark.integration


def said_of_a_job(folder, command: str) -> str:
    """What Snakemake shows of a job that has no room for files."""
    terminal = str(ROOT / "workflow" / "rules" / "terminal.smk")
    (folder / "Snakefile").write_text(
        f"include: {terminal!r}\nrule job:\n    output: 'made'\n    log: 'job.log'\n    shell: {command!r}\n"
    )
    done = subprocess.run(
        ["snakemake", "--cores", "1", "--show-failed-logs"],
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert (folder / "job.log").read_text() == ""
    return done.stdout + done.stderr


def test_the_reason_of_a_failed_job_is_shown_though_its_log_is_empty(tmp_path):
    said = said_of_a_job(tmp_path, "ulimit -f 0; jointgap describe nothing.parquet > {log} 2>&1")
    assert "jointgap: error: nothing.parquet: no such file; check the path" in said
    assert "Traceback" not in said


def test_a_log_without_room_for_what_is_shown_is_the_reason(tmp_path):
    said = said_of_a_job(tmp_path, "ulimit -f 0; jointgap schema > {log} 2>&1")
    assert re.search(r"jointgap: error: .*cannot be written \(File too large\); free some space", said)
