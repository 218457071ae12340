"""The examples on real data, run on small synthetic files."""

import importlib
import re
import sys

import numpy as np
import pytest

from tests.examples import test_emps, test_pendulum

pytestmark = pytest.mark.integration


@pytest.fixture
def run(monkeypatch, capsys):
    """Output of ``python -m NAME FOLDER``."""

    def printed(name, folder) -> str:
        monkeypatch.setattr(sys, "argv", [name, str(folder)])
        importlib.import_module(f"{name}.__main__").main()
        return capsys.readouterr().out

    return printed


def check(said: str, effect: str, unit: str, runs) -> None:
    """The report has a verdict, the gap on held-out data, the estimates and a line for each run."""
    assert "verdict: named" in said and f"effects: {effect}\n" in said
    before, after = map(
        float, re.search(r"gap on the held-out data: falls from (\S+) to (\S+)\n", said).groups()
    )
    assert before > 2.0 and after < 1.2  # of noise
    assert re.search(rf"{effect}\.\w+ = \S+, 90 % interval \S+ to \S+\n", said)
    for run in runs:
        assert re.search(
            rf"run {run}( \(held out\))?: .* \S+{unit} before, \S+{unit} after\n", said
        )
    assert "nan" not in said


def test_the_positioning_axis_example_prints_its_report(tmp_path, run):
    period = test_emps.CYCLE * test_emps.AVERAGED
    phase = 2 * np.pi * np.arange(3 * period) / period
    reference = test_emps.STROKE / 2 * (1.0 - np.cos(phase) + 0.1 * (1.0 - np.cos(5 * phase)))
    clean = test_emps.force(
        test_emps.write(tmp_path, reference), slider_coulomb_friction={"force_N": 20.0}
    )
    random = np.random.default_rng(7)
    noisy = {name: clean + random.normal(0.0, 3.0, clean.size) for name in test_emps.FILES}
    test_emps.write(
        tmp_path, reference, {name: force / test_emps.LOOP["gtau"] for name, force in noisy.items()}
    )
    check(run("examples.emps", tmp_path), "slider_coulomb_friction", "", test_emps.FILES)


def test_the_pendulum_example_prints_its_report(tmp_path, run):
    test_pendulum.write_swings(tmp_path, {"coulomb_friction": {"torque_Nm": 0.15}})
    check(run("examples.pendulum", tmp_path), "coulomb_friction", " rad", test_pendulum.RUNS)
