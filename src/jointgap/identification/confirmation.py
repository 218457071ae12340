"""How far the gap shrinks on data that took no part in fitting or in choosing an explanation.

They choose one thing: with which of the values that the fit leaves open they are predicted (`likeliest`).
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from jointgap.core.candidates import Model
from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.fit import Fit, fit_hypothesis
from jointgap.identification.problem import Hypothesis, Noise, Problem
from jointgap.identification.settings import (
    DEFAULT_SETTINGS,
    ConfirmationSettings,
    IdentificationSettings,
)

_ENDS = (0.05, 0.95)  # [1] quantiles between which a 90 % interval lies


FALLS, STAYS, RISES = "falls", "stays", "rises"
CANNOT_TELL, NOT_SIMULATED, NOTHING_HELD_OUT = "cannot_tell", "not_simulated", "nothing_held_out"


@dataclass(frozen=True)
class HeldOutTest:
    """What becomes of the gap of the held-out data once the effects of a verdict are in the model."""

    outcome: str  # ``falls`` or ``rises``
    before: float = np.nan  # Gaps [1] of the runs that could be simulated; NaN where none could
    after: float = np.nan  # Gaps [1] of the runs that could be simulated; NaN where none could
    after_low: float = np.nan  # Lower end [1] of the 90 % interval of the gap after

    @property
    def words(self) -> str:
        """``falls from 3.00 to 1.02``, ``stays at 1.18``, ``rises from 1.09 to 1.12``; more digits where two show no
        difference."""
        digits = next((n for n in (2, 3, 4) if f"{self.before:.{n}f}" != f"{self.after:.{n}f}"), 2)
        before, after = (f"{gap:.{digits if gap < 100 else 0}f}" for gap in (self.before, self.after))
        if self.outcome in (FALLS, RISES):
            return f"it {self.outcome} from {before} to {after}"
        if f"{self.before:.2f}" == f"{self.after:.2f}":
            return f"it stays at {self.after:.2f}"
        return f"it stays within what noise leaves open, {self.before:.2f} before and {self.after:.2f} after"


@dataclass(frozen=True)
class Rest:
    """What the effects leave in one channel."""

    channel: str
    gap: float  # [1] Root mean square over the runs


@dataclass(frozen=True)
class Confirmed:
    """Residuals and gaps of all runs."""

    residuals: pd.DataFrame  # Table `RESIDUALS`
    gaps: pd.DataFrame  # Table `GAPS`
    variation: Mapping[tuple[str, str], float]  # What each series varies by, as of `Series.variation` [unit]

    @property
    def test(self) -> HeldOutTest:
        """What the held-out data say of the effects."""
        return held_out_test(self.gaps)

    def gap(self, role: str) -> float:
        """Gap [1] with the effects over all runs of a role, ``identify`` or ``confirm``, that can be simulated."""
        rows = self.gaps.query("role == @role and channel != 'all'")["after"].dropna()
        return float(np.sqrt(np.mean(rows**2))) if len(rows) else np.nan

    @property
    def largest_noise(self) -> tuple[str, float]:
        """The channel whose noise is the largest part of what it varies by in a run, and that part [1]."""
        series = self.residuals.groupby(["run", "channel"], sort=False)["spread"]
        shares = {key: mean_square_root(spread) / (self.variation[key] or np.inf) for key, spread in series}
        (_, channel), share = max(shares.items(), key=lambda item: item[1])
        return channel.replace("_", " "), share

    def rests(self, role: str) -> list["Rest"]:
        """What the effects leave in each channel of the runs of a role, ``identify`` or ``confirm``, that can be
        simulated."""
        own = self.residuals[self.residuals["held_out"] == (role == "confirm")].dropna(subset=["augmented"])
        gaps = own.groupby(["channel", "run"], sort=False)["whitened_augmented"].apply(mean_square_root)
        return [Rest(channel, mean_square_root(of_runs)) for channel, of_runs in gaps.groupby("channel", sort=False)]


def mean_square_root(values: Sequence[float]) -> float:
    """The root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def held_out_test(gaps: pd.DataFrame) -> HeldOutTest:
    """What the held-out data say of the effects of a verdict.

    If the effects are true, the squared gap falls by the mean square of what they change there (`fall_expected`): the
    residual before is that change, and noise. Where a run cannot be simulated the others count, each by itself: one
    that contradicts the effects outweighs those that do not.
    """
    held_out = gaps.query("role == 'confirm' and channel == 'all'")
    if held_out.empty:
        return HeldOutTest(NOTHING_HELD_OUT)
    rows = held_out[held_out["run"] == "all"].dropna(subset=["after"])
    if rows.empty:
        rows = held_out[held_out["run"] != "all"].dropna(subset=["after"])
    tests = [
        HeldOutTest(_outcome(row), row["before"], row["after"], row["after_low"]) for row in rows.to_dict("records")
    ]
    order = (RISES, STAYS, FALLS, CANNOT_TELL)
    return min(tests, key=lambda test: order.index(test.outcome), default=HeldOutTest(NOT_SIMULATED))


def _outcome(row: Mapping[str, float]) -> str:
    if row["fall_low"] > 0.0:
        return FALLS
    if row["fall_high"] < 0.0:
        return RISES
    return CANNOT_TELL if row["fall_high"] >= row["fall_expected"] else STAYS


def share_closed(before: float, after: float) -> float:
    """Share of what exceeds the noise that is gone, in squares; NaN where nothing exceeded it."""
    return 1.0 - (after**2 - 1.0) / (before**2 - 1.0) if before > 1.0 else np.nan


def confirm(
    model: Model,
    noise: Mapping[tuple[str, str], Noise],
    base: Fit,
    named: Fit | None = None,
    seed: int = 0,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> Confirmed:
    """Predict every run with and without the effects of the verdict.

    What a held-out run has for itself (its speed, its first angle) is fitted to it, for the base as well as for the
    named effects. What all runs share stays as found on the runs for fitting; where these leave much of it open, as of
    a joint whose contact shows at another speed, it is the `likeliest` of that. A held-out run that cannot be simulated
    with the named effects has no prediction and no gap after, with the reason as a remark of its gaps; all runs
    together have none either.
    """
    named = base if named is None else named
    used = Problem(model, noise, settings=settings)
    frames, remarks = [_compared(used, base.mapping, named.mapping, named.hypothesis).assign(role="identify")], {}
    runs = Problem(model, noise, held_out=True, settings=settings).runs
    problems = {run: Problem(_Alone(model, run), noise, held_out=True, settings=settings) for run in runs}
    likely_base = likeliest(problems.values(), base)
    likely = likely_base if named is base else likeliest(problems.values(), named)
    for run, problem in problems.items():
        before = fit_run_parameters(problem, likely_base)
        try:
            after = before if named is base else fit_run_parameters(problem, likely)
            frame = _compared(problem, before, after, named.hypothesis)
        except (InputError, SimulationError) as error:
            remarks[run] = str(error)
            frame = _compared(problem, before).assign(augmented=np.nan, whitened_augmented=np.nan)
        frames.append(frame.assign(role="confirm"))
    residuals = pd.concat(frames, ignore_index=True)
    gaps = _gaps(residuals, remarks, np.random.default_rng(seed), settings.confirmation)
    variation = {series.key: series.variation(series.value) for series in model.series}
    return Confirmed(residuals.drop(columns="role"), gaps, variation)


class _Alone:
    """One run of a model, as a model: what belongs to it is fitted, and fails, without the others."""

    def __init__(self, model: Model, run: str):
        self._model = model
        self.series = [series for series in model.series if series.run == run]

    def __getattr__(self, name: str):
        return getattr(self._model, name)


def likeliest(problems: Collection[Problem], fit: Fit) -> Fit:
    """The fit at that one of its draws under which the held-out runs are likeliest.

    Draws along a curved valley of chi2 are alike in the data used for fitting and far from each other elsewhere: of a
    joint that became loose, impacts at another speed may ask for a restitution that the slower runs hardly feel. A
    model is contradicted by held-out data if no values that the fit leaves open meet these, not if those at the minimum
    do not. The fit is as it was where it has no such draws, where its own values leave noise alone, or where motion is
    chaotic: among many realisations one is always luckier. Choices of a held-out run are tried in turn, one at each
    draw beside the one that was fitted; at the best draws all of them.
    """
    if fit.draws is None or any(problem.has_statistics for problem in problems):
        return fit
    own = []
    for problem in problems:
        try:
            own.append((problem, *_with_run_parameters(problem, fit)))
        except (InputError, SimulationError):
            continue
    keys = [parameter.key for parameter in fit.parameters]

    def left(values: np.ndarray, turn: int | None = None) -> np.ndarray:
        """chi2 of each run for each sample at `values` (k,), by the choices that were fitted or those of a `turn`; by
        any of all without."""
        shared = dict(zip(keys, map(float, values), strict=True))
        found = []
        for (problem, fitted, directions), others in zip(own, choices, strict=True):
            tried = [{}, *(others if turn is None else others[turn : turn + 1])]
            chi2 = min(_left(problem, fit.hypothesis, fitted | other | shared, directions) for other in tried)
            found.append(chi2 / problem.size)
        return np.array(found)

    choices = [_choices_of_run(problem, fit) for problem, _, _ in own]
    sizes = np.array([problem.size for problem, _, _ in own])
    if not own or left(fit.values) @ sizes <= sizes.sum() * fit.settings.decision.max_gap_of_noise**2:
        return fit
    settings, most = fit.settings.confirmation, max(map(len, choices))
    drawn = [fit.values, *fit.draws[:: -(-len(fit.draws) // settings.valley_draws)]]
    found = [left(values, number % most if most else 0) for number, values in enumerate(drawn)]
    if most:  # runs may be met by different ones, so that one that is met says that others may be
        best = np.argsort(np.min(found, axis=1), kind="stable")[: settings.choosing_draws]
        drawn = [fit.values, *(drawn[number] for number in best)]
        found = [left(values) for values in drawn]
    return replace(fit, values=drawn[int(np.argmin(np.array(found) @ sizes))])


def _choices_of_run(problem: Problem, fit: Fit) -> list[dict[str, float]]:
    """The choices by key that a held-out run may have in place of those that were fitted; none where it has none."""
    fitted = {p.key for p in fit.parameters}
    free = [p for p in problem.parameters(fit.hypothesis) if p.choices and p.key not in fitted]
    most = max((len(p.choices) for p in free), default=0)
    return [{p.key: float(p.choices[number % len(p.choices)]) for p in free} for number in range(most)]


def _left(problem: Problem, hypothesis: Hypothesis, values: Mapping[str, float], directions: np.ndarray) -> float:
    """chi2 of a held-out run at `values` by key, with what it has for itself moved linearly along `directions` (n, own)
    to where it fits best; infinite where it cannot be simulated."""
    try:
        residual = problem.residual(values, hypothesis)
    except (InputError, SimulationError):
        return np.inf
    return float(residual @ residual - np.sum((directions.T @ residual) ** 2))


def fit_run_parameters(problem: Problem, fit: Fit) -> dict[str, float]:
    """Values [SI] of a fit by key, with those that a held-out run has for itself fitted to that run.

    These are nominal where the run cannot be simulated.
    """
    return _with_run_parameters(problem, fit)[0]


def _with_run_parameters(problem: Problem, fit: Fit) -> tuple[dict[str, float], np.ndarray]:
    """As `fit_run_parameters`; and orthonormal columns (n, own) along which these parameters move the residual."""
    fitted = {p.key for p in fit.parameters}
    own = [p for p in problem.parameters(fit.hypothesis) if p.run is not None and p.key not in fitted]
    if not own:
        return fit.mapping, np.empty((problem.size, 0))
    found = fit_hypothesis(problem, fit.hypothesis, start=fit.mapping, vary=own)
    moving = found.jacobian[:, found.jacobian.any(axis=0)]  # a choice moves nothing by derivatives
    return fit.mapping | found.mapping, np.linalg.qr(moving)[0]


def _compared(problem: Problem, before: dict, after: dict | None = None, hypothesis: Hypothesis = ()) -> pd.DataFrame:
    """Rows of the table residuals, run by run; the base stands for the named effects where there are none."""
    whitened = problem.residual(before)
    whitened_after = problem.residual(after, hypothesis) if hypothesis else whitened
    frames = []
    for run in problem.runs:
        predicted = problem.predict(run, before)
        augmented = problem.predict(run, after, hypothesis) if hypothesis else predicted
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


def _gaps(
    residuals: pd.DataFrame, remarks: Mapping[str, str], random: np.random.Generator, settings: ConfirmationSettings
) -> pd.DataFrame:
    """Rows of the table gaps: each run and channel, each run, and all, by role; remarks by held-out run."""
    rows = []
    for role, of_role in residuals.groupby("role", sort=False):
        squares_of = {
            key: _squares(series, random, settings) for key, series in of_role.groupby(["run", "channel"], sort=False)
        }
        runs = dict.fromkeys(run for run, _ in squares_of)
        for run in (*runs, "all"):
            within = {key: squares for key, squares in squares_of.items() if run in ("all", key[0])}
            if run != "all":
                rows += [_row(run, role, channel, [squares]) for (_, channel), squares in within.items()]
            rows.append(_row(run, role, "all", list(within.values())))
    gaps = pd.DataFrame(rows)
    return gaps.assign(remark=gaps["run"].map(remarks).where(gaps["role"] == "confirm", None).astype(object))


@dataclass(frozen=True)
class _Squares:
    """Mean squared whitened residuals of a series, columns before and after: as they are, and of bootstrap samples; and
    the mean square of what lies between the two."""

    mean: np.ndarray
    drawn: np.ndarray
    between: float
    samples: int


def _squares(series: pd.DataFrame, random: np.random.Generator, settings: ConfirmationSettings) -> _Squares:
    whitened = series[["whitened_base", "whitened_augmented"]].to_numpy()
    squared, between = whitened**2, float(np.mean((whitened[:, 0] - whitened[:, 1]) ** 2))
    blocks = np.array_split(squared, min(settings.blocks, len(squared)))
    means, sizes = np.array([block.mean(axis=0) for block in blocks]), np.array([len(block) for block in blocks])
    chosen = random.integers(len(blocks), size=(settings.draws, len(blocks)))
    weights = sizes[chosen][..., None]
    drawn = (means[chosen] * weights).sum(axis=1) / weights.sum(axis=1)
    return _Squares(squared.mean(axis=0), drawn, between, len(squared))


def _row(run: str, role: str, channel: str, parts: list[_Squares]) -> dict[str, object]:
    before, after = np.sqrt(np.mean([part.mean for part in parts], axis=0))
    drawn = np.mean([part.drawn for part in parts], axis=0)
    low, high = np.quantile(np.sqrt(drawn), _ENDS, axis=0)
    fall_low, fall_high = np.quantile(drawn[:, 0] - drawn[:, 1], _ENDS)
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
        "fall_low": fall_low,
        "fall_high": fall_high,
        "fall_expected": np.mean([part.between for part in parts]),
        "closed": share_closed(before, after),
    }
