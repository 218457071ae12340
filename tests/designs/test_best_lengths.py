"""The best lengths of a design by the paper's method: where they are known, and where a search over lengths goes."""

import math

import numpy as np
import pytest

from jointgap.config import Scenario
from jointgap.core.schema import BEST_LENGTHS, PRINTED_OPTIMA
from jointgap.designs.run import best_crank_length, simulate_designs, table_of
from jointgap.designs.sampling import designs_of
from jointgap.designs.sensitivity import decided
from jointgap.designs.sweep import measure_in_words
from jointgap.dynamics.kinematics import clearance_lift
from jointgap.dynamics.simulation import simulate
from jointgap.lengths.objective import frozen_objective, objective_of_motion
from tests.dynamics.cases import mechanism, options

MADE = mechanism(friction=0.1)
CRANK, ROD = MADE.crank.length, MADE.rod.length
COARSE = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8)
ANGLE = np.linspace(0.0, 2.0 * math.pi, 90, endpoint=False)


def asked(parameters: dict, made=MADE, simulated=COARSE, **more) -> Scenario:
    sweep = {"parameters": parameters, "number": 2, "best_lengths": True, **more}
    return Scenario(mechanism=made, simulate=simulated, sweep=sweep)


def measured(scenario: Scenario) -> list[dict]:
    return simulate_designs(designs_of(scenario), 0, scenario.sweep.designs, 1).to_dict("records")


@pytest.mark.parametrize("longer", [-5e-3, -1e-4, 1e-4, 5e-3])
def test_clearances_that_act_as_a_longer_crank_ask_for_a_crank_as_much_shorter(longer):
    known = frozen_objective(MADE, ANGLE, longer * np.sin(ANGLE))
    best = best_crank_length(known, ROD)
    assert best == pytest.approx(CRANK - longer, abs=1e-9)
    assert known.reductions((best, ROD)).rms == pytest.approx(1.0, abs=1e-6)


def test_on_another_rod_these_ask_for_the_crank_that_has_the_same_ratio():
    known = frozen_objective(MADE, ANGLE, 1e-3 * np.sin(ANGLE))
    best = best_crank_length(known, 0.9 * ROD)
    assert best + 1e-3 == pytest.approx(0.9 * CRANK, abs=1e-9)


def test_a_rod_that_is_lifted_alike_all_around_leaves_the_crank_as_it_is():
    """Lift and crank are orthogonal to first order: the crank changes by less than a thousandth of the lift."""
    assert best_crank_length(frozen_objective(MADE, ANGLE, 1e-4), ROD) == pytest.approx(CRANK, abs=1e-7)


def test_without_clearance_the_best_lengths_are_the_original_ones_and_no_share_is_told():
    rod = -np.arcsin(CRANK * np.sin(ANGLE) / ROD)
    assert best_crank_length(objective_of_motion(MADE, ANGLE, rod), ROD) == pytest.approx(CRANK, abs=1e-9)
    for design in measured(asked({"speed": ["300 rpm", "600 rpm"]}, mechanism(loose=()))):
        assert design["best_crank_length"] == pytest.approx(CRANK, abs=1e-9)
        assert math.isnan(design["reduction_at_best"])


def test_the_best_lengths_of_a_design_are_those_of_its_clearance_vectors_in_both_revolutions():
    window = (math.radians(60), math.radians(300))
    (design, _) = measured(asked({"friction": [0.1, 0.2]}, window=window, design="grid"))
    samples = simulate(MADE, COARSE).samples
    turned = samples["crank_angle"].to_numpy()
    parts = {"": slice(360, 720), "_in_window": (turned >= window[0] - 1e-9) & (turned <= window[1] + 1e-9)}
    for suffix, part in parts.items():
        own = samples[part]
        known = frozen_objective(MADE, own["crank_angle"].to_numpy(), clearance_lift(own))
        cranks = np.linspace(CRANK - 1e-3, CRANK + 1e-3, 2001)
        sums = known.value(np.column_stack([cranks, np.full(2001, ROD)]))
        best = cranks[np.argmin(sums)]
        assert design[f"best_crank_length{suffix}"] == pytest.approx(best, abs=1e-6)
        assert design[f"best_ratio{suffix}"] == pytest.approx(best / ROD, abs=2e-6)
        reduction = known.reductions((best, ROD)).rms
        assert design[f"reduction_at_best{suffix}"] == pytest.approx(reduction, abs=1e-5)
        assert design[f"reduction_at_best{suffix}"] > 0.0


def test_the_best_lengths_go_with_the_lengths_of_the_design_and_the_start():
    turned = COARSE.model_copy(update={"start_angle": 1.0})
    short, long = measured(asked({"crank_length": [0.1, 0.2]}, simulated=turned, design="grid"))
    for design in (short, long):
        for suffix in ("", "_in_window"):
            assert design[f"best_crank_length{suffix}"] == pytest.approx(design["crank_length"], abs=2e-3)


def test_a_crank_almost_as_long_as_its_rod_has_best_lengths_or_none_but_does_not_fail():
    (design, _) = measured(asked({"crank_length": [0.55, 0.15]}, design="grid"))
    assert design["reason"] is None and math.isfinite(design["angle_error_rms"])


def test_they_stand_in_the_table_where_they_or_the_printed_numbers_are_asked_for_alone():
    names = set(BEST_LENGTHS.names)
    friction = {"friction": {"from": 0, "to": 0.2}}
    plain, best = (designs_of(asked(friction, best_lengths=given)) for given in (False, True))
    printed = designs_of(asked(friction, best_lengths=False, printed_numbers=True))
    assert not names & set(table_of(plain).names)
    assert names <= set(table_of(best).names) and names <= set(table_of(printed).names)
    assert not set(PRINTED_OPTIMA.names) & set(table_of(best).names)
    assert plain.digest != best.digest != printed.digest


def test_their_words_tell_the_revolutions_apart():
    words = [measure_in_words(name) for name in BEST_LENGTHS.names]
    assert len(set(words)) == len(words)
    assert measure_in_words("best_ratio") == "best ratio of crank to rod by the paper's method, last revolution"


def test_what_decides_the_best_lengths_can_be_asked():
    designs = designs_of(asked({"friction": {"from": 0, "to": 0.2}}, number=256))
    frame = simulate_designs(designs, 0, 256, 2)
    frame["best_ratio_in_window"] = 0.26 + 0.01 * frame["friction"]  # known
    found = decided(designs, frame, ["best_ratio_in_window"], 0)
    assert found.indices["total"].to_numpy() == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("measure", "key"), [("best_ratio", "best_lengths"), ("reduction_at_printed_local", "printed_numbers")]
)
def test_what_decides_is_asked_of_what_is_measured_alone(measure, key):
    given = asked({"friction": [0.1, 0.2]}, best_lengths=False).model_dump(by_alias=True, exclude_unset=True)
    with pytest.raises(ValueError, match=f"{measure} is not measured; set sweep.{key} to true"):
        Scenario(**given | {"sensitivity": {"measures": [measure]}})
    Scenario(**given | {"sweep": given["sweep"] | {key: True}, "sensitivity": {"measures": [measure]}})
