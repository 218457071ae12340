"""Before the measurement: detectable sizes, confusable effects and advice."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from jointgap.core.candidates import Candidate
from jointgap.core.errors import SimulationError
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.preflight import advise, preflight
from jointgap.identification.problem import Problem
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.identification.toy import SPEEDS, Toy, candidate_of, stated_noise, toy

SLOW = {"slow": SPEEDS["slow"]}
PLAN = {"held_out": (), "samples": 36, "cycles": 2.0}
SEEN = "coulomb", "viscous", "constant_force", "sensor_bias:torque"
ADVISED = "coulomb", "spring", "centrifugal", "added_mass", "sensor_gain:acceleration"


def planned(**options) -> Toy:
    """A campaign without held-out runs that has not been measured."""
    return toy(planned=True, **{**PLAN, **options})


def with_candidates(*candidates, **options) -> Toy:
    return replace(planned(**options), candidates=candidates)


def acting(change, *candidates) -> Toy:
    """A campaign whose effects act as `change` says: other ones, or an error."""

    class Other(Toy):
        def simulate(self, run, values, effects=(), numerics=0):
            plain = [one for effect in effects for one in change(*effect)]
            return super().simulate(run, values, plain, numerics)

    model = planned()
    return Other(model.series, model.nuisances, candidates or model.candidates, model.speeds)


@pytest.fixture(scope="module")
def found():
    return preflight(planned())


# Confusable effects


def test_three_speeds_separate_effects_that_one_speed_merges(found):
    one = preflight(planned(speeds=SLOW))
    assert ["spring", "centrifugal"] in one.merged and found.merged == []
    assert one.cosines.loc["spring", "centrifugal"] == pytest.approx(1.0, abs=1e-6)
    assert found.cosines.loc["spring", "centrifugal"] < 0.9
    assert (
        list(found.cosines.index) == list(found.cosines.columns) == found.effects["label"].tolist()
    )
    assert np.allclose(found.cosines, found.cosines.T) and np.allclose(np.diag(found.cosines), 1.0)


def test_equal_effects_are_merged_but_not_an_effect_with_a_more_general_one():
    viscous, steady = candidate_of("viscous"), candidate_of("constant_force")
    coordinates = (replace(steady.coordinates[0], low=0.0),)
    push = replace(steady, site="push", has_site=True, coordinates=coordinates)
    found = preflight(with_candidates(push, steady, viscous))
    assert found.merged == [["constant_force:push", "constant_force"]]
    gain = replace(candidate_of("sensor_gain:acceleration"), site="torque")
    for replaces in ({}, {"slider_mass": "mass_kg"}):  # the torque is all inertia
        heavier = replace(candidate_of("added_mass"), replaces=replaces)
        found = preflight(with_candidates(heavier, gain, viscous, channels=("torque",)))
        assert found.merged == [[heavier.label, gain.label]]

    def parts(candidate, at):
        is_pair = candidate.name == "preloaded_spring"
        both = (candidate_of("spring"), steady) if is_pair else (candidate,)
        return [(part, at) for part in both]

    sizes = candidate_of("spring").coordinates + steady.coordinates
    spring = Candidate("preloaded_spring", "slider", sizes, tuple(p.name for p in sizes))
    found = preflight(acting(parts, spring, steady))
    assert found.cosines.loc["preloaded_spring", "constant_force"] == pytest.approx(1.0, abs=1e-6)
    assert found.merged == []


# Detectable sizes


def test_a_fault_of_an_unmeasured_channel_cannot_be_detected():
    found = preflight(planned(channels=("torque", "guide_force")))
    assert found.undetectable == ["sensor_gain:acceleration"]
    row = found.effects.set_index("label").loc["sensor_gain:acceleration"]
    assert np.isnan(row["smallest_detectable"]) and not row["detectable"]
    assert "sensor_gain:acceleration" not in [label for group in found.merged for label in group]


def test_detectable_sizes_scale_with_noise_and_the_root_of_the_samples():
    few = planned(candidates=SEEN)
    found = preflight(few)
    more = preflight(few, counts={series.key: 4 * series.value.size for series in few.series})
    quiet = preflight(planned(noise=0.01, candidates=SEEN))
    for label in SEEN:  # a little less, as the BIC asks for the logarithm of the number
        assert 1.9 < found.sizes[label] / more.sizes[label] < 2.0
        assert found.sizes[label] == pytest.approx(2 * quiet.sizes[label], rel=0.02)
    # the gap stays
    pd.testing.assert_series_equal(found.effects["typical"], more.effects["typical"], rtol=1e-6)


@pytest.mark.parametrize(
    "label", ["coulomb", "viscous", "spring", "added_mass", "sensor_lag:torque"]
)
def test_a_typical_size_leaves_a_gap_of_1_5_after_recalibration(found, label):
    row = found.effects.set_index("label").loc[label]
    problem = Problem(
        toy({label: {row["parameter"]: row["typical"]}}, seed=1, **PLAN), stated_noise(toy(**PLAN))
    )
    assert problem.gap(fit_hypothesis(problem).residual) == pytest.approx(1.5, abs=0.05)


def test_the_smallest_detectable_size_is_found_in_90_percent():
    options = {"candidates": ("coulomb", "viscous"), "speeds": SLOW, **PLAN}
    size, hits = preflight(toy(planned=True, **options)).sizes["coulomb"], 0
    for seed in range(40):
        model = toy({"coulomb": {"force_N": size}}, seed=seed, **options)
        problem = Problem(model, stated_noise(model))
        gain = (
            fit_hypothesis(problem).chi2 - fit_hypothesis(problem, (candidate_of("coulomb"),)).chi2
        )
        hits += gain > np.log(problem.size) + DEFAULT_SETTINGS.decision.min_delta_bic
    assert 0.8 <= hits / 40 <= 0.99


# Unknown noise and failed simulations


def test_unstated_noise_is_assumed_and_reported(found):
    unstated = preflight(planned(stated=False, candidates=["coulomb"]))
    assert len(unstated.assumed) == 9 and found.assumed == ()
    assert unstated.assumed[0].startswith("torque in run slow: 0.") and "2 %" in unstated.assumed[0]
    # 2 % as well
    assert unstated.sizes["coulomb"] == pytest.approx(found.sizes["coulomb"], rel=1e-6)
    base, _ = advise(
        planned(stated=False, candidates=["coulomb"]), [("slow", "torque"), ("mid", "torque")]
    )
    channels = [text.partition(":")[0] for text in base.assumed]
    assert channels == ["torque in run slow", "torque in run mid"]


def test_a_candidate_that_cannot_be_simulated_is_reported():
    def jams(candidate, at):
        if candidate.name == "spring":
            raise SimulationError("the spring jams")
        return [(candidate, at)]

    found = preflight(acting(jams, candidate_of("spring"), candidate_of("coulomb")))
    assert (found.failed, found.undetectable) == ({"spring": "the spring jams"}, [])
    assert "coulomb" in found.cosines.index
    model = planned()
    broken = [
        replace(p, nominal=-0.1, low=-0.2) if p.name == "crank_length" else p
        for p in model.nuisances
    ]
    with pytest.raises(SimulationError, match="does not turn"):
        preflight(replace(model, nuisances=broken))


# Advice


def test_the_most_helpful_change_comes_first():
    base, changes = advise(planned(candidates=ADVISED), [("slow", "torque")])
    assert ["spring", "centrifugal"] in base.merged
    assert "sensor_gain:acceleration" in base.undetectable
    table = changes.set_index("change")
    changes = {"run mid", "run fast", "channel guide_force", "channel acceleration"}
    assert set(table.index) == changes
    assert table.index[0].startswith("run")  # another speed separates most
    assert "spring | centrifugal" in table.loc["run mid", "separated"]
    assert "spring | centrifugal" not in table.loc["channel guide_force", "separated"]
    assert table.loc["channel acceleration", "newly_detectable"] == ["sensor_gain:acceleration"]
    # samples without information on an effect still raise the penalty k ln n
    assert (table["gain"] >= 0.97).all()


def test_advice_agrees_with_the_preflight_of_the_changed_plan():
    slow = [("slow", channel) for channel in ("torque", "guide_force", "acceleration")]
    base, _ = advise(planned(candidates=ADVISED), slow)
    alone = preflight(planned(speeds=SLOW, candidates=ADVISED))
    assert base.merged == alone.merged and base.undetectable == alone.undetectable
    for label, size in alone.sizes.items():
        assert base.sizes[label] == pytest.approx(size, rel=0.02)
    model = planned(candidates=ADVISED)
    _, changes = advise(model, [series.key for series in model.series])
    assert changes.empty
