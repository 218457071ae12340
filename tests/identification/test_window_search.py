"""Search for clearances, on an oscillator whose spring may be stiffer: which sizes are tried and
fitted, and with which second effect."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.core.candidates import Parameter
from jointgap.core.errors import SimulationError
from jointgap.identification.evidence import reduced_chi2
from jointgap.identification.likelihood import Estimate
from jointgap.identification.problem import SearchLimit
from jointgap.identification.verdict import Thresholds
from jointgap.identification.window_search import fit_clearances, likely_clearances
from tests.catalogue import each
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
    **changed,
):
    """A problem with a stiffer spring and a force `swing`. The filter's deviance is the distance
    from a place among sizes, and `by_shape` for a damping of 0.3."""

    def deviance(effects):
        if fails(effects):
            raise SimulationError("no such motion")
        spring = effects["spring"]
        return (
            abs(np.interp(spring["size"], SIZES, np.arange(10.0)) - place)
            + by_shape * spring["damping"] / 0.3
        )

    hidden, settings = (
        STIFFER | ({"swing": {"size": swing}} if swing else {}),
        windows(**{"jumps": JUMPS, "likely_deviance": 10.0} | changed),
    )
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


def tried(problem):
    """Places and dampings of the sizes that the filter rated over one turn, in order."""
    asked = problem.model.filtered
    assert {jump for *_, jump, turns in asked if turns == 1.0} <= {JUMPS[0]}
    return [place_of(effects["spring"]) for _, effects, _, turns in asked if turns == 1.0]


def names(fit):
    return {one.name for one in fit.hypothesis}


# Sizes


def test_every_size_is_tried_the_best_that_are_no_neighbours_in_all_shapes_and_the_best_of_these_are_kept():
    every, both = [(at, 0.0) for at in range(10)], (SPRING, HINGE)

    def check(place, by_shape, candidates, counts, kept, shapes):
        settings = dict(zip(("tried_sizes", "fitted_sizes"), counts, strict=True))
        problem = springs(place, by_shape, candidates=candidates, **settings)
        sizes = likely_clearances(baseline_of(problem))
        values = [
            {key.removeprefix(f"{one.label}."): v for key, v in start.items()}
            for (one,), start in sizes
        ]
        assert [place_of(one) for one in values] == kept
        assert [one["zero@slow"] for one in values] == [0.07] * len(
            kept
        )  # as fitted with nominal shared values
        assert (
            tried(problem)[: len(every)] == every
            and tried(problem)[len(every) * len(candidates) :] == shapes
        )

    one = (SPRING,)
    each(
        check,
        [
            *(
                (place, 3.0, one, (1, 1), [(at, 0.0)], [(at, 0.3)])
                for place, at in ((0.0, 0), (3.2, 3), (9.0, 9))
            ),
            (
                4.1,
                3.0,
                one,
                (4, 3),
                [(4, 0.0), (6, 0.0), (2, 0.0)],
                [(4, 0.3), (6, 0.3), (2, 0.3), (8, 0.3)],
            ),
            (4.1, -0.5, one, (4, 1), [(4, 0.3)], [(4, 0.3), (6, 0.3), (2, 0.3), (8, 0.3)]),
            (
                4.1,
                3.0,
                both,
                (2, 2),
                [(4, 0.0), (4, 0.1)],
                [(4, 0.3)],
            ),  # the same size of two joints
        ],
    )
    wide = springs(0.0, size_factor=100.0)
    likely_clearances(baseline_of(wide))
    assert {place for place, _ in tried(wide)} == {0, 9}


def test_a_size_that_cannot_be_simulated_is_no_start_and_a_candidate_without_windows_has_no_sizes():
    problem = springs(
        4.0,
        fails=lambda effects: abs(effects["spring"]["size"] - SIZES[4]) < 1e-9,
        tried_sizes=1,
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
        assert {damping for _, damping in tried(problem)} == dampings and bool(found) == bool(
            dampings
        )
    assert search(problem) == [] and problem.model.filtered == []


def test_no_size_is_kept_if_the_best_one_deviates_too_much():
    for limit, count in ((0.39, 0), (0.41, 2)):
        assert len(likely_clearances(baseline_of(springs(6.4, likely_deviance=limit)))) == count


# Fits


def test_a_clearance_is_fitted_from_its_size():
    problem = springs(candidates=(SPRING,))
    fits = search(problem)
    assert (
        fits[0].mapping["spring.size"] == pytest.approx(0.3, abs=0.05) and fits[0].simulations > 0
    )
    assert reduced_chi2(fits[0]) < NOISE_ALONE.omnibus
    assert [fit.chi2 for fit in fits] == sorted(fit.chi2 for fit in fits)
    assert fits[0].states["slow"].shape == (TURNS * problem.model.per_turn, 2)


def test_the_second_effect_is_found_of_a_clearance_that_leaves_much_more_than_noise_and_goes_no_further_alone():
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


def test_a_clearance_that_leaves_noise_gets_the_second_effect_that_gains_more_than_chance():
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


def test_a_whole_number_of_the_second_effect_keeps_its_start_and_is_among_the_values_of_the_fit():
    order = Parameter("order", 1.0, 1.0, 5.0, 1e-3, integer=True)
    whole = replace(
        SWING, coordinates=(*SWING.coordinates, order), initial_guesses=({"order": 2.0},)
    )
    problem = springs(swing=0.3, candidates=(whole, SPRING), fitted_sizes=1)
    fit = search(problem)[0]
    assert {at["swing"]["order"] for _, at, *_ in problem.model.filtered if "swing" in at} == {2.0}
    assert fit.mapping["swing.order"] == 2.0
