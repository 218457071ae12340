"""Identifiability analysis of a planned campaign."""

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from scipy import optimize, stats

from jointgap.core.candidates import Candidate, Model, Series, runs_of
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.words import format_size
from jointgap.identification.fit import (
    FAILED,
    FiniteDifferences,
    Fit,
    bounded_step,
    bounds_of,
    compress_rows,
    fit_hypothesis,
)
from jointgap.identification.noise import Key, numerics_noise
from jointgap.identification.problem import Noise, Problem
from jointgap.identification.screening import (
    Sensitivities,
    Sensitivity,
    SensitivitySubspaces,
    simulate_sensitivities,
)
from jointgap.identification.settings import (
    DEFAULT_SETTINGS,
    DetectabilitySettings,
    IdentificationSettings,
)

_Blocks = tuple[np.ndarray, dict[int, np.ndarray]]
"""Rows of the Jacobian, and of the columns of each sensitivity by its `id`."""


class Detectability:
    """Detectability and confusability of effects, for the samples of some channels and runs."""

    def __init__(
        self,
        sensitivities: Sensitivities,
        lengths: Sequence[int],
        counts: Sequence[int],
        rate: float,
        settings: IdentificationSettings = DEFAULT_SETTINGS,
    ):
        self.sensitivities, self.rate, self.settings = sensitivities, rate, settings
        self._excess = settings.detectability.typical_gap**2 - 1.0  # mean square beyond noise
        self.size = sum(counts)
        self.labels = list(
            dict.fromkeys(sensitivity.candidate.label for sensitivity in sensitivities.entries)
        )
        self._subspaces: dict[frozenset, SensitivitySubspaces] = {}
        self._typical: dict[tuple[int, int], float] = {}
        blocks = [
            sensitivities.jacobian,
            *(sensitivity.columns for sensitivity in sensitivities.entries),
        ]
        weight = np.repeat(np.sqrt(np.divide(counts, lengths)), lengths)[:, None]
        share = np.repeat((len(lengths) * np.array(lengths)) ** -0.5, lengths)[:, None]
        # compressed to few rows, weighted as in chi2 and as in the gap (equal weight of all
        # channels and runs)
        self._chi2 = self._by_sensitivity(compress_rows(*(weight * block for block in blocks)))
        self._gap = self._by_sensitivity(compress_rows(*(share * block for block in blocks)))

    def _by_sensitivity(self, blocks: Sequence[np.ndarray]) -> _Blocks:
        return blocks[0], {
            id(sensitivity): block
            for sensitivity, block in zip(self.sensitivities.entries, blocks[1:], strict=True)
        }

    def part(
        self, rows: np.ndarray, lengths: Sequence[int], counts: Sequence[int]
    ) -> "Detectability":
        """The same for some of the samples."""
        sensitivities = self.sensitivities
        entries = [
            replace(sensitivity, columns=sensitivity.columns[rows], origin=sensitivity.origin[rows])
            for sensitivity in sensitivities.entries
        ]
        fewer = replace(
            sensitivities,
            jacobian=sensitivities.jacobian[rows],
            residual=sensitivities.residual[rows],
            entries=entries,
        )
        return Detectability(fewer, lengths, counts, self.rate, self.settings)

    def detectable_size(self, label: str) -> float:
        """Smallest first amplitude [SI] that is found with a probability of 90 %; infinite if there
        is none.

        The median over the start values of the shape parameters. For an effect that replaces a
        nuisance it is beyond the nuisance's range; for one with secants it is within their range of
        validity.
        """
        return self._usual(
            label,
            [
                self._smallest(s, 0, self._chi2, self._noncentrality(s))
                for s in self.sensitivities.of(label)
            ],
        )

    def typical_size(self, label: str) -> float:
        """First amplitude [SI] with the typical gap after recalibration, as `detectable_size`."""
        return self._usual(
            label, [self._typical_amount(s, 0) for s in self.sensitivities.of(label)]
        )

    def _usual(self, label: str, sizes: list[float]) -> float:
        """The median of amplitudes from several sensitivities, or the least of those from
        secants."""
        finite = any(
            sensitivity.amplitudes[0].key in sensitivity.shape_parameters
            for sensitivity in self.sensitivities.of(label)
        )
        return float(min(sizes) if finite else np.median(sizes))

    def cosine(self, label: str, other: str) -> float:
        """Largest cosine [1] between the changes by two effects, beyond nuisances."""
        both = self._beyond_nuisances(label, other)
        return max((both.cosine(space, other) for space in both.of[label]), default=0.0)

    def merged(self, labels: Sequence[str]) -> list[list[str]]:
        """Classes of effects that are indistinguishable at a typical size, in the order of
        `labels`."""
        group = {label: {label} for label in labels}
        for i, label in enumerate(labels):
            for other in labels[i + 1 :]:
                limit = self.settings.decision.min_delta_bic
                near = max(self._least_left(label, other), self._least_left(other, label)) < limit
                if near and self._mistaken(label, other) and self._mistaken(other, label):
                    joined = group[label] | group[other]
                    for member in joined:
                        group[member] = joined
        classes = []
        for label in labels:
            if len(group[label]) > 1 and sorted(group[label], key=labels.index) not in classes:
                classes.append(sorted(group[label], key=labels.index))
        return classes

    def _least_left(self, label: str, other: str) -> float:
        """Lower bound of chi2 if `other` is fitted to `label` of typical size, without bounds.

        It is 0 if only the bounds of nuisances make the effect visible. Secants are ignored if
        there is a derivative.
        """
        beyond, least = self._beyond_nuisances(other), np.inf
        for sensitivity in self.sensitivities.of(label):
            amount = self._typical_amount(sensitivity, 0)
            if np.isfinite(amount):
                left = beyond.projected(self._chi2[1][id(sensitivity)][:, :1])
                least = min(least, amount**2 * float(np.sum(left**2)))
        cosine = max((beyond.cosine(space, other) for space in beyond.of[label]), default=0.0)
        return (1.0 - cosine**2) * least if np.isfinite(least) else least

    def _noncentrality(self, sensitivity: Sensitivity) -> float:
        """Noncentrality of the gain in chi2 that exceeds the threshold of the search with the power
        of the settings."""
        dimensions = len(sensitivity.amplitudes)
        asked = max(
            stats.chi2.isf(self.rate / len(self.labels), dimensions),
            len(sensitivity.coordinates) * np.log(self.size) + self.settings.decision.min_delta_bic,
        )
        return float(
            optimize.brentq(
                lambda shift: (
                    stats.ncx2.sf(asked, dimensions, shift) - self.settings.detectability.power
                ),
                1e-6,
                20 * asked + 50,
            )
        )

    def _kept(self, *sensitivities: Sensitivity) -> list[int]:
        """Indices of the nuisances that no effect replaces."""
        replaced = {
            name for sensitivity in sensitivities for name in sensitivity.candidate.replaces
        }
        return [i for i, p in enumerate(self.sensitivities.parameters) if p.name not in replaced]

    def _room(self, kept: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        low, high = bounds_of([self.sensitivities.parameters[i] for i in kept])
        return (
            low - self.sensitivities.values[list(kept)],
            high - self.sensitivities.values[list(kept)],
        )

    def _left(self, sensitivity: Sensitivity, size: int, amount: float, measure: _Blocks) -> float:
        """Squared change by an effect after recalibration."""
        jacobian, columns = self._chi2
        effect = -amount * columns[id(sensitivity)][:, size]
        step, _ = bounded_step(jacobian, effect, *self._room(range(jacobian.shape[1])))
        jacobian, columns = measure
        return float(np.sum((jacobian @ step - amount * columns[id(sensitivity)][:, size]) ** 2))

    def _smallest(
        self, sensitivity: Sensitivity, size: int, measure: _Blocks, target: float
    ) -> float:
        """Smallest amount [SI] with the squared change `target` after recalibration; infinite if
        bounds forbid it, within the range of validity for a secant."""
        p = sensitivity.amplitudes[size]
        if (
            p.key in sensitivity.shape_parameters
            and self._left(sensitivity, size, sensitivity.valid_range(p)[0], measure) >= target
        ):
            return float(sensitivity.valid_range(p)[0])
        reach = [abs(bound) for bound in (p.low, p.high) if np.isfinite(bound) and bound != 0.0]
        most = (
            max(reach)
            if np.isfinite(p.high) and reach
            else self.settings.detectability.max_steps * p.step
        )
        per_unit = float(np.sum(measure[1][id(sensitivity)][:, size] ** 2))
        if per_unit == 0.0 or self._left(sensitivity, size, most, measure) < target:
            return float("inf")
        least = min(np.sqrt(target / per_unit), most)

        def excess(logarithm: float) -> float:
            return self._left(sensitivity, size, float(np.exp(logarithm)), measure) - target

        if least == most or excess(np.log(least)) >= 0.0:
            return float(least)
        return float(np.exp(optimize.brentq(excess, np.log(least), np.log(most), xtol=1e-3)))

    def _typical_amount(self, sensitivity: Sensitivity, size: int) -> float:
        """Amount [SI] with the typical gap after recalibration; infinite if bounds forbid it."""
        key = id(sensitivity), size
        if key not in self._typical:
            self._typical[key] = self._smallest(sensitivity, size, self._gap, self._excess)
        return self._typical[key]

    def _beyond_nuisances(self, *labels: str) -> SensitivitySubspaces:
        chosen = [self.sensitivities.of(label)[0] for label in labels]
        replaced = frozenset(
            name for sensitivity in chosen for name in sensitivity.candidate.replaces
        )
        if replaced not in self._subspaces:
            kept = self._kept(*chosen)
            jacobian, columns = self._chi2
            few = [
                replace(
                    sensitivity, columns=columns[id(sensitivity)], origin=np.zeros(len(jacobian))
                )
                for sensitivity in self.sensitivities.entries
            ]
            self._subspaces[replaced] = SensitivitySubspaces(
                replace(self.sensitivities, jacobian=jacobian[:, kept], entries=few),
                self.settings.screening,
            )
        return self._subspaces[replaced]

    def _mistaken(self, label: str, other: str) -> bool:
        """Whether `other` fits `label` of typical size within all bounds.

        For every amplitude of the effect, and for at least half of the shapes and signs.
        """
        own = self.sensitivities.of(label)
        for size, p in enumerate(own[0].amplitudes):
            amounts = [
                (sensitivity, self._typical_amount(sensitivity, size)) for sensitivity in own
            ]
            signs = (1.0, -1.0) if p.low < 0.0 else (1.0,)
            mistaken = [
                self._fitted(sensitivity, size, sign * amount, other)
                < self.settings.decision.min_delta_bic
                for sensitivity, amount in amounts
                if np.isfinite(amount)
                for sign in signs
            ]
            if not mistaken or 2 * sum(mistaken) < len(mistaken):
                return False
        return True

    def _fitted(self, sensitivity: Sensitivity, size: int, amount: float, other: str) -> float:
        """chi2 if `other` is fitted to an effect."""
        jacobian, columns = self._chi2
        left = []
        for rival in self.sensitivities.of(other):
            kept = self._kept(rival)
            low, high = self._room(kept)
            rival_low, rival_high = bounds_of(rival.amplitudes)
            matrix = np.hstack([jacobian[:, kept], columns[id(rival)]])
            bounds = np.concatenate([low, rival_low]), np.concatenate([high, rival_high])
            left.append(
                bounded_step(matrix, -amount * columns[id(sensitivity)][:, size], *bounds)[1]
            )
        return min(left)


@dataclass(frozen=True)
class Preflight:
    """Result of a preflight."""

    effects: pd.DataFrame  # One row for each candidate
    cosines: pd.DataFrame  # Labels by labels [1]
    merged: list[list[str]]  # Indistinguishable effects
    undetectable: list[str]  # Effects that are not detectable within their bounds
    failed: dict[str, str]  # Reasons of effects that could not be simulated
    sizes: dict[str, float]  # Smallest detectable first coordinate [SI]
    assumed: tuple[str, ...] = ()  # Assumed noise by run and channel


def preflight(
    model: Model,
    noise: Mapping[Key, Noise] | None = None,
    rate: float = 0.01,
    counts: Mapping[Key, int] | None = None,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> Preflight:
    """Detectability and confusability of all candidates by linearisation about the nominal
    model."""
    _, detectability, assumed = _detectability(model, noise, rate, counts or {}, settings)
    return _preflight(model, detectability, tuple(assumed.values()))


def detectability(
    problem: Problem,
    base: Fit,
    differences: FiniteDifferences,
    sensitivities: Sensitivities,
    rate: float = 0.01,
) -> Preflight:
    """Detectability and confusability of all candidates in measured data, from their
    `sensitivities` about the fit `base`.

    Clearances, which the screening leaves out, are simulated.
    """
    screened = {entry.candidate.label for entry in sensitivities.entries} | {*sensitivities.failed}
    left_out = [
        candidate
        for candidate in problem.model.candidates
        if candidate.is_nonsmooth and candidate.label not in screened
    ]
    clearances = simulate_sensitivities(problem, base, differences, left_out)
    complete = replace(
        sensitivities,
        entries=[*sensitivities.entries, *clearances.entries],
        failed={**sensitivities.failed, **clearances.failed},
    )
    lengths, counts = _lengths(problem.parts, {})
    found = Detectability(complete, lengths, counts, rate, problem.settings)
    return _preflight(problem.model, found, ())


def advise(
    model: Model,
    planned: Collection[Key],
    noise: Mapping[Key, Noise] | None = None,
    rate: float = 0.01,
    counts: Mapping[Key, int] | None = None,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> tuple[Preflight, pd.DataFrame]:
    """The gain by one further run or channel, the largest first."""
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
        f"channel {channel}": {
            *planned,
            *(key for key in keys if key[1] == channel and key[0] in runs),
        }
        for channel in dict.fromkeys(key[1] for key in keys)
        if channel not in channels
    }
    rows = [
        {
            "change": change,
            **_improvement(
                base, _preflight(model, _part(detectability, problem, wider, counts), ())
            ),
        }
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
    """Stated or assumed noise, and a text for each assumption."""
    noise, assumptions = {}, {}
    for run in runs_of(model):
        predicted = model.simulate(
            run, {p.name: p.nominal for p in model.nuisances if p.run in (None, run)}
        )
        for series in (series for series in model.series if series.run == run):
            if series.stated_noise is not None:
                noise[series.key] = Noise(np.hypot(series.stated_noise, series.rounding))
                continue
            if series.rounding:
                noise[series.key] = Noise(
                    np.full(series.value.shape, series.rounding), source="rounding"
                )
                continue
            sd, reason = _assumed_sd(series, predicted[series.channel], settings)
            noise[series.key] = Noise(np.full(series.value.shape, sd), source="assumed")
            assumptions[series.key] = (
                f"{series.channel} in run {run}: {format_size(sd, series.unit)}, {reason}"
            )
    return noise, assumptions


def _assumed_sd(
    series: Series, predicted: np.ndarray, settings: DetectabilitySettings
) -> tuple[float, str]:
    """Standard deviation [unit] and its reason."""
    share = settings.assumed_noise_share
    if series.unit == "rad":
        return float(np.deg2rad(settings.assumed_angle_noise_deg)), "default for angles"
    varies, size = float(np.std(predicted)), float(np.sqrt(np.mean(predicted**2)))
    if size == 0.0:
        raise InputError(
            f"run {series.run}, channel {series.channel}: the prediction is 0 everywhere; state its"
            " `noise`"
        )
    if varies > settings.hardly_varies * size:
        return share * varies, f"{100 * share:.0f} % of its variation"
    return share * size, f"{100 * share:.0f} % of its root mean square, as it is nearly constant"


def _detectability(
    model: Model,
    noise: Mapping[Key, Noise] | None,
    rate: float,
    counts: Mapping[Key, int],
    settings: IdentificationSettings,
) -> tuple[Problem, Detectability, dict[Key, str]]:
    """The planned problem, its detectability, and texts of assumed noise."""
    assumed: dict[Key, str] = {}
    if noise is None:
        noise, assumed = assumed_noise(model, settings.detectability)
        noise = numerics_noise(model, {}, noise, settings.noise)
    problem = Problem(model, noise, planned=True, settings=settings)
    differences = FiniteDifferences(problem)
    base = fit_hypothesis(problem, differences=differences)
    if base.status == FAILED:
        raise SimulationError(f"{model.name}: the current model cannot be simulated: {base.reason}")
    sensitivities = simulate_sensitivities(problem, base, differences, problem.model.candidates)
    return (
        problem,
        Detectability(sensitivities, *_lengths(problem.parts, counts), rate, settings),
        assumed,
    )


def _lengths(parts: Iterable, counts: Mapping[Key, int]) -> tuple[list[int], list[int]]:
    """Number of samples of each series, and the number that they represent (statistics: the
    same)."""
    lengths = [part.place.stop - part.place.start for part in parts]
    return lengths, [
        length if part.series.statistic else counts.get(part.series.key, length)
        for part, length in zip(parts, lengths, strict=True)
    ]


def _part(
    detectability: Detectability, problem: Problem, keys: Collection[Key], counts: Mapping[Key, int]
) -> Detectability:
    """Detectability for these channels and runs only."""
    parts = [part for part in problem.parts if part.series.key in keys]
    rows = np.concatenate([np.arange(part.place.start, part.place.stop) for part in parts])
    return detectability.part(rows, *_lengths(parts, counts))


def _preflight(model: Model, detectability: Detectability, assumed: tuple[str, ...]) -> Preflight:
    rows, sizes, failed = [], {}, dict(detectability.sensitivities.failed)
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
    columns = [
        "label",
        "parameter",
        "smallest_detectable",
        "unit",
        "typical",
        "falls",
        "detectable",
    ]
    effects = pd.DataFrame(rows, columns=columns)
    seen = [row["label"] for row in rows if row["detectable"]]
    labels = [row["label"] for row in rows if row["label"] in detectability.labels]
    cosines = pd.DataFrame(np.eye(len(labels)), index=labels, columns=labels)
    for i, label in enumerate(labels):
        for other in labels[i + 1 :]:
            cosines.loc[label, other] = cosines.loc[other, label] = detectability.cosine(
                label, other
            )
    undetectable = [
        row["label"] for row in rows if not row["detectable"] and row["label"] not in failed
    ]
    return Preflight(
        effects, cosines, detectability.merged(seen), undetectable, failed, sizes, assumed
    )


def _stated_first(candidate: Candidate, size: float) -> tuple[str, str, float, bool]:
    """The first parameter in a verdict, its unit, its value for an amplitude [SI], and whether it
    decreases.

    The value is NaN for infinity; the unit is empty unless the parameter is the coordinate plus a
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
    seen = [
        label
        for label, size in base.sizes.items()
        if np.isfinite(size) and np.isfinite(wider.sizes[label])
    ]
    gains = [base.sizes[label] / wider.sizes[label] for label in seen]
    return {
        "newly_detectable": [
            label for label in base.undetectable if label not in wider.undetectable
        ],
        "separated": [
            " | ".join(pair)
            for group in base.merged
            for pair in _pairs(group)
            if pair not in together
        ],
        "gain": float(np.median(gains)) if gains else float("nan"),
    }


def _pairs(group: list[str]) -> list[tuple[str, str]]:
    return list(itertools.combinations(group, 2))
