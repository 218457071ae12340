"""Settings that the paper does not print, inferred by rejection sampling: designs that reproduce
its printed numbers.

The error of a number is relative to its printed value; for the ratio of the lengths, which varies
by a percent only, to its printed change.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import yaml
from scipy import stats

from jointgap.config import Scenario
from jointgap.config.designs import InferSettings
from jointgap.core.errors import InputError
from jointgap.core.facts import Fact
from jointgap.core.page import TableBlock
from jointgap.core.schema import INFER_SETTINGS_DESIGNS, INFER_SETTINGS_SETTINGS
from jointgap.core.words import format_range
from jointgap.core.words import number as format_number
from jointgap.designs.dataset import read_designs
from jointgap.designs.figures import format_parameter, format_value
from jointgap.designs.sampling import Axis, Designs, designs_of
from jointgap.designs.study import Study
from jointgap.paper.printed import CRANK_M, OPTIMA, ROD_M

NEAREST_FILE, NEAREST_NAME = "nearest_scenario.yaml", "nearest_settings"
"""File of the nearest settings that can be run as a scenario, and the scenario's name in it."""

_SIGNIFICANCE = 0.01  # level for whether a setting is informative
_MIN_ACCEPTED = 30  # accepted designs below which settings are not tested
_NEAREST_ROWS = 8  # nearest designs on the page
# may be coarser in a sweep than in a scenario
_SAMPLING_KEYS = ("revolutions", "samples_per_revolution", "tolerance")
_NO_SCENARIO = (
    "No design has the RMS over the first revolution as its error, which a scenario's optimum"
    " requires."
)


class PrintedNumber(NamedTuple):
    """A printed number that is computed for each design."""

    column: str  # Of the sweep's designs
    label: str
    printed: float  # [1]
    scale: float  # Reference of its relative error [1]
    template: str = "{:.2%}"

    def format(self, value: float) -> str:
        """The formatted value."""
        return self.template.format(value).replace("%", " %")


_RATIO = OPTIMA[0].crank_length / OPTIMA[0].rod_length
NUMBERS = (
    *(
        PrintedNumber(
            f"reduction_at_{optimum.key}",
            f"reduction, {optimum.name}",
            optimum.reduction,
            optimum.reduction,
        )
        for optimum in OPTIMA
    ),
    PrintedNumber(
        "best_ratio_in_window",
        "L2/L3 of the best lengths",
        _RATIO,
        abs(CRANK_M / ROD_M - _RATIO),
        "{:.5f}",
    ),
)
"""The printed numbers, the reductions first."""


def check(scenario: Scenario) -> None:
    """InputError where the section `infer_settings` of a `scenario` is infeasible."""
    if not scenario.sweep.parameters:
        raise InputError(
            "infer_settings: sweep.parameters is empty; give the settings to infer, as in"
            " config/paper_unknowns.yaml"
        )
    if not scenario.sweep.printed_numbers:
        raise InputError(
            "infer_settings: requires the paper's printed numbers; set sweep.printed_numbers to"
            " true"
        )
    if not any(axis.varies for axis in designs_of(scenario).axes):
        raise InputError(
            "infer_settings: every setting has one value; give a range or a list of values"
        )


@dataclass(frozen=True)
class InferredSettings:
    """The designs that reproduce the printed numbers, and the distribution of their settings."""

    designs: Designs
    within: float
    frame: pd.DataFrame  # Columns of `INFER_SETTINGS_DESIGNS`, sorted by distance
    failed: int

    @property
    def varied(self) -> tuple[Axis, ...]:
        """Settings with more than one value."""
        return tuple(axis for axis in self.designs.axes if axis.varies)

    @cached_property
    def settings(self) -> pd.DataFrame:
        """Ranges of the accepted settings: the table `INFER_SETTINGS_SETTINGS`."""
        rows, is_accepted = [], self.frame["together"]
        for axis in self.varied:
            drawn = self.frame[axis.key]
            accepted, rejected = drawn[is_accepted], drawn[~is_accepted]
            row = {"setting": axis.key, "unit": axis.unit, "p_value": np.nan}
            if axis.values is None:
                if len(accepted) and len(rejected):
                    row["p_value"] = stats.ks_2samp(accepted, rejected).pvalue
                quantiles = accepted.quantile((0.05, 0.5, 0.95))
                row |= dict(zip(("low", "median", "high"), quantiles, strict=True))
                rows.append(row | {"drawn": 1.0, "accepted": 1.0})
                continue
            counts = pd.crosstab(drawn, is_accepted)
            if min(counts.shape) > 1:
                row["p_value"] = stats.chi2_contingency(counts).pvalue
            for value in axis.values:
                shares = {"drawn": (drawn == value).mean(), "accepted": (accepted == value).mean()}
                rows.append(row | shares | {"value": str(value)})
        return pd.DataFrame(rows, columns=INFER_SETTINGS_SETTINGS.names)

    @property
    def nearest_scenario(self) -> pd.Series | None:
        """The nearest design whose error is the RMS over the first revolution, as in a scenario's
        optimum."""
        nearest = self.frame
        for key, value in (("error_measure", "rms"), ("revolution", 1)):
            if key in nearest:
                nearest = nearest[nearest[key] == value]
        return nearest.iloc[0] if len(nearest) else None


def infer(designs: Designs, options: InferSettings | None, dataset: Path) -> InferredSettings:
    """The settings that reproduce the printed numbers, from the dataset of a sweep."""
    keys = [axis.key for axis in designs.axes]
    columns = ["design", *keys, *(number.column for number in NUMBERS), "reason"]
    frame = read_designs(designs, dataset, *columns)
    return accept(designs, frame, (options or InferSettings()).within)


def accept(designs: Designs, frame: pd.DataFrame, within: float) -> InferredSettings:
    """The same from a `frame` with the parameters, printed numbers and `reason` of the
    `designs`."""
    computed = np.isfinite(frame[[number.column for number in NUMBERS]]).all(axis=1)
    computed &= frame["reason"].isna()
    if not computed.any():
        raise InputError(
            "infer_settings: all designs failed; see the reasons on the page of the sweep"
        )
    valid = frame[computed].drop(columns="reason").sort_values("design")
    farthest = relative_errors(valid).max(axis=1)
    valid = valid.assign(farthest=farthest, together=farthest <= within)
    valid = valid.sort_values("farthest", kind="stable", ignore_index=True)
    return InferredSettings(designs, within, valid, int((~computed).sum()))


def relative_errors(frame: pd.DataFrame) -> np.ndarray:
    """Relative errors of `NUMBERS`, (n, 4), of n designs."""
    errors = [(frame[number.column] - number.printed) / number.scale for number in NUMBERS]
    return np.abs(np.column_stack(errors))


def nearest_configuration(inferred: InferredSettings) -> str:
    """The nearest settings as a YAML scenario; only a comment where there are none."""
    nearest, designs = inferred.nearest_scenario, inferred.designs
    if nearest is None:
        return f"# {_NO_SCENARIO}\n"
    design = designs.scenario({axis.key: nearest[axis.key] for axis in designs.axes})
    sections = {"mechanism", "simulate"}
    content = design.model_dump(mode="json", include=sections, exclude_none=True, by_alias=True)
    for key in _SAMPLING_KEYS:
        content["simulate"].pop(key, None)
    content["description"] = (
        f"The nearest settings to all printed numbers of the paper: design {int(nearest['design'])}"
        f" of a sweep; largest error {_percent(nearest['farthest'])}."
    )
    content["optimise"] = {"window": list(designs.error_definition(nearest).window)}
    content["surrogate"] = {"iterations": 2000, "seeds": [0]}
    configuration = {
        "run": [NEAREST_NAME],
        "networks": True,
        "paper": True,
        "scenarios": {NEAREST_NAME: content},
    }
    return yaml.safe_dump(configuration, sort_keys=False)


def inference_study(inferred: InferredSettings) -> Study:
    """The study of the inferred settings."""
    frame, nearest = inferred.frame, inferred.nearest_scenario
    share, smallest_error = frame["together"].mean(), frame["farthest"].min()
    shares = (relative_errors(frame) <= inferred.within).mean(axis=0)
    headline = (
        f"{int(frame['together'].sum()) or 'None'} of {len(frame)} parameter sets"
        f" ({_percent(share)}) reproduce all printed numbers within {_percent(inferred.within)}; in"
        f" the nearest one the largest error is {_percent(smallest_error)}."
    )
    facts = [
        Fact("printed/together_percent", 100.0 * share, "%", sentence=headline),
        Fact("printed/farthest_off_in_nearest_percent", 100.0 * smallest_error, "%"),
    ]
    printed_rows = []
    for number, within in zip(NUMBERS, shares, strict=True):
        facts.append(Fact(f"printed/{number.column}_percent", 100.0 * within, "%", number.label))
        values = frame[number.column]
        low, median, high = map(number.format, values.quantile((0.05, 0.5, 0.95)))
        row = {"number": number.label, "printed": number.format(number.printed)}
        row |= {"reproduced in": _percent(within), "median": median}
        row |= {"5 to 95 %": format_range(low, high), "nearest": number.format(values.iloc[0])}
        printed_rows.append(row)
    designs = [
        _design_row(inferred, str(rank), row)
        for rank, (_, row) in enumerate(frame[:_NEAREST_ROWS].iterrows(), 1)
    ]
    scenario = _NO_SCENARIO
    if nearest is not None:
        designs.append(_design_row(inferred, "scenario", nearest))
        scenario = (
            "The row `scenario` is the nearest design that counts the RMS over the first"
            f" revolution: `{NEAREST_FILE}`."
        )
    align = "l" * (1 + len(inferred.varied)) + "r" * 5
    tables = (
        TableBlock.of(printed_rows, "lrrrrr", "Printed numbers"),
        TableBlock.of(_setting_rows(inferred), "llrrrl", "Settings of the accepted designs"),
        TableBlock.of(designs, align, "Nearest designs"),
    )
    table = INFER_SETTINGS_DESIGNS.filled(swept=[axis.column for axis in inferred.designs.axes])
    return Study(
        "Unreported settings of the paper",
        facts,
        f"Designs that failed: {inferred.failed}.",
        tables,
        f"{scenario} p-value of a test that accepted and rejected designs have the same"
        " distribution (Kolmogorov-Smirnov for ranges, chi-square for lists). All numbers:"
        " `designs.parquet` and `settings.parquet`.",
        frames={INFER_SETTINGS_SETTINGS: inferred.settings, table: frame[table.names]},
    )


def _design_row(inferred: InferredSettings, rank: str, row: pd.Series) -> dict[str, str]:
    settings = {
        format_parameter(axis.key): format_value(axis, row[axis.key]) for axis in inferred.varied
    }
    numbers = {number.label: number.format(row[number.column]) for number in NUMBERS}
    return {"": rank} | settings | numbers | {"largest error": _percent(row["farthest"])}


def _setting_rows(inferred: InferredSettings) -> Iterator[dict[str, str]]:
    axes = {axis.key: axis for axis in inferred.varied}
    accepted = int(inferred.frame["together"].sum())
    for row in inferred.settings.to_dict("records"):
        axis, p_value = axes[row["setting"]], row["p_value"]
        if axis.values is not None:
            by_name = {str(value): format_value(axis, value) for value in axis.values}
            values = by_name[row["value"]]
        else:
            ends = (format_value(axis, row[end]) for end in ("low", "high"))
            values = " to ".join(ends) if accepted else ""
        verdict = "informative" if p_value < _SIGNIFICANCE else "not informative"
        yield {
            "setting": format_parameter(axis.key),
            "5 to 95 %, or value": values,
            "drawn": _percent(row["drawn"]),
            "accepted": _percent(row["accepted"]) if accepted else "",
            "p-value": format_number(p_value),
            "verdict": verdict if accepted >= _MIN_ACCEPTED else "too few accepted",
        }


def _percent(share: float) -> str:
    return f"{format_number(100 * share, 2)} %"
