"""The parameters of a sweep as independent inputs of a surrogate, and the polynomials that are orthonormal to them.

Each parameter is brought to a standard variable by its own distribution: a range to -1 to 1 (a log-uniform one by its
logarithm), a normal tolerance to standard deviations from its mean, a list to places evenly apart, each as likely as
the others. A measure's Sobol indices do not depend on how a parameter is written, as long as each of its values keeps
its probability.
"""

import math
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

import numpy as np

from jointgap.core.errors import needs
from jointgap.designs.design_of_experiments import Axis

with needs("what decides a sweep", "learn"):
    import openturns as ot

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
