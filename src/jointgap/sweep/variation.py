"""The runs of an ensemble: every combination of varied values, each from several starts."""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from jointgap.config import Mechanism, Scenario, Simulate, validate
from jointgap.config.scenario import Runs
from jointgap.dynamics.parallel_runs import Run
from jointgap.dynamics.solver.initial_state import perturbed_start
from jointgap.errors import InputError, did_you_mean
from jointgap.quantities import to_si

WORDS = {"speed": "rad/s", "clearance": "m", "friction": "1", "restitution": "1"}
"""What can be varied by a word, with its unit: the crank's speed, and the data of every loose joint."""


def ensemble_runs(mechanism: Mechanism, options: Simulate, runs: Runs) -> Iterator[Run]:
    """Every combination of the varied values, each from several starts; values of a run by their names.

    The starts of all combinations are the same.

    Raises
    ------
    InputError
        No such key to vary, or an impossible value.
    """
    base = Scenario(mechanism=mechanism.applied(), simulate=options)
    combinations = [
        (altered(base, dict(zip(runs.vary, values, strict=True)), "ensemble.vary"), values)
        for values in itertools.product(*runs.vary.values())
    ]
    for scenario, values in combinations:
        told = {key: stored_value(scenario, key, value) for key, value in zip(runs.vary, values, strict=True)}
        starts = perturbed_starts(scenario.mechanism, runs.members, runs.perturbation, runs.seed)
        for start in starts:
            yield Run(scenario.mechanism, scenario.simulate, start, values=told)


def perturbed_starts(mechanism: Mechanism, members: int, size: float, seed: int) -> np.ndarray:
    """Starting clearance vectors, shape (members, 6) [m]: zero first, then normally distributed in the loose joints."""
    starts = np.random.default_rng(seed).normal(0.0, size, (members, 6))
    starts[0] = 0.0
    return perturbed_start(starts, mechanism.loose)


def altered(scenario: Scenario, changes: dict[str, Any], source: str) -> Scenario:
    """`scenario` with other values, by word or by path; `source` is what to call them in errors.

    Raises
    ------
    InputError
        No such key, or an impossible value; the message names both.
    """
    data = {"mechanism": scenario.mechanism.model_dump(), "simulate": scenario.simulate.model_dump()}
    for key, value in changes.items():
        for path in _paths(data, key):
            holder, last = _holder(data, path, key)
            holder[last] = _new(holder, last, key, value)
    told = ", ".join(f"{key} = {value}" for key, value in changes.items())
    made = validate(Scenario, data, f"{source}, {told}")
    unread = [key for key in changes if key in ("speed", "simulate.speed")]
    if unread and made.simulate.drive.kind == "measured":
        raise InputError(
            f"ensemble.vary.{unread[0]}: a measured drive does not read simulate.speed; vary something else"
        )
    return made


def _paths(data: dict, key: str) -> list[tuple[str, ...]]:
    """Where the value of `key` belongs."""
    if key == "speed":
        return [("simulate", "speed")]
    if key in WORDS:
        joints = [name for name, joint in data["mechanism"]["joints"].items() if joint != "ideal" and joint["loose"]]
        if not joints:
            raise InputError(f"ensemble.vary.{key}: the mechanism has no loose joint to vary it in; make one loose")
        inside = ("bearing_radius",) if key == "clearance" else ("contact", key)
        return [("mechanism", "joints", joint, *inside) for joint in joints]
    path = tuple(key.split("."))
    if path[:2] == ("mechanism", "contacts"):
        raise InputError(
            f"ensemble.vary.{key}: contacts are copied into the joints; vary mechanism.joints.<joint>.contact.{path[-1]}"
        )
    if len(path) < 2:
        raise InputError(f"ensemble.vary.{key}: no such word; {did_you_mean(key, WORDS)} Else give a path of keys")
    return [path]


def _holder(data: Any, path: tuple[str, ...], key: str) -> tuple[Any, Any]:
    """The mapping that holds the end of `path`, and the key there; effects are found by their name, or name@site if listed twice."""
    for depth, step in enumerate(path):
        if isinstance(data, list | tuple):
            names = [one["name"] for one in data]
            known = {
                name if names.count(name) == 1 else f"{name}@{one['site']}": one
                for name, one in zip(names, data, strict=True)
            }
        elif isinstance(data, dict):
            known = data
        else:
            known = {}
        if step not in known:
            at = ".".join(path[:depth]) or "the scenario"
            folded = (
                "; effects which only change data are folded in, so vary the key itself, such as mechanism.slider.mass"
                if path[:depth] == ("mechanism", "effects")
                else ""
            )
            raise InputError(
                f"ensemble.vary.{key}: {at} has no '{step}'; {did_you_mean(step, map(str, known))}{folded}"
            )
        if depth == len(path) - 1:
            if isinstance(data, list | tuple):
                raise InputError(
                    f"ensemble.vary.{key}: names a whole effect; go on to a number, such as {key}.parameters.<name>"
                )
            return known, step
        data = known[step]
    raise AssertionError("a path has at least one step")


def _new(holder: dict, last: str, key: str, value: Any) -> Any:
    if key != "clearance":
        return value
    try:
        return holder["journal_radius"] + to_si(value, "m")
    except ValueError as error:
        raise InputError(f"ensemble.vary.clearance = {value!r}: {error}") from error


def stored_value(scenario: Scenario, key: str, value: Any) -> float | int | str | bool | None:
    """What the table of runs says of a varied value: in SI, as the scenario understood it."""
    data = {"mechanism": scenario.mechanism.model_dump(), "simulate": scenario.simulate.model_dump()}
    holder, last = _holder(data, _paths(data, key)[0], key)
    found = holder[last]
    if key == "clearance":
        found = float(f"{found - holder['journal_radius']:.12g}")
    return found if isinstance(found, float | int | str | bool | None) else str(value)
