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
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.page import Heading, Page, Paragraph, TableBlock
from jointgap.core.schema import INFER_SETTINGS_DESIGNS, INFER_SETTINGS_SETTINGS, Table
from jointgap.core.words import format_range
from jointgap.core.words import number as in_digits
from jointgap.designs.sampling import Axis, Designs, designs_of
from jointgap.designs.sweep import format_parameter, format_value
from jointgap.paper.printed import CRANK_M, OPTIMA, ROD_M

NEAREST_FILE, NEAREST_NAME = "nearest_scenario.yaml", "nearest_settings"
"""File of the nearest settings that can be run as a scenario, and the scenario's name in it."""

_LEVEL = 0.01  # significance level for whether a setting is informative
_FEW = 30  # accepted designs below which settings are not tested
_SHOWN = 8  # nearest designs on the page
_SAMPLING = (
    "revolutions",
    "samples_per_revolution",
    "tolerance",
)  # may be coarser in a sweep than in a scenario
_NONE = (
    "No design has the RMS over the first revolution as its error, which a scenario's optimum"
    " requires."
)


class PrintedNumber(NamedTuple):
    """A printed number that is computed for each design."""

    column: str  # Of the sweep's designs
    words: str
    printed: float  # [1]
    scale: float  # Reference of its relative error [1]
    text: str = "{:.2%}"  # Format

    def shown(self, value: float) -> str:
        """The formatted value."""
        return self.text.format(value).replace("%", " %")


_RATIO = OPTIMA[0].crank_length / OPTIMA[0].rod_length
NUMBERS = (
    *(
        PrintedNumber(
            f"reduction_at_{one.key}", f"reduction, {one.name}", one.reduction, one.reduction
        )
        for one in OPTIMA
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
    frame: pd.DataFrame  # Table `inferred_designs`: designs that did not fail, sorted by distance
    failed: int

    @property
    def varied(self) -> tuple[Axis, ...]:
        """Settings with more than one value."""
        return tuple(axis for axis in self.designs.axes if axis.varies)

    @cached_property
    def settings(self) -> pd.DataFrame:
        """Ranges of the accepted settings: the table `INFERRED_SETTINGS`."""
        rows, accepted = [], self.frame["together"]
        for axis in self.varied:
            own, common = self.frame[axis.key], {"setting": axis.key, "unit": axis.unit}
            kept = own[accepted]
            if axis.values is None:
                chance = (
                    stats.ks_2samp(kept, own[~accepted]).pvalue
                    if 0 < len(kept) < len(own)
                    else np.nan
                )
                ends = dict(
                    zip(("low", "median", "high"), kept.quantile((0.05, 0.5, 0.95)), strict=True)
                )
                rows.append(common | ends | {"drawn": 1.0, "accepted": 1.0, "p_value": chance})
                continue
            counts = pd.crosstab(own, accepted)
            chance = stats.chi2_contingency(counts).pvalue if min(counts.shape) > 1 else np.nan
            for value in axis.values:
                shares = {"drawn": (own == value).mean(), "accepted": (kept == value).mean()}
                rows.append(common | shares | {"value": str(value), "p_value": chance})
        return pd.DataFrame(rows, columns=INFER_SETTINGS_SETTINGS.names)

    @property
    def tables(self) -> dict[Table, pd.DataFrame]:
        """The tables of the stage."""
        designs = INFER_SETTINGS_DESIGNS.filled(swept=[axis.column for axis in self.designs.axes])
        return {INFER_SETTINGS_SETTINGS: self.settings, designs: self.frame[designs.names]}

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
    columns = [
        "design",
        *(axis.key for axis in designs.axes),
        *(one.column for one in NUMBERS),
        "reason",
    ]
    return accept(
        designs,
        parquet.read_columns(dataset, columns).to_pandas(),
        (options or InferSettings()).within,
    )


def accept(designs: Designs, frame: pd.DataFrame, within: float) -> InferredSettings:
    """The same from a `frame` with the parameters, printed numbers and `reason` of the
    `designs`."""
    fine = frame["reason"].isna() & np.isfinite(frame[[one.column for one in NUMBERS]]).all(axis=1)
    if not fine.any():
        raise InputError(
            "infer_settings: all designs failed; see the reasons on the page of the sweep"
        )
    kept = frame[fine].drop(columns="reason").sort_values("design")
    farthest = departures(kept).max(axis=1)
    kept = kept.assign(farthest=farthest, together=farthest <= within)
    kept = kept.sort_values("farthest", kind="stable", ignore_index=True)
    return InferredSettings(designs, within, kept, int((~fine).sum()))


def departures(frame: pd.DataFrame) -> np.ndarray:
    """Relative errors of `NUMBERS`, (n, 4), of n designs."""
    return np.abs(
        np.column_stack([(frame[one.column] - one.printed) / one.scale for one in NUMBERS])
    )


def nearest_configuration(found: InferredSettings) -> str:
    """The nearest settings as a YAML scenario; only a comment where there are none."""
    chosen = found.nearest_scenario
    if chosen is None:
        return f"# {_NONE}\n"
    made = found.designs.scenario({axis.key: chosen[axis.key] for axis in found.designs.axes})
    content = made.model_dump(
        mode="json", include={"mechanism", "simulate"}, exclude_none=True, by_alias=True
    )
    content["simulate"] = {
        key: value for key, value in content["simulate"].items() if key not in _SAMPLING
    }
    content["description"] = (
        f"The nearest settings to all printed numbers of the paper: design {int(chosen['design'])}"
        f" of a sweep; largest error {_percent(chosen['farthest'])}."
    )
    content["optimise"] = {"window": list(found.designs.error_definition(chosen).window)}
    content["surrogate"] = {"iterations": 2000, "seeds": [0]}
    whole = {
        "run": [NEAREST_NAME],
        "networks": True,
        "paper": True,
        "scenarios": {NEAREST_NAME: content},
    }
    return yaml.safe_dump(whole, sort_keys=False)


def page(found: InferredSettings) -> Page:
    frame, chosen, accepted = (
        found.frame,
        found.nearest_scenario,
        int(found.frame["together"].sum()),
    )
    headline = (
        f"{accepted or 'None'} of {len(frame)} parameter sets ({_percent(accepted / len(frame))})"
        f" reproduce all printed numbers within {_percent(found.within)}; in the nearest one the"
        f" largest error is {_percent(frame['farthest'].iloc[0])}."
    )
    numbers = []
    for one, off in zip(NUMBERS, departures(frame).T, strict=True):
        low, middle, high = map(one.shown, frame[one.column].quantile((0.05, 0.5, 0.95)))
        row = {"number": one.words, "printed": one.shown(one.printed)}
        row |= {
            "reproduced in": _percent((off <= found.within).mean()),
            "median": middle,
            "5 to 95 %": format_range(low, high),
        }
        numbers.append(row | {"nearest": one.shown(frame[one.column].iloc[0])})
    nearest = [
        _design(found, str(rank), row) for rank, (_, row) in enumerate(frame[:_SHOWN].iterrows(), 1)
    ]
    nearest += [] if chosen is None else [_design(found, "scenario", chosen)]
    blocks = (
        Paragraph(headline, strong=True),
        Heading("Printed numbers"),
        TableBlock.of(numbers, "lrrrrr"),
        Heading("Settings of the accepted designs"),
        TableBlock(
            ("setting", "5 to 95 %, or value", "drawn", "accepted", "p-value", "verdict"),
            tuple(_settings(found, accepted)),
            "llrrrl",
            "p-value of a test that accepted and rejected designs have the same distribution"
            " (Kolmogorov-Smirnov for ranges, chi-square for lists).",
        ),
        Heading("Nearest designs"),
        TableBlock.of(nearest, "l" * (1 + len(found.varied)) + "r" * 5),
        Paragraph(
            "The row *scenario* is the nearest design that counts the RMS over the first"
            f" revolution: `{NEAREST_FILE}`."
            if chosen is not None
            else _NONE
        ),
        Paragraph(
            f"Designs that failed: {found.failed}. All numbers: `designs.parquet` and"
            " `settings.parquet`."
        ),
    )
    return Page("Unreported settings of the paper", blocks)


def _design(found: InferredSettings, rank: str, row: pd.Series) -> dict[str, str]:
    settings = {
        format_parameter(axis.key): format_value(axis, row[axis.key]) for axis in found.varied
    }
    numbers = {one.words: one.shown(row[one.column]) for one in NUMBERS}
    return {"": rank} | settings | numbers | {"largest error": _percent(row["farthest"])}


def _settings(found: InferredSettings, accepted: int) -> Iterator[tuple[str, ...]]:
    axes = {axis.key: axis for axis in found.varied}
    for row in found.settings.to_dict("records"):
        axis, chance = axes[row["setting"]], row["p_value"]
        where = {str(value): format_value(axis, value) for value in axis.values or ()}.get(
            row["value"]
        )
        if axis.values is None:
            where = (
                " to ".join(format_value(axis, row[end]) for end in ("low", "high"))
                if accepted
                else ""
            )
        verdict = (
            "too few accepted"
            if accepted < _FEW
            else "informative"
            if chance < _LEVEL
            else "not informative"
        )
        shares = (_percent(row["drawn"]), _percent(row["accepted"]) if accepted else "")
        yield format_parameter(axis.key), where, *shares, in_digits(chance), verdict


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def metrics(scenario: Scenario, folder: Path) -> dict[str, float]:
    """Shares of the designs that reproduce the paper's printed numbers, singly and together, for
    MLflow."""
    names = ["together", "farthest", *(one.column for one in NUMBERS)]
    designs = parquet.read_columns(folder / "infer_settings/designs.parquet", names).to_pandas()
    shares = (departures(designs) <= scenario.infer_settings.within).mean(axis=0)
    return {
        "printed/together_percent": 100 * designs["together"].mean(),
        "printed/farthest_off_in_nearest_percent": 100 * designs["farthest"].min(),
        **{
            f"printed/{one.column}_percent": 100 * share
            for one, share in zip(NUMBERS, shares, strict=True)
        },
    }
