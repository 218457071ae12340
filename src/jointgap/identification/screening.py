"""Screening the candidates by their linear effect."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.progress import with_progress
from jointgap.identification.fit import FiniteDifferences, Fit, bounded_step, bounds_of, compress_rows
from jointgap.identification.problem import Hypothesis, Part, Problem, label_of
from jointgap.identification.settings import DEFAULT_SETTINGS, ScreeningSettings


def likely_frequencies(
    parts: Sequence[Part],
    residual: np.ndarray,
    jacobian: np.ndarray,
    carrier: np.ndarray,
    frequency: Parameter,
    settings: ScreeningSettings,
) -> list[float]:
    """The most likely frequencies [Hz] of an effect that is `carrier` times a cosine in time, the likeliest first.

    A periodogram by least squares: at each frequency the carrier times a cosine and a sine, of each run its own, are
    fitted beside the nuisances. It is exact where the motion does not respond to the force (a prescribed motion, of
    which forces are read).
    """
    time, run = np.full(residual.size, np.nan), np.empty(residual.size, dtype=object)
    for part in parts:
        run[part.place] = part.series.run
        if not part.series.statistic:
            time[part.place] = part.series.time[part.used]
    timed = np.isfinite(time)
    if not timed.any() or not residual.any():  # a preflight has nothing to search
        return []
    span = max(np.ptp(part.series.time[part.used]) for part in parts if timed[part.place].all())
    step = 1.0 / (settings.frequencies_per_line * span)
    densest = min(np.median(np.diff(part.series.time[part.used])) for part in parts if timed[part.place].all())
    tried = np.arange(max(frequency.low, 0.5 / span), min(frequency.high, 0.5 / densest), step)
    order = orders_of_cranks(parts, settings)
    tried = np.array([hertz for hertz in tried if not order(hertz)])  # an effect in step with the crank is another one
    basis, left = _beyond_nuisances(residual, jacobian)
    carriers = [np.where(timed & (run == name), carrier, 0.0) for name in dict.fromkeys(run)]
    time = np.where(timed, time, 0.0)
    power = np.array([_power(2 * np.pi * hertz * time, carriers, basis, left) for hertz in tried])
    inner = np.arange(1, power.size - 1)
    peaks = inner[(power[inner] >= power[inner - 1]) & (power[inner] > power[inner + 1])]
    return [float(tried[i]) for i in sorted(peaks, key=lambda i: -power[i])[: settings.max_frequencies]]


def likely_orders(
    parts: Sequence[Part],
    residual: np.ndarray,
    jacobian: np.ndarray,
    carrier: np.ndarray,
    order: Parameter,
    settings: ScreeningSettings,
) -> list[float]:
    """The most likely orders [cycles per revolution] of an effect that is `carrier` times a cosine of the crank angle.

    As `likely_frequencies`, over those that the parameter says; an effect in step with the crank has one phase in all
    runs. Orders that the samples of a series do not resolve are not looked for.
    """
    angle = np.full(residual.size, np.nan)
    finest = np.inf
    for part in parts:
        own = part.series.angle[part.used]
        angle[part.place] = own
        if np.isfinite(own).sum() > 1:
            finest = min(finest, float(np.nanmedian(np.abs(np.diff(own)))))
    known = np.isfinite(angle)
    if not known.any() or not residual.any():  # a preflight has nothing to search
        return []
    tried = np.array([value for value in order.tried if value <= np.pi / max(finest, 1e-9)])
    basis, left = _beyond_nuisances(residual, jacobian)
    carriers, angle = [np.where(known, carrier, 0.0)], np.where(known, angle, 0.0)
    power = [_power(k * angle, carriers, basis, left) for k in tried]
    return [float(tried[i]) for i in sorted(range(tried.size), key=lambda i: -power[i])[: settings.max_frequencies]]


def orders_of_cranks(parts: Sequence[Part], settings: ScreeningSettings) -> Callable[[float], str]:
    """What tells of a frequency [Hz] whether it is an order or half an order of a run's crank, in words; empty where it
    is none.
    """
    rates = {}
    for series in (part.series for part in parts if not part.series.statistic):
        known = np.isfinite(series.time) & np.isfinite(series.angle)
        turns, seconds = (np.ptp(values[known]) if known.any() else 0.0 for values in (series.angle, series.time))
        if turns > 0.0 and seconds > 0.0:
            rates[series.run] = float(turns / seconds / (2.0 * np.pi))

    def order_in_words(frequency: float) -> str:
        for run, rate in rates.items():
            order = max(round(2.0 * frequency / rate), 1) / 2.0
            if abs(frequency / rate - order) <= settings.order_width:
                return f"order {order:g} of the crank in run {run}"
        return ""

    return order_in_words


def _beyond_nuisances(residual: np.ndarray, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal columns of what nuisances change, and what they leave of the residual."""
    basis = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    return basis, residual - basis @ (basis.T @ residual)


def _power(phase: np.ndarray, carriers: Sequence[np.ndarray], basis: np.ndarray, left: np.ndarray) -> float:
    """How much of the squared residual the cosine and the sine of `phase` explain, with each carrier by themselves."""
    columns = np.column_stack([carrier * wave for carrier in carriers for wave in (np.cos(phase), np.sin(phase))])
    columns -= basis @ (basis.T @ columns)
    weight = np.linalg.lstsq(columns, left, rcond=None)[0]
    return float(left @ (columns @ weight))


@dataclass(frozen=True)
class Signature:
    """What one candidate, from one start of its shape parameters, changes in the whitened residuals."""

    candidate: Candidate
    shape_parameters: Mapping[str, float]  # Shapes by name [SI], and amplitudes that are not small
    columns: np.ndarray  # [1/unit] Derivatives with respect to its amplitudes
    origin: np.ndarray  # [1] Residuals at zero amplitude: the base's, unless the candidate replaces a nuisance
    runs: tuple[str, ...]  # The runs that residuals are of
    secant_factor: float = DEFAULT_SETTINGS.screening.secant_factor

    @property
    def coordinates(self) -> tuple[Parameter, ...]:
        """What a fit varies."""
        return self.candidate.coordinates_in(self.runs)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        """The coordinates that `columns` belong to."""
        return tuple(p for p in self.coordinates if p.key in self.candidate.amplitudes)

    @property
    def is_secant(self) -> bool:
        """Whether `columns` are a secant to a finite amplitude."""
        return any(key in self.shape_parameters for key in self.candidate.amplitudes)

    def valid_range(self, amplitude: Parameter) -> tuple[float, float]:
        """Between what values [SI] `columns` say what an amplitude changes."""
        if amplitude.key not in self.shape_parameters:
            return amplitude.low, amplitude.high
        secant = self.shape_parameters[amplitude.key]
        low, high = sorted((secant / self.secant_factor, secant * self.secant_factor))
        return max(low, amplitude.low), min(high, amplitude.high)


@dataclass(frozen=True)
class Signatures:
    """Signatures of all candidates about a fit of the model as it stands."""

    parameters: tuple[Parameter, ...]  # The nuisances, k of them
    values: np.ndarray  # [SI]
    jacobian: np.ndarray  # [1/SI]
    residual: np.ndarray  # [1] Whitened
    entries: list[Signature]
    failed: Mapping[str, str]  # Candidates that could not be simulated

    def about(self, fit: Fit) -> "Signatures":
        """The other candidates' signatures beside the effects of a fit, as they are about the base.

        A nuisance that a candidate replaces goes back to nominal from where the fit has it.
        """
        taken = {name for candidate in fit.hypothesis for name in candidate.claims}
        base = dict(zip((p.key for p in self.parameters), self.values.tolist(), strict=True))

        def origin(signature: Signature) -> np.ndarray:
            keys, left = [p.key for p in signature.amplitudes], fit.residual + (signature.origin - self.residual)
            for name, amplitude in signature.candidate.replaces.items():
                if amplitude in keys and name in base and name in fit.mapping:
                    left = left + signature.columns[:, keys.index(amplitude)] * (base[name] - fit.mapping[name])
            return left

        others = [replace(s, origin=origin(s)) for s in self.entries if not taken & s.candidate.claims]
        return Signatures(fit.parameters, fit.values, fit.jacobian, fit.residual, others, self.failed)

    def of(self, label: str) -> list[Signature]:
        """All signatures of one candidate."""
        return [signature for signature in self.entries if signature.candidate.label == label]

    def derivatives(self, chosen: Sequence[Signature]) -> dict[str, np.ndarray]:
        """Derivatives by key, each (n,), for a fit that starts near the base."""
        columns = {p.key: column for p, column in zip(self.parameters, self.jacobian.T, strict=True)}
        for signature in chosen:
            for p, column in zip(signature.amplitudes, signature.columns.T, strict=True):
                columns[f"{signature.candidate.label}.{p.key}"] = column
        return columns


@dataclass(frozen=True)
class LinearizedFit:
    """What a hypothesis would explain if all were linear."""

    signatures: tuple[Signature, ...]  # One of each effect that is new
    chi2: float  # What would be left
    start: Mapping[str, float]  # Values by key [SI] at which it would be
    bic: float
    fitted_effects: Hypothesis = ()  # Effects that are fitted already; `start` holds their values

    @property
    def hypothesis(self) -> Hypothesis:
        """The effects."""
        return (*self.fitted_effects, *(signature.candidate for signature in self.signatures))

    @property
    def label(self) -> str:
        """The effects in words."""
        return label_of(self.hypothesis)

    @property
    def own_start(self) -> dict[str, float]:
        """Where the values of effects that are new start. In windows nuisances begin where they are: what is far from
        there moves them by less than slopes say."""
        new = tuple(f"{signature.candidate.label}." for signature in self.signatures)
        return {key: value for key, value in self.start.items() if key.startswith(new)}


def simulate_signatures(
    problem: Problem, base: Fit, differences: FiniteDifferences, candidates: Sequence[Candidate] | None = None
) -> Signatures:
    """Simulate every candidate at a small amplitude about the fitted base; by default, all that slopes lead to.

    Statistics over cycles are smooth, so that slopes lead to everything.
    """
    entries: list[Signature] = []
    failed: dict[str, str] = {}
    if candidates is None:
        candidates = [one for one in problem.model.candidates if problem.has_statistics or not one.is_rough]
    taken = {name for effect in base.hypothesis for name in effect.claims}
    candidates = [candidate for candidate in candidates if not taken & candidate.claims]
    for candidate in with_progress(steady_first(candidates), "effects to screen"):
        steady = [signature for signature in entries if signature.candidate.label == candidate.steady_counterpart]
        try:
            origin = base.residual
            if candidate.replaces:
                absent = _absent(candidate, candidate.initial_guesses[0], base)
                origin = problem.residual(absent, (*base.hypothesis, candidate))
            guesses = candidate.initial_guesses
            if steady:
                guesses = swinging_shapes(problem, candidate, base.residual, base.jacobian, steady[0].columns[:, 0])
            for shapes in guesses:
                try:
                    entries.append(_signature(problem, base, differences, candidate, shapes, origin))
                except (InputError, SimulationError) as error:
                    failed[candidate.label] = str(error)
        except (InputError, SimulationError) as error:
            failed[candidate.label] = str(error)
    simulated = {signature.candidate.label for signature in entries}
    failed = {label: reason for label, reason in failed.items() if label not in simulated}
    finite = [signature for signature in entries if np.isfinite(signature.columns).all()]
    return Signatures(base.parameters, base.values, base.jacobian, base.residual, finite, failed)


def steady_first(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Effects that swing after the steady ones, which tell at which frequencies or orders."""
    return sorted(candidates, key=lambda candidate: bool(candidate.steady_counterpart))


def swinging_shapes(
    problem: Problem, candidate: Candidate, residual: np.ndarray, jacobian: np.ndarray, carrier: np.ndarray
) -> Sequence[Mapping[str, float]]:
    """Shapes to start from of an effect that is a steady one, `carrier` (n,), swinging: likely frequencies or orders
    in a residual (n,) beside what nuisances change (n, k)."""
    searches = {"frequency_Hz": likely_frequencies, "order": likely_orders}
    swing = next(p for p in candidate.coordinates if p.name in searches)
    settings = problem.settings.screening
    tried = searches[swing.name](problem.parts, residual, jacobian, carrier, swing, settings)
    return [{**candidate.initial_guesses[0], swing.name: value} for value in tried] or candidate.initial_guesses


def _absent(candidate: Candidate, shapes: Mapping[str, float], base: Fit) -> dict[str, float]:
    """The base's values with the candidate at zero amplitude; nuisances that it replaces are left out, and so at
    nominal."""
    own = {p.key: 0.0 if p.key in candidate.amplitudes else shapes[p.key] for p in candidate.coordinates}
    kept = {key: value for key, value in base.mapping.items() if key.partition("@")[0] not in candidate.replaces}
    return kept | {f"{candidate.label}.{key}": value for key, value in own.items()}


def _signature(
    problem: Problem,
    base: Fit,
    differences: FiniteDifferences,
    candidate: Candidate,
    shapes: Mapping[str, float],
    origin: np.ndarray,
) -> Signature:
    values = _absent(candidate, shapes, base)
    amplitudes = {f"{candidate.label}.{key}" for key in candidate.amplitudes}
    factor = problem.settings.screening.secant_factor
    both = (*base.hypothesis, candidate)
    if finite := [key for key in candidate.amplitudes if key in shapes]:
        (key,) = finite
        # Not linear near zero: the derivative is a secant to a finite amplitude.
        change = problem.residual(values | {f"{candidate.label}.{key}": shapes[key]}, both) - origin
        return Signature(candidate, dict(shapes), change[:, None] / shapes[key], origin, problem.runs, factor)
    columns = [
        differences.column(p, values, origin, both) for p in problem.parameters((candidate,)) if p.key in amplitudes
    ]
    return Signature(candidate, dict(shapes), np.column_stack(columns), origin, problem.runs, factor)


class SignatureRegression:
    """Linear least squares over a set of signatures, in few rows."""

    def __init__(self, signatures: Signatures, fitted_effects: Hypothesis = ()):
        self.signatures, self.fitted_effects = signatures, fitted_effects
        origins = [signature.origin - signatures.residual for signature in signatures.entries]
        self._rows = signatures.residual.size
        blocks = [
            signatures.jacobian,
            signatures.residual,
            *(signature.columns for signature in signatures.entries),
            *origins,
        ]
        blocks = compress_rows(*blocks)
        count = len(signatures.entries)
        self._jacobian, self._residual = blocks[0], blocks[1]
        self._columns, self._origins = blocks[2 : 2 + count], blocks[2 + count :]
        self._index = {id(signature): i for i, signature in enumerate(signatures.entries)}

    def explained(self, chosen: Sequence[Signature]) -> LinearizedFit:
        """What the signatures `chosen` together would explain, within all bounds."""
        signatures = self.signatures
        replaced = {name for signature in chosen for name in signature.candidate.replaces}
        kept = [i for i, p in enumerate(signatures.parameters) if p.name not in replaced]
        indices = [self._index[id(signature)] for signature in chosen]
        matrix = np.hstack([self._jacobian[:, kept], *(self._columns[i] for i in indices)])
        target = self._residual + sum((self._origins[i] for i in indices), np.zeros(self._residual.size))
        amplitudes = [(signature, p) for signature in chosen for p in signature.amplitudes]
        low, high = bounds_of([signatures.parameters[i] for i in kept])
        ranges = np.array([signature.valid_range(p) for signature, p in amplitudes]).reshape(-1, 2).T
        low, high = np.append(low, ranges[0]), np.append(high, ranges[1])
        present = np.append(signatures.values[kept], [s.shape_parameters.get(p.key, 0.0) for s, p in amplitudes])
        target = target + matrix[:, len(kept) :] @ present[len(kept) :]
        step, chi2 = bounded_step(matrix, target, low - present, high - present)
        start = {signatures.parameters[i].key: float(value) for i, value in zip(kept, present + step, strict=False)}
        for (signature, p), value in zip(amplitudes, (present + step)[len(kept) :], strict=True):
            start[f"{signature.candidate.label}.{p.key}"] = float(value)
        for s in chosen:
            shapes = {name: value for name, value in s.shape_parameters.items() if name not in s.candidate.amplitudes}
            start |= {f"{s.candidate.label}.{name}": value for name, value in shapes.items()}
        effects = (*self.fitted_effects, *(signature.candidate for signature in chosen))
        # as `Fit.bic` counts
        counted = len(kept) + sum(len(signature.coordinates) for signature in chosen)
        counted += sum(len(candidate.replaces) for candidate in effects)
        return LinearizedFit(tuple(chosen), chi2, start, chi2 + counted * np.log(self._rows), self.fitted_effects)

    def singles(self) -> list[LinearizedFit]:
        """Every candidate with its best start, best first."""
        return self._best_of_each((signature,) for signature in self.signatures.entries)

    def pairs(self) -> list[LinearizedFit]:
        """Every two candidates that do not replace the same nuisance, and are no alternatives; best first."""
        pairs = combinations(self.signatures.entries, 2)
        return self._best_of_each(pair for pair in pairs if not pair[0].candidate.claims & pair[1].candidate.claims)

    def _best_of_each(self, chosen: Iterable[Sequence[Signature]]) -> list[LinearizedFit]:
        best: dict[str, LinearizedFit] = {}
        for screened in map(self.explained, chosen):
            if screened.label not in best or screened.chi2 < best[screened.label].chi2:
                best[screened.label] = screened
        return sorted(best.values(), key=lambda screened: screened.bic)


def shortlist(screened: Sequence[LinearizedFit], count: int) -> list[LinearizedFit]:
    """The first `count` hypotheses; those that differ only in the effect that they hold of an `exclusion_group` count
    once, since their signatures are the same.
    """
    groups = [frozenset(candidate.exclusion_group for candidate in one.hypothesis) for one in screened]
    kept = list(dict.fromkeys(groups))[:count]
    return [one for one, group in zip(screened, groups, strict=True) if group in kept]


class SignatureSubspaces:
    """What each candidate can change in the whitened residuals beyond what nuisances can, as orthonormal columns."""

    def __init__(self, signatures: Signatures, settings: ScreeningSettings = DEFAULT_SETTINGS.screening):
        self._settings = settings
        self.nuisances = orthonormal(signatures.jacobian)
        self.of: dict[str, list[np.ndarray]] = {}
        linear = {signature.candidate.label for signature in signatures.entries if not signature.is_secant}
        for signature in signatures.entries:
            if signature.is_secant and signature.candidate.label in linear:
                continue  # from where a fit starts too; what it can change is what small amplitudes do
            space = orthonormal(self.projected(signature.columns))
            self.of.setdefault(signature.candidate.label, []).append(space)
        self._groups = {s.candidate.label: s.candidate.exclusion_group for s in signatures.entries}

    def projected(self, columns: np.ndarray) -> np.ndarray:
        """What of the columns (n, m) the nuisances cannot take up; zero where that is rounding."""
        left = columns - self.nuisances @ (self.nuisances.T @ columns)
        lost = np.linalg.norm(left, axis=0) < self._settings.negligible_projection * np.linalg.norm(columns, axis=0)
        return np.where(lost, 0.0, left)

    def span(self, labels: Iterable[str]) -> np.ndarray:
        """All that the candidates `labels` together can change, shape (n, dimensions)."""
        return orthonormal(np.hstack([self.nuisances[:, :0], *(space for label in labels for space in self.of[label])]))

    def cosine(self, space: np.ndarray, label: str) -> float:
        """Largest cosine [1] of anything that the candidate changes with the columns of `space`; 0 where it changes
        nothing.
        """
        cosines = [np.linalg.norm(space.T @ own, 2) for own in self.of[label] if own.size and space.size]
        return float(min(max(cosines, default=0.0), 1.0))

    def is_special_case(self, special: Hypothesis, general: Hypothesis) -> bool:
        """Whether the second hypothesis can do all that the first can, and more: a constant force is a spring without
        stiffness.
        """
        general_labels = {candidate.label for candidate in general}
        own = [candidate.label for candidate in special if candidate.label not in general_labels]
        if any(not self.span([label] if label in self.of else []).size for label in own):
            return False  # nuisances take up all that it changes, or nothing is known of it
        inner, outer = (self.span([c.label for c in hyp if c.label in self.of]) for hyp in (special, general))
        if not 0 < inner.shape[1] < outer.shape[1]:
            return False
        return bool(np.linalg.norm(inner - outer @ (outer.T @ inner), 2) < self._settings.special_case_distance)

    def nearest(self, hypothesis: Hypothesis) -> tuple[str, float]:
        """The candidate beyond the explanation that it could stand for best, and the squared cosine; '' where there is
        none. Alternatives to its effects are left out: signatures cannot tell these apart, fits can.
        """
        named = {candidate.label for candidate in hypothesis}
        taken = {candidate.exclusion_group for candidate in hypothesis}
        space = self.span([label for label in named if label in self.of])
        others = [(self.cosine(space, label) ** 2, label) for label in self.of if self._groups[label] not in taken]
        cosine, label = max(others, default=(0.0, ""))
        return label, cosine


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Orthonormal columns of the same span, shape (n, rank)."""
    length = np.linalg.norm(columns, axis=0)
    live = columns[:, length > 0] / length[length > 0]
    if not live.shape[1]:
        return live
    left, sizes, _ = np.linalg.svd(live, full_matrices=False)
    return left[:, sizes > 1e-9 * sizes[0]]
