"""The points of the study's map: several starts each, measured over settled revolutions."""

import itertools
import math
from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.config import DrivenMechanism, Mechanism, Scenario, Simulate, Study
from jointgap.config.varied_values import with_values
from jointgap.dynamics.model.compile_parameters import joint_parameters
from jointgap.dynamics.parallel_runs import Outcome, Run, simulate_runs
from jointgap.dynamics.simulation import event_frame
from jointgap.ensembles.cycle_statistics import contacts, time_shares
from jointgap.ensembles.ensemble import perturbed_starts
from jointgap.ensembles.growth import USEFUL, sampled_clearances
from jointgap.ensembles.orders import high_order_rms, orders
from jointgap.errors import InputError
from jointgap.mechanism import transmission_angle
from jointgap.progress import followed
from jointgap.tables.study_tables import MEASURES, ORDERS

_PER_PERIOD = 12  # samples in a period of the contact's ringing
_FEWEST, _MOST = 720, 20_000  # samples per revolution: for the spectrum, and that memory holds


def simulate_points(
    scenario: Scenario, first: int = 0, count: int | None = None, workers: int | None = None
) -> pd.DataFrame:
    """Simulate the points of the map, or some of them."""
    study = scenario.study
    if scenario.simulate.drive.kind != "constant":
        raise InputError(
            f"study: varies a constant speed, but simulate.drive.kind is {scenario.simulate.drive.kind}; use constant"
        )
    if scenario.mechanism.effect("speed_fluctuation"):
        raise InputError(
            "study: varies a constant speed; use simulate.drive.kind constant and no effect speed_fluctuation"
        )
    points = list(itertools.product(study.speed, study.friction, study.clearance))
    count = len(points) - first if count is None else count
    if first + count > len(points):
        raise InputError(
            f"study: points {first} to {first + count - 1} are asked for, but there are {len(points)}, from 0 on"
        )
    values = points[first : first + count]
    outcomes = simulate_runs(_runs(scenario, values), workers)
    rows = [
        _row(value, list(itertools.islice(outcomes, study.members)), study)
        for value in followed(values, "points of the map")
    ]
    return pd.DataFrame(rows, columns=[column.name for column in tables.STUDY.columns])


def join_points(parts: Iterable[pd.DataFrame], study: Study) -> pd.DataFrame:
    """The map from its parts."""
    points = pd.concat(list(parts), ignore_index=True)
    keys = ["speed", "friction", "clearance"]
    wanted = set(itertools.product(study.speed, study.friction, study.clearance))
    given = list(points[keys].itertuples(index=False, name=None))
    if sorted(given) != sorted(wanted):
        raise InputError(
            f"study: the given parts hold {len(given)} points, {len(wanted - set(given))} of the {len(wanted)} "
            "wanted ones "
            "are missing; simulate the parts again with these options"
        )
    return points.sort_values(keys, ignore_index=True)


def _runs(scenario: Scenario, values: list[tuple[float, float, float]]) -> Iterator[Run]:
    study = scenario.study
    base = DrivenMechanism(mechanism=scenario.mechanism.applied(), simulate=scenario.simulate)
    for speed, friction, clearance in values:
        changes = {"speed": speed, "friction": friction, "clearance": clearance}
        point = with_values(base, changes | {"simulate.tolerance": study.tolerance * clearance}, "study")
        starts = perturbed_starts(point.mechanism, study.members, 1.0, study.seed)
        starts[1:] *= study.perturbation * clearance / np.linalg.norm(starts[1:], axis=1, keepdims=True)
        angles = sampled_angles(point.mechanism, point.simulate, study)
        for start in starts:
            yield Run(point.mechanism, point.simulate, start, angles)


def _row(values: tuple[float, float, float], outcomes: list[Outcome], study: Study) -> dict[str, object]:
    speed, friction, clearance = values
    done = [outcome for outcome in outcomes if outcome.result is not None]
    failed = [outcome for outcome in outcomes if outcome.result is None]
    row: dict[str, object] = {"clearance": clearance, "speed": speed, "friction": friction}
    row |= {"failed": len(failed), "reason": str(failed[0].error) if failed else None}
    row |= {"sensitive": False, "growth": np.nan}
    if not done:
        return row
    measured = [measure(outcome, study) for outcome in done]
    for name in MEASURES:
        numbers = [measures[name] for measures in measured]
        row |= {name: np.median(numbers), f"{name}_low": min(numbers), f"{name}_high": max(numbers)}
    amplitudes = np.median([measures["orders"] for measures in measured], axis=0)
    row |= {f"order_{k}": amplitudes[k] for k in range(1, ORDERS + 1)}
    if len(done) > 1:
        per_turn = (len(done[0].crank_angle) - 2) // study.settled_revolutions
        last = np.array([sampled_clearances(outcome.result)[-per_turn:] for outcome in done])
        separation = np.sqrt(np.mean(np.sum((last[1:] - last[0]) ** 2, axis=2), axis=1))
        distance = float(np.median(separation))
        row |= {"growth": distance / (study.perturbation * clearance), "sensitive": distance > USEFUL * clearance}
    return row


def samples_per_revolution(mechanism: Mechanism, speed: float) -> int:
    """Samples that resolve the ringing of the contacts under the slider's inertia force, at `speed` [rad/s].

    Linearised about the penetration under that load; slider and rod of `mechanism` move against each other.
    """
    load = mechanism.slider.mass * mechanism.crank.length * speed**2
    mass = 1.0 / (1.0 / mechanism.slider.mass + 1.0 / mechanism.rod.mass)
    frequency = 0.0
    for name in mechanism.loose:
        joint = joint_parameters(mechanism, name)
        n = joint.exponent
        depth = (load / joint.stiffness) ** (1.0 / n)
        frequency = max(frequency, math.sqrt(n * load / depth / mass) / (2.0 * math.pi))
    wanted = _PER_PERIOD * frequency / (speed / (2.0 * math.pi))
    return int(min(max(wanted, _FEWEST), _MOST))


def sampled_angles(mechanism: Mechanism, options: Simulate, study: Study) -> np.ndarray:
    """The start, then samples of the settled revolutions, both of their ends included (n,) [rad]."""
    per_turn = samples_per_revolution(mechanism, options.speed)
    settled = np.arange(study.settled_revolutions * per_turn + 1) * (2.0 * math.pi / per_turn)
    begin = options.start_angle + 2.0 * math.pi * study.transient_revolutions
    return np.append(options.start_angle, begin + settled)


def measure(outcome: Outcome, study: Study) -> dict[str, float | np.ndarray]:
    """The numbers `jointgap.tables.study_tables.MEASURES` of one run [SI], and amplitudes by order, ``orders``."""
    mechanism, result = outcome.run.mechanism, outcome.result
    signals = {name: values[1:] for name, values in result.observed(outcome.parameters).items()}
    angle, times = outcome.crank_angle[1:], result.times[1:]
    ideal = transmission_angle(mechanism.crank.length, mechanism.rod.length, angle, 0.0, mechanism.slider.offset)
    error = ideal - (math.pi / 2 + signals["rod_angle"])
    forces = [signals[f"{joint}_normal_force"].max() for joint in mechanism.loose]
    shares, events = [], event_frame(result.events)
    for joint in mechanism.loose:
        joint_contacts = contacts(events, joint)
        shares.append(1.0 - time_shares(joint_contacts, times[0], times[-1])["flight"])
        within = joint_contacts[(joint_contacts["begin"] >= times[0]) & (joint_contacts["end"] <= times[-1])]
        forces += list(within["peak_force"])
    acceleration = signals["slider_acceleration"]
    spectrum = orders(acceleration[:-1], study.settled_revolutions)
    rms = math.sqrt(np.mean(acceleration[:-1] ** 2))
    return {
        "peak_force": max(forces),
        "angle_error_rms": math.sqrt(np.mean(error[:-1] ** 2)),
        "contact_share": float(np.mean(shares)),
        "acceleration_rms": rms,
        "noise_share": high_order_rms(acceleration[:-1], study.settled_revolutions) / rms,
        "jerk_rms": math.sqrt(np.mean((np.diff(acceleration) / np.diff(times)) ** 2)),
        "orders": spectrum,
    }
