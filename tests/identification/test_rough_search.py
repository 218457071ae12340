"""Effects on which motion depends roughly: features of the cycle lead where samples do not."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import FAST, Parameter
from jointgap.core.errors import SimulationError
from jointgap.identification import decide_by_features, rough_search
from jointgap.identification.baseline import recalibrate
from jointgap.identification.confirmation import HeldOutTest, confirm
from jointgap.identification.decide_by_features import decided_by_features, leaders_by_features, refitted_to_features
from jointgap.identification.decide_verdict import Decision
from jointgap.identification.features import CycleFeatures
from jointgap.identification.fit import (
    MATCHED,
    STOPPED,
    FiniteDifferences,
    Fit,
    effect_estimates,
    fit_hypothesis,
    nuisance_estimates,
)
from jointgap.identification.problem import Problem, label_of
from jointgap.identification.rough_search import can_be_followed, leaves_rough_motion, search_rough
from tests.identification.knocks import LOOSER, knocking
from tests.identification.toy import CANDIDATES, RINGING, candidate_of, ringing, stated_noise, toy

POPULATIONS = 2


def rough(size, seed, other=lambda x, v: 0.0):
    """A baseline of the toy with a ringing hidden, and perhaps another force."""
    model = toy(hidden=lambda x, v, angle, time: ringing(size, angle) + other(x, v), seed=seed)
    model = replace(model, candidates=(*CANDIDATES, RINGING))
    return recalibrate(model, stated_noise(model))


def ring(size, angle):
    """Whitened change of a hit each turn that rings, faster than bins can follow."""
    since = np.mod(angle, 2.0 * np.pi)
    return 20.0 * size * np.exp(-since / (0.5 + size)) * np.cos(100.0 * since + 90.0 * size * since)


def test_features_have_one_broad_minimum_where_samples_have_a_narrow_one():
    problem = Problem(model := toy(samples=360), stated_noise(model))
    angle = np.concatenate([part.series.angle[part.used] for part in problem.parts])
    residual = ring(0.5, angle) + np.random.default_rng(1).standard_normal(problem.size)
    features, of_features, of_samples = CycleFeatures(problem, residual), [], []
    for size in 0.5 * np.array([0.5, 0.6, 0.75, 0.9, 1.0, 1.1, 1.25, 1.5, 2.0]):
        change = ring(size, angle)
        of_features.append(sum(features.misfit(change, run) for run in problem.runs))
        of_samples.append(np.sum((residual - change) ** 2))
    assert np.all(np.diff(of_features[:5]) < 0.0)
    assert np.all(np.diff(of_features[4:]) > 0.0)
    assert np.argmin(of_samples) == 4
    assert min(of_samples[3], of_samples[5]) > np.sum(residual**2)  # ten percent off is worse than nothing


def test_features_of_noise_alone_are_those_of_no_change():
    model = toy(seed=3)
    problem = Problem(model, stated_noise(model))
    noise = np.random.default_rng(0).standard_normal(problem.size)
    features, nothing = CycleFeatures(problem, noise), np.zeros(problem.size)
    bins = 2 * 36 * len(problem.parts)
    assert sum(features.misfit(nothing, run) for run in problem.runs) < 0.75 * bins


def test_features_of_a_run_do_not_depend_on_the_other_runs():
    base = rough(0.31, 4)
    problem, features = base.problem, CycleFeatures(base.problem, base.base.residual)
    change = np.zeros(problem.size)
    first, *others = problem.runs
    before = features.misfit(change, first)
    for part in problem.parts:
        if part.series.run in others:
            change[part.place] = 5.0
    assert features.misfit(change, first) == before


def test_ringing_is_rough_and_a_smooth_force_is_not():
    base = rough(0.31, 4)
    assert leaves_rough_motion(base.problem, base.base)
    smooth = toy({"coulomb": {"force_N": 0.3}}, seed=4)
    base = recalibrate(smooth, stated_noise(smooth))
    assert not leaves_rough_motion(base.problem, base.base)


@pytest.mark.parametrize("size", [0.05, 0.2, 0.6])
def test_the_search_ends_at_the_bottom_of_the_valley(size):
    base = rough(size, 5)
    (found,) = search_rough(base, [base.base], [RINGING], 1.2, POPULATIONS)
    assert found.mapping["ringing.size"] == pytest.approx(size, rel=0.01)
    assert found.chi2 < 1.2 * base.problem.size


def test_an_effect_is_searched_beside_one_that_is_fitted():
    base = rough(0.2, 6, other=lambda x, v: -0.5 * v)
    viscous = next(one for one in CANDIDATES if one.label == "viscous")
    beside = fit_hypothesis(base.problem, (viscous,), refresh=True)
    beside = replace(beside, jacobian=beside.jacobian[:30])  # in fewer rows, as fits come from files
    (found,) = search_rough(base, [beside], [RINGING], 1.2, POPULATIONS)
    assert found.label == "viscous + ringing"
    assert found.mapping["ringing.size"] == pytest.approx(0.2, rel=0.01)
    assert found.mapping["viscous.damping_N_s_m"] == pytest.approx(0.5, rel=0.05)


def test_an_effect_of_which_no_first_point_explains_anything_is_dropped_after_these():
    base = rough(0.2, 5, other=lambda x, v: -3.0 * np.sign(v) * np.abs(v) ** 3)
    never = replace(RINGING, name="spring", coordinates=(replace(RINGING.coordinates[0], name="stiffness_N_m"),))
    never = replace(never, amplitudes=("stiffness_N_m",), initial_guesses=({"stiffness_N_m": 0.1},))
    before = base.problem.simulations
    assert search_rough(base, [base.base], [never], 1.2, 1) == []
    points = 2**base.problem.settings.rough_search.first_points_log2
    derivatives = 2 * len(base.base.parameters)  # simulations at most
    assert base.problem.simulations - before <= (points + derivatives) * len(base.problem.runs)


def rounds_of(monkeypatch, candidates, **changed):
    """Of which candidates points were drawn, one label a round, in a search that samples do not end; its settings."""
    base, rounds = rough(0.2, 5), []
    settings = replace(base.problem.settings.rough_search, matched_misfit=0.0, **changed)
    model = base.problem.model
    problem = Problem(model, stated_noise(model), settings=replace(base.problem.settings, rough_search=settings))
    go_on = rough_search._Contestant.go_on
    monkeypatch.setattr(
        rough_search._Contestant,
        "go_on",
        lambda self, features: rounds.append(self.hypothesis[-1].label) or go_on(self, features),
    )
    blind_to_samples(replace(base, problem=problem), monkeypatch, candidates=candidates)
    return rounds, settings


@pytest.mark.parametrize(("min_behind", "stays"), [(0.0, False), (np.inf, True)])
def test_one_that_may_still_catch_up_is_not_dropped(monkeypatch, min_behind, stays):
    never = replace(RINGING, name="spring", coordinates=(replace(RINGING.coordinates[0], name="stiffness_N_m"),))
    never = replace(never, amplitudes=("stiffness_N_m",), initial_guesses=({"stiffness_N_m": 0.1},))
    rounds, settings = rounds_of(monkeypatch, [RINGING, never], min_behind=min_behind, stalled_rounds=99)
    assert rounds.count("ringing") == POPULATIONS * settings.rounds
    assert rounds.count("spring") == (POPULATIONS * settings.rounds if stays else settings.rounds_for_all)


def test_a_search_that_goes_nowhere_begins_anew_at_once(monkeypatch):
    monkeypatch.setattr(rough_search.CycleFeatures, "misfit", lambda self, change, run: 100.0)
    rounds, settings = rounds_of(monkeypatch, [RINGING], least_explained_share=0.0)
    assert len(rounds) == POPULATIONS * settings.stalled_rounds


def test_a_search_goes_on_as_long_as_one_candidate_comes_nearer(monkeypatch):
    never = replace(RINGING, name="spring", coordinates=(replace(RINGING.coordinates[0], name="stiffness_N_m"),))
    never = replace(never, amplitudes=("stiffness_N_m",), initial_guesses=({"stiffness_N_m": 0.1},))
    comes_nearer = property(lambda self: self.hypothesis[-1].label != "spring")
    monkeypatch.setattr(rough_search._Contestant, "stalled", comes_nearer)
    rounds, settings = rounds_of(monkeypatch, [RINGING, never], min_behind=np.inf)
    assert rounds.count("ringing") == rounds.count("spring") == POPULATIONS * settings.rounds


def test_joints_alone_and_beside_an_effect_compete_in_what_that_effect_leaves(monkeypatch):
    base = rough(0.2, 5, other=lambda x, v: -0.5 * v)
    viscous = candidate_of("viscous")
    beside = fit_hypothesis(base.problem, (viscous,), refresh=True)
    seen, go_on = set(), rough_search._Contestant.go_on

    def watched(one, features):
        go_on(one, features)
        seen.add(label_of(one.hypothesis))
        point = next(point for point in one.points if np.isfinite(point.chi2))
        values = one._origin.mapping | one._box.values(point.place)
        residual, runs = base.problem.residual(values, one.hypothesis, numerics=FAST), base.problem.runs
        left, adapted = one._adaptation.adapted(residual, runs, one._origin.mapping)
        features = CycleFeatures(base.problem, beside.residual)
        assert point.misfit == pytest.approx(sum(features.misfit(beside.residual - left, run) for run in runs))
        assert (point.chi2, point.beside) == (pytest.approx(left @ left), adapted)

    monkeypatch.setattr(rough_search._Contestant, "go_on", watched)
    found = search_rough(base, [base.base, beside], [RINGING], 1.2, 1)
    assert seen == {"ringing", "viscous + ringing"}
    assert min(found, key=lambda fit: fit.bic).label == "viscous + ringing"


def test_a_joint_is_not_searched_beside_itself(monkeypatch):
    base, seen, go_on = rough(0.2, 5), [], rough_search._Contestant.go_on
    itself = fit_hypothesis(base.problem, (RINGING,), {"ringing.size": 0.3}, refresh=True)
    monkeypatch.setattr(
        rough_search._Contestant,
        "go_on",
        lambda one, features: seen.append(label_of(one.hypothesis)) or go_on(one, features),
    )
    search_rough(base, [base.base, itself], [RINGING], 1.2, 1)
    assert set(seen) == {"ringing"}


def test_the_same_search_finds_the_same():
    base = rough(0.2, 5)
    first, second = (search_rough(base, [base.base], [RINGING], 1.2, POPULATIONS)[0] for _ in range(2))
    assert np.array_equal(first.values, second.values)


def fit_at(problem, hypothesis, start):
    """A fit that ends where it begins."""
    parameters = problem.parameters(hypothesis)
    values = {p.key: p.nominal for p in parameters} | dict(start)
    residual = problem.residual(values, hypothesis)
    jacobian = np.zeros((residual.size, len(parameters)))
    return Fit(
        hypothesis,
        parameters,
        np.array([values[p.key] for p in parameters]),
        residual,
        jacobian,
        0,
        STOPPED,
        settings=problem.settings,
    )


def cannot_follow_samples(monkeypatch):
    for module in (rough_search, decide_by_features):
        monkeypatch.setattr(module, "can_be_followed", lambda *args: False)


def blind_to_samples(base, monkeypatch, origin=None, candidates=(RINGING,), others=()):
    """The search where samples cannot be followed and no point of their valley is met: fits end where they begin."""
    cannot_follow_samples(monkeypatch)
    monkeypatch.setattr(rough_search._Contestant, "reached", lambda self, chi2: False)
    monkeypatch.setattr(
        rough_search._Contestant,
        "_fitted",
        lambda self, start, known, sufficient: fit_at(base.problem, self.hypothesis, start),
    )
    return search_rough(base, [origin or base.base], candidates, 0.0, POPULATIONS, others=others)


def test_where_samples_are_not_met_the_best_features_are_the_answer_with_an_interval_that_holds_the_truth(monkeypatch):
    held, sizes = 0, np.array([0.1, 0.2, 0.4, 0.6])
    for seed, size in enumerate(sizes):
        base = rough(size, 10 + seed)
        *_, found = blind_to_samples(base, monkeypatch)
        assert found.status == MATCHED
        estimate = effect_estimates(found, RINGING)["size"]
        low, high = estimate["interval_90"]
        assert estimate["value"] == pytest.approx(size, rel=0.1)
        assert high - low < 0.3 * size
        held += low <= size <= high
        assert {estimate["remark"] for _, estimate in nuisance_estimates(found)} == {"not estimated"}
    assert held >= 3


def test_of_the_best_points_of_the_search_the_usual_numerics_choose(monkeypatch):
    base, seen, usual = rough(0.3, 4), [], Problem.residual

    def coarse(problem, values, hypothesis=(), runs=None, residual=None, numerics=0):
        factor = 1.08 if numerics == FAST and hypothesis else 1.0
        values = {**values, "ringing.size": factor * values["ringing.size"]} if hypothesis else values
        return usual(problem, values, hypothesis, runs, residual, numerics)

    matched = rough_search._Contestant.matched
    monkeypatch.setattr(
        rough_search._Contestant, "matched", lambda self, *args: seen.append(self) or matched(self, *args)
    )
    monkeypatch.setattr(Problem, "residual", coarse)
    *_, found = blind_to_samples(base, monkeypatch)
    (contestant,), features = {*seen}, CycleFeatures(base.problem, base.base.residual)
    best = min(contestant.points, key=lambda point: point.misfit)
    size = contestant._box.values(best.place)["ringing.size"]

    def misfit(values):
        change = base.base.residual - usual(base.problem, {**found.mapping, **values}, found.hypothesis)
        return sum(features.misfit(change, run) for run in base.problem.runs)

    assert 1.08 * size == pytest.approx(0.3, rel=0.05)
    assert misfit({}) < misfit({"ringing.size": size})


def test_points_are_drawn_about_where_a_fit_of_samples_ended_with_what_was_not_searched_as_it_is_there(monkeypatch):
    """Features of the truth are as good as any, wherever the points before were."""
    base, drawn = rough(0.2, 5), []
    ended = base.base.mapping | {"speed@slow": base.base.mapping["speed@slow"] + 1e-4, "ringing.size": 0.2}
    drawn_about = rough_search.drawn_about
    monkeypatch.setattr(
        rough_search, "drawn_about", lambda elite, *args: drawn.append(list(elite)) or drawn_about(elite, *args)
    )
    monkeypatch.setattr(rough_search._Contestant, "reached", lambda self, chi2: False)
    monkeypatch.setattr(rough_search._Contestant, "matched", lambda *args: None)
    monkeypatch.setattr(
        rough_search._Contestant,
        "_fitted",
        lambda self, start, known, sufficient: fit_at(base.problem, self.hypothesis, ended),
    )
    settings = replace(base.problem.settings.rough_search, matched_misfit=0.0)
    problem = Problem(
        base.problem.model,
        stated_noise(base.problem.model),
        settings=replace(base.problem.settings, rough_search=settings),
    )
    simulated, residual = [], Problem.residual
    monkeypatch.setattr(
        Problem, "residual", lambda self, values, *args: simulated.append(values) or residual(self, values, *args)
    )
    search_rough(replace(base, problem=problem), [base.base], [RINGING], 0.0, 2)
    place = rough_search.Box(RINGING, problem.parameters((RINGING,))).place(ended)
    about = [any(np.array_equal(place, one) for one in elite) for elite in drawn]
    assert not about[0] and about[-1]
    speeds = [values["speed@slow"] for values in simulated if "ringing.size" in values]
    assert speeds[0] != ended["speed@slow"] and speeds[-1] == ended["speed@slow"]


def test_points_are_compared_beside_the_nuisances_that_suit_each_best():
    base = rough(0.2, 5)
    problem, fit = base.problem, base.base
    adaptation = rough_search._LinearAdaptation(base, fit)
    p = next(p for p in fit.parameters if p.run is None)
    off = fit.mapping | {p.key: fit.mapping[p.key] + 0.1 * (p.high - fit.mapping[p.key])}
    residual = problem.residual(off)
    moved, adapted = adaptation.adapted(residual, problem.runs, off)
    assert moved @ moved == pytest.approx(fit.chi2, abs=0.05 * (residual @ residual - fit.chi2))
    assert abs(adapted[p.key] - fit.mapping[p.key]) < 0.3 * abs(off[p.key] - fit.mapping[p.key])
    one = problem.runs[:1]
    alone, _ = adaptation.adapted(residual, one, off)
    others = [part.place for part in problem.parts if part.series.run not in one]
    assert all(np.array_equal(alone[place], residual[place]) for place in others)
    replaced = {key: value for key, value in off.items() if key != p.key}
    assert p.key not in adaptation.adapted(residual, problem.runs, replaced)[1]


def test_adapted_nuisances_stay_within_their_ranges():
    base = rough(0.2, 5)
    fit = base.base
    p = next(p for p in fit.parameters if p.run is None)
    inside = fit.mapping | {p.key: p.low + 0.9 * (p.high - p.low)}
    direction = dict(zip([q.key for q in fit.parameters], fit.jacobian.T, strict=True))[p.key]
    beyond = fit.residual - 1e3 * direction * (p.high - p.low)
    _, adapted = rough_search._LinearAdaptation(base, fit).adapted(beyond, base.problem.runs, inside)
    assert adapted[p.key] == pytest.approx(p.high)


def test_where_no_derivative_can_be_simulated_those_of_the_fit_count_or_none(monkeypatch):
    def fails(*args, **kwargs):
        raise SimulationError("at the edge")

    base = rough(0.2, 5)
    monkeypatch.setattr(FiniteDifferences, "jacobian", fails)
    residual, values, runs = base.base.residual + 1.0, base.base.mapping, base.problem.runs
    moved, adapted = rough_search._LinearAdaptation(base, base.base).adapted(residual, runs, values)
    assert adapted and moved @ moved < residual @ residual
    from_file = replace(base.base, jacobian=base.base.jacobian[:30])  # in fewer rows
    moved, adapted = rough_search._LinearAdaptation(base, from_file).adapted(residual, runs, values)
    assert adapted == {} and moved is residual


def test_nothing_is_simulated_where_nothing_is_searched():
    base = rough(0.2, 5)
    before = base.problem.simulations
    assert search_rough(base, [base.base], [], 1.2, POPULATIONS) == []
    assert search_rough(base, [base.base], [RINGING], 1.2, POPULATIONS, until=before - 1) == []
    assert base.problem.simulations == before


def test_a_fit_starts_from_the_nuisances_of_the_origin_where_derivatives_lead_astray(monkeypatch):
    base, starts = rough(0.2, 5), []
    p = next(p for p in base.base.parameters if p.run is None)
    astray = base.base.mapping | {p.key: p.low}
    monkeypatch.setattr(rough_search._LinearAdaptation, "adapted", lambda self, residual, *args: (residual, astray))
    monkeypatch.setattr(
        rough_search._Contestant,
        "_fitted",
        lambda self, start, known, sufficient: starts.append(start) or fit_at(base.problem, self.hypothesis, start),
    )
    search_rough(base, [base.base], [RINGING], 0.0, 1)
    assert starts and all(start[p.key] == base.base.mapping[p.key] for start in starts)


def test_of_a_known_quantity_what_is_left_of_it_is_searched_evenly_in_its_logarithm():
    problem = Problem(model := knocking(), stated_noise(model))
    box = rough_search.Box(LOOSER, problem.parameters((LOOSER,)))
    low, middle, high = (box.values(np.array([place]))["looser.change_mm"] + 0.95 for place in (0.0, 0.5, 1.0))
    assert (low, high) == (pytest.approx(0.45), pytest.approx(2.95))
    assert middle == pytest.approx(np.sqrt(low * high))
    assert box.place({"looser.change_mm": middle - 0.95}) == pytest.approx([0.5])
    assert box.values(np.array([0.5]), 1.1)["looser.change_mm"] + 0.95 == pytest.approx(1.1 * middle)


def test_features_are_matched_beside_an_effect_whose_fit_comes_from_a_file(monkeypatch):
    base = rough(0.2, 6, other=lambda x, v: -0.5 * v)
    viscous = next(one for one in CANDIDATES if one.label == "viscous")
    beside = fit_hypothesis(base.problem, (viscous,), refresh=True)
    beside = replace(beside, jacobian=beside.jacobian[:30])  # in fewer rows
    *_, found = blind_to_samples(base, monkeypatch, beside)
    assert (found.status, found.label) == (MATCHED, "viscous + ringing")
    assert found.mapping["ringing.size"] == pytest.approx(0.2, rel=0.1)


def test_features_are_asked_beside_each_smooth_effect_that_may_be_there(monkeypatch):
    base = rough(0.2, 6, other=lambda x, v: -0.5 * v)
    likely, less = (
        fit_hypothesis(base.problem, (candidate_of(name),), refresh=True) for name in ("viscous", "quadratic")
    )
    one, other = blind_to_samples(base, monkeypatch, likely, others=[less])[-2:]
    assert (one.status, one.label) == (MATCHED, "viscous + ringing")
    assert (other.status, other.label) == (MATCHED, "quadratic + ringing")
    drag = "quadratic.drag_N_s2_m2"
    assert other.mapping[drag] == pytest.approx(less.mapping[drag], rel=1e-3)
    assert other.mapping != pytest.approx(less.mapping | {"ringing.size": other.mapping["ringing.size"]}, rel=1e-12)
    assert other.mapping["ringing.size"] == pytest.approx(0.2, rel=0.1)


def test_features_name_what_leads_by_far_and_call_equal_what_does_not(monkeypatch):
    base = rough(0.3, 4)
    problem, noise = base.problem, base.base.residual
    *_, found = blind_to_samples(base, monkeypatch)
    assert leaders_by_features(problem, base.base, [base.base], [found]) == [found]
    twin = replace(found, hypothesis=(replace(RINGING, name="twin"),))
    assert leaders_by_features(problem, base.base, [], [found, twin]) == [found, twin]
    more = replace(found, hypothesis=(candidate_of("coulomb"), *found.hypothesis))
    assert leaders_by_features(problem, base.base, [], [more, found]) == [found]
    elsewhere = replace(twin, residual=noise + np.roll(found.residual - noise, problem.size // 7))
    assert leaders_by_features(problem, base.base, [], [elsewhere, found]) == [found]
    assert leaders_by_features(problem, base.base, [replace(twin, status="converged")], [found]) == []
    assert leaders_by_features(problem, base.base, [], [elsewhere]) == []


def test_features_decide_only_what_samples_leave_unexplained(monkeypatch):
    base = rough(0.3, 4)
    *_, found = blind_to_samples(base, monkeypatch)
    unexplained = Decision("unexplained", base.base, base.base, best_known=found)

    def never(special, general):
        return False

    assert decided_by_features(base.problem, unexplained, [], never) is unexplained
    assert (
        decided_by_features(base.problem, replace(unexplained, verdict="ambiguous"), [found], never).verdict
        == "ambiguous"
    )
    named = decided_by_features(base.problem, unexplained, [found], never)
    assert (named.verdict, named.chosen, named.best_known) == ("named", found, None)
    several = decided_by_features(base.problem, unexplained, [found, found], never)
    assert (several.verdict, several.chosen, several.equivalent) == ("ambiguous", base.base, [found, found])


def test_a_name_of_samples_that_held_out_data_meet_by_features_alone_rests_on_features():
    """Where samples were met by chance the valley in which their fit ended is none of the truth, however narrow."""
    size, by_features = 0.3, HeldOutTest("falls", 1.3, 1.3, features=(200.0, 100.0))
    base = rough(size, 4)
    chance = fit_at(base.problem, (RINGING,), base.base.mapping | {"ringing.size": 1.02 * size})
    by_samples = Decision("named", chance, base.base)
    found = refitted_to_features(base, by_samples, by_features)
    assert (found.verdict, found.chosen.status, found.chosen.hypothesis) == ("named", MATCHED, (RINGING,))
    low, high = effect_estimates(found.chosen, RINGING)["size"]["interval_90"]
    assert low <= size <= high < 1.4 * low
    assert refitted_to_features(base, found, by_features) is found
    for other in (HeldOutTest("falls", 1.3, 1.0), HeldOutTest("falls", 1.3, 1.2, features=(200.0, 100.0))):
        assert refitted_to_features(base, by_samples, other) is by_samples
    assert found.because.startswith(by_samples.because)
    for other in (
        replace(by_samples, verdict="ambiguous", equivalent=[chance, chance]),
        replace(by_samples, chosen=replace(chance, hypothesis=(candidate_of("coulomb"), RINGING))),
        replace(by_samples, chosen=replace(chance, hypothesis=(candidate_of("coulomb"),))),
        replace(by_samples, chosen=replace(chance, hypothesis=(LOOSER,))),
    ):
        assert refitted_to_features(base, other, by_features) is other


def test_a_name_of_samples_stays_where_the_features_of_the_data_used_for_fitting_are_not_met():
    base = rough(0.0, 4, lambda x, v: 40.0 * np.sin(57.0 * x / 0.01))
    chance = fit_at(base.problem, (RINGING,), base.base.mapping | {"ringing.size": 0.3})
    by_samples = Decision("named", chance, base.base)
    assert refitted_to_features(base, by_samples, HeldOutTest("falls", 1.3, 1.3, features=(200.0, 100.0))) is by_samples


def test_features_name_nothing_where_samples_can_be_followed(monkeypatch):
    base = rough(0.3, 4)
    with monkeypatch.context() as patched:
        *_, found = blind_to_samples(base, patched)
    assert can_be_followed(base.problem, found)
    assert leaders_by_features(base.problem, base.base, [base.base], [found]) == []


def test_a_search_begins_anew_though_features_are_met_where_samples_can_be_followed(monkeypatch):
    base, begun, begin = rough(0.3, 4), [], rough_search._Contestant.begin
    monkeypatch.setattr(
        rough_search._Contestant, "begin", lambda self, features: begun.append(self) or begin(self, features)
    )
    blind_to_samples(base, monkeypatch)
    assert len(begun) == 1
    monkeypatch.setattr(rough_search, "can_be_followed", can_be_followed)
    search_rough(base, [base.base], [RINGING], 0.0, POPULATIONS)
    assert len(begun) == 1 + POPULATIONS
    cannot_follow_samples(monkeypatch)
    monkeypatch.setattr(rough_search._Contestant, "misfit", lambda *args: np.inf)  # met by prediction alone
    search_rough(base, [base.base], [RINGING], 0.0, POPULATIONS)
    assert len(begun) == 1 + 2 * POPULATIONS


def test_features_name_no_parameter_that_stays_within_its_range(monkeypatch):
    """The base is lost at one end of it; a clearance within it, or beyond it, meets the features."""
    cannot_follow_samples(monkeypatch)
    for clearance, verdict in ((1.06, "unexplained"), (1.4, "named")):
        model = knocking(clearance=clearance, seed=2)
        base = recalibrate(model := replace(model, candidates=(*model.candidates, LOOSER)), stated_noise(model))
        true = {p.key: p.nominal for p in base.problem.nuisances}
        lost = fit_at(base.problem, (), {**true, "clearance": 0.9})
        found = fit_at(base.problem, (LOOSER,), {**true, "looser.change_mm": clearance - 1.0})
        found = replace(found, status=MATCHED)
        assert leaders_by_features(base.problem, lost, [], [found]) == [found]
        unexplained = Decision("unexplained", lost, lost)
        assert decided_by_features(base.problem, unexplained, [found], lambda *args: False).verdict == verdict


def test_a_pair_that_was_found_from_either_of_its_effects_is_one_leader(monkeypatch):
    base = rough(0.3, 4)
    *_, found = blind_to_samples(base, monkeypatch)
    one, other = (
        replace(found, hypothesis=tuple(map(candidate_of, names)))
        for names in (("spring", "viscous"), ("viscous", "spring"))
    )
    assert leaders_by_features(base.problem, base.base, [], [one, other]) == [one]


def test_of_two_that_features_call_equal_the_special_case_is_named_unless_they_ask_for_more(monkeypatch):
    base = rough(0.3, 4)
    *_, found = blind_to_samples(base, monkeypatch)
    pairs = [
        replace(found, hypothesis=(candidate_of(name), *found.hypothesis)) for name in ("spring", "constant_force")
    ]

    def is_special(special, general):
        return (special[0].label, general[0].label) == ("constant_force", "spring")

    unexplained = Decision("unexplained", base.base, base.base)
    decision = decided_by_features(base.problem, unexplained, pairs, is_special)
    assert (decision.verdict, decision.chosen.label) == ("named", "constant_force + ringing")
    spring, constant = pairs
    farther = fit_at(
        base.problem, found.hypothesis, {**found.mapping, "ringing.size": 1.1 * found.mapping["ringing.size"]}
    )
    constant = replace(constant, residual=farther.residual)
    decision = decided_by_features(base.problem, unexplained, [spring, constant], is_special)
    assert (decision.verdict, decision.equivalent) == ("ambiguous", [spring, constant])


def test_held_out_data_confirm_by_features_what_rings_in_another_phase_and_not_what_is_elsewhere():
    base = rough(0.3, 4)
    model, problem = base.problem.model, base.problem
    found = fit_hypothesis(problem, (RINGING,), {"ringing.size": 0.3}, differences=base.differences)
    place = [p.key for p in found.parameters].index("ringing.size")

    def held_out(size):
        values = found.values.copy()
        values[place] = size
        return confirm(model, stated_noise(model), base.base, replace(found, values=values)).test

    assert held_out(found.values[place]).features is None  # samples fall
    near = held_out(1.12 * found.values[place])
    assert near.after > near.before
    assert near.outcome == "falls"
    assert near.features[0] - near.features[1] > 10.0
    assert held_out(0.02).features is None


def with_starts():
    """A baseline in which a ringing is hidden, a candidate of it with a start in each run, and one that competes."""
    base = rough(0.5, seed=4)
    starts = tuple(Parameter("start", 0.0, 0.0, 3.0, run=run, whole=True) for run in base.problem.runs)
    shape = Parameter("shape", 0.2, 0.0, 1.0)
    guess = dict(RINGING.initial_guesses[0]) | {p.key: p.nominal for p in (*starts, shape)}
    candidate = replace(
        RINGING,
        coordinates=(*RINGING.coordinates, shape, *starts),
        initial_guesses=(guess,),
        unsearched=("shape",),
    )
    adaptation = rough_search._LinearAdaptation(base, base.base)
    return base, rough_search._Contestant(base, base.base, adaptation, base.base, candidate, 0)


def test_starts_and_what_is_not_searched_are_no_coordinates_of_a_place():
    base, one = with_starts()
    label = RINGING.label
    box = one._box
    assert not {f"{label}.shape", *box.choices} & box.values(np.full(len(box._keys), 0.5)).keys()
    assert set(box.choices) == {f"{label}.start@{run}" for run in base.problem.runs}
    assert box.held == {f"{label}.shape": 0.2}


def test_a_point_has_the_starts_of_the_one_that_it_is_about_and_some_of_its_own():
    _, one = with_starts()
    parent = rough_search._Point(np.zeros(1), 0.0, 0.0, dict.fromkeys(one._box.choices, 2.0))
    drawn = [one._drawn_choices(parent) for _ in range(200)]
    kept = np.mean([[value == 2.0 for value in each.values()] for each in drawn])
    assert kept == pytest.approx(0.5 + 0.5 / 4, abs=0.06)  # of four starts the same one may be drawn again
    anew = [one._drawn_choices(None) for _ in range(200)]
    assert np.mean([[value == 2.0 for value in each.values()] for each in anew]) == pytest.approx(0.25, abs=0.06)


def test_a_run_in_another_motion_counts_as_if_nothing_were_changed_in_it():
    base, one = with_starts()
    first = next(part for part in base.problem.parts if part.series.run == base.problem.runs[0])
    worse = base.base.residual.copy()
    worse[first.place] += 100.0
    assert worse @ worse > 2.0 * base.base.chi2
    assert one._chi2(worse) == pytest.approx(base.base.chi2)


@pytest.mark.parametrize(("share", "is_reached"), [(0.89, False), (0.91, True)])
def test_a_joint_that_explains_hardly_less_than_the_best_effect_lies_in_a_valley(share, is_reached):
    base, one = with_starts()
    excess = base.base.chi2 - base.problem.size
    best = replace(base.base, residual=base.base.residual * np.sqrt(1.0 - 0.9 * excess / base.base.chi2))
    one._reference = best
    assert one.reached(base.base.chi2 - share * 0.9 * excess) == is_reached
