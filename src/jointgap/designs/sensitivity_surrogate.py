"""A surrogate of one measure of a sweep: a sum of orthonormal terms of its parameters, and how well it predicts.

Two kinds are tried, and the one that predicts validation designs better is taken: a polynomial chaos expansion, whose
terms are all up to a degree or chosen by least angle regression, with coefficients by least squares; and a Gaussian
process (kriging) with a nugget, whose mean is written in such terms. Both are linear in the measure once their terms or
covariance are chosen, which makes the bootstrap cheap.

Sources: Blatman and Sudret, J. Comput. Phys. 230 (2011) 2345 (sparse expansion); Rasmussen and Williams, Gaussian
Processes for Machine Learning (2006); Wu, Ann. Stat. 14 (1986) 1261 (the bootstrap, for residuals of unequal size).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from jointgap.core.errors import needs
from jointgap.designs.sensitivity_inputs import Inputs
from jointgap.designs.sensitivity_settings import SensitivitySettings

with needs("what decides a sweep", "learn"):
    import openturns as ot

EXPANSION, KRIGING = "chaos expansion", "Gaussian process"

_POINTS_PER_TERM = 8
"""Points over the ranges at which the mean of a Gaussian process is read, for each term that it is written in."""

_LEAST_LEFT = 0.1
"""A residual is made at most ten times as large where its design decides the surrogate there by itself."""


@dataclass(frozen=True)
class Smoother:
    """How coefficients of terms follow from the values of a measure."""

    kind: str
    terms: np.ndarray  # Degree in each input, (terms, inputs); the first term is the constant
    designs: np.ndarray  # Places of the designs that it uses, (n,)
    matrix: np.ndarray  # Coefficients are this (terms, n) times the measure's values (n,)


@dataclass(frozen=True)
class Surrogate:
    """A trained surrogate; values [SI of the measure]."""

    kind: str
    terms: np.ndarray  # Degree in each input, (terms, inputs); the first term is the constant
    coefficients: np.ndarray  # Of the terms, (terms,)
    replicates: np.ndarray  # The same of bootstrap replicates, (terms, replicates)
    q2: float  # Share of the variance of held-out designs that it explains
    q2_replicates: np.ndarray  # The same of the replicates, each on designs drawn anew of those held out, (replicates,)
    ends: tuple[float, float]  # Smallest and largest value of the designs, between which every mean lies
    trained: int  # Numbers of designs
    held_out: int  # Numbers of designs

    def mean(self, terms_at: np.ndarray) -> np.ndarray:
        """Mean (n,) of the measure where its terms have the means `terms_at` (n, terms)."""
        return np.clip(terms_at @ self.coefficients, *self.ends)

    def mean_interval(self, terms_at: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
        """Quantiles `ends` of the replicates of that mean, (2, n), around the mean itself; `terms_at` as of `mean`."""
        low, high = np.clip(np.quantile(terms_at @ self.replicates, ends, axis=1), *self.ends)
        mean = self.mean(terms_at)
        return np.array([np.minimum(low, mean), np.maximum(high, mean)])


class Training:
    """Designs for which surrogates of one measure after another are trained and judged."""

    def __init__(self, inputs: Inputs, standard: np.ndarray, seed: int, settings: SensitivitySettings):
        ot.TBB.Disable()  # one thread: a job has one core, and sums keep their order
        # No warning where a search for a covariance ends early: the error on validation designs tells what it is worth.
        ot.Log.Show(ot.Log.ERROR)
        self._inputs, self._standard, self._seed, self._settings = inputs, standard, seed, settings
        order = np.random.default_rng(seed).permutation(len(standard))[: settings.most_designs]
        self._held, self._rest = _cut(order, settings.held_out)
        self._validation, self._fitted = _cut(self._rest, settings.validated)
        self._whole: dict[tuple[int, int], Smoother] = {}

    def surrogate(self, values: np.ndarray) -> Surrogate:
        """The surrogate of a measure whose values (n,) are finite [SI]."""
        rest, held = values[self._rest], values[self._held]
        middle, spread = np.mean(rest), np.std(rest) or 1.0
        scaled, held = (values - middle) / spread, (held - middle) / spread

        def error(way: _Way) -> float:
            tried = _tried(way, scaled, self._fitted)
            if tried is None:
                return math.inf
            predicted = self._terms_at(tried, self._validation) @ (tried.matrix @ scaled[tried.designs])
            return np.mean((scaled[self._validation] - predicted) ** 2)

        trained = (_tried(way, scaled, self._rest) for way in sorted(self._ways(), key=error))
        chosen = next(each for each in trained if each is not None)
        coefficients = chosen.matrix @ scaled[chosen.designs]
        chance, number = np.random.default_rng([self._seed, 1]), self._settings.replicates
        residuals = self._residuals_left_out(chosen, scaled[chosen.designs], coefficients)
        signs = chance.choice([-1.0, 1.0], size=(len(residuals), number))
        replicates = coefficients[:, None] + chosen.matrix @ (residuals[:, None] * signs)
        at_held = self._terms_at(chosen, self._held)
        drawn = chance.integers(len(held), size=(number, len(held)))
        errors = held[:, None] - at_held @ replicates
        constant = np.zeros(len(coefficients))
        constant[0] = middle
        return Surrogate(
            kind=chosen.kind,
            terms=chosen.terms,
            coefficients=constant + spread * coefficients,
            replicates=constant[:, None] + spread * replicates,
            q2=_explained(held - at_held @ coefficients, held),
            q2_replicates=np.array([_explained(errors[rows, n], held[rows]) for n, rows in enumerate(drawn)]),
            ends=(float(np.min(values)), float(np.max(values))),
            trained=len(chosen.designs),
            held_out=len(held),
        )

    def _terms_at(self, smoother: Smoother, designs: np.ndarray) -> np.ndarray:
        return self._inputs.evaluated(smoother.terms, self._standard[designs])

    def _residuals_left_out(self, chosen: Smoother, values: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """Residual of each training design from the surrogate that is trained without it, so that many terms do not
        make them small.
        """
        at = self._terms_at(chosen, chosen.designs)
        leverage = np.einsum("ij,ji->i", at, chosen.matrix)
        return (values - at @ coefficients) / np.maximum(1.0 - leverage, _LEAST_LEFT)

    def _ways(self) -> "list[_Way]":
        """The surrogates that are tried."""
        settings = self._settings
        sizes = {degree: len(self._inputs.terms(degree)) for degree in range(1, settings.highest_degree + 1)}
        most = min(settings.most_terms, len(self._fitted) / settings.designs_per_term)
        # Where lists alone vary, no terms are added beyond some degree.
        whole = {size: degree for degree, size in reversed(sizes.items()) if size <= most}
        sparse = max((degree for degree, size in sizes.items() if size <= settings.selection_terms), default=1)
        return [
            *(partial(self._all_terms, degree) for degree in sorted(whole.values())),
            partial(self._chosen_terms, sparse),
            partial(self._kriging, sparse),
        ]

    def _all_terms(self, degree: int, values: np.ndarray, designs: np.ndarray) -> Smoother:
        """All terms up to a degree; the same for each measure."""
        key = degree, len(designs)
        if key not in self._whole:
            self._whole[key] = self._least_squares(self._inputs.terms(degree), designs)
        return self._whole[key]

    def _least_squares(self, terms: np.ndarray, designs: np.ndarray) -> Smoother:
        at = self._inputs.evaluated(terms, self._standard[designs])
        # The terms are nearly orthonormal on the designs, so that the normal equations lose no digits that matter.
        return Smoother(EXPANSION, terms, designs, np.linalg.pinv(at.T @ at, hermitian=True) @ at.T)

    def _chosen_terms(self, degree: int, values: np.ndarray, designs: np.ndarray) -> Smoother:
        """Terms that least angle regression chooses on a part of the designs; their coefficients are of all."""
        terms, few = self._inputs.terms(degree), designs[: self._settings.selection_designs]
        selection = ot.LeastSquaresMetaModelSelectionFactory(ot.LARS(), ot.CorrectedLeaveOneOut())
        algorithm = ot.FunctionalChaosAlgorithm(
            self._standard[few],
            values[few][:, None],
            self._inputs.distribution,
            ot.FixedStrategy(self._inputs.basis, len(terms)),
            ot.LeastSquaresStrategy(selection),
        )
        algorithm.run()
        return self._least_squares(terms[sorted({0, *algorithm.getResult().getIndices()})], designs)

    def _kriging(self, degree: int, values: np.ndarray, designs: np.ndarray) -> Smoother:
        """A Gaussian process of a part of the designs, its mean written in terms up to a degree."""
        few, terms = designs[: self._settings.kriging_designs], self._inputs.terms(degree)
        covariance = ot.MaternModel([1.0] * len(self._inputs.each), [1.0], 2.5)
        covariance.setNuggetFactor(1e-3)
        covariance.activateNuggetFactor(True)
        trend = ot.ConstantBasisFactory(len(self._inputs.each)).build()
        fitter = ot.GaussianProcessFitter(self._standard[few], values[few][:, None], covariance, trend)
        fitter.run()
        trained = fitter.getResult().getCovarianceModel()
        points = self._inputs.even_points(_POINTS_PER_TERM * len(terms))
        across = np.array(trained.computeCrossCovariance(points, self._standard[few]))
        mean = np.linalg.solve(np.array(trained.discretize(self._standard[few])), across.T).T
        return Smoother(KRIGING, terms, few, np.linalg.pinv(self._inputs.evaluated(terms, points)) @ mean)


_Way = Callable[[np.ndarray, np.ndarray], Smoother]
"""Trains one kind of surrogate, of scaled values and the places of the designs to take."""


def _tried(way: _Way, scaled: np.ndarray, places: np.ndarray) -> Smoother | None:
    """What a way makes of these designs; None where OpenTURNS cannot, as of values that are all the same but a few."""
    try:
        return way(scaled, places)
    except (RuntimeError, TypeError):  # what its wrapper raises, whatever went wrong
        return None


def _cut(places: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
    number = max(1, round(share * len(places)))
    return places[:number], places[number:]


def _explained(errors: np.ndarray, values: np.ndarray) -> float:
    """1 less the mean squared error over the variance; 0 where nothing varies."""
    variance = np.var(values)
    return float(1.0 - np.mean(errors**2) / variance) if variance > 0.0 else 0.0
