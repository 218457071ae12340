"""Models of the user by one command: what is hidden in the data is named, with its size."""

import json

import pytest

from jointgap.axis.analyse import ModelState, analyse_model, preflight_model
from tests.axis.folders import GEAR, PENDULUM, PENDULUM_FILE, gear, pendulum, piston


def interval(verdict, name, parameter):
    (effect,) = [effect for effect in verdict["effects"] if effect["name"] == name]
    return effect["parameters"][parameter]["interval_99"]


def within(value, interval):
    return interval[0] <= value <= interval[1]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of a pendulum with friction, a delay and a wrong gain of its encoder."""
    folder = tmp_path_factory.mktemp("pendulum")
    model = pendulum(folder / "model", friction=0.15, delay=5e-3, gain=0.04)
    analyse_model(model, folder / "results/models/pendulum")
    return folder / "results/models/pendulum"


def test_friction_delay_and_gain_of_a_simulated_motion_are_named_with_their_sizes(results):
    verdict = json.loads((results / "verdict.json").read_text(encoding="utf-8"))
    assert verdict["verdict"] == "named"
    names = {effect["name"] for effect in verdict["effects"]}
    assert names == {"coulomb_friction", "sensor_delay", "sensor_gain"}
    assert within(0.15, interval(verdict, "coulomb_friction", "torque_N_m"))
    assert within(5e-3, interval(verdict, "sensor_delay", "delay_s"))
    assert within(0.04, interval(verdict, "sensor_gain", "gain_error"))
    assert verdict["gap"]["confirm"]["after"] < 1.3 < 10.0 < verdict["gap"]["confirm"]["before"]


def test_page_and_figures_are_written_in_units_of_a_body_that_turns(results):
    page = (results / "summary.md").read_text(encoding="utf-8")
    assert "Coulomb friction" in page and "N m" in page and "kg m²" in page
    assert "friction torque" in page and "slider" not in page
    assert "crank" not in page.lower().replace("crank or of the motion", "")
    figures = {path.stem for path in (results / "figures").glob("*.png")}
    assert figures >= {"measured_against_model", "ranking", "gaps"}


def test_the_class_and_file_of_the_pendulum_have_40_lines():
    """Friction, delay and gain are candidates without a line of code of their own."""
    code = [line for line in (PENDULUM + PENDULUM_FILE).splitlines() if line.strip()]
    assert len(code) <= 40


def test_a_pendulum_without_friction_lacks_nothing(tmp_path):
    verdict = analyse_model(pendulum(tmp_path / "m", friction=0.0), tmp_path / "r", pictures=False)
    assert verdict["verdict"] in ("no_disagreement", "parameters_only")


def test_dry_friction_that_grows_with_pressure_is_named_over_a_given_motion(tmp_path):
    verdict = analyse_model(piston(tmp_path / "model"), tmp_path / "results", pictures=False)
    names = {effect["name"] for effect in verdict["effects"]}
    assert names == {"coulomb_friction", "load_friction"}, verdict["because"]
    assert within(3.1, interval(verdict, "coulomb_friction", "force_N"))
    assert within(0.04, interval(verdict, "load_friction", "coefficient"))


def test_a_play_of_a_gear_is_named(tmp_path):
    verdict = analyse_model(gear(tmp_path / "model"), tmp_path / "results", pictures=False)
    (effect,) = verdict["effects"]
    assert effect["name"] == "backlash"
    play = effect["parameters"]["play_rad"]["value"]
    assert play == pytest.approx(2.0 * 3.14159 / 180.0 * 11.2, rel=0.02)


def test_preflight_says_what_the_data_can_show(tmp_path):
    text = preflight_model(gear(tmp_path / "model"))
    assert "a backlash" in text


def test_results_of_another_model_are_not_replaced(results, tmp_path):
    from jointgap.core.errors import InputError

    with pytest.raises(InputError, match="another"):
        analyse_model(gear(tmp_path / "gear"), results)


def test_effects_of_the_class_are_candidates(tmp_path):
    model = ModelState(piston(tmp_path / "model")).model
    assert "squeeze" in {candidate.label for candidate in model.candidates}
    assert [p.key for p in model.nuisances] == ["area", "zero@low", "zero@high", "zero@check"]


def test_a_gear_lacks_no_force(tmp_path):
    """Forces do not act where no drive is measured."""
    model = ModelState(gear(tmp_path / "model")).model
    assert "coulomb_friction" not in {candidate.label for candidate in model.candidates}
    assert GEAR.count("def ") == 1
