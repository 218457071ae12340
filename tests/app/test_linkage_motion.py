"""General linkages in Python and on the command line."""

import re

import numpy as np
import pytest

import jointgap as jg
from tests.app.test_cli import refusal
from tests.command import jointgap

SHIPPED = ("four_bar", "quick_return", "six_bar")
RUN = {"speed": "300 rpm", "revolutions": 2, "samples_per_revolution": 180, "tolerance": 1e-9}


@pytest.fixture(scope="module", params=SHIPPED)
def run(request):
    return jg.simulate(jg.load_mechanism(request.param), **RUN)


def test_a_shipped_linkage_moves_and_says_its_largest_forces(run):
    assert len(run.samples) == 361
    assert run.unit("crank_torque") == "N*m"
    text = str(run)
    for name in run.loose:
        assert f"{name}: clearance" in text and f"{name}: impacts" in text
    for name, force in run.joints.items():
        row = run.summary().set_index("quantity")["value"][
            f"{name}: largest force, including the start"
        ]
        assert row == pytest.approx(np.abs(force).max())


def test_every_figure_is_drawn_from_finite_numbers(run, tmp_path):
    for name in run.figures:
        drawing = run.plot(name)
        assert np.isfinite(drawing.data["y"]).mean() > 0.3 and len(drawing.data) > 10
    path = run.plot("animation").save(tmp_path / "moving.gif")
    assert path.read_bytes().startswith(b"GIF")


def test_a_length_or_clearance_is_changed_by_its_path():
    file = jg.load_mechanism("four_bar")
    longer = jg.change(
        file, {"bodies.crank.length": "110 mm", "joints.A.bearing_radius": "10.1 mm"}
    )
    assert longer.bodies["crank"].length == 0.11
    assert longer.loose_joints["A"].clearance == pytest.approx(1.5e-4)
    swings = [np.ptp(jg.simulate(each, **RUN).samples["rocker_angle"]) for each in (file, longer)]
    assert swings[1] > 1.05 * swings[0]


def test_a_look_at_a_linkage_is_one_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = jointgap("look", "six_bar", "--speed", "120 rpm", "--speed", "-60 rpm")
    assert (done.returncode, done.stdout, done.stderr) == (0, "look_six_bar.html\n", "")
    page = (tmp_path / "look_six_bar.html").read_text(encoding="utf-8")
    assert not re.search(r"(?:src|href)='(?!data:|#)", page)
    for words in ("Loose joints: D", "output angular velocity", "E force", "shaking force"):
        assert words in page


CROSSING = """
frame: {points: {O: [0 mm, 0 mm], C: [300 mm, 0 mm]}}
bodies:
  crank:   {length: 100 mm, ends: [O, A], mass: 1 kg, inertia: 8.3e-4 kg*m^2}
  coupler: {length: 200 mm, ends: [A, B], mass: 1 kg, inertia: 1.33e-2 kg*m^2}
  rocker:  {length: 150 mm, ends: [C, B], mass: 1 kg, inertia: 5.2e-3 kg*m^2, angle: 100 deg}
drive: O
"""


def test_a_linkage_that_does_not_turn_is_refused_before_anything_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(CROSSING)
    message = refusal("look", "mine.yaml", "--speed", "120 rpm")
    assert message.startswith("mine.yaml: at crank angle")
    assert "coupler and rocker do not meet" in message and "200 + 150 mm" in message
    assert [path.name for path in tmp_path.iterdir()] == ["mine.yaml"]
