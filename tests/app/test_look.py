"""The page of `jointgap look`."""

import math
import re

import pytest

from jointgap.config import load_mechanism
from tests.app.test_cli import refusal
from tests.command import jointgap

PEAK = r"<td class='s'>{}</td><td class='s'>[^<]*</td>" + r"<td class='n'>([^<]*)</td>" * 4


def peaks(page: str, quantity: str) -> list[float]:
    """Peak and angle [deg] at each of two speeds."""
    return [float(cell) for cell in re.search(PEAK.format(quantity), page).groups()]


def test_a_look_is_one_page_with_peaks_of_motion_and_forces(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = jointgap("look", "ideal_joints", "--speed", "240 rpm", "--speed", "-480 rpm")
    assert (done.returncode, done.stdout, done.stderr) == (0, "look_ideal_joints.html\n", "")
    assert [path.name for path in tmp_path.iterdir()] == ["look_ideal_joints.html"]
    page = (tmp_path / "look_ideal_joints.html").read_text(encoding="utf-8")
    assert not re.search(r"(?:src|href)='(?!data:|#)", page) and page.count("<img") == 8

    made = load_mechanism("ideal_joints")
    crank, rod, mass = made.crank.length, made.rod.length, made.slider.mass
    size = (
        crank * (240 * math.pi / 30) ** 2 * (1 + crank / rod)
    )  # of the acceleration at the outer dead centre
    slow, at, fast, there = peaks(page, "slider acceleration")
    assert (slow, fast) == (pytest.approx(-size, rel=1e-3), pytest.approx(-4 * size, rel=1e-3))
    assert at % 360 == there % 360 == 0
    assert peaks(page, "piston pin force")[0] == pytest.approx(mass * size, rel=1e-3)
    # in line the torque is the same for a clockwise crank, with equal peaks of both signs
    forward, at, back, there = peaks(page, "crank torque")
    assert abs(back) == pytest.approx(4 * abs(forward), rel=1e-3)
    assert min(there, 360 - there) == pytest.approx(min(at, 360 - at), abs=0.11)


def test_loose_joints_are_simulated_as_such(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert (
        jointgap("look", "compressor", "--speed", "1450 rpm", "--speed", "700 rpm").returncode == 0
    )
    page = (tmp_path / "look_compressor.html").read_text(encoding="utf-8")
    assert "Loose joints: crank pin and piston pin" in page
    made = load_mechanism("compressor")
    rigid = (
        made.crank.length * (1450 * math.pi / 30) ** 2 * (1 + made.crank.length / made.rod.length)
    )
    assert abs(peaks(page, "slider acceleration")[0]) > 1.2 * rigid  # impacts


SLOW = ("--speed", "240 rpm")


@pytest.mark.parametrize(
    "arguments, words",
    [
        (("ideal_joints", "--speed", "0 rpm"), "--speed: must not be 0"),
        (("ideal_joints", "--speed", "240 Hz"), "write rpm"),
        (("ideal_joints", *[f"--speed={n} rpm" for n in range(1, 8)]), "give at most 6"),
        (("nothing.yaml", *SLOW), "no file 'nothing.yaml'"),
        (("campaign.yaml", *SLOW), "is a configuration or campaign file; give the mechanism file"),
    ],
)
def test_a_look_needs_a_speed_and_a_mechanism(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "campaign.yaml").write_text("{name: rig, mechanism: erkaya2009}")
    assert words in refusal("look", *arguments)
    assert not list(tmp_path.glob("*.html"))
