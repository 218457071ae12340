"""Sobol indices and main effects of the measures of a sweep, from a surrogate of each measure.

A surrogate is a sparse polynomial chaos expansion (Blatman and Sudret, J. Comput. Phys. 230 (2011)
2345). The variance of each term belongs to its parameters (Sudret, Reliab. Eng. Syst. Saf. 93
(2008) 964). The unexplained variance, 1 - Q2, may belong to any parameter: an interval runs from Q2
S to Q2 S + 1 - Q2, with the ends of 90 % intervals of bootstrap replicates (Wu, Ann. Stat. 14
(1986) 1261) of surrogate and Q2.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config.designs import Sensitivity
from jointgap.core.errors import InputError, needs
from jointgap.core.progress import with_progress
from jointgap.core.schema import (
    SENSITIVITY_EFFECTS,
    SENSITIVITY_INDICES,
    SENSITIVITY_SURROGATES,
    Column,
)
from jointgap.designs.dataset import read_designs
from jointgap.designs.sampling import Axis, Designs

with needs("the sensitivity analysis", "learn"):
    import openturns as ot

MIN_Q2 = 0.8  # required share of explained variance of the held-out designs
MOST_MISSING = 0.1  # largest share of designs without the measure
MIN_DESIGNS = 50  # with the measure
HELD_OUT = 0.2  # share of test designs
MOST_DESIGNS = 20_000  # random subset of a larger sweep
HIGHEST_DEGREE = 10  # of the polynomials of one parameter
NORM = 0.75  # of the hyperbolic truncation
MOST_TERMS = 500
DESIGNS_PER_TERM = 10  # training designs for each term
SELECTION = 600, 220  # training designs and terms for least angle regression
# bootstrap replicates: the ends of a 90 % interval are accurate to a tenth of its length
REPLICATES = 400
INTERVAL = 0.05, 0.95  # quantiles
ROUNDING = 1e-9  # relative standard deviation below which a measure is constant
CURVE_POINTS = 41  # of a main effect
_TRUNCATION = 8.0  # [standard deviations] of normal distributions
# lower limit of 1 - leverage: leave-one-out residuals grow at most tenfold
_MIN_LEVERAGE_REST = 0.1

ENDS = ("", "_low", "_high")
"""Suffixes of a value and its interval."""


def _levels(axis: Axis) -> np.ndarray:
    """Values of a variable that replace those of a list."""
    return np.linspace(-1.0, 1.0, len(axis.values))


def _distribution(axis: Axis) -> Any:
    """OpenTURNS distribution of a parameter, or of its logarithm where that is uniform."""
    if axis.values is not None:
        return ot.FiniteDiscreteDistribution(_levels(axis)[:, None].tolist())
    name, keywords, (low, high) = axis.law.dist.name, axis.law.kwds, axis.law.support()
    if name == "loguniform":
        return ot.Uniform(math.log(low), math.log(high))
    if name == "uniform":
        return ot.Uniform(low, high)
    if name == "triang":
        return ot.Triangular(low, low + keywords["c"] * keywords["scale"], high)
    mean, deviation = keywords["loc"], keywords["scale"]
    if np.isinf([low, high]).all():
        return ot.Normal(mean, deviation)
    low, high = max(low, mean - _TRUNCATION * deviation), min(high, mean + _TRUNCATION * deviation)
    return ot.TruncatedNormal(mean, deviation, low, high)


def _variable(axis: Axis, values: np.ndarray) -> np.ndarray:
    """`values` (n,) of a parameter as a variable with its `_distribution`."""
    if axis.values is not None:
        return _levels(axis)[pd.Index(axis.values).get_indexer(values)]
    values = np.asarray(values, dtype=float)
    return np.log(values) if axis.is_logarithmic else values


def curve_values(axis: Axis) -> np.ndarray:
    """Values at which a main effect is computed: all of a list, an even grid of a range, the
    central 98 % of a normal distribution."""
    if axis.values is not None:
        return np.array(axis.values, dtype=object if axis.column.kind != "float" else float)
    is_normal = axis.law.dist.name == "truncnorm"
    low, high = axis.law.ppf([0.01, 0.99]) if is_normal else axis.law.support()
    return (np.geomspace if axis.is_logarithmic else np.linspace)(low, high, CURVE_POINTS)


class Basis:
    """Orthonormal polynomials of the varied parameters."""

    def __init__(self, axes: tuple[Axis, ...]):
        ot.TBB.Disable()  # one thread: one core per job, and reproducible sums
        ot.Log.Show(ot.Log.ERROR)
        self.axes = axes
        marginals = [_distribution(axis) for axis in axes]
        self.distribution = ot.JointDistribution(marginals)
        order = ot.HyperbolicAnisotropicEnumerateFunction(len(axes), NORM)
        degrees = [
            HIGHEST_DEGREE if axis.values is None else min(HIGHEST_DEGREE, len(axis.values) - 1)
            for axis in axes
        ]
        order.setUpperBound(degrees)
        self.functions = ot.OrthogonalProductPolynomialFactory(
            [ot.StandardDistributionPolynomialFactory(marginal) for marginal in marginals], order
        )
        count = min(MOST_TERMS, math.prod(degree + 1 for degree in degrees))
        # degrees of each term, (terms, axes); the first term is the constant
        self.degrees = np.array([list(order(term)) for term in range(count)], dtype=int)
        self._terms = ot.AggregatedFunction([self.functions.build(term) for term in range(count)])
        self._medians = [marginal.computeQuantile(0.5)[0] for marginal in marginals]
        self._transformation = ot.DistributionTransformation(
            self.distribution, self.functions.getMeasure()
        )

    def variables(self, frame: pd.DataFrame) -> np.ndarray:
        """Variables (n, axes) of designs."""
        return np.column_stack([_variable(axis, frame[axis.key].to_numpy()) for axis in self.axes])

    def at(self, variables: np.ndarray) -> np.ndarray:
        """Values (n, terms) of all terms at variables (n, axes)."""
        return np.array(self._terms(self._transformation(variables)))

    def means_at(self, index: int, values: np.ndarray) -> np.ndarray:
        """Means (n, terms) of all terms where one parameter has `values` (n,) and the others vary
        as in the sweep."""
        variables = np.tile(self._medians, (len(values), 1))
        variables[:, index] = _variable(self.axes[index], values)
        varies = (np.delete(self.degrees, index, axis=1) > 0).any(axis=1)
        return np.where(varies, 0.0, self.at(variables))

    def select_terms(self, variables: np.ndarray, values: np.ndarray) -> set[int]:
        """Terms selected by least angle regression; none where it fails, such as for almost
        constant values."""
        selection = ot.LeastSquaresMetaModelSelectionFactory(ot.LARS(), ot.CorrectedLeaveOneOut())
        algorithm = ot.FunctionalChaosAlgorithm(
            variables,
            values[:, None],
            self.distribution,
            ot.FixedStrategy(self.functions, min(SELECTION[1], len(self.degrees))),
            ot.LeastSquaresStrategy(selection),
        )
        try:
            algorithm.run()
        except (RuntimeError, TypeError):  # raised by OpenTURNS' wrapper for any failure
            return set()
        return set(algorithm.getResult().getIndices())


@dataclass(frozen=True)
class PolynomialSurrogate:
    """A trained surrogate, with its bootstrap replicates in further columns; values [SI of the
    measure]."""

    terms: np.ndarray  # Indices of its terms in the basis; the first is the constant
    coefficients: np.ndarray  # (terms, 1 + replicates)
    q2: np.ndarray  # Explained share of the variance of held-out designs, (1 + replicates,)
    limits: tuple[float, float]  # Range of the designs, which bounds every mean
    trained: int  # Number of training designs
    held_out: int  # Number of test designs

    def mean(self, terms: np.ndarray) -> np.ndarray:
        """Mean (3, n) of the measure with its interval, where the basis has the means `terms`
        (n, terms)."""
        means = terms[:, self.terms] @ self.coefficients
        return np.clip(_with_interval(means[:, 0], means[:, 1:], means[:, 1:]), *self.limits)


def _with_interval(value: Any, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """A value and its interval, from replicates of each end along the last axis."""
    low, high = np.quantile(low, INTERVAL[0], axis=-1), np.quantile(high, INTERVAL[1], axis=-1)
    return np.array([value, np.minimum(low, value), np.maximum(high, value)])


def train_surrogate(
    basis: Basis, variables: np.ndarray, terms: np.ndarray, values: np.ndarray, seed: int
) -> PolynomialSurrogate:
    """Surrogate of a measure with finite `values` [SI] of randomly ordered designs, their
    `variables` and the basis `terms` there."""
    held_out = max(1, round(HELD_OUT * len(values)))
    centre, scale = np.mean(values[held_out:]), np.std(values[held_out:]) or 1.0
    test, training = np.split((values - centre) / scale, [held_out])
    subset = slice(held_out, held_out + SELECTION[0])
    low_order = max(1, min(len(basis.degrees), len(training) // DESIGNS_PER_TERM))
    selected = basis.select_terms(variables[subset], training[: SELECTION[0]])
    indices = np.array(sorted(selected | set(range(low_order))))
    test_terms, training_terms = np.split(terms[:, indices], [held_out])
    # the terms are almost orthonormal on the designs: the normal equations are well conditioned
    gram = training_terms.T @ training_terms
    smoother = np.linalg.pinv(gram, hermitian=True) @ training_terms.T
    coefficients = smoother @ training
    # leave-one-out residuals, which do not shrink with the number of terms
    leverage = np.einsum("ij,ji->i", training_terms, smoother)
    residuals = training - training_terms @ coefficients
    residuals /= np.maximum(1.0 - leverage, _MIN_LEVERAGE_REST)
    random = np.random.default_rng([seed, 1])
    signs = random.choice([-1.0, 1.0], size=(len(residuals), REPLICATES))
    replicates = coefficients[:, None] + smoother @ (residuals[:, None] * signs)
    coefficients = np.column_stack([coefficients, replicates])
    # evaluate the replicates on resampled test designs
    resampled = random.integers(held_out, size=(REPLICATES, held_out))
    rows = np.vstack([np.arange(held_out), resampled]).T
    errors = np.take_along_axis(test[:, None] - test_terms @ coefficients, rows, axis=0)
    variance = np.var(test[rows], axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        q2 = np.where(variance > 0.0, 1.0 - np.mean(errors**2, axis=0) / variance, 0.0)
    return PolynomialSurrogate(
        terms=indices,
        coefficients=centre * (indices == 0)[:, None] + scale * coefficients,
        q2=q2,
        limits=(float(np.min(values)), float(np.max(values))),
        trained=len(training),
        held_out=held_out,
    )


@dataclass(frozen=True)
class SensitivityResult:
    """Sensitivities of the measures of a sweep."""

    axes: tuple[Axis, ...]  # Parameters with more than one value
    number: int  # Designs
    failed: int  # Failed designs
    columns: Mapping[str, Column]  # Of the measures
    surrogates: pd.DataFrame  # Tables of the stage
    indices: pd.DataFrame
    effects: pd.DataFrame

    def ranked(self, measure: str) -> pd.DataFrame:
        """Rows of `measure` in the table of indices, sorted by the total index."""
        rows = self.indices[self.indices["measure"] == measure]
        return rows.sort_values("total", ascending=False, kind="stable")


def sensitivity_indices(designs: Designs, dataset: Path, options: Sensitivity) -> SensitivityResult:
    """Sensitivities of a sweep, from its dataset."""
    measures = options.measures or [column.name for column in designs.measured]
    keys = (axis.key for axis in designs.axes)
    frame = read_designs(designs, dataset, *keys, "reason", *measures)
    return compute_indices(designs, frame, measures, options.seed)


def compute_indices(
    designs: Designs, frame: pd.DataFrame, measures: Sequence[str], seed: int
) -> SensitivityResult:
    """The same from a `frame` with the parameters, `reason` and `measures` of the designs."""
    axes = tuple(axis for axis in designs.axes if axis.varies)
    if not axes:
        raise InputError(
            "sweep.parameters: every parameter has one value; give a range or a list of values"
        )
    basis = Basis(axes)
    order = np.random.default_rng(seed).permutation(len(frame))[:MOST_DESIGNS]
    variables, succeeded = basis.variables(frame.iloc[order]), frame["reason"].isna().to_numpy()
    terms = basis.at(variables)
    failed = int((~succeeded).sum())
    columns = {column.name: column for column in designs.measured}
    surrogates, indices, effects = [], [], []
    for name in with_progress(iter(measures), "measures", len(measures)):
        values = frame[name].to_numpy(dtype=float)
        defined = succeeded & np.isfinite(values)
        undefined = int(succeeded.sum() - defined.sum())
        row = {"measure": name, "unit": columns[name].unit}
        row |= {"failed": failed, "undefined": undefined}
        row |= dict.fromkeys(("terms", "trained", "held_out"), 0)
        if defined.any():
            row |= {"mean": np.mean(values[defined]), "deviation": np.std(values[defined])}
        reason = _why_unfit(values[defined], len(values), failed, undefined)
        if not reason:
            rows = defined[order]
            surrogate = train_surrogate(
                basis, variables[rows], terms[rows], values[order][rows], seed
            )
            row |= {key: getattr(surrogate, key) for key in ("trained", "held_out")}
            row["terms"] = len(surrogate.terms)
            q2, replicates = surrogate.q2[0], surrogate.q2[1:]
            row |= _named("q2", _with_interval(q2, replicates, replicates))
            if q2 < MIN_Q2:
                reason = (
                    f"the surrogate explains {100 * max(q2, 0.0):.0f} % of the variance of held-out"
                    f" designs, less than {100 * MIN_Q2:.0f} %"
                )
            else:
                indices += _index_rows(name, basis, surrogate)
                effects += _effect_rows(columns[name], basis, surrogate)
        surrogates.append(row | {"reason": reason})
    return SensitivityResult(
        axes,
        len(frame),
        failed,
        columns,
        pd.DataFrame(surrogates, columns=SENSITIVITY_SURROGATES.names),
        pd.DataFrame(indices, columns=SENSITIVITY_INDICES.names),
        pd.DataFrame(effects, columns=SENSITIVITY_EFFECTS.names),
    )


def _why_unfit(values: np.ndarray, number: int, failed: int, undefined: int) -> str | None:
    """Reason for no surrogate of a measure with these finite `values`; None where there is one."""
    if not len(values):
        return "undefined for all designs"
    if np.std(values) <= ROUNDING * np.abs(values).max():
        return "equal for all designs"
    missing = failed + undefined
    if missing > MOST_MISSING * number:
        return (
            f"undefined for {100 * missing / number:.0f} % of the designs ({failed} failed), more"
            " than"
            f" {100 * MOST_MISSING:.0f} %"
        )
    if len(values) < MIN_DESIGNS:
        return f"{len(values)} designs with a value, fewer than {MIN_DESIGNS}"
    return None


def _named(name: str, values: Any) -> dict[str, Any]:
    """A value and its interval, by column."""
    return {name + end: value for end, value in zip(ENDS, values, strict=True)}


def _index_rows(name: str, basis: Basis, surrogate: PolynomialSurrogate) -> Iterator[dict]:
    is_active = basis.degrees[surrogate.terms[1:]] > 0
    variances, q2 = surrogate.coefficients[1:] ** 2, surrogate.q2
    for index, axis in enumerate(basis.axes):
        row = {"measure": name, "parameter": axis.key}
        is_alone = is_active[:, index] & (is_active.sum(axis=1) == 1)
        for key, terms in (("first_order", is_alone), ("total", is_active[:, index])):
            shares = variances[terms].sum(axis=0) / variances.sum(axis=0)
            explained, unexplained = (shares * q2)[1:], 1.0 - q2[1:]
            share, low, high = _with_interval(shares[0], explained, explained + unexplained)
            row |= _named(key, (share, max(0.0, low), min(1.0, high)))
        yield row


def _effect_rows(measure: Column, basis: Basis, surrogate: PolynomialSurrogate) -> Iterator[dict]:
    for index, axis in enumerate(basis.axes):
        values, is_word = curve_values(axis), axis.column.kind != "float"
        curves = surrogate.mean(basis.means_at(index, values))
        for value, *effects in zip(values, *curves, strict=True):
            row = {"measure": measure.name, "parameter": axis.key}
            row |= {"unit": measure.unit, "value_unit": axis.unit}
            row |= {"word": str(value)} if is_word else {"value": float(value)}
            yield row | _named("effect", effects)
