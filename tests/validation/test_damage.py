"""Damaged campaigns hold what the truth says, and other sets are as they were."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.rig.read_files import read_measurements
from validation.campaign import DAMAGES, damage_campaign
from validation.hide import make_trial
from validation.plan import TrialPlan, plan_trials, read_sets

SETS = read_sets(Path(__file__).parents[2] / "config/blind.yaml")


def test_every_damage_is_drawn_about_as_often_and_other_sets_do_not_change():
    plans = plan_trials(SETS["wiring"])
    counts = [sum(plan.damage == damage for plan in plans) for damage in DAMAGES]
    assert (len(plans), min(counts), max(counts)) == (100, 11, 12)
    assert {plan.base for plan in plans} == {"ideal", "loose", "chaotic"}
    alone = SETS["development"]
    more = alone.model_copy(update={"wiring": 5})
    assert [plan for plan in plan_trials(alone) if plan.damage] == []
    drawn = {(plan.kind, plan.base, plan.size, plan.effects) for plan in plan_trials(alone)}
    assert {(p.kind, p.base, p.size, p.effects) for p in plan_trials(more) if not p.damage} == drawn


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Ground truth and campaign file of a trial with an encoder and sound data."""
    folder = tmp_path_factory.mktemp("sound")
    plan = TrialPlan("0123456789ab", 3, "nothing", "ideal", 0.0, ())
    return make_trial(plan, 5, folder), folder / "campaign.yaml"


@pytest.fixture
def damaged(sound, tmp_path):
    """The sound campaign, damaged: from a damage to what the truth says of it, and the campaign file."""

    def made(damage):
        shutil.copytree(sound[1].parent, tmp_path / "campaign")
        return damage_campaign(
            np.random.default_rng(7), damage, tmp_path / "campaign"
        ), tmp_path / "campaign/campaign.yaml"

    return made


@pytest.mark.parametrize("damage", ["swapped", "sign", "unit", "gain", "other_run", "clipped"])
def test_only_what_the_truth_says_is_damaged(sound, damaged, damage):
    done, path = damaged(damage)
    channels = set(done["channels"])
    before, after = (load_campaign(each) for each in (sound[1], path))
    first, second = (read_measurements(each) for each in (before, after))
    for run, recording in first.runs.items():
        for name, values in recording.channels.items():
            same = np.allclose(values, second.runs[run].channels[name], rtol=1e-6, equal_nan=True)
            elsewhere = done.get("run", run) != run
            assert same == (name not in channels or elsewhere), (run, name)


@pytest.mark.parametrize("damage", ["time_stretched", "wrong_speed"])
def test_times_or_the_speed_of_one_run_are_wrong_by_the_factor_of_the_truth(sound, damaged, damage):
    done, path = damaged(damage)
    before, after = (load_campaign(each) for each in (sound[1], path))
    ratios = [b.speed / a.speed for a, b in zip(before.runs, after.runs, strict=True)]
    if damage == "wrong_speed":
        assert max(ratios, key=lambda ratio: abs(np.log(ratio))) == pytest.approx(done["factor"], rel=0.01)
    else:
        assert ratios == [1.0, 1.0, 1.0]
        stretched = {run: slope(columns(sound[1])[run]["t"], own["t"]) for run, own in columns(path).items()}
        expected = dict.fromkeys(stretched, 1.0) | {done["run"]: done["factor"]}
        assert stretched == pytest.approx(expected, rel=1e-6)
    try:
        told = {(one.run, one.channel) for one in read_measurements(after).contradictions}
    except InputError as refused:
        assert f"{done['run']}.csv, " in str(refused)
        assert "column t " in str(refused)
    else:
        assert (done["run"], "time") in told


def columns(path):
    """The columns of all files of a campaign, by run."""
    runs = yaml.safe_load(path.read_text())["runs"]
    return {run["id"]: pd.read_csv(path.parent / run["file"]) for run in runs}


def slope(first, second):
    """By what `second` rises where `first` rises by one."""
    return float(np.polyfit(first - first[0], second - second[0], 1)[0])


def test_the_zero_of_the_encoder_is_off_by_what_the_truth_says(sound, damaged):
    done, path = damaged("zero_off")
    assert sound[0]["encoder"]
    column = yaml.safe_load(path.read_text())["channels"]["crank_angle"]["column"]
    degrees = done["degrees"]
    for run, own in columns(path).items():
        assert (own[column] - columns(sound[1])[run][column]).to_numpy() == pytest.approx(degrees, abs=1e-5)
    found = read_measurements(load_campaign(path)).contradictions
    assert {(one.run, one.channel, one.kind) for one in found} == {
        (run, "crank_angle", "phase") for run in columns(path)
    }
    assert [np.degrees(one.phase) for one in found] == pytest.approx([degrees] * len(found), abs=2.0)
