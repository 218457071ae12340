"""The points of the map: several starts each, measured over settled revolutions."""

import itertools
from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.config import Scenario, Study
from jointgap.dynamics.parallel_runs import Outcome, Run, march_runs
from jointgap.errors import InputError
from jointgap.sweep.growth import USEFUL, clearance_vectors
from jointgap.sweep.study_measures import measure, sampled_angles
from jointgap.sweep.variation import altered, perturbed_starts
from jointgap.tables.study_tables import MEASURES, ORDERS


def points(scenario: Scenario, only_speed: int | None = None, workers: int | None = None) -> pd.DataFrame:
    """Simulate the map.

    Parameters
    ----------
    scenario : Scenario
        Its section `study` says which clearances, speeds and frictions; all else is the mechanism's.
    only_speed : int, optional
        Simulate this one of the speeds alone, counted from 0.
    workers : int, optional
        See `jointgap.dynamics.parallel_runs.march_runs`.

    Returns
    -------
    DataFrame
        Table `jointgap.tables.STUDY`, a row a point.

    Raises
    ------
    InputError
        No joint is loose, the drive does not keep a constant speed, or a value is impossible for the mechanism.
    """
    study = scenario.study
    if scenario.simulate.drive.kind != "constant":
        raise InputError(
            f"study: varies a constant speed, but simulate.drive.kind is {scenario.simulate.drive.kind}; use constant"
        )
    if scenario.mechanism.effect("speed_fluctuation"):
        raise InputError(
            "study: varies a constant speed; use simulate.drive.kind constant and no effect speed_fluctuation"
        )
    speeds = study.speed if only_speed is None else (_speed(study, only_speed),)
    values = list(itertools.product(speeds, study.friction, study.clearance))
    outcomes = march_runs(_runs(scenario, values), workers)
    rows = [_row(value, list(itertools.islice(outcomes, study.members)), study) for value in values]
    return pd.DataFrame(rows, columns=[column.name for column in tables.STUDY.columns])


def joined(parts: Iterable[pd.DataFrame], study: Study) -> pd.DataFrame:
    """The map from frames of single speeds.

    Raises
    ------
    InputError
        A point is missing, or there is one that the study does not ask for.
    """
    whole = pd.concat(list(parts), ignore_index=True)
    keys = ["speed", "friction", "clearance"]
    wanted = set(itertools.product(study.speed, study.friction, study.clearance))
    found = list(whole[keys].itertuples(index=False, name=None))
    if sorted(found) != sorted(wanted):
        raise InputError(
            f"study: the given parts hold {len(found)} points, {len(wanted - set(found))} of the {len(wanted)} wanted ones "
            "are missing; simulate the parts again with these options"
        )
    return whole.sort_values(keys, ignore_index=True)


def _speed(study: Study, number: int) -> float:
    if not 0 <= number < len(study.speed):
        raise InputError(f"study: there is no speed number {number}; they are numbered 0 to {len(study.speed) - 1}")
    return study.speed[number]


def _runs(scenario: Scenario, values: list[tuple[float, float, float]]) -> Iterator[Run]:
    study = scenario.study
    base = Scenario(mechanism=scenario.mechanism.applied(), simulate=scenario.simulate)
    for speed, friction, clearance in values:
        changes = {"speed": speed, "friction": friction, "clearance": clearance}
        point = altered(base, changes | {"simulate.tolerance": study.tolerance * clearance}, "study")
        starts = perturbed_starts(point.mechanism, study.members, 1.0, study.seed)
        starts[1:] *= study.perturbation * clearance / np.linalg.norm(starts[1:], axis=1, keepdims=True)
        angles = sampled_angles(point.mechanism, point.simulate, study)
        for start in starts:
            yield Run(point.mechanism, point.simulate, start, angles)


def _row(values: tuple[float, float, float], outcomes: list[Outcome], study: Study) -> dict[str, object]:
    speed, friction, clearance = values
    done = [outcome for outcome in outcomes if outcome.march is not None]
    failed = [outcome for outcome in outcomes if outcome.march is None]
    row: dict[str, object] = {"clearance": clearance, "speed": speed, "friction": friction}
    row |= {"failed": len(failed), "reason": str(failed[0].error) if failed else None}
    row |= {"sensitive": False, "growth": np.nan}
    if not done:
        return row
    found = [measure(outcome, study) for outcome in done]
    for name in MEASURES:
        numbers = [one[name] for one in found]
        row |= {name: np.median(numbers), f"{name}_low": min(numbers), f"{name}_high": max(numbers)}
    amplitudes = np.median([one["orders"] for one in found], axis=0)
    row |= {f"order_{k}": amplitudes[k] for k in range(1, ORDERS + 1)}
    if len(done) > 1:
        per_turn = (len(done[0].crank_angle) - 2) // study.settled_revolutions
        last = np.array([clearance_vectors(outcome.march)[-per_turn:] for outcome in done])
        apart = np.sqrt(np.mean(np.sum((last[1:] - last[0]) ** 2, axis=2), axis=1))
        distance = float(np.median(apart))
        row |= {"growth": distance / (study.perturbation * clearance), "sensitive": distance > USEFUL * clearance}
    return row
