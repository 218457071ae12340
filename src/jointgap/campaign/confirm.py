"""Stage confirm: how far the gap shrinks on data that took no part in fitting or choosing."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.discrepancy.fit import Fit, fit
from jointgap.discrepancy.problem import Problem
from jointgap.discrepancy.protocol import Model
from jointgap.discrepancy.whiten import Noise

_BLOCKS = 20
"""Stretches into which a series is cut for the bootstrap: neighbours in one miss the measurement alike."""

_DRAWS = 1000
_ENDS = (0.05, 0.95)


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


def gap_of(gaps: pd.DataFrame, role: str) -> dict[str, float]:
    """Gap before and after over all runs and channels of a role, from table `jointgap.tables.GAPS`."""
    whole = gaps[(gaps["role"] == role) & (gaps["run"] == "all") & (gaps["channel"] == "all")]
    return {when: float(whole[when].iloc[0]) for when in ("before", "after")}


def confirm(
    model: Model, noise: Mapping[tuple[str, str], Noise], base: Fit, named: Fit | None = None, seed: int = 0
) -> Confirmed:
    """Predict every run with and without the effects of the verdict.

    What a held-out run has for itself (its speed, its first angle) is fitted to it, for the base as well as for the named effects:
    what all runs share stays as found on the runs for fitting.

    Parameters
    ----------
    model : Model
    noise : mapping of (run, channel) to Noise
    base : Fit
        The recalibrated base model.
    named : Fit, optional
        With the effects of the verdict; the base where there are none.
    seed : int
        Of the bootstrap.

    Raises
    ------
    InputError, SimulationError
        A held-out run cannot be simulated.
    """
    named = base if named is None else named
    frames = []
    for role, held_out in (("identify", False), ("confirm", True)):
        problem = Problem(model, noise, held_out=held_out)
        before = own_fitted(problem, base) if held_out else base.mapping
        after = before if named is base else own_fitted(problem, named) if held_out else named.mapping
        frames.append(_compared(problem, base, before, named, after).assign(role=role))
    residuals = pd.concat(frames, ignore_index=True)
    return Confirmed(residuals.drop(columns="role"), _gaps(residuals, np.random.default_rng(seed)))


def own_fitted(problem: Problem, found: Fit) -> dict[str, float]:
    """Values of a fit, with those that a held-out run has for itself fitted to that run.

    Raises
    ------
    SimulationError
        The runs cannot be simulated.
    """
    known = {p.key for p in found.parameters}
    own = [p for p in problem.parameters(found.explanation) if p.run is not None and p.key not in known]
    refitted = fit(problem, found.explanation, start=found.mapping, vary=own)
    return found.mapping | refitted.mapping


def _compared(problem: Problem, base: Fit, before: dict, named: Fit, after: dict) -> pd.DataFrame:
    """Rows of the table residuals, run by run."""
    whitened = problem.residual(before, base.explanation)
    whitened_after = whitened if after is before else problem.residual(after, named.explanation)
    frames = []
    for run in problem.runs:
        predicted = problem.predict(run, before, base.explanation)
        augmented = predicted if after is before else problem.predict(run, after, named.explanation)
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


def _gaps(residuals: pd.DataFrame, random: np.random.Generator) -> pd.DataFrame:
    """Rows of the table gaps: each run and channel, each run, and all, by role."""
    rows = []
    for role, of_role in residuals.groupby("role", sort=False):
        drawn = {key: _squares(series, random) for key, series in of_role.groupby(["run", "channel"], sort=False)}
        runs = dict.fromkeys(run for run, _ in drawn)
        for run in (*runs, "all"):
            within = {key: squares for key, squares in drawn.items() if run in ("all", key[0])}
            if run != "all":
                rows += [_row(run, role, channel, [squares]) for (_, channel), squares in within.items()]
            rows.append(_row(run, role, "all", list(within.values())))
    return pd.DataFrame(rows)


@dataclass(frozen=True)
class _Squares:
    """Mean squared whitened residuals of a series, columns before and after: as they are, and of bootstrap samples."""

    found: np.ndarray
    drawn: np.ndarray
    samples: int


def _squares(series: pd.DataFrame, random: np.random.Generator) -> _Squares:
    squared = series[["whitened_base", "whitened_augmented"]].to_numpy() ** 2
    blocks = np.array_split(squared, min(_BLOCKS, len(squared)))
    means, sizes = np.array([block.mean(axis=0) for block in blocks]), np.array([len(block) for block in blocks])
    chosen = random.integers(len(blocks), size=(_DRAWS, len(blocks)))
    weights = sizes[chosen][..., None]
    drawn = (means[chosen] * weights).sum(axis=1) / weights.sum(axis=1)
    return _Squares(squared.mean(axis=0), drawn, len(squared))


def _row(run: str, role: str, channel: str, parts: list[_Squares]) -> dict[str, object]:
    before, after = np.sqrt(np.mean([part.found for part in parts], axis=0))
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
        "closed": 1.0 - (after**2 - 1.0) / (before**2 - 1.0) if before > 1.0 else np.nan,
    }
