"""What a planned campaign can show."""

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
    bounded_step,
    bounds_of,
    compress_rows,
    fit_hypothesis,
)
from jointgap.identification.noise import Key, numerics_noise
from jointgap.identification.problem import Noise, Problem
from jointgap.identification.screening import Signature, Signatures, SignatureSubspaces, simulate_signatures
from jointgap.identification.settings import DEFAULT_SETTINGS, DetectabilitySettings, IdentificationSettings

_Blocks = tuple[np.ndarray, dict[int, np.ndarray]]
"""Rows of the Jacobian, and of the columns of each signature by its `id`."""


class Detectability:
    """What is detectable, and what alike, over the samples of some channels of some runs."""

    def __init__(
        self,
        signatures: Signatures,
        lengths: Sequence[int],
        counts: Sequence[int],
        rate: float,
        settings: IdentificationSettings = DEFAULT_SETTINGS,
    ):
        self.signatures, self.rate, self.settings = signatures, rate, settings
        self._excess = settings.detectability.typical_gap**2 - 1.0  # mean square beyond noise
        self.size = sum(counts)
        self.labels = list(dict.fromkeys(signature.candidate.label for signature in signatures.entries))
        self._subspaces: dict[frozenset, SignatureSubspaces] = {}
        self._typical: dict[tuple[int, int], float] = {}
        blocks = [signatures.jacobian, *(signature.columns for signature in signatures.entries)]
        weight = np.repeat(np.sqrt(np.divide(counts, lengths)), lengths)[:, None]
        share = np.repeat((len(lengths) * np.array(lengths)) ** -0.5, lengths)[:, None]
        # The same in few rows: as chi2 sees them, and as the gap does, in which each channel of each run counts the
        # same.
        self._chi2 = self._by_signature(compress_rows(*(weight * block for block in blocks)))
        self._gap = self._by_signature(compress_rows(*(share * block for block in blocks)))

    def _by_signature(self, blocks: Sequence[np.ndarray]) -> _Blocks:
        return blocks[0], {
            id(signature): block for signature, block in zip(self.signatures.entries, blocks[1:], strict=True)
        }

    def part(self, rows: np.ndarray, lengths: Sequence[int], counts: Sequence[int]) -> "Detectability":
        """The same over some of the samples."""
        signatures = self.signatures
        entries = [
            replace(signature, columns=signature.columns[rows], origin=signature.origin[rows])
            for signature in signatures.entries
        ]
        fewer = replace(
            signatures, jacobian=signatures.jacobian[rows], residual=signatures.residual[rows], entries=entries
        )
        return Detectability(fewer, lengths, counts, self.rate, self.settings)

    def detectable_size(self, label: str) -> float:
        """First amplitude [SI] that is found with a probability of 90 %; infinite where none is.

        The median over the shape parameters to start from. Of an effect that replaces a nuisance it lies beyond the
        nuisance's range; of one whose signatures are secants to finite amplitudes it is no less than these are valid
        for.
        """
        return self._usual(
            label, [self._smallest(s, 0, self._chi2, self._noncentrality(s)) for s in self.signatures.of(label)]
        )

    def typical_size(self, label: str) -> float:
        """First amplitude [SI] that leaves the typical gap after recalibration, as `detectable_size`."""
        return self._usual(label, [self._typical_amount(s, 0) for s in self.signatures.of(label)])

    def _usual(self, label: str, sizes: list[float]) -> float:
        """Of the amplitudes that the signatures of an effect give: the median, or the least where each holds for
        others."""
        finite = any(
            signature.amplitudes[0].key in signature.shape_parameters for signature in self.signatures.of(label)
        )
        return float(min(sizes) if finite else np.median(sizes))

    def cosine(self, label: str, other: str) -> float:
        """Largest cosine [1] of anything that the two effects change, beyond what nuisances can."""
        both = self._beyond_nuisances(label, other)
        return max((both.cosine(space, other) for space in both.of[label]), default=0.0)

    def merged(self, labels: Sequence[str]) -> list[list[str]]:
        """Classes of effects that stand for each other at a typical size, in the order of `labels`."""
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
        """chi2 that `other` leaves at least of what `label` typically does, as it would be if nothing had bounds.

        Nothing where the nuisances could take it all up, and only their bounds let the effect be seen. Secants to
        finite sizes are left out where an effect has a derivative too.
        """
        beyond, least = self._beyond_nuisances(other), np.inf
        for signature in self.signatures.of(label):
            amount = self._typical_amount(signature, 0)
            if np.isfinite(amount):
                left = beyond.projected(self._chi2[1][id(signature)][:, :1])
                least = min(least, amount**2 * float(np.sum(left**2)))
        cosine = max((beyond.cosine(space, other) for space in beyond.of[label]), default=0.0)
        return (1.0 - cosine**2) * least if np.isfinite(least) else least

    def _noncentrality(self, signature: Signature) -> float:
        """Of the gain in chi2, so that it exceeds with the power of the settings what the search among all candidates
        asks for."""
        dimensions = len(signature.amplitudes)
        asked = max(
            stats.chi2.isf(self.rate / len(self.labels), dimensions),
            len(signature.coordinates) * np.log(self.size) + self.settings.decision.min_delta_bic,
        )
        return float(
            optimize.brentq(
                lambda shift: stats.ncx2.sf(asked, dimensions, shift) - self.settings.detectability.power,
                1e-6,
                20 * asked + 50,
            )
        )

    def _kept(self, *signatures: Signature) -> list[int]:
        """Places of the nuisances that no effect replaces."""
        replaced = {name for signature in signatures for name in signature.candidate.replaces}
        return [i for i, p in enumerate(self.signatures.parameters) if p.name not in replaced]

    def _room(self, kept: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        low, high = bounds_of([self.signatures.parameters[i] for i in kept])
        return low - self.signatures.values[list(kept)], high - self.signatures.values[list(kept)]

    def _left(self, signature: Signature, size: int, amount: float, measure: _Blocks) -> float:
        """What recalibration cannot take up of an effect that is there, squared."""
        jacobian, columns = self._chi2
        effect = -amount * columns[id(signature)][:, size]
        step, _ = bounded_step(jacobian, effect, *self._room(range(jacobian.shape[1])))
        jacobian, columns = measure
        return float(np.sum((jacobian @ step - amount * columns[id(signature)][:, size]) ** 2))

    def _smallest(self, signature: Signature, size: int, measure: _Blocks, target: float) -> float:
        """Amount of which at least `target` is left; infinite where bounds forbid it. A secant says nothing below its
        reach."""
        p = signature.amplitudes[size]
        if (
            p.key in signature.shape_parameters
            and self._left(signature, size, signature.valid_range(p)[0], measure) >= target
        ):
            return float(signature.valid_range(p)[0])
        reach = [abs(bound) for bound in (p.low, p.high) if np.isfinite(bound) and bound != 0.0]
        most = max(reach) if np.isfinite(p.high) and reach else self.settings.detectability.max_steps * p.step
        per_unit = float(np.sum(measure[1][id(signature)][:, size] ** 2))
        if per_unit == 0.0 or self._left(signature, size, most, measure) < target:
            return float("inf")
        least = min(np.sqrt(target / per_unit), most)

        def excess(logarithm: float) -> float:
            return self._left(signature, size, float(np.exp(logarithm)), measure) - target

        if least == most or excess(np.log(least)) >= 0.0:
            return float(least)
        return float(np.exp(optimize.brentq(excess, np.log(least), np.log(most), xtol=1e-3)))

    def _typical_amount(self, signature: Signature, size: int) -> float:
        """Amount [SI] that leaves the typical gap after recalibration; infinite where bounds forbid it."""
        key = id(signature), size
        if key not in self._typical:
            self._typical[key] = self._smallest(signature, size, self._gap, self._excess)
        return self._typical[key]

    def _beyond_nuisances(self, *labels: str) -> SignatureSubspaces:
        chosen = [self.signatures.of(label)[0] for label in labels]
        replaced = frozenset(name for signature in chosen for name in signature.candidate.replaces)
        if replaced not in self._subspaces:
            kept = self._kept(*chosen)
            jacobian, columns = self._chi2
            few = [
                replace(signature, columns=columns[id(signature)], origin=np.zeros(len(jacobian)))
                for signature in self.signatures.entries
            ]
            self._subspaces[replaced] = SignatureSubspaces(
                replace(self.signatures, jacobian=jacobian[:, kept], entries=few), self.settings.screening
            )
        return self._subspaces[replaced]

    def _mistaken(self, label: str, other: str) -> bool:
        """Whether `other` fits as well what `label` typically does, within all bounds.

        For every size that the effect has: an effect with a further one is more than the effect without. For at least
        half of the shapes and signs: a bias that may go both ways is mistaken for a friction that goes one way.
        """
        own = self.signatures.of(label)
        for size, p in enumerate(own[0].amplitudes):
            amounts = [(signature, self._typical_amount(signature, size)) for signature in own]
            signs = (1.0, -1.0) if p.low < 0.0 else (1.0,)
            mistaken = [
                self._fitted(signature, size, sign * amount, other) < self.settings.decision.min_delta_bic
                for signature, amount in amounts
                if np.isfinite(amount)
                for sign in signs
            ]
            if not mistaken or 2 * sum(mistaken) < len(mistaken):
                return False
        return True

    def _fitted(self, signature: Signature, size: int, amount: float, other: str) -> float:
        """chi2 that `other` leaves of an effect that is there."""
        jacobian, columns = self._chi2
        left = []
        for rival in self.signatures.of(other):
            kept = self._kept(rival)
            low, high = self._room(kept)
            rival_low, rival_high = bounds_of(rival.amplitudes)
            matrix = np.hstack([jacobian[:, kept], columns[id(rival)]])
            bounds = np.concatenate([low, rival_low]), np.concatenate([high, rival_high])
            left.append(bounded_step(matrix, -amount * columns[id(signature)][:, size], *bounds)[1])
        return min(left)


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
            assumptions[series.key] = f"{series.channel} in run {run}: {format_size(sd, series.unit)}, {reason}"
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
    signatures = simulate_signatures(problem, base, differences, problem.model.candidates)
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
