"""Settings that the paper does not print, inferred by rejection: the designs of a sweep that reproduce its numbers.

The departure of a number is its error as a share of what is printed. The ratio of the lengths lies within a percent of
the original one whatever the settings, so its departure is a share of its printed change.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from scipy import stats

from jointgap.config import Scenario
from jointgap.config.designs import InferSettings
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.page import Heading, Page, Paragraph, TableBlock, to_html, to_markdown
from jointgap.core.schema import INFER_SETTINGS_DESIGNS, INFER_SETTINGS_SETTINGS
from jointgap.core.words import joined
from jointgap.core.words import number as in_digits
from jointgap.designs.page import parameter_in_words, value_in_words
from jointgap.designs.sampling import Axis, Designs, designs_of
from jointgap.paper.printed import CRANK_M, OPTIMA, ROD_M

NEAREST_FILE, NEAREST_NAME = "nearest_scenario.yaml", "nearest_settings"
"""File of the nearest settings that a scenario can hold, and the scenario's name in it."""

_LEVEL = 0.01  # of the tests for whether a setting matters
_FEW = 30  # accepted designs below which nothing is said of a setting
_SHOWN = 8  # nearest designs on the page
_SAMPLING = ("revolutions", "samples_per_revolution", "tolerance")  # that a sweep may have coarser than a scenario
_RATIO = OPTIMA[0].crank_length / OPTIMA[0].rod_length


@dataclass(frozen=True)
class PrintedNumber:
    """A number that the paper prints and that is measured of each design."""

    column: str  # Of the sweep's designs
    words: str
    printed: float  # [1]
    scale: float  # What a departure is a share of [1]

    def shown(self, value: float) -> str:
        """A reduction in percent, a ratio as it is."""
        return f"{value:.5f}" if self.printed == _RATIO else f"{100.0 * value:.2f} %"


NUMBERS = (
    *(
        PrintedNumber(f"reduction_at_{one.key}", f"reduction, {one.name}", one.reduction, one.reduction)
        for one in OPTIMA
    ),
    PrintedNumber("best_ratio_in_window", "L2/L3 of the best lengths", _RATIO, abs(CRANK_M / ROD_M - _RATIO)),
)
"""The printed numbers, the reductions first."""


@dataclass(frozen=True)
class InferredSettings:
    """The designs that reproduce the printed numbers, and what they say of the settings."""

    designs: Designs
    within: float
    frame: pd.DataFrame  # Table `inferred_designs`: designs that did not fail, the nearest first
    failed: int

    @cached_property
    def varied(self) -> tuple[Axis, ...]:
        """Settings that have more than one value."""
        return tuple(axis for axis in self.designs.axes if axis.values is None or len(axis.values) > 1)

    @cached_property
    def settings(self) -> pd.DataFrame:
        """Of each setting where the accepted designs lie: the table `INFERRED_SETTINGS`."""
        rows = [row for axis in self.varied for row in self._rows(axis)]
        return pd.DataFrame(rows, columns=INFER_SETTINGS_SETTINGS.names)

    def _rows(self, axis: Axis) -> list[dict]:
        own, accepted = self.frame[axis.key], self.frame["together"]
        kept, common = own[accepted], {"setting": axis.key, "unit": axis.unit}
        if axis.values is None:
            chance = stats.ks_2samp(kept, own[~accepted]).pvalue if 0 < len(kept) < len(own) else np.nan
            names, shares = ("low", "median", "high"), (0.05, 0.5, 0.95)
            ranged = dict(zip(names, kept.quantile(shares), strict=True))
            return [common | ranged | {"drawn": 1.0, "accepted": 1.0, "p_value": chance}]
        counts = pd.crosstab(own, accepted)
        chance = stats.chi2_contingency(counts).pvalue if min(counts.shape) > 1 else np.nan
        shares = ({"drawn": (own == value).mean(), "accepted": (kept == value).mean()} for value in axis.values)
        return [
            common | share | {"value": str(value), "p_value": chance}
            for value, share in zip(axis.values, shares, strict=True)
        ]

    @property
    def nearest_scenario(self) -> pd.Series | None:
        """The nearest design that counts the RMS over the first revolution, as the optimum of a scenario does."""
        nearest = self.frame
        for key, value in (("error_measure", "rms"), ("revolution", 1)):
            if key in nearest:
                nearest = nearest[nearest[key] == value]
        return nearest.iloc[0] if len(nearest) else None


def check_infer_settings(scenario: Scenario) -> None:
    """InputError where the section `infer_settings` of a `scenario` cannot be done."""
    if not scenario.sweep.parameters:
        raise InputError(
            "infer_settings: nothing is swept; give sweep.parameters the settings that are sought, as in "
            "config/paper_unknowns.yaml"
        )
    if not scenario.sweep.printed_numbers:
        raise InputError("infer_settings: no printed numbers are measured; set sweep.printed_numbers to true")
    if all(axis.values is not None and len(axis.values) == 1 for axis in designs_of(scenario).axes):
        raise InputError("infer_settings: no setting varies, each has one value; give a range or a list of several")


def infer(scenario: Scenario, dataset: Path) -> InferredSettings:
    """The settings that reproduce the printed numbers, from the designs of a sweep."""
    designs, options = designs_of(scenario), scenario.infer_settings or InferSettings()
    columns = ["design", *(axis.key for axis in designs.axes), *(one.column for one in NUMBERS), "reason"]
    return accept(designs, parquet.read_columns(dataset, columns).to_pandas(), options.within)


def accept(designs: Designs, frame: pd.DataFrame, within: float) -> InferredSettings:
    """The same of a `frame` with the parameters, printed numbers and `reason` of the `designs` as columns."""
    fine = frame["reason"].isna() & np.isfinite(frame[[one.column for one in NUMBERS]]).all(axis=1)
    if not fine.any():
        raise InputError("infer_settings: all designs failed; the page of the sweep tells why")
    kept = frame[fine].drop(columns="reason").sort_values("design")
    farthest = departures(kept).max(axis=1)
    kept = kept.assign(farthest=farthest, together=farthest <= within)
    return InferredSettings(
        designs, within, kept.sort_values("farthest", kind="stable", ignore_index=True), int((~fine).sum())
    )


def departures(frame: pd.DataFrame) -> np.ndarray:
    """(n, 4): how far each of `NUMBERS` is off in designs, as a share."""
    return np.abs(np.column_stack([(frame[one.column] - one.printed) / one.scale for one in NUMBERS]))


def write_results(found: InferredSettings, folder: Path) -> str:
    """Write tables, the nearest scenario and the page into a `folder`; gives the page as Markdown."""
    designs = INFER_SETTINGS_DESIGNS.filled(swept=[axis.column for axis in found.designs.axes])
    shown = page(found)
    text = to_markdown(shown, ".")
    parquet.check_writable(folder / NEAREST_FILE, folder / "summary.html")
    parquet.write(INFER_SETTINGS_SETTINGS, found.settings, folder / Path(INFER_SETTINGS_SETTINGS.path).name)
    parquet.write(designs, found.frame[list(designs.names)], folder / Path(designs.path).name)
    parquet.write_text(folder / NEAREST_FILE, nearest_configuration(found))
    parquet.write_text(folder / "summary.html", to_html(shown))
    parquet.write_text(folder / "summary.md", text)
    return text


def nearest_configuration(found: InferredSettings) -> str:
    """A configuration, YAML, of the nearest settings that a scenario can hold; a comment alone where there are none."""
    chosen = found.nearest_scenario
    if chosen is None:
        return "# No design counts the RMS over the first revolution, as the optimum of a scenario does.\n"
    made = found.designs.scenario({axis.key: chosen[axis.key] for axis in found.designs.axes})
    content = made.model_dump(mode="json", include={"mechanism", "simulate"}, exclude_none=True, by_alias=True)
    content["simulate"] = {key: value for key, value in content["simulate"].items() if key not in _SAMPLING}
    content["description"] = (
        f"The nearest settings to all of the paper's printed numbers: design {int(chosen['design'])} of a sweep, "
        f"none more than {_percent(chosen['farthest'])} off."
    )
    content["optimise"] = {"window": list(found.designs.counting(chosen).window)}
    content["surrogate"] = {"iterations": 2000, "seeds": [0]}
    whole = {"run": [NEAREST_NAME], "networks": True, "paper": True, "scenarios": {NEAREST_NAME: content}}
    return yaml.safe_dump(whole, sort_keys=False)


def page(found: InferredSettings) -> Page:
    """The page of the settings that reproduce the printed numbers."""
    number, accepted = len(found.frame), int(found.frame["together"].sum())
    headline = (
        f"{accepted or 'None'} of {number} parameter sets ({_percent(accepted / number)}) reproduce "
        f"all printed numbers within {_percent(found.within)}; in the nearest one the largest error "
        f" is {_percent(found.frame['farthest'].iloc[0])}."
    )
    heads = (
        "",
        *(parameter_in_words(axis.key) for axis in found.varied),
        *(one.words for one in NUMBERS),
        "largest error",
    )
    nearest = [(str(rank), row) for rank, (_, row) in enumerate(found.frame[:_SHOWN].iterrows(), 1)]
    chosen = found.nearest_scenario
    if chosen is not None:
        nearest.append(("scenario", chosen))
    rows = tuple(
        (
            rank,
            *(value_in_words(axis, row[axis.key]) for axis in found.varied),
            *(one.shown(row[one.column]) for one in NUMBERS),
            _percent(row["farthest"]),
        )
        for rank, row in nearest
    )
    blocks = (
        Paragraph(headline, strong=True),
        Heading("Printed numbers"),
        TableBlock(
            ("number", "printed", "reproduced in", "median", "5 to 95 %", "nearest"), tuple(_numbers(found)), "lrrrrr"
        ),
        Heading("Settings of the accepted designs"),
        TableBlock(
            ("setting", "unit or value", "drawn", "accepted", "p-value", "verdict"),
            tuple(_settings(found)),
            "llrrrl",
            "p-value of a test that accepted and rejected designs have the same distribution (Kolmogorov-Smirnov for "
            "ranges, chi-square for lists).",
        ),
        Heading("Nearest designs"),
        TableBlock(heads, rows, "l" * (1 + len(found.varied)) + "r" * 5),
        Paragraph(
            f"The row *scenario* is the nearest design that counts the RMS over the first revolution: `{NEAREST_FILE}`."
            if chosen is not None
            else "No design counts the RMS over the first revolution, as the optimum of a scenario does."
        ),
        Paragraph(f"Designs that failed: {found.failed}. All numbers: `designs.parquet` and `settings.parquet`."),
    )
    return Page("Unreported settings of the paper", blocks)


def _numbers(found: InferredSettings):
    off = departures(found.frame) <= found.within
    for one, fits in zip(NUMBERS, off.T, strict=True):
        low, middle, high = (one.shown(value) for value in found.frame[one.column].quantile((0.05, 0.5, 0.95)))
        nearest = one.shown(found.frame[one.column].iloc[0])
        yield one.words, one.shown(one.printed), _percent(fits.mean()), middle, f"{low} to {high}", nearest


def _settings(found: InferredSettings):
    accepted = int(found.frame["together"].sum())
    for axis in found.varied:
        own = found.settings[found.settings["setting"] == axis.key]
        chance, words = own["p_value"].iloc[0], parameter_in_words(axis.key)
        verdict = "too few accepted" if accepted < _FEW else "informative" if chance < _LEVEL else "not informative"
        if axis.values is None:
            drawn, kept = (
                " to ".join(value_in_words(axis, value) for value in ends)
                for ends in (axis.law.ppf([0.0, 1.0]), own[["low", "high"]].iloc[0])
            )
        else:
            drawn, kept = (
                joined(
                    f"{value_in_words(axis, value)} {100 * share:.0f} %"
                    for value, share in zip(axis.values, own[name], strict=True)
                )
                for name in ("drawn", "accepted")
            )
        yield words, axis.unit, drawn, kept if accepted else "", in_digits(chance), verdict


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
