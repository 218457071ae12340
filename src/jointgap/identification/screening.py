"""Which effects are worth a fit: what each would explain if the motion depended on it linearly."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.fit import Fit, bounds_of
from jointgap.identification.frequency_search import frequencies
from jointgap.identification.gauss_newton import bounded_step, compress_rows
from jointgap.identification.problem import Hypothesis, Problem, label_of
from jointgap.identification.protocol import Candidate, Parameter

MOST_FREQUENCIES = 3  # at which one candidate is tried
_SECANT = 2.0  # times or parts of a size for which a secant to it holds


@dataclass(frozen=True)
class Signature:
    """What one candidate, from one start of its shapes, changes in the whitened residuals.

    Attributes
    ----------
    candidate : Candidate
    shape_parameters : mapping of str to float
        Shapes by name, and sizes that are not small.
    columns : (n, m) array
        Derivatives with respect to its sizes, per unit [1/unit]: at 0, or secants from there to sizes among `shape_parameters`.
    origin : (n,) array
        Residuals at zero size: the base's, unless the candidate replaces a nuisance.
    runs : tuple of str
        The runs that residuals are of.
    """

    candidate: Candidate
    shape_parameters: Mapping[str, float]
    columns: np.ndarray
    origin: np.ndarray
    runs: tuple[str, ...]

    @property
    def coordinates(self) -> tuple[Parameter, ...]:
        """What a fit varies."""
        return self.candidate.coordinates_in(self.runs)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        """The coordinates that `columns` belong to."""
        return tuple(p for p in self.coordinates if p.key in self.candidate.amplitudes)

    def reach(self, size: Parameter) -> tuple[float, float]:
        """Between what values `columns` say what a size changes."""
        if size.key not in self.shape_parameters:
            return size.low, size.high
        at = self.shape_parameters[size.key]
        return max(at / _SECANT, size.low), min(at * _SECANT, size.high)


@dataclass(frozen=True)
class Signatures:
    """Signatures of all candidates about a fit of the model as it stands.

    Attributes
    ----------
    parameters : tuple of Parameter
        The nuisances, k of them.
    values : (k,) array
    jacobian : (n, k) array
    residual : (n,) array
    found : list of Signature
    failed : mapping of label to reason
        Candidates that could not be simulated.
    """

    parameters: tuple[Parameter, ...]
    values: np.ndarray
    jacobian: np.ndarray
    residual: np.ndarray
    found: list[Signature]
    failed: Mapping[str, str]

    def about(self, one: Fit) -> "Signatures":
        """The other candidates' signatures beside the effects of a fit, as they are about the base."""
        taken = {name for candidate in one.hypothesis for name in (candidate.label, *candidate.replaces)}
        others = [
            replace(s, origin=one.residual + (s.origin - self.residual))
            for s in self.found
            if not taken & {s.candidate.label, *s.candidate.replaces}
        ]
        return Signatures(one.parameters, one.values, one.jacobian, one.residual, others, self.failed)

    def of(self, label: str) -> list[Signature]:
        """All signatures of one candidate."""
        return [one for one in self.found if one.candidate.label == label]

    def known(self, chosen: Sequence[Signature]) -> dict[str, np.ndarray]:
        """Derivatives by key, for a fit that starts near the base."""
        columns = {p.key: column for p, column in zip(self.parameters, self.jacobian.T, strict=True)}
        for one in chosen:
            for p, column in zip(one.amplitudes, one.columns.T, strict=True):
                columns[f"{one.candidate.label}.{p.key}"] = column
        return columns


@dataclass(frozen=True)
class Screened:
    """What an explanation would explain if all were linear.

    Attributes
    ----------
    signatures : tuple of Signature
        One of each effect that is new.
    chi2 : float
        That would be left.
    start : mapping of str to float
        Values by key at which it would be.
    bic : float
    beside : tuple of Candidate
        Effects that are fitted already; `start` holds their values.
    near : mapping of str to float
        Values by key about which the signatures were taken.
    """

    signatures: tuple[Signature, ...]
    chi2: float
    start: Mapping[str, float]
    bic: float
    beside: Hypothesis = ()
    near: Mapping[str, float] = field(default_factory=dict)

    @property
    def hypothesis(self) -> Hypothesis:
        """The effects."""
        return (*self.beside, *(one.candidate for one in self.signatures))

    @property
    def label(self) -> str:
        """The effects in words."""
        return label_of(self.hypothesis)


def signatures(
    problem: Problem, base: Fit, differences: FiniteDifferences, candidates: Sequence[Candidate] | None = None
) -> Signatures:
    """Simulate every candidate at a small size about the fitted base.

    Parameters
    ----------
    problem : Problem
    base : Fit
        May have effects itself: those, and what replaces the same nuisances, are left out.
    differences : FiniteDifferences
    candidates : sequence of Candidate
        All of the model's by default.
    """
    found, failed = [], {}
    candidates = problem.model.candidates if candidates is None else candidates
    taken = {name for one in base.hypothesis for name in (one.label, *one.replaces)}
    candidates = [one for one in candidates if not taken & {one.label, *one.replaces}]
    for candidate in sorted(candidates, key=lambda one: bool(one.steady_counterpart)):  # carriers come first
        carriers = [one for one in found if one.candidate.label == candidate.steady_counterpart]
        try:
            origin = base.residual
            if candidate.replaces:
                absent = _absent(candidate, candidate.initial_guesses[0], base)
                origin = problem.residual(absent, (*base.hypothesis, candidate))
            for shapes in _starts(problem, base, candidate, carriers):
                try:
                    found.append(_signature(problem, base, differences, candidate, shapes, origin))
                except (InputError, SimulationError) as error:
                    failed[candidate.label] = str(error)
        except (InputError, SimulationError) as error:
            failed[candidate.label] = str(error)
    failed = {label: why for label, why in failed.items() if label not in {one.candidate.label for one in found}}
    known = Signatures(base.parameters, base.values, base.jacobian, base.residual, found, failed)
    return replace(known, found=[one for one in found if np.isfinite(one.columns).all()])


def _starts(problem, base, candidate, carriers) -> Sequence[Mapping[str, float]]:
    if not carriers:
        return candidate.initial_guesses
    frequency = next(p for p in candidate.coordinates if p.name == "frequency_Hz")
    tried = frequencies(
        problem.parts, base.residual, base.jacobian, carriers[0].columns[:, 0], frequency, MOST_FREQUENCIES
    )
    return [{**candidate.initial_guesses[0], "frequency_Hz": value} for value in tried] or candidate.initial_guesses


def _absent(candidate: Candidate, shapes: Mapping[str, float], base: Fit) -> dict[str, float]:
    """The base's values with the candidate there at zero size; nuisances that it replaces are left out, and so at nominal."""
    at = {p.key: 0.0 if p.key in candidate.amplitudes else shapes[p.key] for p in candidate.coordinates}
    kept = {key: value for key, value in base.mapping.items() if key.partition("@")[0] not in candidate.replaces}
    return kept | {f"{candidate.label}.{key}": value for key, value in at.items()}


def _signature(problem, base, differences, candidate, shapes, origin) -> Signature:
    values = _absent(candidate, shapes, base)
    sizes = {f"{candidate.label}.{key}" for key in candidate.amplitudes}
    both = (*base.hypothesis, candidate)
    if finite := [key for key in candidate.amplitudes if key in shapes]:
        (key,) = finite
        away = problem.residual(values | {f"{candidate.label}.{key}": shapes[key]}, both) - origin
        return Signature(candidate, dict(shapes), away[:, None] / shapes[key], origin, problem.runs)
    columns = [differences.column(p, values, origin, both) for p in problem.parameters((candidate,)) if p.key in sizes]
    return Signature(candidate, dict(shapes), np.column_stack(columns), origin, problem.runs)


class Screen:
    """Linear least squares over a set of signatures, in few rows.

    Parameters
    ----------
    known : Signatures
    beside : tuple of Candidate
        Effects among whose parameters and values `known` are.
    smoother : function, optional
        What of the residuals is to be small, as in `jointgap.identification.fit.fit_hypothesis`.
    """

    def __init__(
        self,
        known: Signatures,
        beside: Hypothesis = (),
        smoother: Callable[[np.ndarray], np.ndarray] | None = None,
    ):
        self.known, self.beside = known, beside
        origins = [one.origin - known.residual for one in known.found]
        self._rows = known.residual.size
        blocks = [known.jacobian, known.residual, *(one.columns for one in known.found), *origins]
        blocks = compress_rows(*(blocks if smoother is None else map(smoother, blocks)))
        count = len(known.found)
        self._jacobian, self._residual = blocks[0], blocks[1]
        self._columns, self._origins = blocks[2 : 2 + count], blocks[2 + count :]
        self._place = {id(one): i for i, one in enumerate(known.found)}

    def explained(self, chosen: Sequence[Signature]) -> Screened:
        """What the signatures `chosen` together would explain, within all bounds."""
        known = self.known
        replaced = {name for one in chosen for name in one.candidate.replaces}
        kept = [i for i, p in enumerate(known.parameters) if p.name not in replaced]
        places = [self._place[id(one)] for one in chosen]
        matrix = np.hstack([self._jacobian[:, kept], *(self._columns[i] for i in places)])
        target = self._residual + sum((self._origins[i] for i in places), np.zeros(self._residual.size))
        sizes = [(one, p) for one in chosen for p in one.amplitudes]
        low, high = bounds_of([known.parameters[i] for i in kept])
        reach = np.array([one.reach(p) for one, p in sizes]).reshape(-1, 2).T
        low, high = np.append(low, reach[0]), np.append(high, reach[1])
        here = np.append(known.values[kept], [one.shape_parameters.get(p.key, 0.0) for one, p in sizes])
        target = target + matrix[:, len(kept) :] @ here[len(kept) :]
        step, chi2 = bounded_step(matrix, target, low - here, high - here)
        start = {known.parameters[i].key: float(value) for i, value in zip(kept, here + step, strict=False)}
        for (one, p), value in zip(sizes, (here + step)[len(kept) :], strict=True):
            start[f"{one.candidate.label}.{p.key}"] = float(value)
        for one in chosen:
            shapes = {
                name: value for name, value in one.shape_parameters.items() if name not in one.candidate.amplitudes
            }
            start |= {f"{one.candidate.label}.{name}": value for name, value in shapes.items()}
        effects = (*self.beside, *(one.candidate for one in chosen))
        free = len(kept) + sum(len(one.coordinates) for one in chosen)
        free += sum(len(candidate.replaces) for candidate in effects)  # as `Fit.bic` counts
        near = {p.key: float(value) for p, value in zip(known.parameters, known.values, strict=True)}
        return Screened(tuple(chosen), chi2, start, chi2 + free * np.log(self._rows), self.beside, near)

    def singles(self) -> list[Screened]:
        """Every candidate with its best start, best first."""
        best: dict[str, Screened] = {}
        for one in self.known.found:
            found = self.explained((one,))
            if found.label not in best or found.chi2 < best[found.label].chi2:
                best[found.label] = found
        return sorted(best.values(), key=lambda found: found.bic)
