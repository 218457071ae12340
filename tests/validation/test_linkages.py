"""Rigs of linkages: they turn fully, hide what the ground truth says, and Exudyn simulates them."""

import json
import math
from collections import Counter

import numpy as np
import pytest
import yaml

from jointgap.config.load import load_campaign, load_mechanism
from jointgap.motion.of_file import check_linkage, model_of
from jointgap.rig.drives import options_of
from jointgap.rig.read_files import read_measurements
from jointgap.rig.sensors import FAULTS
from jointgap.rig.simulate_run import channels_at
from validation.kinds import Trial, plan_trials, read_set
from validation.linkages import draw_linkage, draw_loose, exudyn_models, names_to_hide, turns_fully
from validation.rig import LINKAGES, RECIPE, candidates, draw_effect, exudyn_linkage, with_effects
from validation.score import score_trial
from validation.trial import Calibrator, effect_record, make_trial, parameters_beyond_nominal

SPEED = 20.0
NOTHING = {name: Trial("nothing", "ideal", mechanism=name) for name in LINKAGES}


def test_the_set_has_its_counts():
    found = plan_trials(read_set("config/blind.yaml", "linkages"))
    assert found == plan_trials(read_set("config/blind.yaml", "linkages"))
    counts = {"single": 20, "nothing": 10, "clearance": 15, "pair": 5, "off_list": 10}
    assert Counter(trial.kind for trial in found) == counts
    assert Counter(trial.mechanism for trial in found).keys() == LINKAGES.keys()
    assert 0.4 < np.mean([trial.peer for trial in found]) < 0.6
    for trial in found:
        group = {"clearance": "clearances", "single": "listed", "pair": "listed"}
        names = names_to_hide(trial.mechanism, group.get(trial.kind, trial.kind))
        assert {*trial.effects} <= {*names}
        assert not trial.peer or exudyn_models(trial.mechanism, trial.base, trial.effects)


@pytest.mark.parametrize("name", LINKAGES)
def test_drawn_rigs_turn_fully_and_are_like_the_shipped_one(name):
    for seed in range(3):
        rig = draw_linkage(np.random.default_rng(seed), NOTHING[name])
        again = draw_linkage(np.random.default_rng(seed), NOTHING[name])
        assert (rig.content, rig.bounds, rig.values) == (again.content, again.bounds, again.values)
        check_linkage(rig.nominal, "rig")
        assert turns_fully(rig.nominal)
        assert rig.is_linkage and not rig.nominal.loose
        shipped = LINKAGES[name]
        for body, data in rig.nominal.bodies.items():
            assert 0.79 < data.mass / shipped.bodies[body].mass < 1.21
        for key, value in rig.values.items():
            assert rig.bounds[key][0] < value < rig.bounds[key][1]
        assert len(rig.runs) in (2, 3)
        assert "crank_torque" in rig.sensors
        assert 3 <= len(rig.sensors) <= 4
        assert all(run.nominal_speed <= 400 * math.tau / 60 + 1e-9 for run in rig.runs.values())


@pytest.mark.parametrize("name", LINKAGES)
def test_every_effect_of_an_ideal_linkage_can_be_hidden(name):
    rig = draw_linkage(np.random.default_rng(3), NOTHING[name])
    known = candidates(rig.nominal, rig.fastest, rig.nuisances)
    assert {*names_to_hide(name, "listed")} <= {*known, *FAULTS}
    assert {*names_to_hide(name, "clearances")} <= {*known}
    low, high = map(float, RECIPE["linkages"]["clearance"])
    clearance = draw_effect("B_clearance", rig, {}, np.random.default_rng(1))
    ends = (clearance.parameters(size) for size in (clearance.lowest, clearance.most))
    assert [end["clearance_m"] for end in ends] == pytest.approx([low, high])
    for label in RECIPE["linkages"]["laws"]:
        law = draw_effect(label, rig, {}, np.random.default_rng(1))
        augmented = with_effects(rig.true, [(law, law.first)])
        assert [effect.name for effect in augmented.effects] == [law.formula_effect]
        force = effect_record(rig, law, law.first)["force"]
        assert force["kind"] == law.formula_effect
        assert np.isfinite(force["value"]).all() and np.std(force["value"]) > 0.0


@pytest.mark.parametrize(
    ("name", "effects", "peer"),
    [
        ("quick_return", ("ram_spring",), False),
        ("four_bar", ("cubic_drag",), True),
    ],
)
def test_a_campaign_contains_the_effect_and_agrees_with_the_ground_truth(
    tmp_path, name, effects, peer
):
    if peer:
        pytest.importorskip("exudyn", reason="needs Exudyn: scripts/set-up peers")
    kind = "off_list" if effects == ("cubic_drag",) else "single"
    keys = {"number": 4, "id": "0123456789ab", "mechanism": name, "peer": peer}
    trial = Trial(kind, "ideal", 3.0, effects, **keys)
    folder = tmp_path / trial.id
    truth = make_trial(trial, 5, folder)
    json.dumps(truth, allow_nan=False)
    assert truth["mechanism"] == name
    assert [effect["name"] for effect in truth["effects"]] == list(effects)
    assert truth["gaps"] == pytest.approx([3.0], rel=0.2)
    assert truth["numerics_gap"] < 1.1
    assert yaml.safe_load((folder / "mechanism.yaml").read_text())["effects"] == []
    campaign = load_campaign(folder / "campaign.yaml")
    assert campaign.mechanism.sites == LINKAGES[name].sites
    assert set(read_measurements(campaign).runs) == {run.id for run in campaign.runs}
    if kind == "off_list":  # a verdict with its formula is right
        force = truth["effects"][0]["force"]
        assert force["kind"] == "discovered_rocker_torque"
        v = np.array(force["states"]["velocity"])
        assert np.corrcoef(force["value"], -(v**3))[0, 1] > 0.999999


def test_an_added_mass_counts_from_the_file():
    rig = draw_linkage(np.random.default_rng(3), NOTHING["six_bar"])
    heavier = draw_effect("added_link_mass", rig, {}, np.random.default_rng(1))
    found = parameters_beyond_nominal(rig, heavier, 40.0)["mass_kg"]
    deviation = rig.true.bodies["link"].mass - rig.nominal.bodies["link"].mass
    assert found == pytest.approx(heavier.parameters(40.0)["mass_kg"] + deviation)


def test_a_hidden_clearance_is_scored_by_its_joint():
    effect = {
        "name": "B_clearance",
        "site": "B",
        "listed": True,
        "parameters": {"clearance_m": 1e-4},
    }
    truth = {"id": "a", "kind": "clearance", "base": "ideal", "mechanism": "six_bar"}
    truth |= {"drive": "constant_speed", "gaps": [5.0], "size": 0.0, "numerics_gap": None}
    row = score_trial(truth | {"effects": [effect]}, {"error": "unfinished", "seconds": 1.0})
    assert (row["hidden"], row["mechanism"]) == ("B_clearance", "six_bar")
    assert row["outcome"] == "unfinished"


def peer_and_own(name, times, loose=(), **keys):
    """Readings by Exudyn and by the package, at times after the crank angle 1 rad."""
    pytest.importorskip("exudyn", reason="needs Exudyn: scripts/set-up peers")
    data = load_mechanism(name).model_dump()
    for joint, entry in data["joints"].items():
        if "slide" not in entry:
            entry["loose"] = joint in loose
            entry["contact"] |= {"memory": "published", "friction": 0.0}
    file = type(load_mechanism(name)).model_validate(data)
    peer = exudyn_linkage(file, SPEED, 1.0, **keys).readings(times)
    model = model_of(file, options_of(SPEED, 1.0, 1e-12))
    own = channels_at(model, 1.0 + SPEED * times, 1e-12)
    differences = {}
    for channel, values in peer.items():
        difference = values - own[channel]
        if channel.endswith("_angle"):
            difference = (difference + math.pi) % math.tau - math.pi
        differences[channel] = np.abs(difference).max() / np.std(own[channel])
    return differences


@pytest.mark.parametrize("name", LINKAGES)
def test_exudyn_agrees_with_ideal_joints(name):
    """Positions to rounding; accelerations and torque to the second order of the steps."""
    times = np.linspace(0.5, 0.6, 5) * math.tau / SPEED
    differences = peer_and_own(name, times, steps=8000)
    for channel, difference in differences.items():
        assert difference < (1e-10 if channel.endswith(("_angle", "_position")) else 2e-5), channel


@pytest.mark.parametrize("joint", ["A", "B", "C"])
def test_exudyn_agrees_on_the_first_contacts_of_a_loose_joint(joint):
    """Accelerations differ more, as the phase of an impact does."""
    times = np.linspace(0.002, 0.04, 4) * math.tau / SPEED
    for channel, difference in peer_and_own("four_bar", times, (joint,)).items():
        assert difference < (1e-6 if channel.endswith("_angle") else 2e-3), channel


@pytest.mark.slow
def test_the_gap_of_a_hidden_clearance_is_shown(tmp_path):
    keys = {"number": 2, "id": "0123456789ab", "mechanism": "four_bar", "shown": (1.5, 20.0)}
    truth = make_trial(Trial("clearance", "ideal", 0.0, ("B_clearance",), **keys), 5, tmp_path)
    assert 1.5 <= truth["gaps"][0] <= 20.0
    assert 5e-5 <= truth["effects"][0]["parameters"]["clearance_m"] <= 3e-4


def test_nothing_hidden_has_no_gap():
    rig = draw_linkage(np.random.default_rng(3), NOTHING["four_bar"])
    assert Calibrator(rig).gap([]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("effects", "expected"),
    [((), "ABC"), (("B_clearance",), "AC"), (("pin_friction:A",), "BC"), (("cubic_drag",), "AB")],
)
def test_a_joint_with_a_hidden_effect_is_ideal_in_the_model(effects, expected):
    trial = Trial("single", "loose", 3.0, effects, mechanism="four_bar", peer=True)
    drawn = [draw_loose(np.random.default_rng(seed), "ABC", trial) for seed in range(20)]
    assert {name for names in drawn for name in names} == {*expected}
    assert {len(names) for names in drawn} == {1, 2}
