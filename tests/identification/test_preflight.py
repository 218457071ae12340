"""Before anything is measured, a campaign is told what it can detect and tell apart, and what would help."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from jointgap.core.candidates import Candidate
from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.preflight import Detectability, advise, assumed_noise, preflight
from jointgap.identification.problem import Problem
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.identification.toy import SPEEDS, Toy, candidate_of, stated_noise, toy

SLOW = {"slow": SPEEDS["slow"]}
PLAN = {"held_out": (), "samples": 36, "cycles": 2.0}


def planned(**options) -> Toy:
    """A campaign without held-out runs, yet to be measured."""
    return toy(planned=True, **{**PLAN, **options})


def test_effects_that_are_one_force_at_one_speed_are_merged_and_three_speeds_tell_them_apart():
    one = preflight(planned(speeds=SLOW))
    assert ["spring", "centrifugal"] in one.merged
    assert one.cosines.loc["spring", "centrifugal"] == pytest.approx(1.0, abs=1e-6)
    three = preflight(planned())
    assert three.merged == []
    assert three.cosines.loc["spring", "centrifugal"] < 0.9


def test_a_one_sided_effect_and_a_two_sided_one_that_are_the_same_are_merged():
    either_way = candidate_of("constant_force")
    force = replace(either_way.coordinates[0], low=0.0)
    push = replace(either_way, site="push", has_site=True, coordinates=(force,))
    found = preflight(replace(planned(), candidates=(push, either_way, candidate_of("viscous"))))
    assert found.merged == [["constant_force:push", "constant_force"]]


def test_an_effect_is_not_merged_with_one_that_holds_it_and_more():
    stiffness, force = (candidate_of(label).coordinates[0] for label in ("spring", "constant_force"))

    class Preloaded(Toy):
        def simulate(self, run, values, effects=(), numerics=0):
            plain = []
            for candidate, at in effects:
                if candidate.name == "preloaded_spring":
                    plain += [(candidate_of(label), at) for label in ("spring", "constant_force")]
                else:
                    plain.append((candidate, at))
            return super().simulate(run, values, plain, numerics)

    spring = Candidate("preloaded_spring", "slider", (stiffness, force), ("stiffness_N_m", "force_N"))
    model = planned()
    found = preflight(Preloaded(model.series, model.nuisances, (spring, candidate_of("constant_force")), model.speeds))
    assert found.cosines.loc["preloaded_spring", "constant_force"] == pytest.approx(1.0, abs=1e-6)
    assert found.merged == []


@pytest.mark.parametrize("replaces", [{}, {"slider_mass": "mass_kg"}], ids=["beside-the-nuisance", "in-its-place"])
def test_effects_that_only_the_bounds_of_a_nuisance_let_be_seen_are_merged_if_they_are_the_same(replaces):
    heavier = replace(candidate_of("added_mass"), replaces=replaces)  # torque is all inertia: both are what a mass does
    gain = replace(candidate_of("sensor_gain:acceleration"), site="torque")
    found = preflight(replace(planned(channels=("torque",)), candidates=(heavier, gain, candidate_of("viscous"))))
    assert found.merged == [[heavier.label, gain.label]]


@pytest.mark.parametrize("noise", [0.02, 0.005])
def test_what_another_effect_leaves_within_bounds_is_never_less_than_without(noise, monkeypatch):
    kept = []
    monkeypatch.setattr(Detectability, "merged", lambda self, labels: kept.append((self, labels)) or [])
    preflight(planned(noise=noise))
    ((detectability, labels),) = kept
    for label in labels:
        (amount, sensitivity), *_ = (
            (detectability._typical_amount(s, 0), s) for s in detectability.sensitivities.of(label)
        )
        for other in set(labels) - {label}:
            left = min(detectability._fitted(sensitivity, 0, sign * amount, other) for sign in (1.0, -1.0))
            assert detectability._least_left(label, other) <= left * (1.0 + 1e-6) + 1e-6


def test_the_matrix_of_cosines_is_symmetric_with_ones_on_its_diagonal():
    found = preflight(planned())
    assert list(found.cosines.index) == list(found.cosines.columns) == found.effects["label"].tolist()
    assert np.allclose(found.cosines, found.cosines.T)
    assert np.allclose(np.diag(found.cosines), 1.0)


def test_a_fault_of_a_channel_that_is_not_measured_cannot_be_detected():
    found = preflight(planned(channels=("torque", "guide_force")))
    assert found.undetectable == ["sensor_gain:acceleration"]
    row = found.effects.set_index("label").loc["sensor_gain:acceleration"]
    assert np.isnan(row["smallest_detectable"]) and not row["detectable"]
    assert "sensor_gain:acceleration" not in [label for group in found.merged for label in group]


def test_four_times_the_samples_show_half_the_size_and_the_gap_stays():
    model = planned()
    found, more = (
        preflight(model, counts={series.key: many * series.value.size for series in model.series}) for many in (1, 4)
    )
    for label in ("coulomb", "viscous", "constant_force", "sensor_bias:torque"):
        # a little less, as the BIC asks for the logarithm of the number
        assert 1.9 < found.sizes[label] / more.sizes[label] < 2.0
    pd.testing.assert_series_equal(found.effects["typical"], more.effects["typical"], rtol=1e-6)
    assert found.sizes == preflight(model).sizes


@pytest.mark.parametrize("label", ["coulomb", "viscous", "spring", "added_mass", "sensor_lag:torque"])
def test_a_typical_size_leaves_the_gap_of_one_and_a_half_after_recalibration(label):
    row = preflight(planned()).effects.set_index("label").loc[label]
    model = toy({label: {row["parameter"]: row["typical"]}}, seed=1, **PLAN)
    problem = Problem(model, stated_noise(toy(**PLAN)))
    assert problem.gap(fit_hypothesis(problem).residual) == pytest.approx(1.5, abs=0.05)


def test_the_smallest_detectable_size_is_found_nine_times_in_ten():
    options = {"candidates": ("coulomb", "viscous"), "speeds": SLOW, **PLAN}
    size = preflight(toy(planned=True, **options)).sizes["coulomb"]
    hits, seeds = 0, 40
    for seed in range(seeds):
        model = toy({"coulomb": {"force_N": size}}, seed=seed, **options)
        problem = Problem(model, stated_noise(model))
        gain = fit_hypothesis(problem).chi2 - fit_hypothesis(problem, (candidate_of("coulomb"),)).chi2
        hits += gain > np.log(problem.size) + DEFAULT_SETTINGS.decision.min_delta_bic
    assert 0.8 <= hits / seeds <= 0.99


def test_twice_the_noise_hides_effects_of_twice_the_size():
    quiet, loud = (preflight(planned(noise=share)).sizes for share in (0.01, 0.02))
    for label in ("coulomb", "viscous", "constant_force", "sensor_bias:torque"):
        assert loud[label] == pytest.approx(2 * quiet[label], rel=0.02)


def test_an_effect_that_is_a_nuisance_is_seen_beyond_that_nuisances_range():
    found = preflight(planned())
    mass = next(p for p in planned().nuisances if p.name == "slider_mass")
    beyond = found.sizes["added_mass"] - (mass.high - mass.nominal)
    assert 0.0 < beyond < 0.25 * (mass.high - mass.nominal)


def test_noise_that_is_not_stated_is_assumed_and_told():
    found = preflight(planned(stated=False))
    assert len(found.assumed) == 9
    assert re.fullmatch(r"torque in run slow: 0\.\d+ N m, 2 % of its variation", found.assumed[0])
    assert preflight(planned()).assumed == ()
    assert found.sizes["coulomb"] == pytest.approx(preflight(planned()).sizes["coulomb"], rel=1e-6)  # 2 % as well


def test_a_channel_that_is_predicted_to_be_zero_needs_a_stated_noise():
    class Silent(Toy):
        def simulate(self, run, values, effects=(), numerics=0):
            read = super().simulate(run, values, effects, numerics)
            return {**read, "torque": 0.0 * read["torque"]}

    model = planned(stated=False)
    silent = Silent(model.series, model.nuisances, model.candidates, model.speeds)
    with pytest.raises(InputError, match="run slow, channel torque: the prediction is 0 everywhere; state its"):
        assumed_noise(silent)


def test_a_candidate_that_cannot_be_simulated_is_told_and_the_others_go_on():
    class Refusing(Toy):
        def simulate(self, run, values, effects=(), numerics=0):
            if any(candidate.name == "spring" for candidate, _ in effects):
                raise SimulationError("the spring jams")
            return super().simulate(run, values, effects, numerics)

    model = planned()
    found = preflight(Refusing(model.series, model.nuisances, model.candidates, model.speeds))
    assert found.failed == {"spring": "the spring jams"}
    assert found.undetectable == []
    assert "coulomb" in found.cosines.index


def test_a_value_that_falls_as_its_effect_grows_is_told_from_one_that_grows_with_it():
    class Bending(Toy):
        def simulate(self, run, values, effects=(), numerics=0):
            plain = [(candidate_of("spring") if one.name == "bending" else one, at) for one, at in effects]
            return super().simulate(run, values, plain, numerics)

    bending = replace(
        candidate_of("spring"), name="bending", parameters=lambda values: {"softness": 1.0 / values["stiffness_N_m"]}
    )
    model = planned()
    found = preflight(Bending(model.series, model.nuisances, (bending, candidate_of("coulomb")), model.speeds))
    effects = found.effects.set_index("label")
    assert effects["falls"].to_dict() == {"bending": True, "coulomb": False}
    assert effects["unit"].to_dict() == {"bending": "", "coulomb": "N"}  # a softness is not in N/m as its coordinate is
    assert effects.loc["bending", "smallest_detectable"] == 1.0 / found.sizes["bending"]


def test_the_most_helpful_change_is_told_first():
    keys = [("slow", "torque")]
    base, changes = advise(planned(), keys)
    assert ["spring", "centrifugal"] in base.merged
    assert "sensor_gain:acceleration" in base.undetectable
    table = changes.set_index("change")
    assert set(table.index) == {"run mid", "run fast", "channel guide_force", "channel acceleration"}
    assert table.index[0].startswith("run")  # another speed tells most apart
    assert "spring | centrifugal" in table.loc["run mid", "separated"]
    assert "spring | centrifugal" not in table.loc["channel guide_force", "separated"]
    assert table.loc["channel acceleration", "newly_detectable"] == ["sensor_gain:acceleration"]
    # samples that tell nothing of an effect still raise what is asked of it, k ln n
    assert (table["gain"] >= 0.97).all()


def test_only_the_noise_of_what_is_planned_is_told_as_assumed():
    base, _ = advise(planned(stated=False), [("slow", "torque"), ("mid", "torque")])
    assert [text.partition(":")[0] for text in base.assumed] == ["torque in run slow", "torque in run mid"]


def test_advice_on_a_planned_campaign_agrees_with_its_own_preflight():
    base, _ = advise(planned(), [("slow", channel) for channel in ("torque", "guide_force", "acceleration")])
    alone = preflight(planned(speeds=SLOW))
    assert base.merged == alone.merged and base.undetectable == alone.undetectable
    for label, size in alone.sizes.items():
        if not label.startswith("harmonic"):
            assert base.sizes[label] == pytest.approx(size, rel=0.02)


def test_a_campaign_with_all_there_is_has_nothing_further_to_be_advised():
    model = planned()
    _, changes = advise(model, [series.key for series in model.series])
    assert changes.empty


def test_a_model_that_cannot_be_simulated_is_refused():
    model = planned()
    broken = [
        replace(p, nominal=-0.1, low=-0.2, high=-0.05) if p.name == "crank_length" else p for p in model.nuisances
    ]
    with pytest.raises(SimulationError, match="does not turn"):
        preflight(replace(model, nuisances=broken))
