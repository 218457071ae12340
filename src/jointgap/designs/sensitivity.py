"""Sobol indices and main effects of the measures of a sweep, from a surrogate of each measure.

A surrogate is a sparse polynomial chaos expansion (Blatman and Sudret, J. Comput. Phys. 230 (2011)
2345). The variance of each term belongs to its parameters (Sudret, Reliab. Eng. Syst. Saf. 93
(2008) 964). The unexplained variance, 1 - Q2, may belong to any parameter: an interval runs from Q2
S to Q2 S + 1 - Q2, with the ends of 90 % intervals of bootstrap replicates (Wu, Ann. Stat. 14
(1986) 1261) of surrogate and Q2.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.config.designs import ALL_MEASURES, Sensitivity
from jointgap.core import parquet, plot, schema
from jointgap.core.errors import InputError, needs
from jointgap.core.page import FigureBlock, Heading, Page, Paragraph, TableBlock
from jointgap.core.plot import COLOURS, Drawing, Quantity, Sheet
from jointgap.core.progress import with_progress
from jointgap.core.words import format_range, joined
from jointgap.designs.sampling import Axis, Designs
from jointgap.designs.sweep import (
    cells,
    format_measure,
    format_parameter,
    format_value,
    measure_quantity,
    parameter_panels,
    parameter_quantity,
    places,
    scale,
)

with needs("the sensitivity analysis", "learn"):
    import openturns as ot

LEAST_Q2 = 0.8  # [1] required share of explained variance of the held-out designs
MOST_MISSING = 0.1  # [1] largest share of designs without the measure
LEAST_DESIGNS = 50  # with the measure
HELD_OUT = 0.2  # [1] share of test designs
MOST_DESIGNS = 20_000  # random subset of a larger sweep
HIGHEST_DEGREE = 10  # of the polynomials of one parameter
NORM = 0.75  # [1] of the hyperbolic truncation
MOST_TERMS = 500  # at most, with at least
DESIGNS_PER_TERM = 10  # training designs each
SELECTION = 600, 220  # training designs and terms for least angle regression
REPLICATES = (
    400  # bootstrap replicates: the ends of a 90 % interval are accurate to a tenth of its length
)
ENDS = 0.05, 0.95  # quantiles at the ends of an interval
ROUNDING = 1e-9  # [1] relative standard deviation below which a measure is constant
CURVE_POINTS = 41  # per main effect, and per axis of a map
SHOWN_SHARE = 0.01  # [1] smallest total index whose main effect is drawn
_FAR = 8.0  # [standard deviations] truncation of normal distributions
_LEAST_LEFT = 0.1  # lower limit of 1 - leverage: leave-one-out residuals grow at most tenfold


def _distribution(axis: Axis) -> Any:
    """OpenTURNS distribution of a parameter, or of its logarithm where that is uniform."""
    if axis.values is not None:
        return ot.FiniteDiscreteDistribution(
            np.linspace(-1.0, 1.0, len(axis.values))[:, None].tolist()
        )
    name, given, (low, high) = axis.law.dist.name, axis.law.kwds, axis.law.support()
    if name == "loguniform":
        return ot.Uniform(math.log(low), math.log(high))
    if name == "uniform":
        return ot.Uniform(low, high)
    if name == "triang":
        return ot.Triangular(low, low + given["c"] * given["scale"], high)
    mean, size = given["loc"], given["scale"]
    if np.isinf([low, high]).all():
        return ot.Normal(mean, size)
    return ot.TruncatedNormal(
        mean, size, max(low, mean - _FAR * size), min(high, mean + _FAR * size)
    )


def _numbers(axis: Axis, values: np.ndarray) -> np.ndarray:
    """`values` (n,) of a parameter as variables of its `_distribution`."""
    if axis.values is not None:
        level = dict(zip(axis.values, np.linspace(-1.0, 1.0, len(axis.values)), strict=True))
        return np.array([level[value] for value in values.tolist()])
    values = np.asarray(values, dtype=float)
    return np.log(values) if axis.law.dist.name == "loguniform" else values


def _curve(axis: Axis) -> np.ndarray:
    """Abscissa of a curve: all values of a list, an even grid of a range, the central 98 % of a
    normal distribution."""
    if axis.values is not None:
        return np.array(axis.values, dtype=object if axis.column.kind != "float" else float)
    low, high = (
        axis.law.ppf([0.01, 0.99]) if axis.law.dist.name == "truncnorm" else axis.law.support()
    )
    return (np.geomspace if axis.law.dist.name == "loguniform" else np.linspace)(
        low, high, CURVE_POINTS
    )


class Basis:
    """Orthonormal polynomials of the varied parameters."""

    def __init__(self, axes: tuple[Axis, ...]):
        ot.TBB.Disable()  # one thread: one core per job, and reproducible sums
        ot.Log.Show(ot.Log.ERROR)
        self.axes = axes
        marginals = [_distribution(axis) for axis in axes]
        self.distribution = ot.JointDistribution(marginals)
        order = ot.HyperbolicAnisotropicEnumerateFunction(len(axes), NORM)
        highest = [
            HIGHEST_DEGREE if a.values is None else min(HIGHEST_DEGREE, len(a.values) - 1)
            for a in axes
        ]
        order.setUpperBound(highest)
        self.functions = ot.OrthogonalProductPolynomialFactory(
            [ot.StandardDistributionPolynomialFactory(marginal) for marginal in marginals], order
        )
        number = min(MOST_TERMS, math.prod(degree + 1 for degree in highest))
        # degrees of each term, (terms, axes); the first term is the constant
        self.terms = np.array([list(order(place)) for place in range(number)], dtype=int)
        self._all = ot.AggregatedFunction([self.functions.build(place) for place in range(number)])
        self._median = [marginal.computeQuantile(0.5)[0] for marginal in marginals]
        self._transformation = ot.DistributionTransformation(
            self.distribution, self.functions.getMeasure()
        )

    def numbers(self, columns: pd.DataFrame) -> np.ndarray:
        """Variables (n, axes) of designs."""
        return np.column_stack([_numbers(axis, columns[axis.key].to_numpy()) for axis in self.axes])

    def at(self, numbers: np.ndarray) -> np.ndarray:
        """Values (n, terms) of all terms at variables (n, axes)."""
        return np.array(self._all(self._transformation(numbers)))

    def means_where(self, given: dict[int, np.ndarray]) -> np.ndarray:
        """Means (n, terms) of all terms where some parameters are fixed and the others vary as in
        the sweep."""
        columns = [
            given.get(place, np.array([middle])) for place, middle in enumerate(self._median)
        ]
        others = [place for place in range(len(self.axes)) if place not in given]
        varying = (self.terms[:, others] > 0).any(axis=1)
        return np.where(varying, 0.0, self.at(np.column_stack(np.broadcast_arrays(*columns))))

    def selected(self, numbers: np.ndarray, values: np.ndarray) -> set[int]:
        """Terms selected by least angle regression; none where it fails, such as for almost
        constant values."""
        algorithm = ot.FunctionalChaosAlgorithm(
            numbers,
            values[:, None],
            self.distribution,
            ot.FixedStrategy(self.functions, min(SELECTION[1], len(self.terms))),
            ot.LeastSquaresStrategy(
                ot.LeastSquaresMetaModelSelectionFactory(ot.LARS(), ot.CorrectedLeaveOneOut())
            ),
        )
        try:
            algorithm.run()
        except (RuntimeError, TypeError):  # raised by OpenTURNS' wrapper for any failure
            return set()
        return set(algorithm.getResult().getIndices())


@dataclass(frozen=True)
class Surrogate:
    """A trained surrogate, with its bootstrap replicates in further columns; values [SI of the
    measure]."""

    places: np.ndarray  # Indices of its terms in the basis; the first is the constant
    coefficients: np.ndarray  # (terms, 1 + replicates)
    q2: np.ndarray  # Explained share of the variance of held-out designs, (1 + replicates,)
    ends: tuple[float, float]  # Range of the designs, which bounds every mean
    trained: int  # Number of training designs
    held_out: int  # Number of test designs

    def mean(self, at: np.ndarray) -> np.ndarray:
        """Mean (3, n) of the measure with its interval, where the basis terms have the means `at`
        (n, terms)."""
        means = at[:, self.places] @ self.coefficients
        return np.clip(_with_ends(means[:, 0], means[:, 1:], means[:, 1:]), *self.ends)


def _with_ends(value: Any, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """A value and its interval, from replicates of each end along the last axis."""
    low, high = (np.quantile(own, end, axis=-1) for own, end in zip((low, high), ENDS, strict=True))
    return np.array([value, np.minimum(low, value), np.maximum(high, value)])


def surrogate(
    basis: Basis, numbers: np.ndarray, at: np.ndarray, values: np.ndarray, seed: int
) -> Surrogate:
    """Surrogate of a measure with finite `values` [SI] of randomly ordered designs, their variables
    and terms `at`."""
    held = max(1, round(HELD_OUT * len(values)))
    middle, spread = np.mean(values[held:]), np.std(values[held:]) or 1.0
    judged, trained = np.split((values - middle) / spread, [held])
    few = slice(held, held + SELECTION[0])
    kept = set(range(max(1, min(len(basis.terms), len(trained) // DESIGNS_PER_TERM))))
    places = np.array(sorted(kept | basis.selected(numbers[few], trained[: SELECTION[0]])))
    at_held, at_trained = np.split(at[:, places], [held])
    # the terms are almost orthonormal on the designs: the normal equations are well conditioned
    smoother = np.linalg.pinv(at_trained.T @ at_trained, hermitian=True) @ at_trained.T
    coefficients = smoother @ trained
    # leave-one-out residuals, which do not shrink with the number of terms
    leverage = np.einsum("ij,ji->i", at_trained, smoother)
    residuals = (trained - at_trained @ coefficients) / np.maximum(1.0 - leverage, _LEAST_LEFT)
    chance = np.random.default_rng([seed, 1])
    signs = chance.choice([-1.0, 1.0], size=(len(residuals), REPLICATES))
    replicates = coefficients[:, None] + smoother @ (residuals[:, None] * signs)
    both = np.column_stack([coefficients, replicates])
    # evaluate the replicates on resampled test designs
    rows = np.vstack([np.arange(held), chance.integers(held, size=(REPLICATES, held))]).T
    errors = np.take_along_axis(judged[:, None] - at_held @ both, rows, axis=0)
    variance = np.var(judged[rows], axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        q2 = np.where(variance > 0.0, 1.0 - np.mean(errors**2, axis=0) / variance, 0.0)
    return Surrogate(
        places=places,
        coefficients=middle * (places == 0)[:, None] + spread * both,
        q2=q2,
        ends=(float(np.min(values)), float(np.max(values))),
        trained=len(trained),
        held_out=held,
    )


TABLES = (schema.SENSITIVITY_SURROGATES, schema.SENSITIVITY_INDICES, schema.SENSITIVITY_EFFECTS)

UNITS = {column.name: column.unit for column in ALL_MEASURES}
"""SI units of the measures."""


@dataclass(frozen=True)
class SensitivityResult:
    """Sensitivities of the measures of a sweep."""

    basis: Basis
    number: int  # Designs
    failed: int  # Failed designs
    surrogates: pd.DataFrame
    indices: pd.DataFrame
    effects: pd.DataFrame
    good: dict[str, Surrogate]  # Of the measures with indices

    @property
    def tables(self) -> dict[schema.Table, pd.DataFrame]:
        """The tables of the stage."""
        return dict(zip(TABLES, (self.surrogates, self.indices, self.effects), strict=True))

    def ranked(self, measure: str) -> pd.DataFrame:
        """Rows of `measure` in the table of indices, sorted by the total index."""
        own = self.indices[self.indices["measure"] == measure]
        return own.sort_values("total", ascending=False, kind="stable")


def sensitivity_indices(designs: Designs, dataset: Path, options: Sensitivity) -> SensitivityResult:
    """Sensitivities of a sweep, from its dataset."""
    names = options.measures or [column.name for column in designs.measured]
    columns = [*(axis.key for axis in designs.axes), "reason", *names]
    return compute_indices(
        designs, parquet.read_columns(dataset, columns).to_pandas(), names, options.seed
    )


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
    numbers = basis.numbers(frame.iloc[order])
    at, fine = basis.at(numbers), frame["reason"].isna().to_numpy()
    surrogates, indices, effects, good = [], [], [], {}
    for name in with_progress(iter(measures), "measures", len(measures)):
        values = frame[name].to_numpy(dtype=float)
        there = fine & np.isfinite(values)
        row = {"measure": name, "unit": UNITS[name], "terms": 0, "trained": 0, "held_out": 0}
        counts = {"failed": int((~fine).sum()), "undefined": int((fine & ~there).sum())}
        if there.any():
            row |= {"mean": np.mean(values[there]), "deviation": np.std(values[there])}
        reason = _unfit(values[there], len(values), counts)
        if not reason:
            own = there[order]
            found = surrogate(basis, numbers[own], at[own], values[order][own], seed)
            row |= {
                "terms": len(found.places),
                "trained": found.trained,
                "held_out": found.held_out,
            }
            row |= _interval("q2", found.q2[0], found.q2[1:], found.q2[1:])
            if found.q2[0] < LEAST_Q2:
                reason = (
                    f"the surrogate explains {100 * max(found.q2[0], 0.0):.0f} % of the variance of"
                    f" held-out designs, less than {100 * LEAST_Q2:.0f} %"
                )
            else:
                good[name] = found
                indices += _index_rows(name, basis, found)
                effects += _effect_rows(name, basis, found)
        surrogates.append(row | counts | {"reason": reason})
    found = (surrogates, indices, effects)
    made = (
        pd.DataFrame(rows, columns=table.names) for table, rows in zip(TABLES, found, strict=True)
    )
    return SensitivityResult(basis, len(frame), int((~fine).sum()), *made, good)


def _unfit(values: np.ndarray, number: int, counts: dict[str, int]) -> str | None:
    """Reason for no surrogate of a measure with these finite `values`; None where there is one."""
    missing = sum(counts.values())
    if not len(values):
        return "undefined for all designs"
    if np.std(values) <= ROUNDING * np.abs(values).max():
        return "equal for all designs"
    if missing > MOST_MISSING * number:
        whose = " and ".join(f"{count} {what}" for what, count in counts.items() if count)
        most = f"more than {100 * MOST_MISSING:.0f} %"
        return f"undefined for {100 * missing / number:.0f} % of the designs ({whose}), {most}"
    return (
        f"{len(values)} designs with a value, fewer than {LEAST_DESIGNS}"
        if len(values) < LEAST_DESIGNS
        else None
    )


def _interval(name: str, value: Any, low: np.ndarray, high: np.ndarray) -> dict[str, Any]:
    return dict(
        zip((name, f"{name}_low", f"{name}_high"), _with_ends(value, low, high), strict=True)
    )


def _index_rows(name: str, basis: Basis, found: Surrogate) -> Iterator[dict]:
    active, variances = basis.terms[found.places[1:]] > 0, found.coefficients[1:] ** 2
    for place, axis in enumerate(basis.axes):
        row = {"measure": name, "parameter": axis.key}
        alone = active[:, place] & (active.sum(axis=1) == 1)
        for index, whose in (("first_order", alone), ("total", active[:, place])):
            shares = variances[whose].sum(axis=0) / variances.sum(axis=0)
            known, missed = (shares * found.q2)[1:], 1.0 - found.q2[1:]
            row |= _interval(index, shares[0], known, known + missed)
            row |= {
                f"{index}_low": max(0.0, row[f"{index}_low"]),
                f"{index}_high": min(1.0, row[f"{index}_high"]),
            }
        yield row


def _effect_rows(name: str, basis: Basis, found: Surrogate) -> Iterator[dict]:
    for place, axis in enumerate(basis.axes):
        values, is_word = _curve(axis), axis.column.kind != "float"
        curves = found.mean(basis.means_where({place: _numbers(axis, values)}))
        for value, *effects in zip(values, *curves, strict=True):
            row = {
                "measure": name,
                "parameter": axis.key,
                "unit": UNITS[name],
                "value_unit": axis.unit,
            }
            row |= {
                "value": np.nan if is_word else float(value),
                "word": str(value) if is_word else None,
            }
            yield row | dict(zip(("effect", "effect_low", "effect_high"), effects, strict=True))


INDICES, EFFECTS, MAP = "indices", "main_effects", "map"
"""Names of the figures; those of a measure are ``main_effects_<measure>`` and ``map_<measure>``."""

_IN_A_ROW = 3
_BARS = {
    "first_order": ("alone (first order)", "simulation", 0.2),
    "total": ("with others (total)", "sky", -0.2),
}
"""By index: label, colour and vertical offset."""


def draw(found: SensitivityResult) -> Iterator[tuple[str, Drawing]]:
    """All figures by name, one at a time; none without indices."""
    if not found.good:
        return
    with plot.matplotlib_style():
        yield INDICES, _indices(found)
        for measure in found.good:
            yield f"{EFFECTS}_{measure}", _main_effects(found, measure)
            if len(found.basis.axes) > 1:
                yield f"{MAP}_{measure}", _map(found, measure)


def _indices(found: SensitivityResult) -> Drawing:
    """Bars of both indices with their intervals: a panel per measure, a row per parameter."""
    titles = {measure: fill(format_measure(measure), 31) for measure in found.good}
    keys = [axis.key for axis in found.basis.axes]
    columns = min(_IN_A_ROW, len(titles))
    rows, lines = (
        -(-len(titles) // columns),
        max(title.count("\n") + 1 for title in titles.values()),
    )
    sheet = Sheet(0.8 + rows * (0.25 + 0.15 * lines + 0.24 * len(keys)), rows, columns)
    places, share = np.arange(len(keys))[::-1], Quantity("share of the variance", "1")
    for number, (measure, title) in enumerate(titles.items()):
        panel = sheet.panel(divmod(number, columns), title, share, Quantity("", ""))
        panel.axes.set_title(title, fontsize=8.0)
        own = found.indices[found.indices["measure"] == measure]
        for index, (words, colour, offset) in _BARS.items():
            values, low, high = (own[index + end].to_numpy() for end in ("", "_low", "_high"))
            panel.axes.barh(places + offset, values, 0.38, color=COLOURS[colour], label=words)
            panel.axes.hlines(places + offset, low, high, color=plot.INK, linewidth=0.9)
            panel.record(words, values, places + offset, low=low, high=high, label=keys)
        panel.rows([format_parameter(key) if number % columns == 0 else "" for key in keys], places)
        panel.axes.set_xlim(0.0, 1.0)
        panel.axes.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
        if number + columns < len(titles):
            panel.axes.set_xlabel("")
    sheet.legend()
    return sheet.drawing()


def _main_effects(found: SensitivityResult, measure: str) -> Drawing:
    """Mean of a measure over each relevant parameter, on a common scale."""
    ranked, (quantity, factor) = found.ranked(measure), measure_quantity(measure)
    by_key = {axis.key: axis for axis in found.basis.axes}
    axes = [by_key[key] for key in ranked["parameter"][ranked["total"] >= SHOWN_SHARE]]
    curves = found.effects[found.effects["measure"] == measure]
    sheet = parameter_panels(axes, quantity)
    for panel, axis in zip(sheet.panels, axes, strict=True):
        own, x = curves[curves["parameter"] == axis.key], places(axis, _curve(axis))
        effect, low, high = (
            factor * own[f"effect{end}"].to_numpy() for end in ("", "_low", "_high")
        )
        if axis.values is not None:
            texts = [format_value(axis, value, with_unit=False) for value in axis.values]
            panel.marks("mean", x, effect, "simulation", low=low, high=high, labels=texts)
        else:
            panel.line("mean", x, effect, "simulation")
            panel.axes.fill_between(
                x, low, high, color=COLOURS["simulation"], alpha=0.2, linewidth=0.0
            )
            panel.record("interval", x, effect, low=low, high=high)
    ends = [panel.axes.get_ylim() for panel in sheet.panels]
    for panel in sheet.panels:
        panel.axes.set_ylim(np.min(ends), np.max(ends))
    return sheet.drawing()


def _map(found: SensitivityResult, measure: str) -> Drawing:
    """Mean of a measure over the two parameters of the largest total indices."""
    keys = [axis.key for axis in found.basis.axes]
    chosen = [keys.index(key) for key in found.ranked(measure)["parameter"][:2]]
    axes, (quantity, factor) = (
        [found.basis.axes[place] for place in chosen],
        measure_quantity(measure),
    )
    curves = [_curve(axis) for axis in axes]
    grid = np.meshgrid(*map(_numbers, axes, curves))
    means = found.basis.means_where(dict(zip(chosen, map(np.ravel, grid), strict=True)))
    value = factor * found.good[measure].mean(means)[0].reshape(grid[0].shape)
    sheet = Sheet(3.6, 1, 1, width=4.6)
    panel = sheet.panel((0, 0), "", *(parameter_quantity(axis)[0] for axis in axes))
    drawn = cells(panel, "mean", *map(places, axes, curves), value, quantity)
    for side, axis in zip("xy", axes, strict=True):
        scale(panel, side, axis)
    sheet.figure.colorbar(drawn, ax=panel.axes, label=fill(quantity.label, 40))
    return sheet.drawing()


_METHOD = (
    "Surrogate of each measure: polynomial chaos expansion (OpenTURNS), tested on randomly"
    " held-out designs. Q2 is 1 minus the mean squared test error over the variance; below"
    f" {LEAST_Q2:g} no indices are given. First order: share of the variance due to a parameter"
    " alone; total: including interactions. Intervals: 90 %, including the surrogate's error. Main"
    f" effects: mean for a fixed parameter, for parameters with a total index of {SHOWN_SHARE:g} or"
    " more. All numbers: `indices.parquet`, `surrogates.parquet` and `main_effects.parquet`;"
    " `jointgap describe` explains their columns."
)
_MORE = (
    "Simulate more designs (a larger `sweep.number` keeps existing ones), or use narrower ranges."
    " If this does not help, the motion is not reproducible, and only means over revolutions or"
    " starts (`sweep.starts`) can be compared."
)


def page(found: SensitivityResult) -> Page:
    ranked = {measure: found.ranked(measure) for measure in found.good}
    failed = f"{found.failed} of them failed" if found.failed else "none failed"
    blocks = [
        Paragraph(_headline(found, ranked), strong=True),
        Paragraph(f"From {found.number} designs of the sweep; {failed}."),
    ]
    if ranked:
        blocks += [
            _decisions(found, ranked),
            Heading("Indices of all measures"),
            FigureBlock(INDICES, "Sobol indices"),
        ]
        blocks.append(Heading("Main effects"))
    for measure, rows in ranked.items():
        words = format_measure(measure)
        blocks += [Heading(words, 3), FigureBlock(f"{EFFECTS}_{measure}", f"Main effects: {words}")]
        if len(rows) > 1:
            two = joined(format_parameter(key) for key in rows["parameter"][:2])
            blocks.append(FigureBlock(f"{MAP}_{measure}", f"Map: {words} over {two}", small=True))
    # measures without any value, such as impacts of an ideal joint, are omitted
    poor = found.surrogates.dropna(subset=["reason", "mean"])
    if len(poor):
        rows = tuple(zip(map(format_measure, poor["measure"]), poor["reason"], strict=True))
        blocks += [
            Heading("Measures without indices"),
            TableBlock(("measure", "reason"), rows),
            Paragraph(_MORE),
        ]
    return Page("Sensitivity", (*blocks, Heading("Method"), Paragraph(_METHOD)))


def _is_significant(ranked: pd.DataFrame) -> bool:
    """Whether the interval of the largest total index lies above that of the second."""
    return len(ranked) < 2 or ranked["total_low"].iloc[0] > ranked["total_high"].iloc[1]


def _headline(found: SensitivityResult, ranked: dict[str, pd.DataFrame]) -> str:
    number = int(found.surrogates["mean"].notna().sum())
    if not ranked:
        return f"No indices: none of the {number} measures has an accurate surrogate."
    counted = Counter(format_parameter(rows["parameter"].iloc[0]) for rows in ranked.values())
    (first, most), *others = counted.most_common()
    text = (
        f"{first[0].upper()}{first[1:]} has the largest total index for {most} of {len(ranked)}"
        " measures"
    )
    text += f", {joined(f'{words} for {count}' for words, count in others)}" if others else ""
    text += f"; significant for {sum(map(_is_significant, ranked.values()))}."
    return text + (
        f" {number - len(ranked)} measures have no indices." if len(ranked) < number else ""
    )


def _decisions(found: SensitivityResult, ranked: dict[str, pd.DataFrame]) -> TableBlock:
    table = []
    for measure, rows in ranked.items():
        parts = [
            (format_parameter(row["parameter"]), f"{row['total']:.2f} ({format_range(*ends)})")
            for row in rows[:2].to_dict("records")
            for ends in [[f"{row[f'total_{end}']:.2f}" for end in ("low", "high")]]
        ]
        first, second = (*parts, ("–", ""))[:2]
        sure = "significant" if _is_significant(rows) else "not significant"
        table.append(
            (format_measure(measure), *first, *second, sure, f"{found.good[measure].q2[0]:.3f}")
        )
    heads = (
        "measure",
        "first parameter",
        "total index",
        "second parameter",
        "total index",
        "order",
        "Q2",
    )
    return TableBlock(
        heads,
        tuple(table),
        "lllllll",
        "Total index with its 90 % interval; Q2 of the held-out designs",
    )


def metrics(scenario: Scenario, folder: Path) -> dict[str, float]:
    """Q2 of each measure's surrogate, and its indices, for MLflow."""
    surrogates, indices = (
        parquet.read(table, folder / table.path).to_dict("records") for table in TABLES[:2]
    )
    found = {
        f"q2/{row['measure']}{end}": row[f"q2{end}"]
        for row in surrogates
        for end in ("", "_low", "_high")
    }
    for row in indices:
        of = f"{row['measure']} by {row['parameter']}"
        for index in _BARS:
            found |= {f"{index}/{of}{end}": row[f"{index}{end}"] for end in ("", "_low", "_high")}
    return {name: value for name, value in found.items() if pd.notna(value)}
