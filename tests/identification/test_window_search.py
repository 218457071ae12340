"""Search for clearances, on an oscillator with a stiffer spring."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.core.errors import SimulationError
from jointgap.identification.evidence import reduced_chi2
from jointgap.identification.likelihood import Estimate
from jointgap.identification.problem import SearchLimit
from jointgap.identification.verdict import Thresholds
from jointgap.identification.window_search import fit_clearances, likely_clearances
from tests.identification.oscillator import PULL, SPRING, SWING, TURNS, WOBBLE, linear, windows

NOISE_ALONE = Thresholds(rate=0.01, omnibus=1.2, max_gain_threshold=10.0)
JUMPS = 1.0, 0.3, 0.03  # fewer than usual, to save time
SIZES = SPRING.vanishing_amplitude + np.geomspace(0.1, 1.6, 10)  # by less than 1.4
HINGE = replace(
    SPRING, site="hinge", has_site=True, initial_guesses=({"size": 0.2, "damping": 0.1},)
)
STIFFER = {"spring": {"size": 0.3, "damping": 0.0}}


def springs(
    place=6.4,
    by_shape=3.0,
    fails=lambda effects: False,
    swing=0.0,
    candidates=(SWING, SPRING),
    ideal=10.0,
    **changed,
):
    """A stiffer spring and a force. The deviance is the distance from a place, and `by_shape` at
    damping 0.3; without a spring `ideal`."""

    def deviance(effects):
        if not effects:
            return ideal
        if fails(effects):
            raise SimulationError("no such motion")
        spring = effects["spring"]
        return (
            abs(np.interp(spring["size"], SIZES, np.arange(10.0)) - place)
            + by_shape * spring["damping"] / 0.3
        )

    hidden = STIFFER | ({"swing": {"size": swing}} if swing else {})
    settings = windows(**{"jumps": JUMPS} | changed)
    more = {"candidates": candidates, "hidden": hidden, "deviance": deviance}
    return linear(
        settings=settings, runs=("slow",), windowed=lambda effects: "spring" in effects, **more
    )


def baseline_of(problem):
    return SimpleNamespace(problem=problem, nominal=SimpleNamespace(mapping={"zero@slow": 0.07}))


def search(problem, limits=NOISE_ALONE, alone=(), limit=None):
    baseline = baseline_of(problem)
    return fit_clearances(baseline, likely_clearances(baseline), limits, alone, limit)


def place_of(spring):
    return int(np.argmin(np.abs(SIZES - spring["size"]))), spring["damping"]


def tried(problem, jump=JUMPS[0]):
    """Places and dampings of the sizes rated over one turn at a jump, in order."""
    asked = problem.model.filtered
    assert {at for *_, at, turns in asked if turns == 1.0} <= {*JUMPS[:2]}
    return [
        place_of(effects["spring"]) for _, effects, at, turns in asked if (at, turns) == (jump, 1.0)
    ]


def names(fit):
    return {one.name for one in fit.hypothesis}


# Sizes


@pytest.mark.parametrize("place, best", [(0.0, 0), (3.2, 3), (9.0, 9)])
def test_the_filter_rates_every_size_and_starts_at_the_best(place, best):
    problem = springs(place, candidates=(SPRING,), fitted_sizes=1)
    ((_, start),) = likely_clearances(baseline_of(problem))
    assert place_of({"size": start["spring.size"], "damping": 0.0}) == (best, 0.0)
    assert start["zero@slow"] == 0.07  # as fitted with nominal shared values
    assert sorted(tried(problem)) == [(at, 0.0) for at in range(10)]
    # each shape with the values of runs fitted with ideal joints, and with those before
    shapes = [(best, damping) for damping in (0.0, 0.3) for _ in range(2)]
    assert sorted(tried(problem, JUMPS[1])) == shapes


def test_starting_sizes_are_no_neighbours_and_have_the_better_shape():
    problem = springs(4.1, by_shape=-0.5, candidates=(SPRING,), fitted_sizes=3)
    starts = [start for _, start in likely_clearances(baseline_of(problem))]
    springs_at = [{"size": s["spring.size"], "damping": s["spring.damping"]} for s in starts]
    assert list(map(place_of, springs_at)) == [(4, 0.3), (6, 0.3), (2, 0.3)]


def test_sizes_that_cannot_be_simulated_are_no_starts():
    problem = springs(
        4.0,
        fails=lambda effects: abs(effects["spring"]["size"] - SIZES[4]) < 1e-9,
        fitted_sizes=1,
    )
    ((_, start),) = likely_clearances(baseline_of(problem))
    assert place_of({"size": start["spring.size"], "damping": 0.0}) in ((3, 0.0), (5, 0.0))
    problem = springs(4.0, candidates=(SPRING, HINGE, SWING))
    for damping, dampings in ((0.1, {0.1}), (0.2, set())):  # with which there are windows
        problem.model.windowed = lambda at, damping=damping: (
            at.get("spring", {}).get("damping") == damping
        )
        problem.model.filtered.clear()
        found = likely_clearances(baseline_of(problem))
        assert {damping for _, damping in tried(problem)} == dampings
        assert bool(found) == bool(dampings)
    assert search(problem) == [] and problem.model.filtered == []


def test_only_sizes_more_likely_than_ideal_joints_are_starts():
    for ideal, count in ((0.39, 0), (0.41, 1), (10.0, 2)):
        assert len(likely_clearances(baseline_of(springs(6.4, ideal=ideal)))) == count


def test_a_size_with_less_than_half_of_the_best_gain_is_no_start():
    for ideal, count in ((3.3, 1), (3.5, 2)):  # the best two deviate by 0.2 and 1.8
        assert len(likely_clearances(baseline_of(springs(6.2, ideal=ideal)))) == count


# Fits


def test_a_clearance_is_fitted_from_its_size():
    problem = springs(candidates=(SPRING,))
    fits = search(problem)
    assert fits[0].mapping["spring.size"] == pytest.approx(0.3, abs=0.05)
    assert fits[0].simulations > 0
    assert reduced_chi2(fits[0]) < NOISE_ALONE.omnibus
    assert [fit.chi2 for fit in fits] == sorted(fit.chi2 for fit in fits)
    assert fits[0].states["slow"].shape == (TURNS * problem.model.per_turn, 2)


def test_a_second_effect_is_found_for_a_clearance_with_misfit():
    problem = springs(swing=0.3, candidates=(SWING, WOBBLE, SPRING), fitted_sizes=1)
    (spring,) = Estimate(problem, (SPRING,), {"spring.size": 0.3}).anneal().stages[-1:]
    assert spring.cost > problem.settings.stopping.poor_chi2_per_sample * problem.size
    fits = search(problem)
    assert names(fits[0]) == {"spring", "swing"} and all(len(fit.hypothesis) == 2 for fit in fits)
    assert [fits[0].mapping[key] for key in ("spring.size", "swing.size")] == pytest.approx(
        [0.3, 0.3], abs=0.02
    )
    # none is sought where an effect alone leaves less, the budget is spent, or none can be
    # simulated
    assert search(problem, alone=[replace(fits[0], residual=np.full(problem.size, 1.2))]) == []
    assert search(problem, limit=SearchLimit(problem, "clearances", 0)) == []
    assert problem.not_searched == ["clearances"]
    assert search(springs(fails=lambda effects: len(effects) > 1, swing=0.3)) == []


def test_a_clearance_at_noise_level_gets_only_a_significant_second_effect():
    problem = springs(swing=0.04, candidates=(SWING, PULL, SPRING), fitted_sizes=1)
    fits = search(problem)
    single, pair = (
        min((f for f in fits if len(f.hypothesis) == n), key=lambda f: f.bic) for n in (1, 2)
    )
    assert reduced_chi2(single) < NOISE_ALONE.omnibus
    assert names(pair) == {"spring", "swing"} and single.bic - pair.bic > 10.0
    assert all(
        len(fit.hypothesis) == 1
        for fit in search(problem, replace(NOISE_ALONE, max_gain_threshold=1e3))
    )
