"""Before anything is measured: which effects a campaign can detect and tell apart, and what would help most."""

import itertools
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

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
from jointgap.identification.settings import DEFAULT_SETTINGS, DetectabilitySettings, IdentificationSettings
from jointgap.identification.whitening import Noise
from jointgap.report.plain_words import size_for_the_eye


@dataclass(frozen=True)
class Preflight:
    """What a campaign can tell."""

    effects: pd.DataFrame  # Per candidate
    cosines: pd.DataFrame  # Labels by labels [1]
    merged: list[list[str]]  # Effects that cannot be told apart at a gap of 1.5
    undetectable: list[str]  # Effects that no size within their bounds shows
    failed: dict[str, str]  # Effects of which nothing is known since they could not be simulated, and why
    sizes: dict[str, float]  # As smallest_detectable, of the first coordinate [SI]
    assumed: tuple[str, ...] = ()  # Noise that was assumed where none is stated, by run and channel


def preflight(
    model: Model,
    noise: Mapping[Key, Noise] | None = None,
    rate: float = 0.01,
    counts: Mapping[Key, int] | None = None,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> Preflight:
    """Detectability and confusability of every candidate about the nominal model, as far as all is linear."""
    _, detectability, assumed = _detectability(model, noise, rate, counts or {}, settings)
    return _preflight(model, detectability, tuple(assumed.values()))


def advise(
    model: Model,
    planned: Collection[Key],
    noise: Mapping[Key, Noise] | None = None,
    rate: float = 0.01,
    counts: Mapping[Key, int] | None = None,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> tuple[Preflight, pd.DataFrame]:
    """Which one further run or channel helps a planned campaign most."""
    counts = counts or {}
    problem, detectability, assumed = _detectability(model, noise, rate, counts, settings)
    keys = [part.series.key for part in problem.parts]
    runs, channels = ({key[i] for key in planned} for i in (0, 1))
    assumptions = tuple(text for key, text in assumed.items() if key in planned)
    base = _preflight(model, _part(detectability, problem, planned, counts), assumptions)
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
        {"change": change, **_improvement(base, _preflight(model, _part(detectability, problem, wider, counts), ()))}
        for change, wider in choices.items()
    ]
    table = pd.DataFrame(rows, columns=["change", "newly_detectable", "separated", "gain"])
    helped = table["newly_detectable"].map(len) + table["separated"].map(len) if len(table) else []
    ordered = table.assign(helped=helped).sort_values(
        ["helped", "gain"], ascending=False, kind="stable", ignore_index=True
    )
    return base, ordered.drop(columns="helped")


def assumed_noise(
    model: Model, settings: DetectabilitySettings = DEFAULT_SETTINGS.detectability
) -> tuple[dict[Key, Noise], dict[Key, str]]:
    """Noise as stated, or assumed where it is not, and in words what was assumed of which run and channel."""
    noise, assumptions = {}, {}
    for run in runs_of(model):
        predicted = model.simulate(run, {p.name: p.nominal for p in model.nuisances if p.run in (None, run)})
        for series in (series for series in model.series if series.run == run):
            if series.stated_noise is not None:
                noise[series.key] = Noise(np.hypot(series.stated_noise, series.rounding))
                continue
            if series.rounding:
                noise[series.key] = Noise(np.full(series.value.shape, series.rounding), source="rounding")
                continue
            sd, reason = _assumed_sd(series, predicted[series.channel], settings)
            noise[series.key] = Noise(np.full(series.value.shape, sd), source="assumed")
            assumptions[series.key] = f"{series.channel} in run {run}: {size_for_the_eye(sd, series.unit)}, {reason}"
    return noise, assumptions


def _assumed_sd(series: Series, predicted: np.ndarray, settings: DetectabilitySettings) -> tuple[float, str]:
    """Standard deviation [unit], and where it comes from."""
    share = settings.assumed_noise_share
    if series.unit == "rad":
        return float(np.deg2rad(settings.assumed_angle_noise_deg)), "as for every angle"
    varies, size = float(np.std(predicted)), float(np.sqrt(np.mean(predicted**2)))
    if size == 0.0:
        raise InputError(
            f"run {series.run}, channel {series.channel}: it is predicted to be 0 throughout; state its `noise`"
        )
    if varies > settings.hardly_varies * size:
        return share * varies, f"{100 * share:.0f} % of what it varies by"
    return share * size, f"{100 * share:.0f} % of its size, as it hardly varies"


def _detectability(
    model: Model,
    noise: Mapping[Key, Noise] | None,
    rate: float,
    counts: Mapping[Key, int],
    settings: IdentificationSettings,
) -> tuple[Problem, Detectability, dict[Key, str]]:
    """The planned problem, what it can detect, and the noise that was assumed, in words."""
    assumed: dict[Key, str] = {}
    if noise is None:
        noise, assumed = assumed_noise(model, settings.detectability)
        noise = numerics_noise(model, {}, noise, settings.noise)
    problem = Problem(model, noise, planned=True, settings=settings)
    differences = FiniteDifferences(problem)
    base = fit_hypothesis(problem, differences=differences)
    if base.status == FAILED:
        raise SimulationError(f"{model.name}: cannot be simulated as it stands: {base.reason}")
    signatures = simulate_signatures(problem, base, differences)
    return problem, Detectability(signatures, *_lengths(problem.parts, counts), rate, settings), assumed


def _lengths(parts: Iterable, counts: Mapping[Key, int]) -> tuple[list[int], list[int]]:
    """Samples of each series, and how many they stand for; statistics over cycles stand for themselves."""
    lengths = [part.place.stop - part.place.start for part in parts]
    return lengths, [
        length if part.series.statistic else counts.get(part.series.key, length)
        for part, length in zip(parts, lengths, strict=True)
    ]


def _part(
    detectability: Detectability, problem: Problem, keys: Collection[Key], counts: Mapping[Key, int]
) -> Detectability:
    """What these channels and runs alone can detect."""
    parts = [part for part in problem.parts if part.series.key in keys]
    rows = np.concatenate([np.arange(part.place.start, part.place.stop) for part in parts])
    return detectability.part(rows, *_lengths(parts, counts))


def _preflight(model: Model, detectability: Detectability, assumed: tuple[str, ...]) -> Preflight:
    rows, sizes, failed = [], {}, dict(detectability.signatures.failed)
    for candidate in model.candidates:
        simulated = candidate.label in detectability.labels
        smallest = detectability.detectable_size(candidate.label) if simulated else np.inf
        typical = detectability.typical_size(candidate.label) if simulated else np.inf
        sizes[candidate.label] = smallest
        parameter, unit, value, falls = _stated_first(candidate, smallest)
        rows.append(
            {
                "label": candidate.label,
                "parameter": parameter,
                "smallest_detectable": value,
                "unit": unit,
                "typical": _stated_first(candidate, typical)[2],
                "falls": falls,
                "detectable": bool(np.isfinite(smallest) and np.isfinite(typical)),
            }
        )
    columns = ["label", "parameter", "smallest_detectable", "unit", "typical", "falls", "detectable"]
    effects = pd.DataFrame(rows, columns=columns)
    seen = [row["label"] for row in rows if row["detectable"]]
    labels = [row["label"] for row in rows if row["label"] in detectability.labels]
    cosines = pd.DataFrame(np.eye(len(labels)), index=labels, columns=labels)
    for i, label in enumerate(labels):
        for other in labels[i + 1 :]:
            cosines.loc[label, other] = cosines.loc[other, label] = detectability.cosine(label, other)
    undetectable = [row["label"] for row in rows if not row["detectable"] and row["label"] not in failed]
    return Preflight(effects, cosines, detectability.merged(seen), undetectable, failed, sizes, assumed)


def _stated_first(candidate: Candidate, size: float) -> tuple[str, str, float, bool]:
    """The parameter that a verdict states first, its unit, its value at an amplitude [SI], and whether that falls.

    The value is NaN at infinity; the unit is empty where the parameter is not the coordinate itself, or that and a
    constant.
    """
    first = next(p for p in candidate.coordinates if p.key in candidate.amplitudes)
    shapes = {p.key: p.nominal for p in candidate.coordinates} | dict(candidate.initial_guesses[0])
    amount = size if np.isfinite(size) else first.step

    def named(value: float) -> dict[str, float]:
        return candidate.parameters({**shapes, first.key: value})

    parameter = next(iter(named(amount)))
    single, double = named(amount)[parameter], named(2 * amount)[parameter]
    unit = first.unit if np.isclose(double - single, amount, rtol=1e-6) else ""
    return parameter, unit, single if np.isfinite(size) else float("nan"), bool(double < single)


def _improvement(base: Preflight, wider: Preflight) -> dict[str, Any]:
    together = {pair for group in wider.merged for pair in _pairs(group)}
    seen = [label for label, size in base.sizes.items() if np.isfinite(size) and np.isfinite(wider.sizes[label])]
    gains = [base.sizes[label] / wider.sizes[label] for label in seen]
    return {
        "newly_detectable": [label for label in base.undetectable if label not in wider.undetectable],
        "separated": [" | ".join(pair) for group in base.merged for pair in _pairs(group) if pair not in together],
        "gain": float(np.median(gains)) if gains else float("nan"),
    }


def _pairs(group: list[str]) -> list[tuple[str, str]]:
    return list(itertools.combinations(group, 2))
