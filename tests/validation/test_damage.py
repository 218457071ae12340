"""Data faults change the recorded channels only."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.rig.read_files import read_measurements
from validation.data_faults import DATA_FAULTS
from validation.kinds import Trial
from validation.trial import make_trial


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory):
    """Record and campaign file of one trial with each data fault, and without."""
    found = {}
    for damage in ("", *DATA_FAULTS):
        folder = tmp_path_factory.mktemp(damage or "intact")
        truth = make_trial(
            replace(Trial("wiring", "ideal", id="0123456789ab", number=4), damage=damage), 5, folder
        )
        found[damage] = truth.get("damage"), folder / "campaign.yaml"
    return found


def lengths(path) -> dict[str, float]:
    """Duration of each run of a campaign, in the unit of its file."""
    found = {}
    for run in yaml.safe_load(path.read_text())["runs"]:
        file = path.parent / run["file"]
        if file.suffix == ".parquet":
            time = pd.read_parquet(file)["t"]
        else:
            mark = next(mark for mark in ";\t," if mark in file.read_text().splitlines()[0])
            time = pd.read_csv(file, sep=mark, decimal="," if mark == ";" else ".")["t"]
        found[run["id"]] = time.max() - time.min()
    return found


@pytest.mark.parametrize("damage", ["swapped", "sign", "unit", "gain", "other_run", "clipped"])
def test_only_the_recorded_channels_are_damaged(campaigns, damage):
    (_, intact), (done, path) = campaigns[""], campaigns[damage]
    assert done["what"] == damage
    first, after = read_measurements(load_campaign(intact)), load_campaign(path)
    try:
        second = read_measurements(after)
    except InputError as refused:
        assert any(
            f"column {after.channels[name].column}:" in str(refused) for name in done["channels"]
        )
        return
    for run, recording in first.runs.items():
        for name, values in recording.channels.items():
            same = np.allclose(values, second.runs[run].channels[name], rtol=1e-6, equal_nan=True)
            elsewhere = done.get("run", run) != run
            assert same == (name not in done["channels"] or elsewhere), (run, name)


@pytest.mark.parametrize("damage", ["time_stretched", "wrong_speed"])
def test_the_recorded_factor_stretches_times_or_speed(campaigns, damage):
    (_, intact), (done, path) = campaigns[""], campaigns[damage]
    before, after = (load_campaign(each) for each in (intact, path))
    sound_speeds = {run.id: run.speed for run in before.runs}
    speeds = {run.id: run.speed / sound_speeds[run.id] for run in after.runs}
    own, other = lengths(path), lengths(intact)
    wrong = {done["run"]: pytest.approx(done["factor"], rel=0.01)}
    expected = dict.fromkeys(own, pytest.approx(1.0))
    ratios = {run: own[run] / other[run] for run in own}
    assert ratios == (expected | wrong if damage == "time_stretched" else expected)
    assert speeds == (expected if damage == "time_stretched" else expected | wrong)
    try:
        reported = {(one.run, one.channel) for one in read_measurements(after).contradictions}
    except InputError as refused:
        assert done["run"] in str(refused) and "column t " in str(refused)
    else:
        assert (done["run"], "time") in reported


def test_the_recorded_angle_shifts_the_encoder_zero(campaigns):
    done, path = campaigns["zero_off"]
    found = read_measurements(load_campaign(path)).contradictions
    assert {(one.run, one.channel, one.kind) for one in found} == {
        (run, "crank_angle", "phase") for run in lengths(path)
    }
    assert [np.degrees(one.phase) for one in found] == pytest.approx(
        [done["degrees"]] * len(found), abs=2.0
    )
