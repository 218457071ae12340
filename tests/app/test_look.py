"""One look at a mechanism: motion and forces at a few speeds on one page."""

import math
import re

import pytest

from jointgap.config import load_mechanism
from tests.app.test_cli import refusal
from tests.catalogue import refused
from tests.command import jointgap

PEAK = r"<td class='s'>{}</td><td class='s'>[^<]*</td>" + r"<td class='n'>([^<]*)</td>" * 4


def peaks(page: str, quantity: str) -> list[float]:
    """Peak and angle [deg] at each of two speeds."""
    return [float(cell) for cell in re.search(PEAK.format(quantity), page).groups()]


def test_a_look_writes_one_page_with_the_peaks_of_motion_and_forces_at_each_speed(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    done = jointgap("look", "ideal_joints", "--speed", "240 rpm", "--speed", "-480 rpm")
    assert (done.returncode, done.stdout, done.stderr) == (0, "look_ideal_joints.html\n", "")
    assert [path.name for path in tmp_path.iterdir()] == ["look_ideal_joints.html"]
    page = (tmp_path / "look_ideal_joints.html").read_text(encoding="utf-8")
    assert not re.search(r"(?:src|href)='(?!data:|#)", page) and page.count("<img") == 11

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


def test_a_look_without_a_speed_or_a_mechanism_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "campaign.yaml").write_text("{name: rig, mechanism: erkaya2009}")
    (tmp_path / "broken.yaml").write_text("a: [")
    slow = ("--speed", "240 rpm")

    def look(*words):
        raise ValueError(refusal("look", *words))

    cases = [
        ("ideal_joints", "--speed is missing; give one"),
        ("ideal_joints", "--speed", "0 rpm", "--speed '0 rpm': must not be 0"),
        ("ideal_joints", "--speed", "240 Hz", "--speed '240 Hz' ~ write rpm"),
        (
            "ideal_joints",
            *[word for n in range(1, 8) for word in ("--speed", f"{n} rpm")],
            "give at most 6",
        ),
        ("nothing.yaml", *slow, "no file 'nothing.yaml'"),
        ("broken.yaml", *slow, "broken.yaml, line 1 ~ is not YAML"),
        (
            "campaign.yaml",
            *slow,
            "campaign.yaml: is a configuration or campaign file; give the mechanism file",
        ),
    ]
    refused(look, cases, error=ValueError)
    assert not list(tmp_path.glob("*.html"))
