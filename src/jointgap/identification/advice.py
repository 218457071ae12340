"""Before anything is measured: which effects a campaign can detect and tell apart, and what further run or channel helps most."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.errors import InputError, SimulationError
from jointgap.identification.detectability import Detectability
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.fit import FAILED, fit_hypothesis
from jointgap.identification.noise_model import Key, numerics_noise
from jointgap.identification.problem import Problem
from jointgap.identification.protocol import Candidate, Model, Series, runs_of
from jointgap.identification.screening import simulate_signatures
from jointgap.identification.whitening import Noise

ASSUMED_SHARE = 0.02
"""Noise of a channel of which none is stated, as a share of what it varies by."""

ASSUMED_ANGLE = np.deg2rad(0.2)
"""Noise [rad] of an angle of which none is stated."""


@dataclass(frozen=True)
class Preflight:
    """What a campaign can tell.

    Attributes
    ----------
    effects : DataFrame
        Per candidate: label; parameter that a verdict states first; smallest_detectable: its value where the effect is found
        with a probability of 90 %; unit, empty where the parameter is no coordinate; typical: its value where the gap after
        recalibration is 1.5; falls: whether the value falls as the effect grows; detectable. NaN where the effect cannot be seen
        at any size.
    cosines : DataFrame
        Labels by labels: largest cosine between what two effects change beyond what nuisances can.
    merged : list of lists of str
        Effects that cannot be told apart at a gap of 1.5.
    undetectable : list of str
        Effects that no size within their bounds shows.
    failed : dict of label to str
        Effects of which nothing is known since they could not be simulated, and why.
    sizes : dict of label to float
        As smallest_detectable, of the first coordinate; infinite where the effect cannot be seen.
    assumed : tuple of str
        Noise that was assumed where none is stated, by run and channel.
    """

    effects: pd.DataFrame
    cosines: pd.DataFrame
    merged: list[list[str]]
    undetectable: list[str]
    failed: dict[str, str]
    sizes: dict[str, float]
    assumed: tuple[str, ...] = ()


def preflight(
    model: Model,
    noise: Mapping[Key, Noise] | None = None,
    rate: float = 0.01,
    counts: Mapping[Key, int] | None = None,
) -> Preflight:
    """Detectability and confusability of every candidate about the nominal model, as far as all is linear.

    Parameters
    ----------
    model : Model
        Values of its series are not looked at.
    noise : mapping of (run, channel) to Noise, optional
        As stated where absent, or assumed (`ASSUMED_SHARE`, `ASSUMED_ANGLE`), with what other numerics predict added.
    rate : float
        False alarms allowed over all candidates.
    counts : mapping of (run, channel) to int, optional
        How many samples there will be, where they are not as many as the model's: these then stand for them.

    Raises
    ------
    SimulationError
        The model cannot be simulated as it stands.
    """
    problem, survey, assumed = _surveyed(model, noise, rate, counts or {})
    return _preflight(problem.model, survey, tuple(assumed.values()))


def advise(
    model: Model,
    planned: Collection[Key],
    noise: Mapping[Key, Noise] | None = None,
    rate: float = 0.01,
    counts: Mapping[Key, int] | None = None,
) -> tuple[Preflight, pd.DataFrame]:
    """Which one further run or channel helps a planned campaign most.

    Parameters
    ----------
    model : Model
        With all runs and channels that could be had.
    planned : collection of (run, channel)
        Those that the campaign has.
    noise, rate, counts
        As in `preflight`.

    Returns
    -------
    preflight : Preflight
        Of the campaign as planned.
    changes : DataFrame
        Most helpful first: change; newly_detectable: labels; separated: merged pairs that it tells apart, as ``a | b``; gain:
        by how much the smallest detectable sizes shrink (median over effects).
    """
    counts = counts or {}
    problem, survey, assumed = _surveyed(model, noise, rate, counts)
    keys = [part.series.key for part in problem.parts]
    runs, channels = ({key[i] for key in planned} for i in (0, 1))
    told = tuple(text for key, text in assumed.items() if key in planned)
    base = _preflight(model, _of(survey, problem, planned, counts), told)
    choices = {
        f"run {run}": {*planned, *(key for key in keys if key[0] == run and key[1] in channels)}
        for run in dict.fromkeys(key[0] for key in keys)
        if run not in runs
    } | {
        f"channel {channel}": {*planned, *(key for key in keys if key[1] == channel and key[0] in runs)}
        for channel in dict.fromkeys(key[1] for key in keys)
        if channel not in channels
    }
    rows = [
        {"change": change, **_help(base, _preflight(model, _of(survey, problem, wider, counts), ()))}
        for change, wider in choices.items()
    ]
    table = pd.DataFrame(rows, columns=["change", "newly_detectable", "separated", "gain"])
    worth = table["newly_detectable"].map(len) + table["separated"].map(len) if len(table) else []
    ordered = table.assign(worth=worth).sort_values(
        ["worth", "gain"], ascending=False, kind="stable", ignore_index=True
    )
    return base, ordered.drop(columns="worth")


def assumed_noise(model: Model) -> tuple[dict[Key, Noise], dict[Key, str]]:
    """Noise as stated, or assumed where it is not, and in words what was assumed of which run and channel.

    Raises
    ------
    InputError
        A channel whose noise is not stated is predicted to be 0 throughout.
    """
    found, told = {}, {}
    for run in runs_of(model):
        at = {p.name: p.nominal for p in model.nuisances if p.run in (None, run)}
        predicted = model.simulate(run, at)
        for series in (one for one in model.series if one.run == run):
            if series.stated_noise is not None:
                found[series.key] = Noise(series.stated_noise)
                continue
            sd, why = _assumed(series, predicted[series.channel])
            found[series.key] = Noise(np.full(series.value.shape, sd), source="assumed")
            told[series.key] = f"{series.channel} in run {run}: {sd:.3g} {series.unit}, {why}"
    return found, told


def _assumed(series: Series, predicted: np.ndarray) -> tuple[float, str]:
    if series.unit == "rad":
        return float(ASSUMED_ANGLE), "0.2 deg"
    varies, size = float(np.std(predicted)), float(np.sqrt(np.mean(predicted**2)))
    if size == 0.0:
        raise InputError(
            f"run {series.run}, channel {series.channel}: it is predicted to be 0 throughout; state its `noise`"
        )
    if varies > 1e-3 * size:
        return ASSUMED_SHARE * varies, f"{100 * ASSUMED_SHARE:.0f} % of what it varies by"
    return ASSUMED_SHARE * size, f"{100 * ASSUMED_SHARE:.0f} % of its size, as it hardly varies"


def _surveyed(
    model: Model, noise, rate: float, counts: Mapping[Key, int]
) -> tuple[Problem, Detectability, dict[Key, str]]:
    assumed: dict[Key, str] = {}
    if noise is None:
        noise, assumed = assumed_noise(model)
        noise = numerics_noise(model, {}, noise)
    problem = Problem(model, noise, planned=True)
    differences = FiniteDifferences(problem)
    base = fit_hypothesis(problem, differences=differences)
    if base.status == FAILED:
        raise SimulationError(f"{model.name}: cannot be simulated as it stands: {base.reason}")
    known = simulate_signatures(problem, base, differences)
    return problem, Detectability(known, *_lengths(problem.parts, counts), rate, problem.settings), assumed


def _lengths(parts: Iterable, counts: Mapping[Key, int]) -> tuple[list[int], list[int]]:
    """Samples of each series, and how many they stand for; statistics over cycles stand for themselves."""
    lengths = [part.place.stop - part.place.start for part in parts]
    return lengths, [
        length if part.series.statistic else counts.get(part.series.key, length)
        for part, length in zip(parts, lengths, strict=True)
    ]


def _of(survey: Detectability, problem: Problem, keys: Collection[Key], counts: Mapping[Key, int]) -> Detectability:
    parts = [part for part in problem.parts if part.series.key in keys]
    rows = np.concatenate([np.arange(part.place.start, part.place.stop) for part in parts])
    return survey.part(rows, *_lengths(parts, counts))


def _preflight(model: Model, survey: Detectability, assumed: tuple[str, ...]) -> Preflight:
    rows, sizes, failed = [], {}, dict(survey.known.failed)
    for candidate in model.candidates:
        there = candidate.label in survey.labels
        smallest = survey.detectable_size(candidate.label) if there else np.inf
        typical = survey.typical_size(candidate.label) if there else np.inf
        sizes[candidate.label] = smallest
        parameter, unit, stated, falls = _stated(candidate, smallest)
        rows.append(
            {
                "label": candidate.label,
                "parameter": parameter,
                "smallest_detectable": stated,
                "unit": unit,
                "typical": _stated(candidate, typical)[2],
                "falls": falls,
                "detectable": bool(np.isfinite(smallest) and np.isfinite(typical)),
            }
        )
    columns = ["label", "parameter", "smallest_detectable", "unit", "typical", "falls", "detectable"]
    effects = pd.DataFrame(rows, columns=columns)
    seen = [row["label"] for row in rows if row["detectable"]]
    known = [row["label"] for row in rows if row["label"] in survey.labels]
    cosines = pd.DataFrame(np.eye(len(known)), index=known, columns=known)
    for i, label in enumerate(known):
        for other in known[i + 1 :]:
            cosines.loc[label, other] = cosines.loc[other, label] = survey.cosine(label, other)
    undetectable = [row["label"] for row in rows if not row["detectable"] and row["label"] not in failed]
    return Preflight(effects, cosines, survey.merged(seen), undetectable, failed, sizes, assumed)


def _stated(candidate: Candidate, size: float) -> tuple[str, str, float, bool]:
    """The parameter that a verdict states first, its unit, its value at a size of the first coordinate, and whether it falls.

    The value is NaN at infinity; the unit is empty where the parameter is not the coordinate itself, or that and a constant.
    """
    first = next(p for p in candidate.coordinates if p.key in candidate.amplitudes)
    shapes = {p.key: p.nominal for p in candidate.coordinates} | dict(candidate.initial_guesses[0])
    amount = size if np.isfinite(size) else first.step

    def named(value: float) -> dict[str, float]:
        return candidate.parameters({**shapes, first.key: value})

    parameter = next(iter(named(amount)))
    one, two = named(amount)[parameter], named(2 * amount)[parameter]
    proportional = np.isclose(two - one, amount, rtol=1e-6)
    return parameter, first.unit if proportional else "", one if np.isfinite(size) else float("nan"), bool(two < one)


def _help(base: Preflight, wider: Preflight) -> dict:
    together = {pair for group in wider.merged for pair in _pairs(group)}
    seen = [label for label, size in base.sizes.items() if np.isfinite(size) and np.isfinite(wider.sizes[label])]
    gains = [base.sizes[label] / wider.sizes[label] for label in seen]
    return {
        "newly_detectable": [label for label in base.undetectable if label not in wider.undetectable],
        "separated": [" | ".join(pair) for group in base.merged for pair in _pairs(group) if pair not in together],
        "gain": float(np.median(gains)) if gains else float("nan"),
    }


def _pairs(group: list[str]) -> list[tuple[str, str]]:
    return [(one, other) for i, one in enumerate(group) for other in group[i + 1 :]]
