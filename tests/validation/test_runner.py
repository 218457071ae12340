"""Trials drawn and analysed in processes with a limit of processor time."""

import json
import time
from pathlib import Path

import pytest

from jointgap.core.errors import InputError
from validation import runner
from validation.__main__ import run
from validation.kinds import Trial, chosen_trials, read_set
from validation.runner import in_process, run_trials
from validation.score import UNFINISHED, score_trials

PLANS = [Trial("nothing", "ideal", number=number, id=f"00000000000{number}") for number in range(4)]


def endless():
    while True:
        pass


def test_an_analysis_ends_at_its_limit_of_processor_time():
    begin = time.perf_counter()
    assert in_process(endless, 0.2) == (None, UNFINISHED)
    assert time.perf_counter() - begin < 20.0
    # waiting costs no processor time
    assert in_process(lambda: time.sleep(0.5) or "rested", 0.2) == ("rested", "")

    def broken():
        raise SystemExit(1)

    assert in_process(broken, 60.0) == (None, "the process ended early")


def test_trials_are_chosen_by_part_or_number():
    assert [plan.number for plan in chosen_trials(PLANS, "even")] == [0, 2]
    assert [plan.number for plan in chosen_trials(PLANS, "odd")] == [1, 3]
    assert chosen_trials(PLANS, "all") == PLANS
    assert [plan.number for plan in chosen_trials(PLANS, f"3,{PLANS[0].id}")] == [3, 0]
    parts = [chosen_trials(PLANS, f"{part}/3") for part in (1, 2, 3)]
    assert [[plan.number for plan in part] for part in parts] == [[0, 3], [1], [2]]
    for choice, name in (("1,7", "7"), ("4/3", "4/3"), ("0/3", "0/3")):
        with pytest.raises(InputError, match=rf"'{name}' is no trial; .*numbers from 0 to 3"):
            chosen_trials(PLANS, choice)


def test_a_set_without_a_seed_asks_for_one(tmp_path):
    sets = tmp_path / "sets.yaml"
    sets.write_text("sets: {sealed: {nothing: 3}, known: {seed: 7, nothing: 3}}\n")
    with pytest.raises(InputError, match=r"sealed has no seed; .*--seed 0x1a2b3c4d"):
        read_set(sets, "sealed")
    assert read_set(sets, "sealed", 5).seed == 5
    assert read_set(sets, "known").seed == read_set(sets, "known", 7).seed == 7
    with pytest.raises(InputError, match=r"known\.seed is 7; remove --seed 5"):
        read_set(sets, "known", 5)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--seconds=0", "--seconds: is 0; give CPU-seconds above 0"),
        ("--cores=0", "--cores: is 0; give a whole number from 1"),
        ("--trials=9", "trials: '9' is no trial"),
    ],
)
def test_options_of_a_run_are_checked(tmp_path, option, message):
    with pytest.raises(InputError, match=message):
        run("config/blind.yaml", "small", str(tmp_path), option)
    assert not any(tmp_path.iterdir())


@pytest.fixture
def instant_draws(monkeypatch):
    """Trials are drawn at once; the last one of `PLANS` cannot be drawn."""

    def make(plan, seed, folder):
        if plan == PLANS[3]:
            raise RuntimeError("no rig")
        folder.mkdir()
        (folder / "campaign.yaml").write_text(f"{seed}")
        truth = {"id": plan.id, "kind": plan.kind, "base": plan.base, "drive": "constant_speed"}
        return truth | {"size": 0.0, "gaps": [], "effects": [], "numerics_gap": None, "where": None}

    monkeypatch.setattr(runner, "make_trial", make)


def analysed(campaign: Path) -> dict:
    """Nothing is named; the second trial is never finished."""
    assert not (campaign.parent / "truth").exists()
    if campaign.name == PLANS[1].id:
        endless()
    assert campaign.name != PLANS[2].id, "fails"
    verdict = {"verdict": "no_disagreement", "because": "", "effects": [], "certain": []}
    verdict |= {"preflight": {"undetectable": [], "merged": []}, "gap": {"confirm": None}}
    return {"id": campaign.name, "seconds": 1.5, "verdict": verdict}


@pytest.mark.parametrize("cores", [1, 2])
def test_every_drawn_trial_has_a_row(tmp_path, instant_draws, cores):
    run_trials(PLANS, 11, tmp_path, 0.3, cores=cores, analyse=analysed)
    table = score_trials(tmp_path).set_index("id")
    outcomes = [table["outcome"].get(plan.id) for plan in PLANS]
    assert outcomes == ["right", UNFINISHED, "failed", None]
    assert table["seconds"].tolist() == pytest.approx([1.5, 0.3, 0.0], abs=0.15)
    assert table["code"].nunique() == 1
    assert (tmp_path / "campaigns" / PLANS[0].id / "campaign.yaml").read_text() == "11"
    assert not [*tmp_path.glob("*/.*")]


def test_a_run_resumes_and_ends_at_its_budget(tmp_path, instant_draws):
    def verdicts():
        return sorted(path.stem for path in (tmp_path / "verdicts").glob("*.json"))

    run_trials(PLANS, 11, tmp_path, 0.3, budget=1e-6, analyse=analysed)
    assert verdicts() == [PLANS[0].id]
    first = tmp_path / "verdicts" / f"{PLANS[0].id}.json"
    first.write_text("{}")
    (tmp_path / "truth" / f"{PLANS[1].id}.json").write_text("{}")  # a campaign is missing
    run_trials(PLANS[:3], 11, tmp_path, 0.3, analyse=analysed)
    assert verdicts() == [plan.id for plan in PLANS[:3]]
    assert first.read_text() == "{}"
    truth = json.loads((tmp_path / "truth" / f"{PLANS[1].id}.json").read_text())
    assert truth["id"] == PLANS[1].id
