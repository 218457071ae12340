"""Designs of a sweep weighed by how near the paper's printed numbers come out in them.

Of each number there is a departure: how far off it is, as a share of what is printed. The ratio of the lengths lies
within a percent of the original one whatever the settings, so its departure is a share of its printed change. In the
likelihood the three reductions count as one number, the mean of their squares, for any measure linear in the angle has
(1 - R) L3 in common along the valley in which the printed lengths lie. Of the sum of squares (1 - R) L3^2 is constant
there, and the third reduction comes out short where the first two do not: that speaks against it, more than this says,

    log L = -(mean of d_R^2 + d_ratio^2) / (2 deviation^2).

The designs are drawn from what the settings may be, so weights proportional to L make a sample of the posterior of
them (importance sampling). Its effective sample size, how many equally weighed designs it is worth, is
(sum w)^2 / sum w^2 (Kish 1965).
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.config import Scenario
from jointgap.config.infer_settings_config import InferSettings
from jointgap.core.errors import InputError
from jointgap.designs.design_of_experiments import Axis, Designs, designs_of
from jointgap.paper.printed import CRANK_M, OPTIMA, ROD_M
from jointgap.tables.infer_settings_tables import INFERRED_NUMBERS, INFERRED_SETTINGS

BINS = 8
"""Of a range, each as likely before: with some hundred designs' worth of weight a bin still has ten or more."""

REPLICATES = 400
"""Of the bootstrap: the ends of a 90 % interval are then known to a tenth of its length."""

CONFIDENCE = 0.9
"""Of intervals: 90 %, as everywhere in jointgap."""

CHANCE = 0.99
"""Share of the shuffles that a setting has to beat: of nine settings one in eleven sweeps then moves by chance."""


_RATIO_COLUMN = "best_ratio_in_window"


@dataclass(frozen=True)
class PrintedNumber:
    """A number that the paper prints and that is measured of each design."""

    column: str  # Of `jointgap.tables.sweep_tables.PRINTED_OPTIMA`, or the best ratio
    words: str
    printed: float  # [1]
    scale: float  # What a departure is a share of [1]

    def shown(self, value: float) -> str:
        """A value of it as people read it: a reduction in percent, a ratio as it is."""
        return f"{value:.5f}" if self.column == _RATIO_COLUMN else f"{100.0 * value:.2f} %"


_RATIO = OPTIMA[0].crank_length / OPTIMA[0].rod_length
NUMBERS = (
    *(
        PrintedNumber(f"reduction_at_{one.key}", f"error falls at the lengths of: {one.name}", one.reduction,
                      one.reduction)
        for one in OPTIMA
    ),
    PrintedNumber(_RATIO_COLUMN, "L2/L3 of the best lengths", _RATIO, abs(CRANK_M / ROD_M - _RATIO)),
)  # fmt: skip
"""The printed numbers, the reductions first."""


@dataclass(frozen=True)
class InferredSettings:
    """What the printed numbers tell of the settings."""

    designs: Designs
    options: InferSettings
    frame: pd.DataFrame
    failed: int
    numbers: pd.DataFrame  # Tables `INFERRED_NUMBERS` and `INFERRED_SETTINGS` of `jointgap.tables`
    settings: pd.DataFrame  # Tables `INFERRED_NUMBERS` and `INFERRED_SETTINGS` of `jointgap.tables`

    @property
    def varied(self) -> tuple[Axis, ...]:
        """Settings that have more than one value."""
        return tuple(axis for axis in self.designs.axes if axis.values is None or len(axis.values) > 1)

    @property
    def together(self) -> float:
        """Share of the designs in which all numbers come out."""
        return float(self.frame["together"].mean())

    @property
    def effective_sample_size(self) -> float:
        """How many equally weighed designs the posterior is worth."""
        return effective_sample_size(self.frame["weight"].to_numpy())

    @property
    def nearest(self) -> pd.DataFrame:
        """The designs, those first whose farthest number is nearest."""
        return self.frame.sort_values("farthest", kind="stable")

    @property
    def nearest_scenario(self) -> pd.Series | None:
        """The nearest of the designs that a scenario can hold, whose optimum counts the RMS over the first revolution;
        None where there is none.
        """
        nearest = self.nearest
        for key, value in (("error_measure", "rms"), ("revolution", 1)):
            if key in nearest:
                nearest = nearest[nearest[key] == value]
        return nearest.iloc[0] if len(nearest) else None

    @cached_property
    def moved(self) -> pd.DataFrame:
        """By setting, largest first: ``moved``, how far its posterior lies from what was drawn, as the share of weight
        that would have to move (total variation distance); ``by_chance``, what CHANCE of the shuffles stay below in
        which the weights are dealt to the designs anew, so that they know nothing of the setting; ``told``, whether it
        is beyond that.
        """
        weight, shuffles = self.frame["weight"].to_numpy(), np.random.default_rng(self.options.seed)
        shuffled = np.array([shuffles.permutation(weight) for _ in range(REPLICATES)])
        rows = {}
        for axis in self.varied:
            members, _ = _members(axis, self.frame[axis.key].to_numpy())
            shares = members.astype(float) @ np.vstack([weight, shuffled]).T
            apart = 0.5 * np.abs(shares - members.mean(axis=1)[:, None]).sum(axis=0)
            rows[axis.key] = {"moved": apart[0], "by_chance": np.quantile(apart[1:], CHANCE)}
        found = pd.DataFrame.from_dict(rows, orient="index")
        found["told"] = found["moved"] > found["by_chance"]
        return found.sort_values("moved", ascending=False, kind="stable")


def check_infer_settings(scenario: Scenario) -> None:
    """Whether the section `infer_settings` of a `scenario` can be done at all."""
    if not scenario.sweep.parameters:
        raise InputError(
            "infer_settings: nothing is swept; give sweep.parameters the settings that are sought, as in "
            "config/paper_unknowns.yaml"
        )
    if not scenario.sweep.printed_numbers:
        raise InputError("infer_settings: no printed numbers are measured; set sweep.printed_numbers to true")
    designs = designs_of(scenario)
    if all(axis.values is not None and len(axis.values) == 1 for axis in designs.axes):
        raise InputError("infer_settings: no setting varies, each has one value; give a range or a list of several")
    options, simulate = scenario.infer_settings, scenario.simulate
    if options and options.trained:
        points, samples = scenario.surrogate.training_points - 1, simulate.samples_per_revolution
        if samples % points or samples < 5 * points:
            raise InputError(
                f"infer_settings.trained: simulate.samples_per_revolution {samples} must be a multiple of the {points} "
                "points that networks are trained at, five times it at least; change it, or set trained to 0"
            )


def inferred(scenario: Scenario, dataset: Path) -> InferredSettings:
    """The settings that the printed numbers tell of, from the designs of a sweep."""
    check_infer_settings(scenario)
    designs = designs_of(scenario)
    columns = ["design", *(axis.key for axis in designs.axes), *(one.column for one in NUMBERS), "reason"]
    return inferred_from(
        designs, tables.read_columns(dataset, columns).to_pandas(), scenario.infer_settings or InferSettings()
    )


def inferred_from(designs: Designs, frame: pd.DataFrame, options: InferSettings) -> InferredSettings:
    """The same of a `frame` with the parameters, printed numbers and `reason` of the `designs` as columns; errors as
    `inferred`. `options` are the limits.
    """
    fine = frame["reason"].isna() & np.isfinite(frame[[one.column for one in NUMBERS]]).all(axis=1)
    if not fine.any():
        raise InputError("infer_settings: all designs failed; the page of the sweep tells why")
    kept = frame[fine].drop(columns="reason").sort_values("design", ignore_index=True)
    off = departures(kept)
    out = np.abs(off) <= options.within
    kept = kept.assign(
        weight=weights(off, options.deviation), farthest=np.abs(off).max(axis=1), together=out.all(axis=1)
    )
    numbers = pd.DataFrame([_number_row(one, kept, out[:, place]) for place, one in enumerate(NUMBERS)])
    replicated = _replicated(kept["weight"].to_numpy(), options.seed)
    rows = [row for axis in designs.axes for row in _setting_rows(axis, kept, replicated)]
    settings = pd.DataFrame(rows, columns=INFERRED_SETTINGS.names)
    return InferredSettings(designs, options, kept, int((~fine).sum()), numbers[list(INFERRED_NUMBERS.names)], settings)


def departures(frame: pd.DataFrame) -> np.ndarray:
    """(n, 4): how far off each of `NUMBERS` is in designs whose columns a `frame` has, as a share."""
    return np.column_stack([(frame[one.column].to_numpy() - one.printed) / one.scale for one in NUMBERS])


def weights(off: np.ndarray, deviation: float) -> np.ndarray:
    """Weights (n,) of designs by the likelihood of the printed numbers; they add up to 1."""
    logarithm = -0.5 * (np.mean(off[:, :-1] ** 2, axis=1) + off[:, -1] ** 2) / deviation**2
    likelihood = np.exp(logarithm - logarithm.max())
    return likelihood / likelihood.sum()


def effective_sample_size(weight: np.ndarray) -> float:
    """How many equally weighed designs those of a `weight` (n,) are worth."""
    return float(weight.sum() ** 2 / np.sum(weight**2))


def _replicated(weight: np.ndarray, seed: int) -> np.ndarray:
    """Weights (replicates, n) of designs drawn anew from those that there are."""
    counts = np.random.default_rng(seed).multinomial(len(weight), np.full(len(weight), 1.0 / len(weight)), REPLICATES)
    drawn = counts * weight
    return drawn / drawn.sum(axis=1, keepdims=True)


def _number_row(one: PrintedNumber, frame: pd.DataFrame, out: np.ndarray) -> dict:
    values = frame[one.column].to_numpy()
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
    return {
        "number": one.column,
        "printed": one.printed,
        "share": float(out.mean()),
        "low": low,
        "median": middle,
        "high": high,
        "nearest": float(values[np.argmin(frame["farthest"])]),
    }


def edges_of(axis: Axis) -> np.ndarray:
    """Ends (BINS + 1,) of the bins of a range of an `axis` [SI], each as likely before; of a tolerance without ends the
    outer ones lie beyond all designs.
    """
    edges = axis.law.ppf(np.linspace(0.0, 1.0, BINS + 1))
    return np.where(np.isfinite(edges), edges, axis.law.ppf(np.clip(np.linspace(0.0, 1.0, BINS + 1), 1e-12, 1 - 1e-12)))


def place_of(axis: Axis, own: np.ndarray) -> np.ndarray:
    """Number (n,) of the bin, or of the value of a list, in which values lie."""
    if axis.values is not None:
        return np.argmax([own == value for value in axis.values], axis=0)
    return np.clip(np.searchsorted(edges_of(axis), own, side="right") - 1, 0, BINS - 1)


def _members(axis: Axis, own: np.ndarray) -> tuple[np.ndarray, list[tuple]]:
    """Which values lie in which bin, or are which value of a list, (bins, n); and ends and word of each bin."""
    if axis.values is not None:
        spans = [(np.nan, np.nan, str(value)) for value in axis.values]
    else:
        spans = [(low, high, None) for low, high in pairwise(edges_of(axis))]
    place = place_of(axis, own)
    return np.array([place == number for number in range(len(spans))]), spans


def _setting_rows(axis: Axis, frame: pd.DataFrame, replicated: np.ndarray) -> list[dict]:
    """Prior and posterior share of each value of a list, or of each bin of a range."""
    weight = frame["weight"].to_numpy()
    members, spans = _members(axis, frame[axis.key].to_numpy())
    rows = []
    for member, (low, high, word) in zip(members, spans, strict=True):
        ends = np.quantile(replicated[:, member].sum(axis=1), ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2))
        posterior = float(weight[member].sum())
        rows.append(
            {
                "setting": axis.key,
                "from": low,
                "to": high,
                "value": word,
                "unit": axis.unit,
                "prior": float(member.mean()),
                "posterior": posterior,
                "posterior_low": min(posterior, ends[0]),
                "posterior_high": max(posterior, ends[1]),
                "together": float(frame["together"].to_numpy()[member].mean()) if member.any() else np.nan,
            }
        )
    return rows


def densest(settings: pd.DataFrame) -> tuple[float, float, float, float]:
    """Of a range the fewest neighbouring bins that hold half of the weight or more: lower end, upper end [SI], weight,
    share that was drawn there.
    """
    weight = settings["posterior"].to_numpy()
    for width in range(1, len(weight) + 1):
        held = np.convolve(weight, np.ones(width), "valid")
        first = int(np.argmax(held))
        if held[first] >= 0.5 or width == len(weight):
            rows = settings.iloc[first : first + width]
            return (
                float(rows["from"].iloc[0]),
                float(rows["to"].iloc[-1]),
                float(held[first]),
                float(rows["prior"].sum()),
            )
    raise AssertionError("all bins hold all of the weight")
