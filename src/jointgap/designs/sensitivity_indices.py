"""Sobol indices and main effects of the measures of a sweep, read from a surrogate of each.

The terms of a surrogate are orthonormal, so the variance of each belongs to the parameters in it: those of one
parameter alone make its first-order index, all that it stands in its total index (Sudret, Reliab. Eng. Syst. Saf. 93
(2008) 964). What the surrogate misses, 1 - Q2 of the variance, belongs to parameters that nobody knows. An interval
counts it once for nothing and once wholly for the parameter in question:

    Q2 S  to  Q2 S + 1 - Q2,

the first at the lower, the second at the upper end of a 90 % interval of bootstrap replicates of surrogate and Q2. For
a surrogate by least squares that holds for any motion, for then what is missed is uncorrelated with each of its terms.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.config.sensitivity_config import Sensitivity
from jointgap.core.errors import InputError
from jointgap.core.progress import followed
from jointgap.designs.design_of_experiments import Designs
from jointgap.designs.sensitivity_inputs import Input, Inputs
from jointgap.designs.sensitivity_settings import SETTINGS, SensitivitySettings
from jointgap.designs.sensitivity_surrogate import Surrogate, Training
from jointgap.tables.sweep_tables import ALL_MEASURES

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
    return decided(designs, tables.read_columns(dataset, columns).to_pandas(), names, options.seed, settings)


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
        for table, rows in zip(tables.SENSITIVITY_TABLES, (surrogates, indices, effects), strict=True)
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
