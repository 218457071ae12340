"""Warnings about implausible data and effective restitutions."""

import json
import math

import pytest
from click.testing import CliRunner

from benchmarks.project import ROOT
from jointgap.app.cli import cli
from jointgap.config import load_mechanism
from jointgap.config.yaml_files import plain_speeds
from jointgap.core.errors import InputError
from jointgap.motion.mechanism_warnings import odd_data, odd_speed, remarks, sentences
from tests.config.mechanisms import mechanism, paper

PENALTY = {"law": "penalty", "restitution": None, "penalty_depth": "1 um"}
CLOSE = {name: {"bearing_radius": "7.1 mm"} for name in ("crank_pin", "piston_pin")}
IDEAL = {"crank_pin": {"loose": False}, "piston_pin": "ideal"}


def with_contact(**keys):
    """The paper's mechanism with usual clearances."""
    return mechanism(contacts={"steel": keys}, joints=CLOSE)


def test_large_clearances_and_very_different_masses_get_a_warning():
    assert [remark.split(":")[0] for remark in odd_data(paper())] == ["crank_pin", "piston_pin"]
    assert "1 mm, is 14.3 % of journal_radius, 7 mm" in odd_data(paper())[0]
    assert odd_data(mechanism(joints=CLOSE)) == odd_data(mechanism(joints=IDEAL)) == []
    (remark,) = odd_data(mechanism(slider={"mass": 190}, joints=CLOSE))
    assert remark.startswith("slider.mass: 190 kg") and "513 times crank.mass, 0.3704 kg" in remark
    assert "`slider.mass`: 190 kg" in sentences(mechanism(slider={"mass": 190}))[0]


def test_masses_and_inertias_that_do_not_fit_the_size_get_a_warning():
    tight = {"joints": CLOSE}
    (remark,) = odd_data(mechanism(slider={"mass": 2400}, **tight))  # grams, without the unit
    assert remark.startswith("slider.mass: 2400 kg is implausible with rod.length 0.564 m")
    assert (
        odd_data(mechanism(crank={"mass": "20 kg"}, rod={"mass": "2 kg"}, **tight)) == []
    )  # a flywheel
    grams = {
        body: {"mass": f"{mass} g"}
        for body, mass in (("crank", 0.37), ("rod", 0.77), ("slider", 0.45))
    }
    for body in ("crank", "rod"):
        grams[body]["inertia"] = 1e-6
    light = odd_data(mechanism(**grams, **tight))
    assert [remark.split(":")[0] for remark in light] == ["crank.mass", "rod.mass", "slider.mass"]
    (remark,) = odd_data(mechanism(rod={"inertia": "0.02 kg*mm^2"}, **tight))
    assert (
        remark.startswith("rod.inertia: 2e-08 kg*m^2") and "a uniform rod has 0.02 kg*m^2" in remark
    )


def test_a_plain_number_that_probably_means_rpm_gets_a_warning():
    compressor = load_mechanism("compressor")
    assert odd_speed(compressor, 1450 * math.pi / 30) == []
    assert (
        "1450 rpm" in odd_speed(compressor, -1450)[0]
        and "13846 rpm" in odd_speed(compressor, 1450)[0]
    )
    assert sentences(compressor, 1450)[0].startswith("`speed`: ")


def test_a_speed_without_a_unit_gets_a_warning_except_in_json(tmp_path):
    mine, motor = tmp_path / "mine.yaml", "motor: {no_load_speed: 30, stall_torque: 5 N*m}\n"
    mine.write_text(
        "runs: [{id: a, speed: 200 rpm}, {id: b, speed: 240}]\n" + motor, encoding="utf-8"
    )
    run, no_load = plain_speeds(mine)
    assert "runs.b.speed = 240 " in run and "2291.8 rpm" in run and "'240 rpm'" in run
    assert "motor.no_load_speed = 30 " in no_load
    written = tmp_path / "options.json"  # by a program
    written.write_text('{"simulate": {"speed": 240.0}}', encoding="utf-8")
    assert plain_speeds(written) == []
    mine.write_text(
        "mechanism: erkaya2009\nscenarios: {one: {simulate: {speed: '240'}}}\n", encoding="utf-8"
    )
    done = CliRunner().invoke(cli, ["config", str(mine)])
    assert (
        done.exit_code == 0
        and "scenarios.one.simulate.speed = 240" in done.stderr
        and json.loads(done.stdout)
    )
    own = [
        path for place in ("config", "examples", "docs") for path in (ROOT / place).rglob("*.yaml")
    ]
    assert own and [remark for path in own for remark in plain_speeds(path)] == []


@pytest.mark.parametrize(
    ("link", "most"), [("crank", 0.3704 * (20 * 0.15) ** 2), ("rod", 0.773 * 1.128**2)]
)
def test_an_inertia_too_large_for_mass_and_length_is_an_error(link, most):
    assert mechanism(**{link: {"inertia": 0.999 * most}})
    with pytest.raises(
        InputError, match=rf"mine\.yaml: {link}.inertia .* give at most {most:.3g} kg\*m\^2"
    ):
        mechanism(**{link: {"inertia": 1.001 * most}})


def test_an_effective_restitution_that_differs_gets_a_warning_for_each_loose_joint():
    for law, restitution, delivered in (("hunt_crossley", 0.5, "0.663"), ("flores", 0.3, "0.256")):
        found = remarks(with_contact(law=law, restitution=restitution))
        assert [remark.split(":")[0] for remark in found] == ["crank_pin", "piston_pin"]
        for remark in found:
            assert (
                f"a restitution of {restitution:g}; {law} effectively gives {delivered}" in remark
            )
    assert remarks(with_contact(law="exact_restitution")) == []
    assert remarks(with_contact(law="carvalho_martins", restitution=0.7)) == []


def test_the_penalty_law_states_its_effective_restitution():
    elastic = remarks(with_contact(penalty_damping=0, **PENALTY))[0]
    assert "depends on mass and speed: approximately 1 at 0.1 m/s and 1 at 1 m/s" in elastic
    damped = remarks(with_contact(penalty_damping=2000, **PENALTY))[0]
    numbers = [float(word) for word in damped.split() if word[:2] == "0."]
    assert (
        all(0 < number < 1 for number in numbers) and len(numbers) == 3
    )  # two restitutions and a speed


def test_bristles_that_can_drive_the_motion_get_a_warning():
    lugre = {"law": "exact_restitution", "friction_law": "lugre", "friction": 0.1}
    assert remarks(with_contact(**lugre)) == []
    found = remarks(with_contact(static_friction=0.15, viscous_friction=0.01, **lugre))
    most = 0.01 * 0.1 / (0.15 - 0.1)  # sigma_1 (mu_s - mu) = sigma_2 mu
    assert math.isclose(most, 0.02)
    assert "a bristle_damping of at most 0.02 s/m" in found[0]
    assert (
        remarks(
            with_contact(
                static_friction=0.15, viscous_friction=0.01, bristle_damping=0.019, **lugre
            )
        )
        == []
    )
