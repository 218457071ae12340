"""How far the gap shrinks on data that took no part in fitting or choosing."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.errors import InputError, SimulationError
from jointgap.identification.fit import Fit, fit_hypothesis
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.protocol import Model
from jointgap.identification.settings import DEFAULT_SETTINGS, ConfirmationSettings, IdentificationSettings
from jointgap.identification.whitening import Noise

_ENDS = (0.05, 0.95)  # [1] quantiles between which a 90 % interval lies


@dataclass(frozen=True)
class Confirmed:
    """Residuals and gaps of all runs.

    Attributes
    ----------
    residuals : DataFrame
        Table `jointgap.tables.RESIDUALS`.
    gaps : DataFrame
        Table `jointgap.tables.GAPS`.
    """

    residuals: pd.DataFrame
    gaps: pd.DataFrame


def share_closed(before: float, after: float) -> float:
    """Share of what exceeds the noise that is gone, in squares; NaN where nothing exceeded it.

    Parameters
    ----------
    before, after : float
        Gaps [1]: root mean squares of the residual over its noise, so that noise alone makes 1.
    """
    return 1.0 - (after**2 - 1.0) / (before**2 - 1.0) if before > 1.0 else np.nan


def confirm(
    model: Model,
    noise: Mapping[tuple[str, str], Noise],
    base: Fit,
    named: Fit | None = None,
    seed: int = 0,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> Confirmed:
    """Predict every run with and without the effects of the verdict.

    What a held-out run has for itself (its speed, its first angle) is fitted to it, for the base as well as for the
    named effects: what all runs share stays as found on the runs for fitting. A held-out run that cannot be simulated
    with the named effects has no prediction and no gap after, with the reason as a remark of its gaps; all runs
    together have none either.

    Parameters
    ----------
    model : Model
    noise : mapping of (run, channel) to Noise
    base : Fit
        With no effect added: the base that the verdict rests on, or the nominal model where that is enough.
    named : Fit, optional
        With the effects of the verdict; the base where there are none.
    seed : int
        Of the bootstrap.
    settings : IdentificationSettings

    Raises
    ------
    InputError, SimulationError
        A held-out run cannot be simulated with the base.
    """
    named = base if named is None else named
    used = Problem(model, noise, settings=settings)
    frames, remarks = [_compared(used, base.mapping, named.mapping, named.hypothesis).assign(role="identify")], {}
    for run in Problem(model, noise, held_out=True, settings=settings).runs:
        problem = Problem(_Alone(model, run), noise, held_out=True, settings=settings)
        before = fit_run_parameters(problem, base)
        try:
            after = before if named is base else fit_run_parameters(problem, named)
            frame = _compared(problem, before, after, named.hypothesis)
        except (InputError, SimulationError) as error:
            remarks[run] = str(error)
            frame = _compared(problem, before).assign(augmented=np.nan, whitened_augmented=np.nan)
        frames.append(frame.assign(role="confirm"))
    residuals = pd.concat(frames, ignore_index=True)
    gaps = _gaps(residuals, remarks, np.random.default_rng(seed), settings.confirmation)
    return Confirmed(residuals.drop(columns="role"), gaps)


class _Alone:
    """One run of a model, as a model: what belongs to it is fitted, and fails, without the others."""

    def __init__(self, model: Model, run: str):
        self._model = model
        self.series = [series for series in model.series if series.run == run]

    def __getattr__(self, name: str):
        return getattr(self._model, name)


def fit_run_parameters(problem: Problem, fit: Fit) -> dict[str, float]:
    """Values [SI] of a fit by key, with those that a held-out run has for itself fitted to that run.

    These are nominal where the run cannot be simulated.

    Parameters
    ----------
    problem : Problem
        Of the held-out run.
    fit : Fit
        To the runs for fitting.
    """
    fitted = {p.key for p in fit.parameters}
    own = [p for p in problem.parameters(fit.hypothesis) if p.run is not None and p.key not in fitted]
    if not own:
        return fit.mapping
    return fit.mapping | fit_hypothesis(problem, fit.hypothesis, start=fit.mapping, vary=own).mapping


def _compared(problem: Problem, before: dict, after: dict | None = None, hypothesis: Hypothesis = ()) -> pd.DataFrame:
    """Rows of the table residuals, run by run; the base stands for the named effects where there are none."""
    whitened = problem.residual(before)
    whitened_after = problem.residual(after, hypothesis) if hypothesis else whitened
    frames = []
    for run in problem.runs:
        predicted = problem.predict(run, before)
        augmented = problem.predict(run, after, hypothesis) if hypothesis else predicted
        for part in problem.parts:
            series = part.series
            if series.run != run:
                continue
            used = part.used
            frames.append(
                pd.DataFrame(
                    {
                        "run": run,
                        "channel": series.channel,
                        "sample": np.flatnonzero(used),
                        "crank_angle": series.angle[used],
                        "held_out": series.held_out[used],
                        "measured": series.value[used],
                        "base": predicted[series.channel][used],
                        "augmented": augmented[series.channel][used],
                        "whitened_base": whitened[part.place],
                        "whitened_augmented": whitened_after[part.place],
                        "spread": np.broadcast_to(part.noise.spread, used.shape)[used],
                    }
                )
            )
    return pd.concat(frames, ignore_index=True)


def _gaps(
    residuals: pd.DataFrame, remarks: Mapping[str, str], random: np.random.Generator, settings: ConfirmationSettings
) -> pd.DataFrame:
    """Rows of the table gaps: each run and channel, each run, and all, by role; remarks by held-out run."""
    rows = []
    for role, of_role in residuals.groupby("role", sort=False):
        squares_of = {
            key: _squares(series, random, settings) for key, series in of_role.groupby(["run", "channel"], sort=False)
        }
        runs = dict.fromkeys(run for run, _ in squares_of)
        for run in (*runs, "all"):
            within = {key: squares for key, squares in squares_of.items() if run in ("all", key[0])}
            if run != "all":
                rows += [_row(run, role, channel, [squares]) for (_, channel), squares in within.items()]
            rows.append(_row(run, role, "all", list(within.values())))
    gaps = pd.DataFrame(rows)
    return gaps.assign(remark=gaps["run"].map(remarks).where(gaps["role"] == "confirm", None).astype(object))


@dataclass(frozen=True)
class _Squares:
    """Mean squared whitened residuals of a series, columns before and after: as they are, and of bootstrap samples."""

    mean: np.ndarray
    drawn: np.ndarray
    samples: int


def _squares(series: pd.DataFrame, random: np.random.Generator, settings: ConfirmationSettings) -> _Squares:
    squared = series[["whitened_base", "whitened_augmented"]].to_numpy() ** 2
    blocks = np.array_split(squared, min(settings.blocks, len(squared)))
    means, sizes = np.array([block.mean(axis=0) for block in blocks]), np.array([len(block) for block in blocks])
    chosen = random.integers(len(blocks), size=(settings.draws, len(blocks)))
    weights = sizes[chosen][..., None]
    drawn = (means[chosen] * weights).sum(axis=1) / weights.sum(axis=1)
    return _Squares(squared.mean(axis=0), drawn, len(squared))


def _row(run: str, role: str, channel: str, parts: list[_Squares]) -> dict[str, object]:
    before, after = np.sqrt(np.mean([part.mean for part in parts], axis=0))
    low, high = np.quantile(np.sqrt(np.mean([part.drawn for part in parts], axis=0)), _ENDS, axis=0)
    return {
        "run": run,
        "role": role,
        "channel": channel,
        "samples": sum(part.samples for part in parts),
        "before": before,
        "after": after,
        "before_low": low[0],
        "before_high": high[0],
        "after_low": low[1],
        "after_high": high[1],
        "closed": share_closed(before, after),
    }
