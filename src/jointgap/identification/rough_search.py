"""The search for effects on which motion depends roughly: by features of the cycle first, then by samples.

Around the truth chi2 of samples has a valley that is a percent wide; outside it is flat. Features of the cycle
(`jointgap.identification.features`) lead there. As in sequential Monte Carlo without likelihoods (Sisson, Fan and
Tanaka, PNAS 104 (2007) 1760-1765) points are drawn from the range of the coordinates, the best are kept, and the next
ones drawn about these. At each of them nuisances are where derivatives say that samples are met best: those of the base
make up for what is missing, and with them a valley may not be seen. Candidates compete: one that falls behind is
dropped. From the best points fits of the samples start. One that ends in a valley, but not at its bottom, is where
points are drawn once more, now for the samples. Where a fit ended is a point like others: if its features are among the
best, the next ones are drawn about it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import qmc

from jointgap.core.candidates import FAST, Candidate, Parameter
from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.baseline import Baseline, other_numerics
from jointgap.identification.decide_verdict import reduced_chi2
from jointgap.identification.features import CycleFeatures
from jointgap.identification.fit import FAILED, MATCHED, Fit, bounded_step, bounds_of, fit_hypothesis
from jointgap.identification.initial_fit import derivatives_of, labels_of
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.settings import RoughSearchSettings


@dataclass
class _Point:
    """One simulated point."""

    place: np.ndarray  # in the box of the coordinates, each from 0 to 1
    misfit: float  # of the features of the cycle; infinite where it was given up
    chi2: float  # of the samples, as derivatives predict it beside these values
    beside: dict[str, float]  # values by key [SI] of what is not searched, choices of runs among them


class Box:
    """The ranges of a candidate's coordinates, each from 0 to 1; others than the amplitude as they are.

    The amplitude counts from `Candidate.vanishing_amplitude`, by its logarithm.
    """

    def __init__(self, candidate: Candidate, parameters: Sequence[Parameter]):
        key = f"{candidate.label}.{candidate.amplitudes[0]}"
        own = [p for p in parameters if p.name.startswith(f"{candidate.label}.")]
        self.choices = {p.key: p.choices for p in own if p.choices}
        held = {f"{candidate.label}.{name}" for name in candidate.unsearched}
        self.held = {p.key: p.nominal for p in own if p.key in held}
        own = [p for p in own if not p.choices and p.key not in held and (p.key == key or np.isfinite(p.high - p.low))]
        self._keys = [p.key for p in own]
        self._logarithmic, self._vanishing = np.array([p.key == key for p in own]), candidate.vanishing_amplitude
        amplitudes = np.log(np.subtract(candidate.search_range, self._vanishing))
        ends = np.array([amplitudes if p.key == key else (p.low, p.high) for p in own])
        self._low, self._width = ends[:, 0], ends[:, 1] - ends[:, 0]

    def spread(self, settings: RoughSearchSettings, generator: np.random.Generator) -> np.ndarray:
        """Places (points, dimensions) spread evenly over the box: the first ones of a search."""
        return qmc.Sobol(len(self._keys), seed=generator).random_base2(settings.first_points_log2)

    def values(self, place: np.ndarray, factor: float = 1.0) -> dict[str, float]:
        """By key [SI], what the amplitude is beyond `Candidate.vanishing_amplitude` times a `factor`."""
        plain = self._low + self._width * place
        sizes = self._vanishing + factor * np.exp(plain)
        return dict(zip(self._keys, np.where(self._logarithmic, sizes, plain).tolist(), strict=True))

    def place(self, values: Mapping[str, float]) -> np.ndarray:
        """Of values by key [SI], on the edge where they are beyond."""
        plain = np.array([values[key] for key in self._keys])
        plain = np.where(self._logarithmic, np.log(np.maximum(plain - self._vanishing, 1e-300)), plain)
        return np.clip((plain - self._low) / self._width, 0.0, 1.0)


def drawn_about(
    elite: Sequence[np.ndarray], settings: RoughSearchSettings, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Places (points, dimensions) about the `elite`, normally distributed with parts of their spread, from a small one
    to all of it; and about which of these each one is, (points,) int.
    """
    count, dimensions = settings.points, len(elite[0])
    covariance = np.cov(np.transpose(elite)).reshape(dimensions, -1)
    narrow, wide = np.log(settings.kernel_widths)
    widths = np.exp(generator.uniform(narrow, wide, (count, 1)))
    steps = widths * generator.multivariate_normal(np.zeros(dimensions), covariance, count)
    steps += settings.least_spread * generator.standard_normal((count, dimensions))
    chosen = generator.integers(len(elite), size=count)
    return np.clip(np.array(elite)[chosen] + steps, 0, 1), chosen


class _LinearAdaptation:
    """Adapts nuisances, and the effects of a fit, to a point by what small changes of them do, without another fit.

    Where no derivatives can be had nothing is adapted.
    """

    def __init__(self, baseline: Baseline, origin: Fit):
        self._baseline, self._origin, problem = baseline, origin, baseline.problem
        self.rows = {
            run: np.concatenate(
                [np.arange(part.place.start, part.place.stop) for part in problem.parts if part.series.run == run]
            )
            for run in problem.runs
        }

    @cached_property
    def _derivatives(self) -> dict[str, tuple[Parameter, np.ndarray]]:
        """By key, a parameter and the derivative by it (n,)."""
        origin, differences = self._origin, self._baseline.differences
        try:
            columns = differences.jacobian(origin.parameters, origin.mapping, origin.residual, origin.hypothesis).T
            derivatives = dict(zip((p.key for p in origin.parameters), columns, strict=True))
        except (InputError, SimulationError):  # at the edge of what can be simulated
            derivatives = derivatives_of(origin)
        return {p.key: (p, derivatives[p.key]) for p in origin.parameters if p.key in derivatives}

    def adapted(
        self, residual: np.ndarray, runs: Sequence[str], values: Mapping[str, float]
    ) -> tuple[np.ndarray, dict[str, float]]:
        """The residual (n,) and the values by key [SI] of what is left to fit, where those of some runs are least."""
        keys = [key for key in self._derivatives if key in values]
        if not keys:
            return residual, {}
        present = np.array([values[key] for key in keys])
        low, high = bounds_of([self._derivatives[key][0] for key in keys])
        rows = np.concatenate([self.rows[run] for run in runs])
        columns = np.column_stack([self._derivatives[key][1][rows] for key in keys])
        step, _ = bounded_step(columns, residual[rows], low - present, high - present)
        moved = residual.copy()
        moved[rows] += columns @ step
        return moved, dict(zip(keys, (present + step).tolist(), strict=True))


class _Contestant:
    """A candidate beside the effects of a fit, and the points at which it was simulated.

    Features are those of what a `reference` leaves, the same for all that compete.
    """

    def __init__(
        self,
        baseline: Baseline,
        origin: Fit,
        adaptation: _LinearAdaptation,
        reference: Fit,
        candidate: Candidate,
        number: int,
    ):
        self._baseline, self._origin, self._adaptation, self._reference = baseline, origin, adaptation, reference
        self._settings: RoughSearchSettings = baseline.problem.settings.rough_search
        self._generator = np.random.default_rng([number, self._settings.seed])
        self.hypothesis: Hypothesis = (*origin.hypothesis, candidate)
        self._box = Box(candidate, baseline.problem.parameters((candidate,)))
        free = {p.key for p in baseline.problem.parameters(self.hypothesis)}
        self._beside = {key: value for key, value in origin.mapping.items() if key in free} | self._box.held
        self.points: list[_Point] = []
        self._population: list[_Point] = []
        self._fits: list[_Point] = []  # where fits of the samples ended
        self._started: list[_Point] = []  # and where they started
        self._progress: list[float] = []  # the least misfit of the population, by round

    @property
    def least(self) -> float:
        """The least misfit of the features."""
        return min((point.misfit for point in self.points), default=np.inf)

    @property
    def stalled(self) -> bool:
        """Whether the best points gather about a place that is none of the truth: they have not become better for some
        rounds since the search began anew."""
        rounds = self._settings.stalled_rounds
        return len(self._progress) > rounds and self._progress[-1] >= self._progress[-1 - rounds]

    @property
    def deepest(self) -> _Point:
        """The point of least chi2, but for those where a fit ended."""
        ends = {id(point) for point in self._fits}
        return min((point for point in self.points if id(point) not in ends), key=lambda point: point.chi2)

    @property
    def point_in_valley(self) -> _Point | None:
        """The deepest point, if it lies in a valley, deeper than where a fit started before."""
        point, before = self.deepest, min((start.chi2 for start in self._started), default=np.inf)
        return point if self.reached(point.chi2) and point.chi2 < self._settings.deeper * before else None

    @property
    def best_unfitted_point(self) -> _Point | None:
        """The point whose features are best, unless a fit started or ended there."""
        best = min(self.points, key=lambda point: point.misfit)
        return None if best.misfit == np.inf or any(best is one for one in (*self._started, *self._fits)) else best

    def begin(self, features: CycleFeatures) -> None:
        """Simulate points spread evenly over the box, others at each call: a new population, with the ends of fits."""
        self._population, self._progress = list(self._fits), []
        self._simulate(features, self._box.spread(self._settings, self._generator))

    def go_on(self, features: CycleFeatures) -> None:
        """Simulate points about those of the population with the best features."""
        elite = sorted(self._population, key=lambda point: point.misfit)[: self._settings.elite]
        places, parents = drawn_about([point.place for point in elite], self._settings, self._generator)
        self._simulate(features, places, [elite[parent] for parent in parents])

    def _simulate(self, features: CycleFeatures, places: np.ndarray, parents: Sequence[_Point] = ()) -> None:
        """Simulate places run by run, each as long as its misfit is less than that of the last of the best.

        What is not searched is adapted to each, from where it is at the best point: after each run to those that are
        simulated by then, so that a misfit may fall with the next run, which is not waited for. Choices of runs are
        those of the point that a place is about, of some runs drawn anew. A run of which they may be wrong counts no
        more than if nothing were changed in it: the others tell as much of the place.
        """
        problem, reference = self._baseline.problem, self._reference
        unchanged = self._misfit_of_no_change(features)
        for place, parent in zip(places, parents or [None] * len(places), strict=True):
            known = sorted(self._population, key=lambda point: point.misfit)
            limit = known[self._settings.elite - 1].misfit if len(known) >= self._settings.elite else np.inf
            beside = known[0].beside if known else self._beside
            beside = beside | self._drawn_choices(parent)
            values, residual, misfit, adapted = beside | self._box.values(place), self._origin.residual, 0.0, beside
            left = residual
            try:
                for number, run in enumerate(problem.runs):
                    residual = problem.residual(values, self.hypothesis, (run,), residual, FAST)
                    simulated = problem.runs[: number + 1]
                    left, moved = self._adaptation.adapted(residual, simulated, beside)
                    adapted = beside | moved
                    misfits = {one: features.misfit(reference.residual - left, one) for one in simulated}
                    if self._box.choices:
                        misfits = {one: min(own, unchanged[one]) for one, own in misfits.items()}
                    misfit = sum(misfits.values())
                    if misfit > limit:
                        misfit = np.inf
                        break
            except (InputError, SimulationError):
                misfit = np.inf
            chi2 = self._chi2(left) if misfit < np.inf else np.inf
            self._population.append(_Point(place, misfit, chi2, adapted))
            self.points.append(self._population[-1])
        self._progress.append(min((point.misfit for point in self._population), default=np.inf))

    def _misfit_of_no_change(self, features: CycleFeatures) -> dict[str, float]:
        """By run, of the features, where the origin is as it is."""
        changes = self._reference.residual - self._origin.residual
        return {run: features.misfit(changes, run) for run in self._baseline.problem.runs}

    def _chi2(self, residual: np.ndarray) -> float:
        """Of a residual (n,); of a run whose choices may be others no more than the origin leaves in it."""
        if not self._box.choices:
            return float(residual @ residual)
        origin, total = self._origin.residual, 0.0
        for run in self._baseline.problem.runs:
            rows = self._adaptation.rows[run]
            total += min(float(residual[rows] @ residual[rows]), float(origin[rows] @ origin[rows]))
        return total

    def _drawn_choices(self, parent: _Point | None) -> dict[str, float]:
        """Choices of runs by key, drawn evenly; of some runs those of the `parent` stay, if there is one."""
        chosen = {}
        for key, choices in self._box.choices.items():
            anew = parent is None or self._generator.random() < self._settings.drawn_choices
            chosen[key] = float(self._generator.choice(choices)) if anew else parent.beside[key]
        return chosen

    def fit(self, point: _Point, features: CycleFeatures, sufficient: float) -> Fit:
        """The fit of the samples from a point; from others about it where it ends in a valley, not at its bottom. Where
        it ends is a point of those to come."""
        self._started.append(point)
        fit = self._fitted(self._start_values(point), derivatives_of(self._origin), sufficient)
        for _ in range(self._settings.refinements):
            if not self.reached(fit.chi2) or reduced_chi2(fit) <= sufficient:
                break
            again = self._fitted(self._nearby(fit), None, sufficient)
            if again.chi2 >= fit.chi2:
                break
            fit = again
        if fit.status != FAILED:
            self.add_end_of_fit(fit, features)
        return fit

    def add_end_of_fit(self, fit: Fit, features: CycleFeatures) -> None:
        """Take where a fit of the samples ended as a point of those to come."""
        beside = {key: fit.mapping[key] for key in (*self._beside, *self._box.choices)}
        end = _Point(self._box.place(fit.mapping), self.misfit(features, fit.residual), fit.chi2, beside)
        for points in (self._fits, self.points, self._population):
            points.append(end)

    def _start_values(self, point: _Point) -> dict[str, float]:
        """Values by key [SI] of a point, with what is not searched as adapted or as the origin has it, whichever leaves
        less: derivatives may be wrong far from there. The point has the chi2 that it has then."""
        problem, started = self._baseline.problem, []
        for beside in (point.beside, point.beside | self._beside):
            values = beside | self._box.values(point.place)
            try:
                residual = problem.residual(values, self.hypothesis)
            except (InputError, SimulationError):
                continue
            started.append((float(residual @ residual), values))
        if not started:
            point.chi2 = np.inf
            return point.beside | self._box.values(point.place)
        point.chi2, values = min(started, key=lambda each: each[0])
        return values

    def misfit(self, features: CycleFeatures, residual: np.ndarray) -> float:
        """Of the features, where a simulation leaves a `residual` (n,)."""
        changes = self._reference.residual - residual
        return sum(features.misfit(changes, run) for run in self._baseline.problem.runs)

    def _fitted(self, start: Mapping[str, float], known: Mapping[str, np.ndarray] | None, sufficient: float) -> Fit:
        problem, differences = self._baseline.problem, self._baseline.differences
        enough = sufficient * problem.size
        return fit_hypothesis(problem, self.hypothesis, start, known, differences, sufficient_chi2=enough)

    def matched(self, features: CycleFeatures, other: Fit | None = None) -> Fit | None:
        """The point whose features are best, as a fit to these alone; None where none can be simulated.

        Beside the effects of the `other` fit, where one is given, in place of those of its origin, and adapted alike.

        Of the best points by the numerics of the search it is the one that is best by the usual numerics, by which the
        features of others are known too: in the demonstration 0.64 became 0.85 for each.

        Draws of the coordinates are the best points that were simulated, more often the better their features are met,
        with sizes spread by what nuisances may change in them that were not searched: these stay as they are at the
        best point.
        """
        problem, origin = self._baseline.problem, other or self._origin
        hypothesis = (*origin.hypothesis, self.hypothesis[-1])
        parameters = problem.parameters(hypothesis)
        misfits = np.array([point.misfit for point in self.points])
        adaptation = _LinearAdaptation(self._baseline, other) if other else None
        simulated = []
        for place in np.argsort(misfits, kind="stable")[: self._settings.elite]:
            point = self.points[place]
            beside = point.beside | (other.mapping if other else {})
            at = {p.key: p.nominal for p in parameters} | beside | self._box.values(point.place)
            at = {p.key: at[p.key] for p in parameters}
            try:
                at, residual = self._with_best_choices(features, at, problem.residual(at, hypothesis), hypothesis)
                if adaptation is not None:
                    at |= adaptation.adapted(residual, problem.runs, at)[1]
                    residual = problem.residual(at, hypothesis)
            except (InputError, SimulationError):
                continue
            simulated.append((self.misfit(features, residual), at, residual))
        if not simulated:
            return None
        _, values, residual = min(simulated, key=lambda each: each[0])
        columns = {p.key: number for number, p in enumerate(parameters)}
        jacobian, count = np.zeros((problem.size, len(columns))), self._settings.draws
        draws = np.tile([values[key] for key in columns], (count, 1))
        for key, column in derivatives_of(origin).items():
            if key in columns:  # else an effect replaces it
                jacobian[:, columns[key]] = column
        chosen = self._generator.choice(misfits.size, count, p=_likely(misfits, self._settings.elite))
        spread = np.exp(self._settings.size_error * self._generator.standard_normal(count))
        for row, point in enumerate(chosen):
            for key, value in self._box.values(self.points[point].place, spread[row]).items():
                if key in columns:
                    draws[row, columns[key]] = value
        fitted = np.array([values[key] for key in columns])
        return Fit(
            hypothesis, parameters, fitted, residual, jacobian, 0, MATCHED, draws=draws, settings=problem.settings
        )

    def _with_best_choices(
        self, features: CycleFeatures, at: dict[str, float], residual: np.ndarray, hypothesis: Hypothesis
    ) -> tuple[dict[str, float], np.ndarray]:
        """Values by key [SI] and residual (n,), where each run that is no better than without a change has those of its
        choices by which its features are best: in the search it counted as not changed."""
        problem, unchanged = self._baseline.problem, self._misfit_of_no_change(features)
        for p in (p for p in problem.parameters(hypothesis) if p.key in self._box.choices):
            least = features.misfit(self._reference.residual - residual, p.run)
            if least < unchanged[p.run]:
                continue
            for choice in p.choices:
                tried = at | {p.key: float(choice)}
                try:
                    left = problem.residual(tried, hypothesis, (p.run,), residual)
                except (InputError, SimulationError):
                    continue
                if (misfit := features.misfit(self._reference.residual - left, p.run)) < least:
                    at, residual, least = tried, left, misfit
        return at, residual

    def _nearby(self, fit: Fit) -> dict[str, float]:
        """The best of points drawn about a fit, for the samples: values by key [SI]; what is not searched stays."""
        problem, centre = self._baseline.problem, self._box.place(fit.mapping)
        count, best, least = self._settings.points, fit.mapping, fit.chi2
        spreads = np.exp(self._generator.uniform(*np.log(self._settings.nearby_spreads), (count, 1)))
        for place in centre + spreads * self._generator.standard_normal((count, centre.size)):
            values = fit.mapping | self._box.values(np.clip(place, 0.0, 1.0))
            try:
                residual = problem.residual(values, self.hypothesis)
            except (InputError, SimulationError):
                continue
            if (chi2 := float(residual @ residual)) < least:
                best, least = values, chi2
        return dict(best)

    def reached(self, chi2: float) -> bool:
        """Whether so little `chi2` says that a valley is reached: a part of what the origin leaves is explained, and
        hardly less than by the reference."""
        origin, settings = self._origin.chi2, self._settings
        least = settings.reached_share * max(origin - self._baseline.problem.size, 0.0)
        return origin - chi2 > max(least, settings.as_much_share * (origin - self._reference.chi2))


def _likely(misfits: np.ndarray, count: int) -> np.ndarray:
    """How likely points are by their `misfits` (n,), flattened until as many as `count` carry it: (n,), sums to 1.

    Points are few in five dimensions, so the likelihood itself would rest on the luckiest one. Flattening it is what a
    tolerance does in approximate Bayesian computation: intervals become wider, not narrower.
    """
    low, high = 1.0, 1e6
    while high > 1.01 * low:
        scale = np.sqrt(low * high)
        weights = np.exp((misfits.min() - misfits) / scale)
        low, high = (low, scale) if weights.sum() ** 2 >= count * (weights**2).sum() else (scale, high)
    weights = np.exp((misfits.min() - misfits) / high)
    return weights / weights.sum()


def can_be_followed(problem: Problem, fit: Fit) -> bool:
    """Whether samples say more than that they were met by chance: other numerics change less than noise in them.

    Motion that never quite repeats can be met by parameters that are wrong, if they are tuned finely enough: in the
    example campaign a clearance 3 % off left what noise does, and other numerics changed nine times as much there.
    Where a model has no other numerics they are taken as followed.
    """
    try:
        changes = other_numerics(problem, fit)
    except (InputError, SimulationError):
        return False
    changed = np.mean(np.square(changes), axis=1)
    return bool(np.max(changed, initial=0.0) <= problem.settings.rough_search.max_numerics_change)


def leaves_rough_motion(problem: Problem, fit: Fit) -> bool:
    """Whether what a `fit` of a `problem` leaves is rough: an effect may be missing on which motion depends roughly."""
    if fit.status == FAILED:
        return False
    return CycleFeatures(problem, fit.residual).rough_share > problem.settings.rough_search.min_rough_share


def depends_roughly(problem: Problem, fit: Fit) -> bool:
    """Whether motion depends roughly on nuisances that runs share at a `fit` of a `problem`: what small changes of them
    do rings, as where joints are loose. chi2 has many valleys then.
    """
    settings = problem.settings.rough_search
    shared = (column for p, column in zip(fit.parameters, fit.jacobian.T, strict=True) if p.run is None)
    # features count what is beyond noise, so a change has to be far above it
    enlarged = (
        settings.enlarged_change * np.sqrt(problem.size) * column / np.linalg.norm(column)
        for column in shared
        if column.any()
    )
    ringing = (CycleFeatures(problem, column).rough_share for column in enlarged)
    return max(ringing, default=0.0) > settings.min_rough_share


def fit_to_features(baseline: Baseline, fit: Fit) -> Fit | None:
    """The effect of a fit, fitted to the features of the cycle alone, from points of which one is where the samples
    led; None where the features are not met.
    """
    problem, (candidate,) = baseline.problem, fit.hypothesis
    settings, features = problem.settings.rough_search, CycleFeatures(problem, baseline.base.residual)
    adaptation = _LinearAdaptation(baseline, baseline.base)
    one = _Contestant(baseline, baseline.base, adaptation, baseline.base, candidate, 0)
    one.add_end_of_fit(fit, features)
    one.begin(features)
    for _ in range(settings.rounds):  # all of them, though none may be better: intervals are made of their points
        one.go_on(features)
    found = one.matched(features)
    is_met = found is not None and one.misfit(features, found.residual) < settings.matched_misfit * features.size
    return found if is_met else None


def _ends_by_features(problem: Problem, contestants: Sequence[_Contestant], features: CycleFeatures) -> bool:
    """Whether features say all that can be known: they are met where samples cannot be followed, or none competes.

    Where samples can be, those at the truth would have been met.
    """
    best = min(contestants, key=lambda one: one.least, default=None)
    if best is None:
        return True
    enough = problem.settings.rough_search.matched_misfit * features.size
    if best.least >= enough:
        return False
    fit = best.matched(features)
    return fit is not None and best.misfit(features, fit.residual) < enough and not can_be_followed(problem, fit)


def search_rough(
    baseline: Baseline,
    origins: Sequence[Fit],
    candidates: Sequence[Candidate],
    sufficient: float,
    populations: int,
    until: float = np.inf,
    others: Sequence[Fit] = (),
    least_share: float | None = None,
) -> list[Fit]:
    """Fits of candidates on which motion depends roughly, each beside the effects of fits that are there."""
    problem, fits = baseline.problem, []
    settings, reference = problem.settings.rough_search, origins[-1]
    features = CycleFeatures(problem, reference.residual)
    absent = sum(features.misfit(np.zeros(problem.size), run) for run in problem.runs)
    contestants = [
        _Contestant(baseline, origin, adaptation, reference, candidate, number)
        for origin, adaptation in ((origin, _LinearAdaptation(baseline, origin)) for origin in origins)
        for number, candidate in enumerate(candidates)
        if all(candidate.label != effect.label for effect in origin.hypothesis)
    ]
    most_misfit = (1.0 - (least_share or settings.least_explained_share)) * absent

    def ends(fit: Fit) -> bool:
        return reduced_chi2(fit) <= sufficient and can_be_followed(problem, fit)

    for population in range(populations):
        if problem.simulations > until or (population and _ends_by_features(problem, contestants, features)):
            break
        for one in contestants:
            one.begin(features)
        if min((one.least for one in contestants), default=np.inf) > most_misfit:
            # nothing rings; else all go on, for a narrow minimum may lie between the first points
            contestants = [one for one in contestants if one.point_in_valley is not None]
        for round_ in range(settings.rounds):
            if problem.simulations > until or all(one.stalled for one in contestants):
                break
            for one in contestants:
                one.go_on(features)
            if population or round_ + 1 >= settings.rounds_for_all:
                least = min(one.least for one in contestants)
                behind = max(settings.eliminated_share * (absent - least), settings.min_behind)
                contestants = [one for one in contestants if one.least <= least + behind]
            deepest = min(contestants, key=lambda one: one.deepest.chi2)
            if (point := deepest.point_in_valley) is not None:
                fits.append(deepest.fit(point, features, sufficient))
                if ends(fits[-1]):
                    return fits
        ranked = sorted(contestants, key=lambda one: one.least)
        for one in ranked[:1] if problem.simulations > until else ranked:
            if (point := one.best_unfitted_point) is not None:
                fits.append(one.fit(point, features, sufficient))
                if ends(fits[-1]):
                    return fits
    if min((one.least for one in contestants), default=np.inf) < settings.matched_misfit * features.size:
        for one in (one for one in contestants if one.least < np.inf):
            beside = [other for other in others if one.hypothesis[-1].label not in labels_of(other.hypothesis)]
            beside = [None, *beside] if len(one.hypothesis) > 1 else [None]
            fits += [fit for other in beside if (fit := one.matched(features, other)) is not None]
    return fits
