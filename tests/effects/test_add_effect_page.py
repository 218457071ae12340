"""docs/how_to/add_effect.md followed to the letter in a copy of the sources: the effect and the
fault that it adds work everywhere.

Compiled code runs as plain Python here: a copy would have to be compiled anew, which takes longer
than these few samples.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.integration

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/how_to/add_effect.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"`(src/jointgap/[\w/]+\.py)`(?:(?!\n\n).)*:\n\n```diff\n(.*?)```", re.DOTALL)


def with_diff(text: str, diff: str) -> str:
    """`text` with the + and - lines of a block ``diff`` applied."""
    lines = diff.splitlines(keepends=True)
    before = "".join(line[1:] for line in lines if not line.startswith("+"))
    assert text.count(before) == 1, (
        f"the page shows lines that are not exactly once in the file:\n{before}"
    )
    return text.replace(before, "".join(line[1:] for line in lines))


def followed(folder: Path, section: str) -> list[str]:
    """Apply the blocks of a section of the page to the sources in `folder`; the files that it
    touches."""
    blocks = BLOCK.findall(PAGE[PAGE.index(section) :].split("\n## ")[0])
    for path, diff in blocks:
        file = folder / path
        file.write_text(with_diff(file.read_text("utf-8"), diff), "utf-8")
    return [path for path, _ in blocks]


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    folder = tmp_path_factory.mktemp("extended")
    shutil.copytree(ROOT / "src", folder / "src", ignore=shutil.ignore_patterns("__pycache__"))
    touched = followed(folder, "## Effect") + followed(folder, "## Sensor fault")
    return folder / "src", touched


def run(sources, *arguments: str) -> str:
    environment = os.environ | {
        "PYTHONPATH": f"{sources[0]}{os.pathsep}{ROOT}",
        "NUMBA_DISABLE_JIT": "1",
    }
    done = subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_one_file_makes_an_effect_and_one_makes_a_fault(sources):
    _, (*effect, fault) = sources
    assert set(effect) == {"src/jointgap/effects/pivots.py"}
    assert fault == "src/jointgap/rig/sensors.py"


def test_the_catalogue_shows_the_effect_and_the_pages_own_checks_of_its_law_hold(sources):
    cli = "from jointgap.app.cli import cli; cli()"
    assert "M = -k sin(theta - theta0)" in run(sources, "-c", cli, "effects")
    assert "stiffness_N_m_rad [>= 0 N*m/rad]" in run(
        sources, "-c", cli, "effects", "crank_return_spring"
    )
    checks = re.findall(r"```python\n(import numpy.*?)```", PAGE, re.DOTALL)
    assert len(checks) == 2
    for check in checks:
        run(sources, "-c", check)


FIT = """
import math
import numpy as np
from jointgap.rig.model import build_model
from jointgap.campaign.labels import format_effect
from tests.rig.rigs import campaign, mechanism, recorded

true = {"stiffness_N_m_rad": 2.0, "rest_angle_rad": 2.5}
spring = {"name": "crank_return_spring", "parameters": true}
few = {"channels": ("time", "crank_angle", "crank_torque"), "speeds": (30.0, 31.0)}
true_campaign = campaign(mechanism(effects=[spring]), **few)
measurements = recorded(true_campaign, dropped=0, kept=1, per_turn=24)
model = build_model(campaign(mechanism(), **few), measurements)
labels = {candidate.label: candidate for candidate in model.candidates}
candidate = labels["crank_return_spring"]
series = next(one for one in model.series if one.key == ("slow", "crank_torque"))

def torque(*effects):
    return model.simulate("slow", model.nominal("slow"), effects)["crank_torque"]

base, steps = torque(), [p.step for p in candidate.coordinates]
names = [p.name for p in candidate.coordinates]
zero = dict.fromkeys(names, 0.0)
slopes = [torque((candidate, zero | {name: step})) - base for name, step in zip(names, steps)]
fitted = np.linalg.lstsq(np.column_stack(slopes), series.value - base, rcond=None)[0] * steps
found = candidate.parameters(dict(zip(names, fitted)))
assert math.isclose(found["stiffness_N_m_rad"], 2.0, rel_tol=1e-6), found
assert math.isclose(found["rest_angle_rad"], 2.5, rel_tol=1e-6), found
mirrored = spring | {"parameters": true | {"rest_angle_rad": -2.5}}
clockwise = campaign(mechanism(effects=[mirrored]), run={"direction": "clockwise"}, **few)
for recording in measurements.runs.values():  # seen from behind; angles are mirrored already
    recording.channels["crank_torque"] *= -1.0
behind = build_model(clockwise, measurements)
values = next(one for one in behind.series if one.key == ("slow", "crank_torque")).value
read = behind.simulate("slow", behind.nominal("slow"))["crank_torque"]
assert np.allclose(read, values, atol=1e-6)
label = format_effect({"name": "crank_return_spring", "site": "crank_pivot"})
assert label == "a return spring on the crank"
fault = labels["sensor_asymmetry:crank_torque"]
wrong = torque((fault, {"gain_error_below_0": 0.1}))
assert np.allclose(wrong, np.where(base < 0.0, 1.1 * base, base))
assert (base < 0.0).any()
"""


def test_a_fit_recovers_the_spring_clockwise_too_and_verdicts_know_effect_and_fault(sources):
    run(sources, "-c", FIT)
