"""The set-up, from nothing but Python."""

import os
import re
import subprocess
import sys

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
    assert said[0].startswith("set-up: making a virtual environment")
    assert sum(line.startswith(("set-up: 1/2, torch", "set-up: 2/2, jointgap")) for line in said) == 2
    assert len(said) < 40  # not what pip says
    assert re.fullmatch(r"set-up: done in \d+ s", said[-1])
    second = call("make", "set-up")
    assert (second.returncode, second.stdout) == (0, "")  # nothing left to do
    shown = call("scripts/in-venv", "jointgap", "--version")
    assert shown.returncode == 0, shown.stderr
    assert "0.1.0" in shown.stdout
