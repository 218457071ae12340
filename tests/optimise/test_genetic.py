import numpy as np
import pytest

from jointgap.config import Genetic
from jointgap.lengths.search import evaluations_until, evolve, search_from_all

OPTIONS = Genetic(population=20, generations=100, seed=5)


@pytest.fixture(scope="module")
def run(objective, region):
    return evolve(objective, region, OPTIONS)


def test_it_finds_what_a_dense_grid_finds(objective, region, run):
    cranks, rods = np.meshgrid(
        np.linspace(region.lower[0], region.upper[0], 241), np.linspace(region.lower[1], region.upper[1], 241)
    )
    points = np.stack([cranks.ravel(), rods.ravel()], axis=1)
    points = points[region.contains(points, slack=1e-12)]
    best = min(np.min(objective.value(part)) for part in np.array_split(points, 100))
    assert run.value <= best * (1 + 1e-3)


def test_it_comes_near_the_local_optimum(objective, region, run):
    best = min(result.value for result in search_from_all(objective, region, 1e-12))
    assert best * (1 - 1e-9) <= run.value <= best * (1 + 1e-3)


def test_the_best_never_gets_worse(run):
    best = run.population.groupby("generation")["sum_of_squares"].min().to_numpy()
    assert np.all(np.diff(best) <= 0.0)
    assert best[-1] == run.value


def test_elites_are_the_best_two_of_the_generation_before(run):
    generations = dict(list(run.population.groupby("generation")))
    for number in range(1, len(generations)):
        elites = generations[number].query("origin == 'elite'")
        before = np.sort(generations[number - 1]["sum_of_squares"])
        assert np.array_equal(np.sort(elites["sum_of_squares"]), before[:2])


def test_each_generation_has_the_configured_shares(run):
    for number, generation in run.population.groupby("generation"):
        origins = generation["origin"].value_counts().to_dict()
        assert origins == ({"first": 20} if number == 0 else {"elite": 2, "crossover": 14, "mutation": 4})


def test_every_individual_is_allowed_and_has_its_own_value(objective, region, run):
    lengths = run.population[["crank_length", "rod_length"]].to_numpy()
    assert region.contains(lengths, slack=1e-15).all()
    assert objective.value(lengths) == pytest.approx(run.population["sum_of_squares"].to_numpy(), rel=1e-13)


def test_evaluations_are_counted_without_the_elites(run):
    assert run.evaluations == 20 + 100 * 18 == len(run.values)
    assert run.population["evaluations"].max() == run.evaluations


def test_the_same_seed_gives_the_same_run_and_another_seed_another(objective, region, run):
    assert evolve(objective, region, OPTIONS).population.equals(run.population)
    other = evolve(objective, region, OPTIONS.model_copy(update={"seed": 6}))
    assert not other.population.equals(run.population)


def test_evaluations_until_counts_up_to_the_first_that_is_near():
    values = np.array([9.0, 3.0, 1.1, 1.0])
    assert evaluations_until(values, 1.0, 0.2) == 3
    assert evaluations_until(values, 1.0, 0.0) == 4
    assert evaluations_until(values, 0.5, 0.1) is None
