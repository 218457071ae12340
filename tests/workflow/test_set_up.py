"""The set-up, from nothing but Python."""

import os
import subprocess
import sys
import time

import pytest


@pytest.mark.slow
def test_set_up_from_nothing_in_a_path_with_a_space_without_a_home_and_once_only(fresh_project):
    base_python = os.path.realpath(sys.executable)
    environment = {"PATH": os.defpath, "HOME": "/dev/null/home", "PYTHON": base_python}
    environment |= {name: value for name, value in os.environ.items() if name.startswith(("PIP_", "SSL_", "HTTPS_"))}

    def call(*command):
        return subprocess.run(command, cwd=fresh_project, env=environment, capture_output=True, text=True, check=False)

    first = call("make", "set-up")
    assert first.returncode == 0, first.stderr
    said = first.stdout.splitlines()
    assert [line.split()[1] for line in said] == ["making", "installing", "installing", "installing", "done"]

    start = time.monotonic()
    second = call("make", "set-up")
    assert time.monotonic() - start < 1
    assert (second.returncode, second.stdout) == (0, "")

    shown = call("scripts/in-venv", "jointgap", "--version")
    assert shown.returncode == 0, shown.stderr
    assert "0.1.0" in shown.stdout
