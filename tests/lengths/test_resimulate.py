import numpy as np
import pytest

from jointgap.config import Ensemble, Optimise, Simulate, load_mechanism
from jointgap.core.joints import PINS
from jointgap.dynamics.simulation import simulate
from jointgap.lengths.objective import MEASURES, Measures, measure
from jointgap.lengths.resimulate import (
    Resimulation,
    compare,
    perturbations,
    reduction_pairs,
    resimulate,
)

SIMULATE = Simulate(revolutions=2, samples_per_revolution=720)
OPTIMISE = Optimise(
    window=("60 deg", "360 deg"), ensemble=Ensemble(members=4, settled_revolution=2)
)
POINTS = 73
LENGTHS = (0.1494, 0.563)


def with_friction(mechanism, friction):
    contact = mechanism.joint("crank_pin").contact.model_copy(update={"friction": friction})
    pins = {
        name: mechanism.joint(name).model_copy(update={"contact": contact})
        for name in ("crank_pin", "piston_pin")
    }
    return mechanism.model_copy(update={"joints": mechanism.joints.model_copy(update=pins)})


@pytest.fixture(scope="module")
def mechanism():
    return with_friction(load_mechanism("config/mechanisms/erkaya2009.yaml"), 0.2)


def test_the_error_is_the_ideal_angle_of_the_original_lengths_less_the_simulated_one(mechanism):
    options = OPTIMISE.model_copy(update={"ensemble": Ensemble(members=2, settled_revolution=2)})
    ours = resimulate(mechanism, SIMULATE, options, POINTS, LENGTHS)
    for member, start in enumerate(perturbations(options.ensemble, PINS)):
        run = simulate(mechanism.with_lengths(*LENGTHS), SIMULATE, start).samples
        desired = np.arccos(0.150 * np.sin(run["crank_angle"]) / 0.564)
        error = (desired - run["transmission_angle"]).to_numpy()
        turned = np.degrees(run["crank_angle"])
        window = (turned > 59.9) & (turned < 360.1) & (np.arange(len(run)) % 10 != 0)
        settled = (turned > 359.9) & (turned < 719.9)
        for stretch, chosen in (("window", window), ("settled", settled)):
            by_hand = measure(error[chosen])
            for name in MEASURES:
                assert getattr(ours.errors[stretch], name)[member] == pytest.approx(
                    getattr(by_hand, name), rel=1e-12
                )
        last = run[settled]
        assert ours.largest_departure[member] == pytest.approx(
            np.max(np.abs(last["rod_angle"])), rel=1e-12
        )
        assert ours.outer_dead_centre[member] == pytest.approx(
            last["slider_position"].max(), rel=1e-12
        )
        assert ours.inner_dead_centre[member] == pytest.approx(
            last["slider_position"].min(), rel=1e-12
        )


def test_chaos_spreads_the_reduction_of_unchanged_lengths_around_zero_and_friction_does_does_not(
    mechanism,
):
    chaotic = with_friction(mechanism, 0.0)
    lengths, width = (mechanism.crank.length, mechanism.rod.length), {}
    for friction, made in ((0.2, mechanism), (0.0, chaotic)):
        ensemble = resimulate(made, SIMULATE, OPTIMISE, POINTS, lengths)
        rows = compare(ensemble, ensemble)
        (row,) = (row for row in rows if (row["stretch"], row["measure"]) == ("settled", "rms"))
        width[friction] = row["reduction_high"] - row["reduction_low"]
    assert width[0.0] > 0.01 and width[0.2] < 1e-3


def test_every_pair_of_runs_is_compared_and_a_row_has_the_errors_of_the_new_and_of_the_original_lengths():
    pairs = reduction_pairs(np.array([1.0, 3.0]), np.array([2.0, 4.0, 8.0]))
    assert sorted(pairs) == pytest.approx(sorted([0.5, 0.75, 0.875, -0.5, 0.25, 0.625]))

    def of(lengths, *errors):
        none = np.zeros(3)
        return Resimulation(
            lengths, {"window": Measures(*[np.array(errors)] * 4)}, none, none, none, {}
        )

    rows = compare(of(LENGTHS, 1.0, 2.0, 4.0), of((0.15, 0.564), 8.0, 10.0, 20.0))
    assert [row["measure"] for row in rows] == list(MEASURES)
    for row in rows:
        assert [row[f"error{end}"] for end in ("", "_low", "_high")] == pytest.approx(
            [2.0, 1.1, 3.8]
        )
        assert [row[f"original_error{end}"] for end in ("", "_low", "_high")] == pytest.approx(
            [10.0, 8.2, 19.0]
        )
        assert row["reduction"] == pytest.approx(0.8) and row["share_better"] == 1.0


def test_ideal_joints_are_not_perturbed_and_loose_ones_are_alike_whichever_others_are_loose():
    options = Ensemble(members=5)
    three, pins, pivot = (
        perturbations(options, loose) for loose in ((*PINS, "crank_pivot"), PINS, ("crank_pivot",))
    )
    assert np.array_equal(pins[:, :4], three[:, :4]) and not pins[:, 4:].any()
    assert np.array_equal(pivot[:, 4:], three[:, 4:]) and not pivot[:, :4].any()
