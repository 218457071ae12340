"""Stage noise: what the measurement scatters by, found from what repeats and what does not."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from jointgap.campaign.confirm import own_fitted
from jointgap.errors import SimulationError
from jointgap.identification.fit import FAILED, fit
from jointgap.identification.noise_model import FoundNoise, estimate_noise, telling
from jointgap.identification.problem import Problem
from jointgap.identification.protocol import Model
from jointgap.identification.whitening import Noise

_GUESS = 0.02
"""Noise as a share of a channel's standard deviation where nothing is known yet: it weighs the channels for a first fit."""


_JOIN = "; "


def noise(model: Model) -> dict[tuple[str, str], FoundNoise]:
    """The noise of every series.

    The model as it stands is fitted with noise as stated or guessed; what its residuals do not repeat from cycle to cycle is noise.

    Raises
    ------
    SimulationError
        The model as it stands cannot be simulated.
    """
    guess = {series.key: _guess(series) for series in model.series}
    problem = Problem(model, guess)
    first = fit(problem)
    if first.status == FAILED:
        raise SimulationError(f"the model as it stands cannot be fitted: {first.reason}")
    values = first.mapping | own_fitted(Problem(model, guess, held_out=True), first)
    residuals = {}
    for run in dict.fromkeys(series.run for series in model.series):
        predicted = problem.predict(run, values)
        residuals |= {s.key: s.value - predicted[s.channel] for s in model.series if s.run == run}
    return estimate_noise(model, residuals)


def _guess(series) -> Noise:
    if series.stated_noise is not None:
        return Noise(series.stated_noise)
    known = series.value[telling(series) & np.isfinite(series.value)]
    spread = max(_GUESS * float(np.std(known)), np.finfo(float).tiny) if known.size else 1.0
    return Noise(np.full(series.value.shape, spread), source="guessed")


def to_frames(found: Mapping[tuple[str, str], FoundNoise]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables `jointgap.tables.NOISE` and `jointgap.tables.NOISE_MEMORY`."""
    samples, memory = [], []
    for (run, channel), one in found.items():
        count = one.sd.size
        numerics = np.broadcast_to(one.numerics, count)
        samples.append(
            pd.DataFrame(
                {"run": run, "channel": channel, "sample": np.arange(count), "sd": one.sd, "numerics": numerics}
            )
        )
        told = {"found": one.found, "effective_samples": one.effective_samples, "remarks": _JOIN.join(one.remarks)}
        shared = {"run": run, "channel": channel, "source": one.source} | told
        lags = enumerate((1.0, *one.autocorrelation))
        memory += [shared | {"lag": lag, "autocorrelation": value} for lag, value in lags]
    return pd.concat(samples, ignore_index=True), pd.DataFrame(memory)


def from_frames(samples: pd.DataFrame, memory: pd.DataFrame) -> dict[tuple[str, str], FoundNoise]:
    """The noise of every series from its tables."""
    lags = {key: rows.sort_values("lag") for key, rows in memory.groupby(["run", "channel"], sort=False)}
    found = {}
    for key, rows in samples.groupby(["run", "channel"], sort=False):
        known = lags[key].iloc[0]
        found[key] = FoundNoise(
            rows["sd"].to_numpy(),
            tuple(lags[key]["autocorrelation"].iloc[1:]),
            rows["numerics"].to_numpy(),
            known["source"],
            known["found"],
            known["effective_samples"],
            tuple(known["remarks"].split(_JOIN)) if known["remarks"] else (),
        )
    return found
