"""A full disk or quota."""

import re
import subprocess

import pytest

from benchmarks.project import ROOT, environment

pytestmark = pytest.mark.integration

RULE = (
    "rule {}:\n    output: '{}.made'\n    log: '{}.log'\n    shell: 'ulimit -f 0; jointgap {} >"
    " {{log}} 2>&1'\n"
)


def test_a_failed_job_reports_its_reason_on_a_full_disk(tmp_path):
    text = f"include: {str(ROOT / 'workflow' / 'rules' / 'terminal.smk')!r}\n"
    for name, command in (("read", "describe nothing.parquet"), ("write", "schema")):
        text += RULE.format(name, name, name, command)
    (tmp_path / "Snakefile").write_text(text)
    command = "snakemake read.made write.made --cores 1 --show-failed-logs --keep-going".split()
    done = subprocess.run(
        command, cwd=tmp_path, env=environment(), capture_output=True, text=True, check=False
    )
    said = done.stdout + done.stderr
    assert done.returncode != 0
    assert (tmp_path / "read.log").read_text() == (tmp_path / "write.log").read_text() == ""
    assert "jointgap: error: nothing.parquet: no such file; check the path" in said
    assert "Traceback" not in said
    assert re.search(
        r"jointgap: error: .*cannot be written \(File too large\); free disk space", said
    )
