"""Screening of candidates by linearisation."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np

from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.progress import with_progress
from jointgap.identification.fit import (
    Direction,
    FiniteDifferences,
    Fit,
    LinearisedColumn,
    bounded_step,
    bounds_of,
    compress_rows,
)
from jointgap.identification.problem import Hypothesis, Part, Problem, label_of
from jointgap.identification.settings import DEFAULT_SETTINGS, ScreeningSettings

_RATES_A_BLOCK = 64

NOT_EXAMINED = "not examined: it takes long with loose joints"
"""Reason why the sensitivity of an effect is unknown, if it is screened last."""


def likely_frequencies(
    parts: Sequence[Part],
    residual: np.ndarray,
    jacobian: np.ndarray,
    carrier: np.ndarray,
    frequency: Parameter,
    settings: ScreeningSettings,
) -> list[float]:
    """The most likely frequencies [Hz] of an effect that is `carrier` times a cosine in time, best
    first.

    Least-squares periodogram: carrier times cosine and sine, separately for each run, fitted
    together with the nuisances. Exact if the motion does not respond to the force.
    """
    time, run = np.full(residual.size, np.nan), np.empty(residual.size, dtype=object)
    for part in parts:
        run[part.place] = part.series.run
        if not part.series.statistic:
            time[part.place] = part.series.time[part.used]
    timed = np.isfinite(time)
    if not timed.any() or not residual.any():  # a preflight has no residual
        return []
    span = max(np.ptp(part.series.time[part.used]) for part in parts if timed[part.place].all())
    step = 1.0 / (settings.frequencies_per_line * span)
    densest = min(
        np.median(np.diff(part.series.time[part.used])) for part in parts if timed[part.place].all()
    )
    tried = np.arange(max(frequency.low, 0.5 / span), min(frequency.high, 0.5 / densest), step)
    order = crank_orders(parts, settings)
    tried = np.array(
        [hertz for hertz in tried if not order(hertz)]
    )  # crank orders are other effects
    basis, left = _beyond_nuisances(residual, jacobian)
    carriers = [np.where(timed & (run == name), carrier, 0.0) for name in dict.fromkeys(run)]
    time = np.where(timed, time, 0.0)
    power = _powers(2.0 * np.pi * tried, time, carriers, basis, left)
    inner = np.arange(1, power.size - 1)
    peaks = inner[(power[inner] >= power[inner - 1]) & (power[inner] > power[inner + 1])]
    return [
        float(tried[i]) for i in sorted(peaks, key=lambda i: -power[i])[: settings.max_frequencies]
    ]


def likely_orders(
    parts: Sequence[Part],
    residual: np.ndarray,
    jacobian: np.ndarray,
    carrier: np.ndarray,
    order: Parameter,
    settings: ScreeningSettings,
) -> list[float]:
    """The most likely orders [cycles per revolution] of an effect that is `carrier` times a cosine
    of the crank angle.

    As `likely_frequencies`, with one phase for all runs, over the `tried` orders that the samples
    resolve.
    """
    angle = np.full(residual.size, np.nan)
    finest = np.inf
    for part in parts:
        own = part.series.angle[part.used]
        angle[part.place] = own
        if np.isfinite(own).sum() > 1:
            finest = min(finest, float(np.nanmedian(np.abs(np.diff(own)))))
    known = np.isfinite(angle)
    if not known.any() or not residual.any():  # a preflight has no residual
        return []
    tried = np.array([value for value in order.search_values if value <= np.pi / max(finest, 1e-9)])
    basis, left = _beyond_nuisances(residual, jacobian)
    carriers, angle = [np.where(known, carrier, 0.0)], np.where(known, angle, 0.0)
    power = _powers(tried, angle, carriers, basis, left)
    return [
        float(tried[i])
        for i in sorted(range(tried.size), key=lambda i: -power[i])[: settings.max_frequencies]
    ]


def crank_orders(
    parts: Sequence[Part], settings: ScreeningSettings, in_all_runs: bool = False
) -> Callable[[float], str]:
    """A function: text for a frequency [Hz] that is an order or half order of the crank, in a run
    or in all, else empty."""
    rates = {}
    for series in (part.series for part in parts if not part.series.statistic):
        known = np.isfinite(series.time) & np.isfinite(series.angle)
        turns, seconds = (
            np.ptp(values[known]) if known.any() else 0.0 for values in (series.angle, series.time)
        )
        if turns > 0.0 and seconds > 0.0:
            rates[series.run] = float(turns / seconds / (2.0 * np.pi))

    def order_label(frequency: float) -> str:
        found = []
        for run, rate in rates.items():
            order = max(round(2.0 * frequency / rate), 1) / 2.0
            if abs(frequency / rate - order) <= settings.order_width:
                found.append(f"order {order:g} of the crank in run {run}")
        return " and ".join(found) if not in_all_runs or len(found) == len(rates) else ""

    return order_label


def _beyond_nuisances(residual: np.ndarray, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal basis of the nuisances' changes, and the residual projected onto its
    complement."""
    basis = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    return basis, residual - basis @ (basis.T @ residual)


def _powers(
    rates: np.ndarray,
    phase: np.ndarray,
    carriers: Sequence[np.ndarray],
    basis: np.ndarray,
    left: np.ndarray,
) -> np.ndarray:
    """Squared residual `left` (n,) explained by cosine and sine of each of the `rates` (m,) times
    the `phase` (n,), separately for each carrier (n,), by normal equations.

    Carriers act in different rows. A block of rates at a time saves memory.
    """
    size, powers = 2 * len(carriers), [np.empty(0)]
    for block in (
        np.array_split(rates, math.ceil(rates.size / _RATES_A_BLOCK)) if rates.size else ()
    ):
        square, shared, side = np.zeros((block.size, size, size)), [], []
        for i, carrier in enumerate(carriers):
            rows = np.flatnonzero(carrier)
            turned = np.exp(1j * np.outer(phase[rows], block)) * carrier[rows, None]
            waves = np.stack([turned.real, turned.imag])
            place = slice(2 * i, 2 * i + 2)
            square[:, place, place] = np.einsum("anf,bnf->fab", waves, waves)
            shared.append(np.einsum("nk,anf->fak", basis[rows], waves, optimize=True))
            side.append(np.einsum("n,anf->fa", left[rows], waves, optimize=True))
        shared, side = np.concatenate(shared, axis=1), np.concatenate(side, axis=1)
        square -= shared @ shared.transpose(0, 2, 1)
        inverse = np.linalg.pinv(square, rcond=1e-12, hermitian=True)
        powers.append(np.einsum("fi,fij,fj->f", side, inverse, side))
    return np.concatenate(powers)


@dataclass(frozen=True)
class Sensitivity:
    """Change of the whitened residuals by one candidate, for one start of its shape parameters."""

    candidate: Candidate
    shape_parameters: Mapping[str, float]  # Shapes by name [SI], and amplitudes of a secant
    columns: np.ndarray  # [1/unit] Derivatives with respect to the amplitudes
    origin: (
        np.ndarray
    )  # [1] Residuals at zero amplitude: the base's, unless the candidate replaces a nuisance
    runs: tuple[str, ...]  # Runs of the residuals
    secant_factor: float = DEFAULT_SETTINGS.screening.secant_factor

    @property
    def coordinates(self) -> tuple[Parameter, ...]:
        return self.candidate.coordinates_in(self.runs)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        """The coordinates of `columns`."""
        return tuple(p for p in self.coordinates if p.key in self.candidate.amplitudes)

    @property
    def largest_change(self) -> float:
        """Largest norm of the change of the residuals by a typical step of an amplitude [1]."""
        return max(
            float(np.linalg.norm(c)) * p.step
            for c, p in zip(self.columns.T, self.amplitudes, strict=True)
        )

    @property
    def is_secant(self) -> bool:
        """Whether `columns` are secants to a finite amplitude."""
        return any(key in self.shape_parameters for key in self.candidate.amplitudes)

    def valid_range(self, amplitude: Parameter) -> tuple[float, float]:
        """Range of an amplitude [SI] in which `columns` are valid."""
        if amplitude.key not in self.shape_parameters:
            return amplitude.low, amplitude.high
        secant = self.shape_parameters[amplitude.key]
        low, high = sorted((secant / self.secant_factor, secant * self.secant_factor))
        return max(low, amplitude.low), min(high, amplitude.high)


@dataclass(frozen=True)
class Sensitivities:
    """Sensitivities of all candidates about a fit of the current model."""

    parameters: tuple[Parameter, ...]  # The nuisances, k of them
    values: np.ndarray  # [SI]
    jacobian: np.ndarray  # [1/SI]
    residual: np.ndarray  # [1] Whitened
    entries: list[Sensitivity]
    failed: Mapping[str, str]  # Candidates that could not be simulated

    def about(self, fit: Fit) -> "Sensitivities":
        """The sensitivities of the other candidates about a fit with effects, with the columns of
        the base.

        Nuisances that a candidate replaces are reset from the value of the fit to nominal.
        """
        taken = {name for candidate in fit.hypothesis for name in candidate.claims}
        base = dict(zip((p.key for p in self.parameters), self.values.tolist(), strict=True))

        def origin(sensitivity: Sensitivity) -> np.ndarray:
            keys, left = (
                [p.key for p in sensitivity.amplitudes],
                fit.residual + (sensitivity.origin - self.residual),
            )
            for name, amplitude in sensitivity.candidate.replaces.items():
                if amplitude in keys and name in base and name in fit.mapping:
                    left = left + sensitivity.columns[:, keys.index(amplitude)] * (
                        base[name] - fit.mapping[name]
                    )
            return left

        others = [
            replace(s, origin=origin(s)) for s in self.entries if not taken & s.candidate.claims
        ]
        return Sensitivities(
            fit.parameters, fit.values, fit.jacobian, fit.residual, others, self.failed
        )

    def of(self, label: str) -> list[Sensitivity]:
        """All sensitivities of one candidate."""
        return [sensitivity for sensitivity in self.entries if sensitivity.candidate.label == label]

    def derivatives(self, chosen: Sequence[Sensitivity]) -> dict[str, np.ndarray]:
        """Derivatives by key, each (n,), for a fit near the base."""
        columns = {
            p.key: column for p, column in zip(self.parameters, self.jacobian.T, strict=True)
        }
        for sensitivity in chosen:
            for p, column in zip(sensitivity.amplitudes, sensitivity.columns.T, strict=True):
                columns[f"{sensitivity.candidate.label}.{p.key}"] = column
        return columns


@dataclass(frozen=True)
class LinearizedFit:
    """Linear regression of a hypothesis."""

    sensitivities: tuple[Sensitivity, ...]  # One for each new effect
    chi2: float  # Predicted
    start: Mapping[str, float]  # Values by key [SI] of the minimum
    bic: float
    fitted_effects: Hypothesis = ()  # Effects fitted before; `start` contains their values

    @property
    def hypothesis(self) -> Hypothesis:
        return (
            *self.fitted_effects,
            *(sensitivity.candidate for sensitivity in self.sensitivities),
        )

    @property
    def label(self) -> str:
        return label_of(self.hypothesis)

    @property
    def own_start(self) -> dict[str, float]:
        """Start values of the new effects only (in windows nuisances start at their present
        values)."""
        new = tuple(f"{sensitivity.candidate.label}." for sensitivity in self.sensitivities)
        return {key: value for key, value in self.start.items() if key.startswith(new)}


def is_slow_effect(effect: Candidate) -> bool:
    """Whether simulations with an effect with loose joints take long: of finite size only, such
    as an oil film. A fault of a sensor changes no motion."""
    is_finite = all({*guess} & {*effect.amplitudes} for guess in effect.initial_guesses)
    return is_finite and not effect.sensor


def simulate_sensitivities(
    problem: Problem,
    base: Fit,
    differences: FiniteDifferences,
    candidates: Sequence[Candidate] | None = None,
) -> Sensitivities:
    """Derivatives for the candidates about the fitted base; default: all smooth ones (for
    statistics: all), with loose joints without slow ones.

    Without candidates that change nothing in what was measured, such as a force where no channel
    responds to forces.
    """
    entries: list[Sensitivity] = []
    failed: dict[str, str] = {}
    if candidates is None:
        candidates = list(problem.model.candidates)
        if not problem.has_statistics:
            candidates = [one for one in candidates if not one.is_nonsmooth]
            if problem.is_rough:
                slow = [one for one in candidates if is_slow_effect(one)]
                failed |= {one.label: NOT_EXAMINED for one in slow}
                candidates = [one for one in candidates if one not in slow]
    taken = {name for effect in base.hypothesis for name in effect.claims}
    candidates = [candidate for candidate in candidates if not taken & candidate.claims]
    for oscillating in (False, True):  # after their steady carriers
        group = [one for one in candidates if bool(one.carrier) is oscillating]
        starts: list[_Start] = []
        for candidate in group:
            try:
                starts += _starts(problem, base, candidate, entries)
            except (InputError, SimulationError) as error:
                failed[candidate.label] = str(error)
        linearised = _linearised(problem, base, differences, starts)
        for start in with_progress(starts, "effects to screen"):
            try:
                entries.append(_sensitivity(problem, base, differences, start, linearised))
            except (InputError, SimulationError) as error:
                failed[start.candidate.label] = str(error)
    simulated = {sensitivity.candidate.label for sensitivity in entries}
    failed = {label: reason for label, reason in failed.items() if label not in simulated}
    least = problem.settings.screening.negligible_projection
    known = [s for s in entries if np.isfinite(s.columns).all() and s.largest_change > least]
    return Sensitivities(base.parameters, base.values, base.jacobian, base.residual, known, failed)


def steady_first(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Candidates sorted so that oscillating effects follow their steady carriers."""
    return sorted(candidates, key=lambda candidate: bool(candidate.carrier))


def oscillating_shapes(
    problem: Problem,
    candidate: Candidate,
    residual: np.ndarray,
    jacobian: np.ndarray,
    carrier: np.ndarray,
) -> Sequence[Mapping[str, float]]:
    """Start shapes of an oscillating effect with the `carrier` (n,): likely frequencies or orders
    of a residual (n,), besides nuisances (jacobian (n, k))."""
    searches = {"frequency_Hz": likely_frequencies, "order": likely_orders}
    swing = next(p for p in candidate.coordinates if p.name in searches)
    settings = problem.settings.screening
    tried = searches[swing.name](problem.parts, residual, jacobian, carrier, swing, settings)
    return [
        {**candidate.initial_guesses[0], swing.name: value} for value in tried
    ] or candidate.initial_guesses


class _Start(NamedTuple):
    """A candidate at the base, for one start of its shape parameters: its amplitudes are zero, or
    what the nuisances that they replace differ from nominal."""

    candidate: Candidate
    shapes: Mapping[str, float]
    amplitudes: Mapping[str, float]  # By key of the candidate
    values: Mapping[str, float]
    residual: np.ndarray  # There
    is_base: bool  # Whether it is that of the base, in all runs

    @classmethod
    def of(
        cls, problem: Problem, base: Fit, candidate: Candidate, shapes: Mapping[str, float]
    ) -> "_Start":
        nominal = {p.name: p.nominal for p in problem.nuisances}
        replaced = {
            amplitude: base.mapping[name] - nominal[name]
            for name, amplitude in candidate.replaces.items()
            if name in base.mapping and amplitude not in shapes
        }
        amplitudes = {key: replaced.get(key, 0.0) for key in candidate.amplitudes}
        # a nuisance of several sites remains a coordinate of the others
        remaining = {
            p.key: base.mapping.get(p.key, shapes.get(p.key, p.nominal))
            if p.key in candidate.replaces
            else shapes[p.key]
            for p in candidate.coordinates
            if p.key not in amplitudes
        }
        own = {f"{candidate.label}.{key}": at for key, at in (amplitudes | remaining).items()}
        kept = {
            key: value
            for key, value in base.mapping.items()
            if key.partition("@")[0] not in candidate.replaces
        }
        shapes, values, residual = {**shapes, **remaining}, kept | own, base.residual
        if candidate.replaces:
            residual = problem.residual(values, (*base.hypothesis, candidate))
        is_base = len(replaced) == len(candidate.replaces)
        return cls(candidate, shapes, amplitudes, values, residual, is_base)

    @property
    def secant(self) -> str:
        """The amplitude with a finite first guess, to which a secant is used; '' if there is
        none."""
        return next((key for key in self.candidate.amplitudes if key in self.shapes), "")

    def directions(self, problem: Problem, base: Fit) -> list[Direction]:
        """One for each amplitude."""
        keys = {f"{self.candidate.label}.{key}" for key in self.candidate.amplitudes}
        both = (*base.hypothesis, self.candidate)
        parameters = problem.parameters((self.candidate,))
        return [Direction(p, self.values, both) for p in parameters if p.key in keys]


def _starts(
    problem: Problem, base: Fit, candidate: Candidate, entries: Sequence[Sensitivity]
) -> list[_Start]:
    """The starts of a candidate; those of an oscillating effect depend on its carrier among the
    `entries`."""
    guesses = candidate.initial_guesses
    carriers = [entry for entry in entries if entry.candidate.label == candidate.carrier]
    if carriers:
        guesses = oscillating_shapes(
            problem, candidate, base.residual, base.jacobian, carriers[0].columns[:, 0]
        )
    return [_Start.of(problem, base, candidate, shapes) for shapes in guesses]


def _linearised(
    problem: Problem, base: Fit, differences: FiniteDifferences, starts: Sequence[_Start]
) -> dict[tuple[int, str], LinearisedColumn]:
    """Derivatives by linearisation about the base, by index of the values of a start and key of the
    amplitude; none of starts with other residuals than the base."""
    directions = [
        direction
        for start in starts
        if not start.secant and start.is_base
        for direction in start.directions(problem, base)
    ]
    columns = differences.linearised(base.mapping, base.hypothesis, directions)
    return {
        (id(direction.values), direction.parameter.key): column
        for direction, column in zip(directions, columns, strict=True)
    }


def _sensitivity(
    problem: Problem,
    base: Fit,
    differences: FiniteDifferences,
    start: _Start,
    linearised: Mapping[tuple[int, str], LinearisedColumn],
) -> Sensitivity:
    candidate, shapes, residual = start.candidate, start.shapes, start.residual
    factor = problem.settings.screening.secant_factor
    if key := start.secant:
        # nonlinear near zero: use a secant to a finite amplitude
        varied = {**start.values, f"{candidate.label}.{key}": shapes[key]}
        change = problem.residual(varied, (*base.hypothesis, candidate)) - residual
        columns = change[:, None] / shapes[key]
    else:
        columns = np.column_stack(
            [
                differences.column(
                    p, at, residual, both, linearised=linearised.get((id(at), p.key))
                )
                for p, at, both in start.directions(problem, base)
            ]
        )
    sensitivity = Sensitivity(candidate, dict(shapes), columns, residual, problem.runs, factor)
    present = np.array([start.amplitudes[p.key] for p in sensitivity.amplitudes])
    return replace(sensitivity, origin=residual - columns @ present)


class SensitivityRegression:
    """Linear least squares over a set of sensitivities, in compressed rows."""

    def __init__(self, sensitivities: Sensitivities, fitted_effects: Hypothesis = ()):
        self.sensitivities, self.fitted_effects = sensitivities, fitted_effects
        origins = [
            sensitivity.origin - sensitivities.residual for sensitivity in sensitivities.entries
        ]
        self._rows = sensitivities.residual.size
        blocks = [
            sensitivities.jacobian,
            sensitivities.residual,
            *(sensitivity.columns for sensitivity in sensitivities.entries),
            *origins,
        ]
        blocks = compress_rows(*blocks)
        count = len(sensitivities.entries)
        self._jacobian, self._residual = blocks[0], blocks[1]
        self._columns, self._origins = blocks[2 : 2 + count], blocks[2 + count :]
        self._index = {id(sensitivity): i for i, sensitivity in enumerate(sensitivities.entries)}

    def explained(self, chosen: Sequence[Sensitivity]) -> LinearizedFit:
        """Regression with the sensitivities `chosen`, within all bounds."""
        sensitivities = self.sensitivities
        replaced = {name for sensitivity in chosen for name in sensitivity.candidate.replaces}
        kept = [i for i, p in enumerate(sensitivities.parameters) if p.name not in replaced]
        indices = [self._index[id(sensitivity)] for sensitivity in chosen]
        labels = {s.candidate.regress_with for s in chosen} - {s.candidate.label for s in chosen}
        freed = [
            self._columns[self._index[id(s)]]
            for s in self.sensitivities.entries
            if s.candidate.label in labels
        ]
        matrix = np.hstack([self._jacobian[:, kept], *(self._columns[i] for i in indices), *freed])
        target = self._residual + sum(
            (self._origins[i] for i in indices), np.zeros(self._residual.size)
        )
        amplitudes = [(sensitivity, p) for sensitivity in chosen for p in sensitivity.amplitudes]
        low, high = bounds_of([sensitivities.parameters[i] for i in kept])
        ranges = (
            np.array([sensitivity.valid_range(p) for sensitivity, p in amplitudes]).reshape(-1, 2).T
        )
        low, high = np.append(low, ranges[0]), np.append(high, ranges[1])
        present = np.append(
            sensitivities.values[kept], [s.shape_parameters.get(p.key, 0.0) for s, p in amplitudes]
        )
        free = np.zeros(matrix.shape[1] - present.size)
        low, high, present = (
            np.append(low, free - np.inf),
            np.append(high, free + np.inf),
            np.append(present, free),
        )
        target = target + matrix[:, len(kept) :] @ present[len(kept) :]
        step, chi2 = bounded_step(matrix, target, low - present, high - present)
        start = {
            sensitivities.parameters[i].key: float(value)
            for i, value in zip(kept, present + step, strict=False)
        }
        for (sensitivity, p), value in zip(amplitudes, (present + step)[len(kept) :], strict=False):
            start[f"{sensitivity.candidate.label}.{p.key}"] = float(value)
        for s in chosen:
            shapes = {
                name: value
                for name, value in s.shape_parameters.items()
                if name not in s.candidate.amplitudes
            }
            start |= {f"{s.candidate.label}.{name}": value for name, value in shapes.items()}
        effects = (*self.fitted_effects, *(sensitivity.candidate for sensitivity in chosen))
        # as `Fit.bic` counts
        counted = len(kept) + sum(len(sensitivity.coordinates) for sensitivity in chosen)
        counted += sum(len(candidate.replaces) for candidate in effects)
        return LinearizedFit(
            tuple(chosen), chi2, start, chi2 + counted * np.log(self._rows), self.fitted_effects
        )

    def singles(self) -> list[LinearizedFit]:
        """Regressions of single candidates, each with its best start, best first."""
        return self._best_of_each((sensitivity,) for sensitivity in self.sensitivities.entries)

    def pairs(self, most_chi2: float = np.inf) -> list[LinearizedFit]:
        """Regressions of compatible pairs of candidates with at most that chi2, best first."""
        compatible = [
            pair
            for pair in combinations(self.sensitivities.entries, 2)
            if not pair[0].candidate.claims & pair[1].candidate.claims
        ]
        if np.isfinite(most_chi2):
            compatible = [pair for pair in compatible if self._least_chi2(pair) <= most_chi2]
        return [pair for pair in self._best_of_each(compatible) if pair.chi2 <= most_chi2]

    @cached_property
    def _beyond_nuisances(self) -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray]:
        """Columns and origins of the candidates and the residual, beyond the nuisances."""
        nuisances = orthonormal(self._jacobian)

        def beyond(rows: np.ndarray) -> np.ndarray:
            return rows - nuisances @ (nuisances.T @ rows)

        columns, origins = (
            [beyond(rows) for rows in part] for part in (self._columns, self._origins)
        )
        return columns, origins, beyond(self._residual)

    def _least_chi2(self, chosen: Sequence[Sensitivity]) -> float:
        """chi2 of the regression without bounds, which none within bounds is below."""
        columns, origins, residual = self._beyond_nuisances
        labels = {s.candidate.regress_with for s in chosen}
        together = [s for s in self.sensitivities.entries if s.candidate.label in labels]
        places = [self._index[id(s)] for s in chosen]
        span = orthonormal(np.hstack([columns[self._index[id(s)]] for s in (*chosen, *together)]))
        target = residual + sum(origins[place] for place in places)
        return float(target @ target - np.sum((span.T @ target) ** 2))

    def _best_of_each(self, chosen: Iterable[Sequence[Sensitivity]]) -> list[LinearizedFit]:
        best: dict[str, LinearizedFit] = {}
        for screened in map(self.explained, chosen):
            if screened.label not in best or screened.chi2 < best[screened.label].chi2:
                best[screened.label] = screened
        return sorted(best.values(), key=lambda screened: screened.bic)


def shortlist(screened: Sequence[LinearizedFit], count: int) -> list[LinearizedFit]:
    """The first `count` hypotheses; alternatives of an `exclusion_group` count once, as their
    sensitivities are equal."""
    groups = [
        frozenset(candidate.exclusion_group for candidate in one.hypothesis) for one in screened
    ]
    kept = list(dict.fromkeys(groups))[:count]
    return [one for one, group in zip(screened, groups, strict=True) if group in kept]


class SensitivitySubspaces:
    """Orthonormal bases of the changes by each candidate, projected onto the complement of the
    nuisances."""

    def __init__(
        self, sensitivities: Sensitivities, settings: ScreeningSettings = DEFAULT_SETTINGS.screening
    ):
        self._settings = settings
        self.nuisances = orthonormal(sensitivities.jacobian)
        self.of: dict[str, list[np.ndarray]] = {}
        linear = {
            sensitivity.candidate.label
            for sensitivity in sensitivities.entries
            if not sensitivity.is_secant
        }
        for sensitivity in sensitivities.entries:
            if sensitivity.is_secant and sensitivity.candidate.label in linear:
                continue  # the derivative at small amplitudes counts
            space = orthonormal(self.projected(sensitivity.columns))
            self.of.setdefault(sensitivity.candidate.label, []).append(space)
        self._groups = {
            s.candidate.label: s.candidate.exclusion_group for s in sensitivities.entries
        }

    def projected(self, columns: np.ndarray) -> np.ndarray:
        """The columns (n, m) projected onto the complement of the nuisances; zero if that is
        rounding."""
        left = columns - self.nuisances @ (self.nuisances.T @ columns)
        lost = np.linalg.norm(left, axis=0) < self._settings.negligible_projection * np.linalg.norm(
            columns, axis=0
        )
        return np.where(lost, 0.0, left)

    def span(self, labels: Iterable[str]) -> np.ndarray:
        """Basis (n, dimensions) of the changes by the candidates `labels` together."""
        return orthonormal(
            np.hstack(
                [self.nuisances[:, :0], *(space for label in labels for space in self.of[label])]
            )
        )

    def cosine(self, space: np.ndarray, label: str) -> float:
        """Cosine [1] of the smallest principal angle between the candidate's subspace and `space`;
        0 if it is empty."""
        cosines = [
            np.linalg.norm(space.T @ own, 2) for own in self.of[label] if own.size and space.size
        ]
        return float(min(max(cosines, default=0.0), 1.0))

    def is_special_case(self, special: Hypothesis, general: Hypothesis) -> bool:
        """Whether the subspace of the second hypothesis contains that of the first: a constant
        force is a limit of a spring.
        """
        general_labels = {candidate.label for candidate in general}
        own = [candidate.label for candidate in special if candidate.label not in general_labels]
        if any(not self.span([label] if label in self.of else []).size for label in own):
            return False  # equivalent to nuisances, or unknown
        inner, outer = (
            self.span([c.label for c in hyp if c.label in self.of]) for hyp in (special, general)
        )
        if not 0 < inner.shape[1] < outer.shape[1]:
            return False
        return bool(
            np.linalg.norm(inner - outer @ (outer.T @ inner), 2)
            < self._settings.special_case_distance
        )

    def nearest(self, hypothesis: Hypothesis) -> tuple[str, float]:
        """The most similar candidate outside the explanation, and the squared cosine; '' if there
        is none. Alternatives of its effects are ignored, as their sensitivities are equal.
        """
        named = {candidate.label for candidate in hypothesis}
        taken = {candidate.exclusion_group for candidate in hypothesis}
        space = self.span([label for label in named if label in self.of])
        others = [
            (self.cosine(space, label) ** 2, label)
            for label in self.of
            if self._groups[label] not in taken
        ]
        cosine, label = max(others, default=(0.0, ""))
        return label, cosine


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis (n, rank) of the columns."""
    length = np.linalg.norm(columns, axis=0)
    live = columns[:, length > 0] / length[length > 0]
    if not live.shape[1]:
        return live
    left, sizes, _ = np.linalg.svd(live, full_matrices=False)
    return left[:, sizes > 1e-9 * sizes[0]]
