"""Four ways to the best lengths: what is refused, what is counted, and from when on it pays to learn."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Scenario
from jointgap.core.errors import InputError
from jointgap.core.page import to_markdown
from jointgap.length_searches.break_even import break_even, cost_from_which, gain_of_simulations, summary
from jointgap.length_searches.compare_searches import WAYS, compare_searches
from jointgap.length_searches.searches_figures import draw_searches
from jointgap.length_searches.searches_page import Shown, headline, page, verdict, winner
from jointgap.scenario.stages import SCENARIO_STAGES
from tests.design_networks.spaces import scenario

SMALL = {"optima": 2, "budgets": ["0.1 s", "0.25 s"], "repetitions": 2, "held_out": 8}


def small(**more) -> Scenario:
    return scenario(compare_searches=SMALL | more)


@pytest.mark.parametrize(
    "more, words",
    [
        ({"budgets": ["1 s", "0.5 s"]}, "do not rise"),
        ({"budgets": []}, "budgets"),
        ({"budgets": ["0 s"]}, "budgets"),
        ({"budgets": ["1 mm"]}, "budgets"),
        ({"optima": 0}, "optima"),
        ({"repetitions": 1}, "repetitions"),
    ],
)
def test_numbers_that_make_no_comparison_are_refused(more, words):
    with pytest.raises(InputError, match=words):
        small(**more)


def test_a_constraint_on_forces_is_refused_before_anything_is_simulated(monkeypatch):
    monkeypatch.setattr("jointgap.design_networks.settled_motion.simulate_runs", None)
    made = scenario(optimise={"constraints": {"largest_pin_force": "500 N"}}, compare_searches=SMALL)
    with pytest.raises(InputError, match="largest_pin_force cannot be kept"):
        compare_searches(made)
    with pytest.raises(InputError, match="nothing varies besides the lengths"):
        compare_searches(scenario({}, compare_searches=SMALL))


@pytest.fixture(scope="module")
def once():
    return compare_searches(small(), 1)


@pytest.fixture(scope="module")
def shown(once):
    return Shown(once, summary(once), break_even(once, 2), small())


def test_each_way_finds_lengths_in_the_box_that_are_simulated_again(once):
    rows = once.searches.groupby("way").size()
    assert rows.to_dict() == {"frozen": 4, "networks": 8, "surrogate": 8, "simulation": 8}
    lengths = once.searches[["crank_length", "rod_length"]].to_numpy()
    assert once.space.region.contains(lengths, slack=1e-9).all()
    simulated = once.searches[once.searches["way"] == "simulation"]
    assert (simulated["gain"] >= -1e-12).all()  # what was simulated once has the same error again
    best = once.searches[once.searches["way"] == "frozen"]["gain"]
    assert best.max() > 0.0


def test_the_time_of_an_optimum_is_its_search_and_its_share_of_the_learning(once):
    rows = once.searches
    np.testing.assert_allclose(rows["cpu_time"], rows["search_time"] + rows["learning_time"] / 2)
    assert (rows.loc[rows["way"].isin(("networks", "surrogate")), "learning_time"] > 0.0).all()
    within = rows[(rows["way"] == "simulation") & (rows["budget"] == 0.25)]
    assert (within["cpu_time"] <= 0.25).all()


def test_the_simulation_misses_nothing_on_held_out_designs_and_the_others_something(once):
    missed = once.predictions.groupby("way")["missed"].max()
    assert missed["simulation"] == 0.0
    assert (missed[["frozen", "networks", "surrogate"]] > 0.0).all()


def test_dearer_simulations_favour_learning_from_the_cost_at_which_both_ways_take_as_long():
    simulations, training, search, needed, besides, optima = 100.0, 2.0, 0.05, 60.0, 0.01, 8
    cost = cost_from_which(simulations, training, search, needed, besides, optima)
    learning = simulations * cost + training + optima * search
    assert learning == pytest.approx(optima * (needed * cost + besides))
    assert cost_from_which(simulations, training, search, None, besides, optima) == 0.0
    assert math.isnan(cost_from_which(simulations, training, search, 10.0, besides, optima))
    assert cost_from_which(simulations, 0.0, 0.0, needed, 1.0, optima) == 0.0


def test_the_gain_of_so_many_simulations_is_the_mean_over_all_searches():
    progress = pd.DataFrame(
        {
            "repetition": [0, 0, 0, 0],
            "optimum": [0, 0, 1, 1],
            "simulations": [1, 7, 1, 13],
            "gain": [0.0, 0.2, 0.0, 0.4],
        }
    )
    numbers, gains = gain_of_simulations(progress)
    assert numbers.tolist() == [1, 7, 13]
    assert gains.tolist() == pytest.approx([0.0, 0.1, 0.3])


def test_the_winner_is_the_cheapest_of_those_whose_gain_is_as_good_as_the_largest():
    frame = pd.DataFrame({"way": list(WAYS), "gain": [0.0995, 0.1, 0.05, 0.098], "cpu_time": [0.2, 0.5, 0.1, 0.15]})
    assert winner(frame)["way"] == "frozen"
    assert winner(frame.assign(gain=[0.09, 0.1, 0.05, 0.098]))["way"] == "networks"


def test_the_page_says_who_wins_and_when_learning_pays(shown):
    text = to_markdown(page(shown, "mine"))
    for words in ("frozen motion", "networks", "surrogate of the error", "CMA-ES", "2 designs", "When learning pays"):
        assert words in text
    assert "for each optimum" in headline(shown)
    assert sum("Against" in sentence for sentence in verdict(shown)) == 2
    drawn = draw_searches(shown.summary, shown.compared.progress, shown.break_even, shown.compared.cost)
    assert set(drawn) == {"gain_over_cpu_time", "when_learning_pays"}
    tables = {Path(table.path).stem for table in SCENARIO_STAGES["compare-searches"].writes}
    assert not tables & set(drawn)  # beside a figure lies its data, under the name of the figure


def test_where_the_simulation_never_gains_as_much_it_counts_as_having_taken_all_it_tried(once):
    poor = replace(once, searches=once.searches.assign(gain=0.1), progress=once.progress.assign(gain=-0.1))
    rows = break_even(poor, 2)
    networks = rows[(rows["way"] == "networks") & (rows["against"] == "simulation")]
    assert len(networks)
    assert networks["simulations"].eq(once.progress["simulations"].max()).all()
