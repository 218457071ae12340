"""The search finds the lengths that a measure of many draws is smallest at, and keeps what is asked of them."""

import numpy as np
import pytest

from jointgap.config import Constraints
from jointgap.config.designs import OptimiseRobust
from jointgap.designs.optimise_robust import (
    OBJECTIVES,
    best_of,
    deviation,
    front_of,
    held_quantile,
    minimised,
    search,
)
from jointgap.lengths.region import Region, geometric
from tests.designs.standin import BOX, NOMINAL, ROD, STEADY, Formula, asked, standard_draws
from tests.rows import each

WITHIN = 1e-4  # [m] half a percent of the box


def best_lengths(wanted, formula) -> np.ndarray:
    found = search(wanted, formula, with_front=False)
    return best_of(found)[["crank_length", "rod_length"]].to_numpy(dtype=float)


@each("k", [0.0, 3.0])
def test_the_smallest_mean_and_deviations_lie_between_the_best_and_the_steadiest_lengths(k):
    # d/dL of (L - nominal)^2 + k (L - steady)^2 is zero at their weighted mean
    expected = (NOMINAL + k * STEADY) / (1.0 + k)
    found = best_lengths(asked(deviations=k), Formula(standard_draws()))
    np.testing.assert_allclose(found, [expected, ROD], atol=WITHIN)


def test_the_smallest_quantile_lies_where_its_closed_form_says():
    z = standard_draws()
    expected = (NOMINAL + np.quantile(z, 0.9) * STEADY) / (1.0 + np.quantile(z, 0.9))
    found = best_lengths(asked(measure="quantile", quantile=0.9), Formula(z))
    np.testing.assert_allclose(found, [expected, ROD], atol=WITHIN)


def test_no_candidate_is_better_than_one_on_the_front_in_all_that_is_minimised():
    formula = Formula(standard_draws(), force=lambda lengths, z: 1e3 * (lengths[:, :1] / 0.15) * (1.0 + 0.1 * z))
    found = search(asked(), formula)
    values, front = found[list(OBJECTIVES)].to_numpy(), front_of(found)
    assert len(front) > 10
    for place in front:
        assert not (np.all(values <= values[place], axis=1) & np.any(values < values[place], axis=1)).any()


def test_an_uncertain_force_keeps_its_limit_in_the_share_of_the_draws_that_is_asked_for():
    # the force grows with the crank, so that the limit in 9 of 10 draws cuts the better lengths off
    z = standard_draws(40)
    wanted = asked(constraints=Constraints(largest_pin_force=1000.0), probability=0.9)
    formula = Formula(z, force=lambda lengths, z: 1000.0 * (lengths[:, :1] / 0.150) * (1.0 + 0.01 * z))
    crank, _ = best_lengths(wanted, formula)
    last = np.sort(z)[int(0.9 * len(z)) - 1]  # the draw in which 36 of 40 just hold
    assert crank == pytest.approx(0.150 / (1.0 + 0.01 * last), abs=WITHIN)
    assert crank <= 0.150 / (1.0 + 0.01 * last)


def test_lengths_that_cannot_be_simulated_in_a_draw_are_no_optimum():
    def respond(lengths):
        answer = Formula(standard_draws())(lengths)
        answer.error[answer.lengths[:, 0] > 0.150, 3] = np.nan
        return answer

    found = search(asked(deviations=3.0), respond, with_front=False)
    assert best_of(found)["crank_length"] <= 0.150
    assert found["failed"].max() == 1


def test_a_range_is_kept_with_the_tolerances_of_the_lengths():
    region = Region.of(BOX, None).under(geometric(Constraints(stroke=(0.280, 0.304)), 0.0))
    wanted, formula = asked(region=region, probability=0.9), Formula(standard_draws(10))
    answer = formula(np.array([[0.1519, 0.57], [0.1515, 0.57]]))
    answer.actual[:, :2, 0] += 3e-4  # two of ten draws lead beyond 152 mm from 151.9, none from 151.5
    assert list(wanted.assess(answer)["missed"] > 0.0) == [True, False]


def test_statistics_count_the_draws_that_did_not_fail_and_a_quantile_of_misses_those_that_hold():
    missed = np.array([-1.0, -1.0, -1.0, 2.0])
    assert held_quantile(missed, 0.75) <= 0.0 < held_quantile(missed, 0.76)
    values = np.array([1.0, 2.0, 4.0, np.nan])
    assert deviation(values) == pytest.approx(np.std([1, 2, 4], ddof=1))
    assert minimised(OptimiseRobust(measure="quantile", quantile=0.5), values) == pytest.approx(2.0)
