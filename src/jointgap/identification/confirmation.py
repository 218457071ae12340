"""Gaps on held-out data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri, stdtrit

from jointgap.core.candidates import Model, Parameter
from jointgap.identification.fit import Fit, fit_hypothesis
from jointgap.identification.likelihood import (
    FAILURES,
    Prediction,
    as_fitted,
    has_windows,
    predicted,
)
from jointgap.identification.problem import Noise, Problem
from jointgap.identification.settings import (
    DEFAULT_SETTINGS,
    ConfirmationSettings,
    IdentificationSettings,
)
from jointgap.identification.verdict import (
    CANNOT_TELL,
    FALLS,
    NOT_SIMULATED,
    NOTHING_HELD_OUT,
    RISES,
    STAYS,
    HeldOut,
    HeldOutTest,
    share_closed,
)

_ENDS = (0.05, 0.95)  # [1] quantiles of a 90 % interval


@dataclass(frozen=True)
class Confirmed:
    """Residuals and gaps of all runs."""

    residuals: pd.DataFrame  # Table `RESIDUALS`
    gaps: pd.DataFrame  # Table `GAPS`
    variation: Mapping[tuple[str, str], float]  # `Series.variation` of each series [unit]

    @property
    def test(self) -> HeldOutTest:
        """The test of the effects on held-out data."""
        return held_out_test(self.gaps)

    @property
    def held_out(self) -> HeldOut:
        """Input of the verdict."""
        worst = (
            max(self.channel_gaps(role), key=lambda each: each[0], default=(0.0, ""))
            for role in ("identify", "confirm")
        )
        return HeldOut(self.test, self.gap("confirm"), *worst, self.largest_noise)

    @property
    def largest_noise(self) -> tuple[float, str]:
        """The largest share [1] of noise in the variation of a channel, and the channel."""
        series = self.residuals.groupby(["run", "channel"], sort=False)["spread"]
        shares = [
            (root_mean_square(own) / (self.variation[key] or np.inf), key[1]) for key, own in series
        ]
        share, channel = max(shares, key=lambda each: each[0])
        return share, channel.replace("_", " ")

    def gap(self, role: str) -> float:
        """Gap [1] with the effects over all simulated runs of a role (``identify`` or
        ``confirm``)."""
        rows = self.gaps.query("role == @role and channel != 'all'")["after"].dropna()
        return root_mean_square(rows) if len(rows) else np.nan

    def channel_gaps(self, role: str) -> list[tuple[float, str]]:
        """Gap [1] with the effects of each channel over the simulated runs of a role."""
        own = self.residuals[self.residuals["held_out"] == (role == "confirm")].dropna(
            subset=["augmented"]
        )
        gaps = own.groupby(["channel", "run"], sort=False)["whitened_augmented"].apply(
            root_mean_square
        )
        by_channel = gaps.groupby("channel", sort=False)
        return [
            (root_mean_square(of_runs), channel.replace("_", " "))
            for channel, of_runs in by_channel
        ]


def root_mean_square(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def held_out_test(gaps: pd.DataFrame) -> HeldOutTest:
    """The test of the effects on held-out data.

    If the effects are true, the squared gap falls by the mean square of the change that they cause
    (`fall_expected`). If some runs cannot be simulated, the others are tested one by one, and the
    worst result counts.
    """
    held_out = gaps.query("role == 'confirm' and channel == 'all'")
    if held_out.empty:
        return HeldOutTest(NOTHING_HELD_OUT)
    simulated = held_out.dropna(subset=["after"])
    together = simulated[simulated["run"] == "all"]
    order, tests = (RISES, STAYS, FALLS, CANNOT_TELL), []
    for row in (simulated if together.empty else together).to_dict("records"):
        outcome = CANNOT_TELL if row["fall_high"] >= row["fall_expected"] else STAYS
        outcome = FALLS if row["fall_low"] > 0.0 else RISES if row["fall_high"] < 0.0 else outcome
        tests.append(HeldOutTest(outcome, row["before"], row["after"], row["after_low"]))
    return min(
        tests, key=lambda test: order.index(test.outcome), default=HeldOutTest(NOT_SIMULATED)
    )


def confirm(
    model: Model,
    noise: Mapping[tuple[str, str], Noise],
    base: Fit,
    named: Fit | None = None,
    seed: int = 0,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> Confirmed:
    """Predict every run with and without the effects of the verdict.

    Run-specific values (speed, first angle) of a held-out run are fitted to it, for the base and
    for the named effects; shared values are those of the fitted runs. If a held-out run cannot be
    simulated with the named effects, the gap after of that run and of all runs together is NaN,
    with the reason as remark.
    """
    named = base if named is None else named
    used, frames, remarks = Problem(model, noise, settings=settings), [], {}
    plain = as_fitted(used, base)
    frames.append(_compared(used, plain, plain if named is base else as_fitted(used, named)))
    runs = Problem(model, noise, held_out=True, settings=settings).runs
    problems = {
        run: Problem(_Alone(model, run), noise, held_out=True, settings=settings) for run in runs
    }
    for run, problem in problems.items():
        before = _predicted(problem, base)
        try:
            frames.append(
                _compared(problem, before, before if named is base else _predicted(problem, named))
            )
        except FAILURES as error:
            remarks[run] = str(error)
            frames.append(
                _compared(problem, before, before).assign(
                    augmented=np.nan, whitened_augmented=np.nan
                )
            )
    residuals = pd.concat(frames, ignore_index=True)
    gaps = _gaps(residuals, remarks, np.random.default_rng(seed), settings.confirmation)
    return Confirmed(
        residuals, gaps, {series.key: series.variation(series.value) for series in model.series}
    )


class _Alone:
    """A model with one run of another model."""

    def __init__(self, model: Model, run: str):
        self._model = model
        self.series = [series for series in model.series if series.run == run]

    def __getattr__(self, name: str):
        return getattr(self._model, name)


def fit_run_parameters(problem: Problem, fit: Fit) -> dict[str, float]:
    """Values [SI] of a fit by key, with the run-specific values of a held-out run fitted (nominal
    if that fails)."""
    own = _not_fitted(problem, fit)
    if not own:
        return fit.mapping
    return (
        fit.mapping | fit_hypothesis(problem, fit.hypothesis, start=fit.mapping, vary=own).mapping
    )


def _not_fitted(problem: Problem, fit: Fit) -> list[Parameter]:
    """Run-specific parameters of a problem that the fit did not vary."""
    fitted = {p.key for p in fit.parameters}
    return [
        p for p in problem.parameters(fit.hypothesis) if p.run is not None and p.key not in fitted
    ]


def _predicted(problem: Problem, fit: Fit) -> Prediction:
    """The prediction of a held-out run with its run-specific values (and states, in windows)
    fitted."""
    if fit.in_windows and has_windows(problem, fit.hypothesis, fit.mapping):
        return predicted(problem, fit.hypothesis, fit.mapping, _not_fitted(problem, fit))
    values = fit_run_parameters(problem, fit)
    readings = {run: problem.predict(run, values, fit.hypothesis) for run in problem.runs}
    return Prediction(values, problem.residual(values, fit.hypothesis), readings)


def _compared(problem: Problem, before: Prediction, after: Prediction) -> pd.DataFrame:
    """Rows of the table residuals."""
    frames = []
    for run in problem.runs:
        for part in (part for part in problem.parts if part.series.run == run):
            series, used = part.series, part.used
            columns = {
                "run": run,
                "channel": series.channel,
                "sample": np.flatnonzero(used),
                "crank_angle": series.angle[used],
                "held_out": series.held_out[used],
                "measured": series.value[used],
                "base": before.readings[run][series.channel][used],
                "augmented": after.readings[run][series.channel][used],
                "whitened_base": before.residual[part.place],
                "whitened_augmented": after.residual[part.place],
                "spread": np.broadcast_to(part.noise.spread, used.shape)[used],
            }
            frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def _gaps(
    residuals: pd.DataFrame,
    remarks: Mapping[str, str],
    random: np.random.Generator,
    settings: ConfirmationSettings,
) -> pd.DataFrame:
    """Rows of the table gaps: by run and channel, by run, and for all, each by role; remarks by
    held-out run."""
    rows = []
    for held_out, of_role in residuals.groupby("held_out", sort=False):
        by_series = of_role.groupby(["run", "channel"], sort=False)
        squares = {key: _squares(series, random, settings) for key, series in by_series}
        for run in (*dict.fromkeys(run for run, _ in squares), "all"):
            own = {key: each for key, each in squares.items() if run in ("all", key[0])}
            channels = (
                [] if run == "all" else [(channel, [each]) for (_, channel), each in own.items()]
            )
            for channel, parts in (*channels, ("all", [*own.values()])):
                remark = remarks.get(run) if held_out else None
                place = {
                    "run": run,
                    "role": "confirm" if held_out else "identify",
                    "channel": channel,
                }
                rows.append(place | _gap(parts) | {"remark": remark})
    return pd.DataFrame(rows).astype({"remark": object})


class _Squares(NamedTuple):
    """Mean squared whitened residuals of a series."""

    mean: np.ndarray  # Before, after, and of their difference
    drawn: np.ndarray  # Before and after, for bootstrap samples (draws, 2)
    samples: int
    blocks: int


def _squares(
    series: pd.DataFrame, random: np.random.Generator, settings: ConfirmationSettings
) -> _Squares:
    before, after = series[["whitened_base", "whitened_augmented"]].to_numpy().T
    squared = np.column_stack([before, after, before - after]) ** 2
    blocks = np.array_split(squared[:, :2], min(settings.blocks, len(squared)))
    means, sizes = (
        np.array([block.mean(axis=0) for block in blocks]),
        np.array([len(block) for block in blocks]),
    )
    chosen = random.integers(len(blocks), size=(settings.draws, len(blocks)))
    weights = sizes[chosen][..., None]
    return _Squares(
        squared.mean(axis=0),
        (means[chosen] * weights).sum(axis=1) / weights.sum(axis=1),
        len(squared),
        len(blocks),
    )


def _gap(parts: Sequence[_Squares]) -> dict[str, float]:
    """Columns of the table gaps for several series together.

    Few blocks scatter less in a bootstrap than the mean does: deviations are widened as by
    Student's distribution.
    """
    before, after, between = np.mean([part.mean for part in parts], axis=0) ** [0.5, 0.5, 1.0]
    drawn, mean = (
        np.mean([part.drawn for part in parts], axis=0),
        np.mean([part.mean[:2] for part in parts], axis=0),
    )
    blocks, free = sum(part.blocks for part in parts), sum(part.blocks - 1 for part in parts)
    if free:
        widening = np.sqrt(blocks / free) * stdtrit(free, _ENDS[1]) / ndtri(_ENDS[1])
        drawn = np.maximum(mean + widening * (drawn - mean), 0.0)
    names = [f"{name}_{end}" for end in ("low", "high") for name in ("before", "after", "fall")]
    ends = np.quantile(np.column_stack([np.sqrt(drawn), drawn[:, 0] - drawn[:, 1]]), _ENDS, axis=0)
    found = {"samples": sum(part.samples for part in parts), "before": before, "after": after}
    found |= dict(zip(names, ends.ravel(), strict=True))
    return found | {"fall_expected": between, "closed": share_closed(before, after)}
