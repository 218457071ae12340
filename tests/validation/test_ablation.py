"""Variants of the identification, limits of processor time, and their table."""

import json
from dataclasses import asdict, fields, replace

import pandas as pd
import pytest

from jointgap.core.errors import InputError
from jointgap.identification.search import STEPS
from jointgap.identification.settings import DEFAULT_SETTINGS
from validation import ablation
from validation.ablation import (
    COMPLETE,
    KINDS,
    Variant,
    against_complete,
    all_variants,
    by_group,
    chosen_variants,
    group_of,
    scaled,
    watched,
    write_ablation,
)
from validation.kinds import Trial
from validation.score import UNFINISHED

PLANS = [Trial("nothing", "ideal", number=number, id=f"00000000000{number}") for number in range(4)]
SECONDS = {PLANS[0].id: 3.0, PLANS[1].id: 9.0, PLANS[2].id: 1.0, PLANS[3].id: 2.0}


def flat(settings, path="") -> dict:
    """Numbers by path."""
    if not isinstance(settings, dict):
        return {path: settings}
    return {
        place: value
        for key, inner in settings.items()
        for place, value in flat(inner, f"{path}.{key}".strip(".")).items()
    }


USUAL = flat(asdict(DEFAULT_SETTINGS))


def changes(variant) -> dict:
    """The changed numbers of a variant."""
    return {
        path: value
        for path, value in flat(asdict(variant.settings)).items()
        if USUAL[path] != value
    }


def test_a_variant_changes_one_setting_or_a_section():
    complete, *variants = all_variants()
    assert complete.name == COMPLETE and not changes(complete)
    singles = [variant for variant in variants if variant.kind == "settings"]
    for variant in singles:
        assert list(changes(variant)) == [variant.changed]
    assert {variant.changed for variant in singles} == USUAL.keys()
    steps = DEFAULT_SETTINGS.stopping.max_steps
    by_name = {variant.name: variant for variant in variants}
    assert changes(by_name["stopping.max_steps halved"]) == {"stopping.max_steps": steps // 2}
    assert changes(by_name["stopping.max_steps doubled"]) == {"stopping.max_steps": 2 * steps}
    section = {path for path in USUAL if path.startswith("stopping.")}
    assert changes(by_name["stopping doubled"]).keys() == section


def test_a_variant_leaves_out_one_step():
    variants = [variant for variant in all_variants() if variant.kind == "steps"]
    left_out = [[step for step in STEPS if step not in variant.steps] for variant in variants]
    assert left_out == [[step] for step in STEPS]
    assert [variant.name for variant in variants] == [f"without {step.name}" for step in STEPS]
    assert all(not changes(variant) for variant in variants)


def test_variants_are_chosen_by_kind_or_name():
    def names(choice):
        first, *others = [variant.name for variant in chosen_variants(choice)]
        assert first == COMPLETE
        return others

    assert names(COMPLETE) == []
    assert names("stopping halved") == ["stopping halved"]
    assert names("damping.f*") == [
        f"damping.{name} {word}" for name in ("factor", "first") for word in ("halved", "doubled")
    ]
    assert len(names("sections")) <= 2 * len(fields(DEFAULT_SETTINGS))
    assert len(names("*")) == sum(len(names(kind)) for kind in KINDS)
    with pytest.raises(InputError, match="'stoping' matches none; give complete, steps, sections"):
        chosen_variants("stoping")


def test_settings_in_use_are_recorded():
    read = set()
    settings = watched(DEFAULT_SETTINGS, read)
    assert settings.stopping.max_steps == DEFAULT_SETTINGS.stopping.max_steps
    assert read == {"stopping.max_steps"}
    assert asdict(settings) == asdict(DEFAULT_SETTINGS)
    assert replace(settings.damping, factor=3.0).factor == 3.0


@pytest.mark.parametrize(
    ("value", "halved", "doubled"),
    [
        (0.03, 0.015, 0.06),
        (0.5, 0.25, 1.0),
        (0.95, 0.975, 0.9),  # a share: its distance to 1
        (0.7, 0.85, 0.4),
        (1, 1, 2),
        (5, 2, 10),
        ((6, 1.0), (3, 0.5), (12, 2.0)),
    ],
)
def test_settings_are_halved_and_doubled(value, halved, doubled):
    assert scaled(value, 0.5) == pytest.approx(halved)
    assert scaled(value, 2.0) == pytest.approx(doubled)


def analysed(campaign, variant) -> dict:
    """A record: the complete identification is right, a variant names an effect in trial 0."""
    false_alarm = variant.name != COMPLETE and campaign.name == PLANS[0].id
    effect = {"name": "gravity", "site": "", "parameters": {"acceleration_m_s2": {"value": 1.0}}}
    verdict = {
        "verdict": "named" if false_alarm else "no_disagreement",
        "because": "",
        "effects": [effect] if false_alarm else [],
        "certain": [],
        "preflight": {"undetectable": [], "merged": []},
        "gap": {"confirm": {"before": 1.0, "after": 1.0}},
        "costs": {"total": {"runs": 10, "revolutions": 40.0 if false_alarm else 20.0}},
    }
    return {"id": campaign.name, "seconds": SECONDS[campaign.name], "verdict": verdict}


@pytest.fixture
def drawn(tmp_path):
    """A folder with the truth of `PLANS`."""
    (tmp_path / "truth").mkdir()
    for plan in PLANS:
        truth = {"id": plan.id, "kind": plan.kind, "base": plan.base, "drive": "constant_speed"}
        truth |= {"size": 0.0, "gaps": [], "effects": [], "numerics_gap": 1.0, "where": None}
        (tmp_path / "truth" / f"{plan.id}.json").write_text(json.dumps(truth))
    return tmp_path


VARIANTS = [Variant(COMPLETE), Variant("a halved"), Variant("a doubled")]


def ablate(folder, budget, analyse=analysed) -> pd.DataFrame:
    return ablation.ablate(PLANS, 1, folder, VARIANTS, 60.0, budget, analyse)


def test_variants_begin_with_the_cheapest_trial_and_end_at_the_budget(drawn, capsys):
    ablate(drawn, budget=18.0)
    lines = [line.split(": ")[:2] for line in capsys.readouterr().out.splitlines()]
    complete = [[COMPLETE, str(number)] for number in range(4)]
    others = [["a halved", "2"], ["a doubled", "2"], ["a halved", "3"]]  # 15 + 1 + 1 + 2 CPU-s
    assert lines == complete + others


def test_a_setting_that_is_not_read_is_not_tried(drawn, capsys):
    def analysed_with_stopping(campaign, variant):
        return analysed(campaign, variant) | {"settings_read": ["stopping.max_steps"]}

    names = "stopping doubled", "damping doubled", "stopping.max_steps doubled"
    variants = [variant for variant in all_variants() if variant.name in (COMPLETE, *names)]
    analyses = ablation.ablate(PLANS[:1], 1, drawn, variants, 60.0, 60.0, analysed_with_stopping)
    printed = capsys.readouterr().out
    assert "damping" not in printed and "stopping.max_steps doubled" in printed
    verdicts = analyses.set_index("variant")["verdict"]
    assert verdicts["damping doubled"] == verdicts[COMPLETE] == "no_disagreement"
    assert verdicts["stopping doubled"] == verdicts["stopping.max_steps doubled"] == "named"


@pytest.mark.integration
def test_a_drawn_trial_is_analysed_by_variants(tmp_path):
    trial = Trial("single", "ideal", 5.0, ("crank_coulomb_friction",), number=8, id="0123456789ab")
    names = ("windows doubled", "decision.min_delta_bic doubled")
    variants = [variant for variant in all_variants() if variant.name in (COMPLETE, *names)]
    analyses = ablation.ablate([trial], 11, tmp_path, variants).set_index("variant")
    assert analyses["outcome"].eq("right").all() and len(analyses) == 3
    assert analyses["revolutions"].gt(0.0).all() and analyses["seconds"].gt(0.0).all()
    # joints are ideal and one effect is sufficient, so windows are not simulated
    assert analyses["seconds"]["windows doubled"] == analyses["seconds"][COMPLETE]
    assert analyses["seconds"]["decision.min_delta_bic doubled"] != analyses["seconds"][COMPLETE]


def test_an_interrupted_ablation_resumes(drawn):
    def interrupted(campaign, variant):
        raise AssertionError("analysed again")

    partial, complete = ablate(drawn, budget=14.0), ablate(drawn, budget=100.0)
    assert (len(partial), len(complete)) == (4, 12)
    assert ablate(drawn, budget=100.0, analyse=interrupted).equals(complete)


def test_the_table_counts_changed_verdicts_and_costs(drawn):
    analyses = ablate(drawn, budget=100.0)
    table = against_complete(analyses).set_index("variant")
    assert set(table.index) == {"a halved", "a doubled"}
    row = table.loc["a halved"]
    assert row["trials":"right gained"].tolist() == [4, 1, 1, 0]
    assert row["revolutions [%]"] == 125.0  # 40 + 3 * 20 over 80
    assert row["CPU-s [%]"] == 100.0
    text = write_ablation("hand-made", analyses, drawn)
    assert "| a halved | 4 | 1 | 1 | 0 | 125.0 | 100.0 |" in text
    assert pd.read_csv(drawn / "analyses.csv")["outcome"].value_counts().to_dict() == {
        "right": 10,
        "wrong": 2,
    }


def test_unfinished_analyses_are_counted_with_the_limit(drawn):
    def endless_for_the_first(campaign, variant):
        while campaign.name == PLANS[0].id:
            pass
        return analysed(campaign, variant)

    analyses = ablation.ablate(PLANS, 1, drawn, VARIANTS[:1], 0.2, 100.0, endless_for_the_first)
    row = by_group(analyses).loc["one effect or none, ideal joints"]
    assert (row["trials"], row["right"], row[UNFINISHED]) == (4, 3, 1)
    assert row["CPU-s, median"] == 1.5  # of 0.2, 1, 2 and 9


def test_trials_with_similar_costs_form_a_group():
    cases = {
        ("single", "chaotic", ("gravity",)): "motion never repeats",
        ("clearance", "ideal", ("crank_pin_clearance",)): "hidden clearance",
        ("single", "loose", ("gravity",)): "one effect or none, loose joints",
        ("pair", "loose", ("gravity", "crank_pin_clearance")): "two effects, loose joints",
        ("triple", "ideal", ("gravity", "gas_pressure", "sensor_bias")): (
            "three effects, ideal joints"
        ),
    }
    for (kind, base, effects), group in cases.items():
        assert group_of(Trial(kind, base, effects=effects)) == group
