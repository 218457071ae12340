"""Re-simulated lengths: ensembles against single simulations, reductions over pairs of runs."""

import numpy as np
import pytest

from jointgap.config import Ensemble, Optimise, Simulate, load_mechanism
from jointgap.core.joints import PINS
from jointgap.lengths.objective import MEASURES, measure
from jointgap.lengths.resimulate import Resimulation, perturbations, resimulate
from jointgap.lengths.search import Point
from jointgap.lengths.tables import resimulated
from jointgap.motion.slider_crank import simulate

SIMULATE = Simulate(revolutions=2, samples_per_revolution=720)
ENSEMBLE = Ensemble(members=4, settled_revolution=2)
OPTIMISE = Optimise(window=("60 deg", "360 deg"), ensemble=ENSEMBLE)
POINTS = 73
LENGTHS = (0.1494, 0.563)


def with_friction(friction):
    mechanism = load_mechanism("config/mechanisms/erkaya2009.yaml")
    contact = mechanism.joint("crank_pin").contact.model_copy(update={"friction": friction})
    pins = {
        name: mechanism.joint(name).model_copy(update={"contact": contact})
        for name in ("crank_pin", "piston_pin")
    }
    return mechanism.model_copy(update={"joints": mechanism.joints.model_copy(update=pins)})


def test_the_error_is_the_ideal_angle_of_the_original_lengths_minus_the_simulated_one():
    mechanism = with_friction(0.2)
    options = OPTIMISE.model_copy(update={"ensemble": Ensemble(members=2, settled_revolution=2)})
    ensemble = resimulate(mechanism, SIMULATE, options, POINTS, LENGTHS)
    for member, start in enumerate(perturbations(options.ensemble, PINS)):
        run = simulate(mechanism.with_lengths(*LENGTHS), SIMULATE, start).samples
        desired = np.arccos(0.150 * np.sin(run["crank_angle"]) / 0.564)
        error = (desired - run["transmission_angle"]).to_numpy()
        turned = np.degrees(run["crank_angle"])
        settled = (turned > 359.9) & (turned < 719.9)
        window = (turned > 59.9) & (turned < 360.1) & (np.arange(len(run)) % 10 != 0)
        sizes = {"window": measure(error[window]), "settled": measure(error[settled])}
        for (stretch, name), values in ensemble.sizes.items():
            assert values[member] == pytest.approx(getattr(sizes[stretch], name), rel=1e-12)
        cycle = run[settled]
        extremes = {
            "largest_departure": np.max(np.abs(cycle["rod_angle"])),
            "outer_dead_centre": cycle["slider_position"].max(),
            "inner_dead_centre": cycle["slider_position"].min(),
        }
        assert {key: values[member] for key, values in ensemble.extremes.items()} == pytest.approx(
            extremes, rel=1e-12
        )


@pytest.mark.parametrize("friction, low, high", [(0.2, 0.0, 1e-3), (0.0, 0.01, np.inf)])
def test_only_chaos_spreads_the_reduction_of_unchanged_lengths(friction, low, high):
    mechanism = with_friction(friction)
    lengths = mechanism.crank.length, mechanism.rod.length
    rms = resimulate(mechanism, SIMULATE, OPTIMISE, POINTS, lengths).sizes["settled", "rms"]
    pairs = 1.0 - np.divide.outer(rms, rms)
    assert low <= np.ptp(np.quantile(pairs, [0.05, 0.95])) <= high


def test_a_row_has_the_errors_of_both_ensembles_and_compares_every_pair_of_runs(objective):
    def ensemble(lengths, *errors):
        sizes = {("window", name): np.array(errors) for name in MEASURES}
        return Resimulation(lengths, sizes, {}, {})

    ensembles = {
        "original": ensemble((0.15, 0.564), 8.0, 10.0, 20.0),
        "better": ensemble(LENGTHS, 1.0, 2.0, 9.0),
    }
    frozen = dict.fromkeys(("simulation", "simulation_settled"), objective)
    table = resimulated([Point("better", "local", LENGTHS)], ensembles, frozen, frozen)
    assert list(table["measure"]) == list(MEASURES)
    row = table.iloc[0]
    columns = [
        f"{name}{end}" for name in ("error", "original_error") for end in ("", "_low", "_high")
    ]
    assert list(row[columns]) == pytest.approx([2.0, 1.1, 8.3, 10.0, 8.2, 19.0])
    pairs = [1 - error / original for error in (1, 2, 9) for original in (8, 10, 20)]
    assert row["reduction"] == pytest.approx(np.median(pairs)) and row["share_better"] == 8 / 9


def test_perturbations_of_a_joint_do_not_depend_on_which_others_are_loose():
    options = Ensemble(members=5)
    three, pins, pivot = (
        perturbations(options, loose) for loose in ((*PINS, "crank_pivot"), PINS, ("crank_pivot",))
    )
    assert np.array_equal(pins[:, :4], three[:, :4]) and not pins[:, 4:].any()
    assert np.array_equal(pivot[:, 4:], three[:, 4:]) and not pivot[:, :4].any()
