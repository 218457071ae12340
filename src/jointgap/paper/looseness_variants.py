"""Scenarios that differ in nothing but which joints are loose, and what the count of loose joints does to the optimum."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import pandas as pd

from jointgap.config import Scenario

NEEDED = ("optimise_resimulated",)


@dataclass(frozen=True)
class Member:
    """The optimum of one scenario, simulated again, by RMS.

    Attributes
    ----------
    scenario : str
        Its name.
    loose : tuple of str
        Names of its loose joints.
    reduction, low, high : float
        Median, 5 % and 95 % quantile of the reduction over the window.
    settled : float
        Median of the reduction over a whole settled revolution.
    original_error, error : float
        RMS error over the window at the original lengths and at the optimum, medians [rad].
    """

    scenario: str
    loose: tuple[str, ...]
    reduction: float
    low: float
    high: float
    settled: float
    original_error: float
    error: float


def _apart_from_looseness(scenario: Scenario) -> dict:
    mechanism = scenario.mechanism.applied().model_dump()
    for joint in mechanism["joints"].values():
        if isinstance(joint, dict):
            joint.pop("loose")
    mechanism.pop("contacts")  # each joint carries its own
    return {"mechanism": mechanism, "simulate": scenario.simulate, "optimise": scenario.optimise}


def family(name: str, scenarios: Mapping[str, Scenario]) -> tuple[str, ...]:
    """Names of the scenarios, `name` among them, that differ from it in nothing but which joints are loose.

    How networks are trained may differ; scenarios in which all joints are ideal have no optimum and are left out.
    """
    wanted = _apart_from_looseness(scenarios[name])
    return tuple(
        other
        for other, scenario in scenarios.items()
        if scenario.mechanism.applied().loose and _apart_from_looseness(scenario) == wanted
    )


def member(name: str, scenario: Scenario, resimulated: pd.DataFrame) -> Member:
    """What the lengths found on the simulation's own motion are worth in one scenario.

    Lengths found on networks would hang on how long these were trained, which may differ between scenarios.
    """
    point = f"simulation_{next(iter(scenario.optimise.boxes))}_genetic"
    rows = resimulated[(resimulated["point"] == point) & (resimulated["measure"] == "rms")].set_index("stretch")
    window = rows.loc["window"]
    return Member(
        scenario=name,
        loose=scenario.mechanism.applied().loose,
        reduction=float(window["reduction"]),
        low=float(window["reduction_low"]),
        high=float(window["reduction_high"]),
        settled=float(rows.loc["settled", "reduction"]),
        original_error=float(window["original_error"]),
        error=float(window["error"]),
    )


def by_count(members: Iterable[Member]) -> dict[int, list[Member]]:
    """Members by how many joints are loose, counts rising."""
    found: dict[int, list[Member]] = {}
    for one in sorted(members, key=lambda one: len(one.loose)):
        found.setdefault(len(one.loose), []).append(one)
    return found


def more_is_better(members: Iterable[Member]) -> bool | None:
    """Whether the reduction grows with the count of loose joints.

    True where all scenarios with one joint more lie above all with one fewer, spreads included; False where, spreads
    included, some scenario with more joints lies below one with fewer; None where spreads overlap or there is one count alone.
    """
    counts = list(by_count(members).values())
    if len(counts) < 2:
        return None
    pairs = [
        (few, many) for i, fewer in enumerate(counts) for more in counts[i + 1 :] for few in fewer for many in more
    ]
    if any(many.high < few.low for few, many in pairs):
        return False
    return True if all(many.low > few.high for few, many in pairs) else None
