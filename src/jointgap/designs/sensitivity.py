"""Sobol indices and main effects of the measures of a sweep, read from a surrogate of each.

A surrogate is a sum of orthonormal terms of the parameters: a polynomial chaos expansion (Blatman and Sudret, J.
Comput. Phys. 230 (2011) 2345) or a Gaussian process whose mean is written in such terms; the one that predicts
validation designs better is taken. The variance of each term belongs to the parameters in it (Sudret, Reliab. Eng.
Syst. Saf. 93 (2008) 964). What the surrogate misses, 1 - Q2, belongs to parameters that nobody knows, so an
interval runs from

    Q2 S  to  Q2 S + 1 - Q2,

each end that of a 90 % interval of bootstrap replicates (Wu, Ann. Stat. 14 (1986) 1261) of surrogate and Q2.
"""

import math
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial, reduce
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from jointgap.config.measures import ALL_MEASURES
from jointgap.config.sensitivity_config import Sensitivity
from jointgap.core import parquet, plot, schema
from jointgap.core.errors import InputError, needs
from jointgap.core.page import FigureBlock, Heading, Page, Paragraph, TableBlock, to_html, to_markdown
from jointgap.core.plot import COLOURS, Drawing, Panel, Quantity, Sheet, tick_label
from jointgap.core.progress import followed
from jointgap.core.words import joined
from jointgap.designs.page import (
    measure_in_words,
    measure_quantity,
    parameter_in_words,
    parameter_quantity,
)
from jointgap.designs.sampling import Axis, Designs

with needs("what decides a sweep", "learn"):
    import openturns as ot


@dataclass(frozen=True)
class SensitivitySettings:
    """How surrogates are trained and judged, and where there are no indices."""

    least_q2: float = 0.8  # [1] Share of the variance of held-out designs that a surrogate has to explain
    most_missing: float = 0.1
    least_designs: int = 50  # Designs with the measure
    held_out: float = 0.2  # [1] Share of designs that the surrogate is judged by and not trained on: the usual fifth
    validated: float = 0.25
    most_designs: int = 20_000  # Designs that are looked at, drawn at random of a larger sweep
    most_terms: int = 500  # Terms of a chaos expansion that are tried
    designs_per_term: int = 8  # Training designs for each term where all terms are kept
    norm: float = 0.75  # [1] Of the hyperbolic truncation
    highest_degree: int = 10  # Of the polynomials
    selection_designs: int = 600  # Designs on which sparse terms are chosen (least angle regression)
    selection_terms: int = 220  # Terms from which it chooses
    kriging_designs: int = 400  # Designs that a Gaussian process is trained on
    replicates: int = 400  # Of the bootstrap: the ends of a 90 % interval are then known to a tenth of its length
    confidence: float = 0.9  # [1] Of all intervals: 90 %, as everywhere in jointgap
    rounding: float = 1e-9  # [1] A measure whose standard deviation is a smaller share of its mean does not vary
    curve_points: int = 41  # Of a main effect, and of a map along each axis: a curve looks smooth
    shown_share: float = 0.01  # [1] Total index from which on a parameter's main effect is drawn


SETTINGS = SensitivitySettings()


_FAR = 8.0
"""Standard deviations beyond which no design of a normal tolerance lies (1e-15 of them would), though it has no end."""


@dataclass(frozen=True)
class Input:
    """One parameter that varies."""

    axis: Axis

    @cached_property
    def ends(self) -> tuple[float, float]:
        """Lower and upper end of a range, in the variable in which it is drawn evenly: SI, its logarithm, or
        standard deviations.
        """
        name, given = self.axis.law.dist.name, self.axis.law.kwds
        if name == "truncnorm":
            return max(given["a"], -_FAR), min(given["b"], _FAR)
        low, high = self.axis.law.support()
        return (math.log(low), math.log(high)) if name == "loguniform" else (float(low), float(high))

    @property
    def is_unbounded(self) -> bool:
        """Whether it is a normal tolerance without ends."""
        law = self.axis.law
        return law is not None and law.dist.name == "truncnorm" and math.isinf(law.kwds["a"]) and math.isinf(
            law.kwds["b"]
        )  # fmt: skip

    @cached_property
    def measure(self) -> Any:
        """Distribution of the standard variable, of OpenTURNS."""
        if self.axis.values is not None:
            return ot.FiniteDiscreteDistribution([[place] for place in self.levels])
        name, (low, high) = self.axis.law.dist.name, self.ends
        if name == "triang":
            return ot.Triangular(-1.0, 2.0 * self.axis.law.kwds["c"] - 1.0, 1.0)
        if name != "truncnorm":
            return ot.Uniform(-1.0, 1.0)
        if self.is_unbounded:
            return ot.Normal()
        half = (high - low) / 2.0
        return ot.TruncatedNormal(-(low + high) / 2.0 / half, 1.0 / half, -1.0, 1.0)

    @property
    def levels(self) -> np.ndarray:
        """Standard variable of each value of a list."""
        return np.linspace(-1.0, 1.0, len(self.axis.values))

    @property
    def highest_degree(self) -> int | None:
        """Of polynomials that differ on its values; None for a range."""
        return None if self.axis.values is None else len(self.axis.values) - 1

    def standard(self, values: np.ndarray) -> np.ndarray:
        """Standard variable (n,) of `values` (n,) as they stand in the table of designs."""
        if self.axis.values is not None:
            place = {value: level for value, level in zip(self.axis.values, self.levels, strict=True)}
            return np.array([place[value] for value in values.tolist()])
        name, given = self.axis.law.dist.name, self.axis.law.kwds
        values = np.asarray(values, dtype=float)
        if name == "truncnorm":
            values = (values - given["loc"]) / given["scale"]
        elif name == "loguniform":
            values = np.log(values)
        low, high = self.ends
        return values if self.is_unbounded else np.clip(2.0 * (values - low) / (high - low) - 1.0, -1.0, 1.0)

    def curve(self, points: int) -> np.ndarray:
        """Values to draw over: all of a list, `points` of a range, evenly apart where it is drawn evenly; of a normal
        tolerance those between the 1 % and the 99 % quantile.
        """
        if self.axis.values is not None:
            return np.array(self.axis.values, dtype=object if self.axis.column.kind != "float" else float)
        law = self.axis.law
        low, high = law.ppf([0.01, 0.99]) if law.dist.name == "truncnorm" else law.support()
        return np.geomspace(low, high, points) if law.dist.name == "loguniform" else np.linspace(low, high, points)

    def polynomials(self, standard: np.ndarray, degree: int) -> np.ndarray:
        """Orthonormal polynomials (degree + 1, n) of the standard variable (n,), by their recurrence."""
        factory = ot.StandardDistributionPolynomialFactory(self.measure)
        found = [np.ones_like(standard)]
        for n in range(degree):
            a, b, c = factory.getRecurrenceCoefficients(n)
            found.append((a * standard + b) * found[-1] + (c * found[-2] if n else 0.0))
        return np.array(found)


@dataclass(frozen=True)
class Inputs:
    """All parameters that vary, in the order of the sweep."""

    each: tuple[Input, ...]
    norm: float  # Of the hyperbolic truncation of the terms' degrees (Blatman and Sudret 2011)

    @cached_property
    def distribution(self) -> Any:
        """Joint distribution of the standard variables, of OpenTURNS."""
        return ot.JointDistribution([one.measure for one in self.each])

    @cached_property
    def _enumeration(self) -> Any:
        order = ot.HyperbolicAnisotropicEnumerateFunction(len(self.each), self.norm)
        unlimited = np.iinfo(np.uint32).max
        order.setUpperBound([unlimited if one.highest_degree is None else one.highest_degree for one in self.each])
        return order

    @cached_property
    def basis(self) -> Any:
        """The products of their polynomials in the order of `terms`, of OpenTURNS."""
        factories = [ot.StandardDistributionPolynomialFactory(one.measure) for one in self.each]
        return ot.OrthogonalProductPolynomialFactory(factories, self._enumeration)

    def terms(self, degree: int) -> np.ndarray:
        """Degree in each input of the terms up to a `degree`, (terms, inputs); the first is the constant."""
        highest = [one.highest_degree for one in self.each]
        if None in highest:
            number = self._enumeration.getBasisSizeFromTotalDegree(degree)
        else:  # of lists alone there are as many terms as combinations of their values, and OpenTURNS counts beyond
            of_degree = reduce(np.convolve, (np.ones(one + 1) for one in highest))
            number = int(of_degree[: degree + 1].sum())
        return np.array([list(self._enumeration(place)) for place in range(number)], dtype=int)

    def standard(self, columns: dict[str, np.ndarray]) -> np.ndarray:
        """Standard variables (n, inputs) of the designs' `columns`, each (n,), by the parameter's key."""
        return np.column_stack([one.standard(columns[one.axis.key]) for one in self.each])

    def evaluated(self, terms: np.ndarray, standard: np.ndarray) -> np.ndarray:
        """Values (n, terms) of products of polynomials at standard variables (n, inputs)."""
        product = np.ones((len(standard), len(terms)))
        for place, one in enumerate(self.each):
            if highest := int(terms[:, place].max(initial=0)):
                product *= one.polynomials(standard[:, place], highest)[terms[:, place]].T
        return product

    def even_points(self, number: int) -> np.ndarray:
        """Standard variables (number, inputs) of points as even as the designs of a Sobol sequence."""
        return np.array(ot.LowDiscrepancyExperiment(ot.SobolSequence(), self.distribution, number, False).generate())


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


TABLES_OF_SENSITIVITY = (schema.SENSITIVITY_SURROGATES, schema.SENSITIVITY_INDICES, schema.SENSITIVITY_EFFECTS)

UNITS = {column.name: column.unit for column in ALL_MEASURES}
"""SI unit of each measure."""


@dataclass(frozen=True)
class SensitivityResult:
    """What decides the measures of a sweep."""

    inputs: Inputs  # The parameters that vary
    number: int  # Designs, and those that failed
    failed: int  # Designs, and those that failed
    surrogates: pd.DataFrame
    indices: pd.DataFrame
    effects: pd.DataFrame
    good: dict[str, Surrogate]  # Of the measures that have indices


def what_decides(
    designs: Designs, dataset: Path, options: Sensitivity, settings: SensitivitySettings = SETTINGS
) -> SensitivityResult:
    """Indices of the measures of a sweep."""
    names = options.measures or [column.name for column in designs.measured]
    columns = [*(axis.key for axis in designs.axes), "reason", *names]
    return decided(designs, parquet.read_columns(dataset, columns).to_pandas(), names, options.seed, settings)


def decided(
    designs: Designs, frame: pd.DataFrame, measures: Sequence[str], seed: int, settings: SensitivitySettings = SETTINGS
) -> SensitivityResult:
    """The same of a `frame` with the parameters, `reason` and `measures` of the designs as columns.

    The `seed` is that of all drawing, `settings` are the limits.
    """
    each = tuple(Input(axis) for axis in designs.axes if axis.values is None or len(axis.values) > 1)
    if not each:
        raise InputError("sweep.parameters: none varies, each has one value; give a range or a list of several values")
    inputs = Inputs(each, settings.norm)
    standard = inputs.standard({one.axis.key: frame[one.axis.key].to_numpy() for one in each})
    fine = frame["reason"].isna().to_numpy()
    trainings: dict[bytes, Training] = {}
    surrogates, indices, effects, good = [], [], [], {}
    for name in followed(iter(measures), "measures", len(measures)):
        values = frame[name].to_numpy(dtype=float)
        there = fine & np.isfinite(values)
        counts = {"failed": int((~fine).sum()), "undefined": int((fine & ~there).sum())}
        reason = _unfit(values[there], len(values), counts, settings)
        found = None
        if not reason:
            key = np.packbits(there).tobytes()
            if key not in trainings:
                trainings[key] = Training(inputs, standard[there], seed, settings)
            found = trainings[key].surrogate(values[there])
            if found.q2 < settings.least_q2:
                reason = (
                    f"the surrogate explains {100 * max(found.q2, 0.0):.0f} % of the variance of held-out designs, "
                    f"less than {100 * settings.least_q2:.0f} %"
                )
        surrogates.append(_surrogate_row(name, values[there], found, settings) | counts | {"reason": reason})
        if found and not reason:
            good[name] = found
            indices += _index_rows(name, inputs, found, settings)
            effects += _effect_rows(name, inputs, found, settings)
    made = (
        pd.DataFrame(rows, columns=table.names)
        for table, rows in zip(TABLES_OF_SENSITIVITY, (surrogates, indices, effects), strict=True)
    )
    return SensitivityResult(inputs, len(frame), int((~fine).sum()), *made, good)


def _unfit(values: np.ndarray, number: int, counts: dict[str, int], settings: SensitivitySettings) -> str | None:
    """Why no surrogate is made of a measure with these finite `values`."""
    missing = sum(counts.values())
    if not len(values):
        return "no design has it"
    if np.std(values) <= settings.rounding * np.abs(values).max():
        return "it is the same for all designs"
    if missing > settings.most_missing * number:
        whose = " and ".join(f"{count} {what}" for what, count in counts.items() if count)
        most = f"more than {100 * settings.most_missing:.0f} %"
        return f"{100 * missing / number:.0f} % of the designs lack it ({whose}), {most}"
    if len(values) < settings.least_designs:
        return f"{len(values)} designs have it, fewer than {settings.least_designs}"
    return None


def _surrogate_row(name: str, values: np.ndarray, found: Surrogate | None, settings: SensitivitySettings) -> dict:
    row = {"measure": name, "kind": None, "terms": 0, "trained": 0, "held_out": 0, "q2": np.nan}
    row |= {"q2_low": np.nan, "q2_high": np.nan, "unit": UNITS[name]}
    row |= {"mean": np.mean(values) if len(values) else np.nan, "deviation": np.std(values) if len(values) else np.nan}
    if found is None:
        return row
    low, high = np.quantile(found.q2_replicates, _ends(settings))
    return row | {
        "kind": found.kind,
        "terms": len(found.terms),
        "trained": found.trained,
        "held_out": found.held_out,
        "q2": found.q2,
        "q2_low": min(low, found.q2),
        "q2_high": max(high, found.q2),
    }


def _ends(settings: SensitivitySettings) -> tuple[float, float]:
    return (1.0 - settings.confidence) / 2.0, (1.0 + settings.confidence) / 2.0


def _index_rows(name: str, inputs: Inputs, found: Surrogate, settings: SensitivitySettings) -> list[dict]:
    low, high = _ends(settings)
    active = found.terms > 0
    rows = []
    for place, one in enumerate(inputs.each):
        row = {"measure": name, "parameter": one.axis.key}
        alone = active[:, place] & (active.sum(axis=1) == 1)
        for index, whose in (("first_order", alone), ("total", active[:, place])):
            replicate = _share(found.replicates, whose) * found.q2_replicates
            open_end = replicate + 1.0 - found.q2_replicates
            value = float(_share(found.coefficients, whose))
            row |= {
                index: value,
                f"{index}_low": max(0.0, min(value, np.quantile(replicate, low))),
                f"{index}_high": min(1.0, max(value, np.quantile(open_end, high))),
            }
        rows.append(row)
    return rows


def _share(coefficients: np.ndarray, whose: np.ndarray) -> np.ndarray:
    """Share of the variance of terms (terms, ...) that those of `whose` (terms,) have."""
    variances = coefficients[1:] ** 2
    return variances[whose[1:]].sum(axis=0) / variances.sum(axis=0)


def _effect_rows(name: str, inputs: Inputs, found: Surrogate, settings: SensitivitySettings) -> list[dict]:
    rows = []
    for place, one in enumerate(inputs.each):
        values = one.curve(settings.curve_points)
        at = conditional_terms(inputs, found.terms, {place: one.standard(values)})
        words = one.axis.column.kind != "float"
        curves = found.mean(at), *found.mean_interval(at, _ends(settings))
        for value, *curve in zip(values, *curves, strict=True):
            row = {"measure": name, "parameter": one.axis.key, "unit": UNITS[name], "value_unit": one.axis.unit}
            row |= {"value": np.nan if words else float(value), "word": str(value) if words else None}
            rows.append(row | dict(zip(("effect", "effect_low", "effect_high"), curve, strict=True)))
    return rows


def conditional_terms(inputs: Inputs, terms: np.ndarray, given: dict[int, np.ndarray]) -> np.ndarray:
    """Means (n, terms) of the terms where some inputs have given values and the others vary as in the sweep."""
    others = [place for place in range(len(inputs.each)) if place not in given]
    standard = np.zeros((len(next(iter(given.values()))), len(inputs.each)))
    for place, values in given.items():
        standard[:, place] = values
    kept = (terms[:, others] == 0).all(axis=1)
    means = np.zeros((len(standard), len(terms)))
    means[:, kept] = inputs.evaluated(terms[kept], standard)
    return means


INDICES, EFFECTS, MAP = "indices", "main_effects", "map"
"""Names of the figures; those of a measure are ``main_effects_<measure>`` and ``map_<measure>``."""

_IN_A_ROW = 3
_BARS = {"first_order": ("alone (first order)", "simulation", 0.2), "total": ("with others (total)", "sky", -0.2)}
"""By index: its words, colour and place beside the parameter's name."""

_STEPS = (1, 2, 5, 10)
_ROUND_STEPS = MaxNLocator(12, steps=_STEPS)


def draw(found: SensitivityResult) -> Iterator[tuple[str, Drawing]]:
    """All figures with their names, one at a time; none where no measure has indices."""
    if not found.good:
        return
    with plot.matplotlib_style():
        yield INDICES, _indices(found)
        for measure in found.good:
            yield f"{EFFECTS}_{measure}", _main_effects(found, measure)
            if len(found.inputs.each) > 1:
                yield f"{MAP}_{measure}", _map(found, measure)


def of_measure(found: SensitivityResult, measure: str) -> pd.DataFrame:
    """Rows of `measure` in the table of indices, those of the largest total index first."""
    own = found.indices[found.indices["measure"] == measure]
    return own.sort_values("total", ascending=False, kind="stable")


def _indices(found: SensitivityResult) -> Drawing:
    """Bars of both indices with their intervals, a panel a measure, a row a parameter."""
    measures = list(found.good)
    keys = [one.axis.key for one in found.inputs.each]
    columns = min(_IN_A_ROW, len(measures))
    rows = -(-len(measures) // columns)
    titles = [textwrap.fill(measure_in_words(measure), 31) for measure in measures]
    lines = max(title.count("\n") + 1 for title in titles)
    sheet = Sheet(0.8 + rows * (0.25 + 0.15 * lines + 0.24 * len(keys)), rows, columns)
    places = np.arange(len(keys))[::-1]
    share = Quantity("share of the variance", "1")
    for number, (measure, title) in enumerate(zip(measures, titles, strict=True)):
        panel = sheet.panel(divmod(number, columns), title, share, Quantity("", ""))
        panel.axes.set_title(title, fontsize=8.0)
        own = found.indices[found.indices["measure"] == measure].set_index("parameter").loc[keys]
        for index, (words, colour, beside) in _BARS.items():
            values, low, high = (own[index + end].to_numpy() for end in ("", "_low", "_high"))
            at = places + beside
            panel.axes.barh(at, values, 0.38, color=COLOURS[colour], label=words)
            panel.axes.hlines(at, low, high, color=plot.INK, linewidth=0.9)
            panel.record(words, values, at, low=low, high=high, label=keys)
        shown = number % columns == 0
        panel.rows([parameter_in_words(key) if shown else "" for key in keys], places)
        panel.axes.set_xlim(0.0, 1.0)
        panel.axes.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
        if number + columns < len(measures):
            panel.axes.set_xlabel("")
    sheet.legend()
    return sheet.drawing()


def _main_effects(found: SensitivityResult, measure: str) -> Drawing:
    """Mean of a measure over each parameter that takes part, on one scale."""
    ranked = of_measure(found, measure)
    keys = list(ranked["parameter"][ranked["total"] >= SETTINGS.shown_share])
    by_key = {one.axis.key: one for one in found.inputs.each}
    columns = min(_IN_A_ROW, len(keys))
    rows = -(-len(keys) // columns)
    quantity, factor = measure_quantity(measure)
    sheet = Sheet(0.5 + 2.1 * rows, rows, columns)
    label = textwrap.fill(quantity.label, 30)
    curves = found.effects[found.effects["measure"] == measure]
    shown = curves[curves["parameter"].isin(keys)]
    low, high = factor * shown["effect_low"].min(), factor * shown["effect_high"].max()
    for number, key in enumerate(keys):
        one, own = by_key[key], curves[curves["parameter"] == key]
        panel = sheet.panel(divmod(number, columns), parameter_in_words(key), parameter_quantity(one.axis)[0], quantity)
        effect, lower, upper = (factor * own[f"effect{end}"].to_numpy() for end in ("", "_low", "_high"))
        if one.axis.values is not None:
            places = np.arange(len(own))
            panel.marks("mean", places, effect, "simulation", low=lower, high=upper, labels=_texts(one))
            _listed(panel.axes.xaxis, one)
            panel.axes.set_xlim(-0.5, len(own) - 0.5)
        else:
            values = parameter_quantity(one.axis)[1] * own["value"].to_numpy()
            panel.line("mean", values, effect, "simulation")
            panel.axes.fill_between(values, lower, upper, color=COLOURS["simulation"], alpha=0.2, linewidth=0.0)
            panel.record("interval", values, effect, low=lower, high=upper)
            _ranged(panel, "x", one, values)
        panel.axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
        panel.axes.yaxis.set_major_locator(MaxNLocator(5, steps=_STEPS))
        panel.axes.set_ylabel(label if number % columns == 0 else "")
    return sheet.drawing()


def _map(found: SensitivityResult, measure: str) -> Drawing:
    """Mean of a measure over the two parameters of the largest total indices."""
    keys = list(of_measure(found, measure)["parameter"][:2])
    by_key = {one.axis.key: place for place, one in enumerate(found.inputs.each)}
    places = [by_key[key] for key in keys]
    across, up = (found.inputs.each[place] for place in places)
    quantity, factor = measure_quantity(measure)
    curves = [one.curve(SETTINGS.curve_points) for one in (across, up)]
    grid = np.meshgrid(across.standard(curves[0]), up.standard(curves[1]))
    surrogate = found.good[measure]
    means = conditional_terms(found.inputs, surrogate.terms, dict(zip(places, map(np.ravel, grid), strict=True)))
    value = factor * surrogate.mean(means).reshape(grid[0].shape)
    axes = [_axis_values(one, curve) for one, curve in zip((across, up), curves, strict=True)]
    quantities = [parameter_quantity(one.axis)[0] for one in (across, up)]
    sheet = Sheet(3.6, 1, 1, width=4.6)
    panel = sheet.panel((0, 0), "", *quantities)
    if across.axis.values is None and up.axis.values is None:
        drawn = panel.contours(
            "mean", *axes, value, quantity, levels=_ROUND_STEPS.tick_values(value.min(), value.max()), cmap="viridis"
        )
    else:
        drawn = panel.axes.pcolormesh(*axes, value, cmap="viridis", shading="nearest")
        x, y = np.meshgrid(*axes)
        panel.record("mean", x.ravel(), y.ravel(), value=value.ravel(), value_quantity=quantity.name,
                     value_unit=quantity.unit)  # fmt: skip
    panel.axes.grid(False)
    for side, one, values in zip("xy", (across, up), axes, strict=True):
        if one.axis.values is not None:
            _listed(getattr(panel.axes, f"{side}axis"), one)
        else:
            _ranged(panel, side, one, values)
    sheet.figure.colorbar(
        drawn, ax=panel.axes, label=textwrap.fill(quantity.label, 40), ticks=MaxNLocator(6, steps=_STEPS)
    )
    return sheet.drawing()


def _axis_values(one: Input, curve: np.ndarray) -> np.ndarray:
    """Where the values of a `curve` stand on an axis: places of a list, a range in its unit."""
    return np.arange(len(curve)) if one.axis.values is not None else parameter_quantity(one.axis)[1] * curve


def _texts(one: Input) -> list[str]:
    factor = parameter_quantity(one.axis)[1]
    return [f"{factor * v:.4g}" if one.axis.column.kind == "float" else str(v) for v in one.axis.values]


def _listed(axis, one: Input) -> None:
    """The values of a list at 0, 1, 2, ..., or some of them where they are many."""
    texts = _texts(one)
    step = -(-len(texts) // 8)
    axis.set_ticks(range(0, len(texts), step), texts[::step])


def _ranged(panel: Panel, side: str, one: Input, values: np.ndarray) -> None:
    """Ends and ticks of a range, logarithmic where it is drawn so."""
    axis = getattr(panel.axes, f"{side}axis")
    getattr(panel.axes, f"set_{side}lim")(values[0], values[-1])
    if one.axis.law.dist.name == "loguniform":
        getattr(panel.axes, f"set_{side}scale")("log")
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if values[-1] < 100 * values[0] else (1.0,)))
        axis.set_major_formatter(FuncFormatter(tick_label))
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_major_locator(MaxNLocator(4, steps=_STEPS))


def page(found: SensitivityResult) -> Page:
    """The page of a sweep's sensitivities."""
    ranked = {measure: of_measure(found, measure) for measure in found.good}
    failed = f"{found.failed} of them failed" if found.failed else "none failed"
    blocks = [
        Paragraph(_headline(found, ranked), strong=True),
        Paragraph(f"From {found.number} designs of the sweep; {failed}."),
    ]
    if ranked:
        blocks += [_decisions(found, ranked), Heading("Indices of all measures"), FigureBlock(INDICES, "Sobol indices")]
        blocks.append(Heading("Main effects"))
    for measure, rows in ranked.items():
        words = measure_in_words(measure)
        blocks += [Heading(words, 3), FigureBlock(f"{EFFECTS}_{measure}", f"Main effects: {words}")]
        if len(rows) > 1:
            two = joined(parameter_in_words(key) for key in rows["parameter"][:2])
            blocks.append(FigureBlock(f"{MAP}_{measure}", f"Map: {words} over {two}", small=True))
    # What no design has, such as the impacts of an ideal joint, nobody asks for.
    poor = found.surrogates[found.surrogates["reason"].notna() & found.surrogates["mean"].notna()]
    if len(poor):
        rows = tuple((measure_in_words(row["measure"]), row["reason"]) for row in poor.to_dict("records"))
        blocks += [Heading("Measures without indices"), TableBlock(("measure", "why"), rows)]
        blocks.append(
            Paragraph(
                "Simulate more designs (a larger `sweep.number` keeps those that are there) or narrow the ranges. "
                "Where that does not help the motion is not reproducible, and only means over revolutions or starts "
                "(`jointgap ensemble`) can be compared."
            )
        )
    return Page("Sensitivity", (*blocks, Heading("Method"), Paragraph(_METHOD)))


_METHOD = (
    "A surrogate of each measure (OpenTURNS: chaos expansion or Gaussian process), judged by designs held out by "
    f"chance. Q2 is 1 less the mean squared error on these over the variance; below {SETTINGS.least_q2:g} there are no "
    "indices. First order: share of the variance that a parameter decides alone; total: alone and with others. "
    "Intervals hold 90 % and include what the surrogate misses. Main effects: mean where one parameter is given, of "
    f"parameters with a total index of {SETTINGS.shown_share:g} or more. All numbers: `indices.parquet`, "
    "`surrogates.parquet` and `main_effects.parquet`; `jointgap describe` explains their columns."
)


def _is_sure(ranked: pd.DataFrame) -> bool:
    """Whether the interval of the largest total index lies above that of the next."""
    return len(ranked) < 2 or ranked["total_low"].iloc[0] > ranked["total_high"].iloc[1]


def _headline(found: SensitivityResult, ranked: dict[str, pd.DataFrame]) -> str:
    number = int(found.surrogates["mean"].notna().sum())
    if not ranked:
        return f"What decides is not known: none of the {number} measures has a surrogate that is good enough."
    counted = Counter(parameter_in_words(rows["parameter"].iloc[0]) for rows in ranked.values())
    (first, most), *others = counted.most_common()
    text = f"{first[0].upper()}{first[1:]} decides {most} of {len(ranked)} measures most"
    text += f", {joined(f'{words} {count}' for words, count in others)}" if others else ""
    text += f"; in {sum(map(_is_sure, ranked.values()))} of them that is sure."
    return text + (f" Of {number - len(ranked)} more measures it is not known." if len(ranked) < number else "")


def _decisions(found: SensitivityResult, ranked: dict[str, pd.DataFrame]) -> TableBlock:
    q2, table = found.surrogates.set_index("measure")["q2"], []
    for measure, rows in ranked.items():
        parts = [
            (parameter_in_words(row["parameter"]), "{total:.2f} ({total_low:.2f} to {total_high:.2f})".format(**row))
            for row in rows[:2].to_dict("records")
        ]
        first, second = (*parts, ("–", ""))[:2]
        sure = "sure" if _is_sure(rows) else "open which of the two"
        table.append((measure_in_words(measure), *first, *second, sure, f"{q2[measure]:.3f}"))
    heads = ("measure", "decided most by", "total index", "then by", "total index", "order", "Q2")
    return TableBlock(heads, tuple(table), "lllllll", "Total index with its 90 % interval; Q2 of held-out designs")


def write_results(found: SensitivityResult, folder: Path) -> str:
    """Write tables, figures and page into a `folder`; gives the page as Markdown.

    Figures of an earlier run that are not drawn again, of measures that have no indices any more, are removed.
    """
    places = {
        folder / Path(table.path).name: (table, frame)
        for table, frame in zip(TABLES_OF_SENSITIVITY, (found.surrogates, found.indices, found.effects), strict=True)
    }
    pages, figures = (folder / "summary.html", folder / "summary.md"), folder / "figures"
    parquet.check_writable(*places, *pages)
    figures.mkdir(exist_ok=True)
    drawn = {path for name, drawing in draw(found) for path in plot.save(drawing, figures / name)}
    for path in set(figures.iterdir()) - drawn:
        path.unlink()
    for path, (table, frame) in places.items():
        parquet.write(table, frame, path)
    shown = page(found)
    text = to_markdown(shown)
    parquet.write_text(pages[0], to_html(shown, figures))
    parquet.write_text(pages[1], text)
    return text
