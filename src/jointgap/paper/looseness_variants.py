"""Scenarios that differ in nothing but which joints are loose: are more loose joints better, as the paper claims?"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.paper.printed import Row, claim
from jointgap.report.plain_words import in_words

_CLAIM = "better results with an increasing number of joints with clearance"


@dataclass(frozen=True)
class VariantOptimum:
    """The optimum of one scenario, simulated again, by RMS."""

    scenario: str  # Its name
    loose: tuple[str, ...]  # Names of its loose joints
    reduction: float  # Median, 5 % and 95 % quantile of the reduction over the window
    low: float  # Median, 5 % and 95 % quantile of the reduction over the window
    high: float  # Median, 5 % and 95 % quantile of the reduction over the window
    settled: float  # Median of the reduction over a whole settled revolution
    original_error: float  # RMS error over the window at the original lengths and at the optimum, medians [rad]
    error: float  # RMS error over the window at the original lengths and at the optimum, medians [rad]


def _apart_from_looseness(scenario: Scenario) -> dict:
    mechanism = scenario.mechanism.applied().model_dump()
    for joint in mechanism["joints"].values():
        if isinstance(joint, dict):
            joint.pop("loose")
    mechanism.pop("contacts")  # each joint carries its own
    return {"mechanism": mechanism, "simulate": scenario.simulate, "optimise": scenario.optimise}


def looseness_variants(name: str, scenarios: Mapping[str, Scenario]) -> tuple[str, ...]:
    """Names of those of the `scenarios`, `name` among them, that differ from it in nothing but which joints are loose.

    How networks are trained may differ; scenarios in which all joints are ideal have no optimum and are left out.
    """
    wanted = _apart_from_looseness(scenarios[name])
    return tuple(
        other
        for other, scenario in scenarios.items()
        if scenario.mechanism.applied().loose and _apart_from_looseness(scenario) == wanted
    )


def variant_optimum(name: str, scenario: Scenario, resimulated: pd.DataFrame) -> VariantOptimum:
    """What the lengths found on the simulation's own motion gain in the `scenario` called `name`, by its table
    `resimulated`.

    Lengths found on networks would hang on how long these were trained, which may differ between scenarios.
    """
    point = f"simulation_{next(iter(scenario.optimise.boxes))}_genetic"
    rows = resimulated[(resimulated["point"] == point) & (resimulated["measure"] == "rms")].set_index("stretch")
    window = rows.loc["window"]
    return VariantOptimum(
        scenario=name,
        loose=scenario.mechanism.applied().loose,
        reduction=float(window["reduction"]),
        low=float(window["reduction_low"]),
        high=float(window["reduction_high"]),
        settled=float(rows.loc["settled", "reduction"]),
        original_error=float(window["original_error"]),
        error=float(window["error"]),
    )


def _by_count(variants: Iterable[VariantOptimum]) -> dict[int, list[VariantOptimum]]:
    """Variants by how many joints are loose, counts rising."""
    groups: dict[int, list[VariantOptimum]] = {}
    for variant in sorted(variants, key=lambda variant: len(variant.loose)):
        groups.setdefault(len(variant.loose), []).append(variant)
    return groups


def more_is_better(variants: Iterable[VariantOptimum]) -> bool | None:
    """Whether the reduction grows with the count of loose joints.

    True where all scenarios with one joint more lie above all with one fewer, spreads included; False where, spreads
    included, some scenario with more joints lies below one with fewer; None where spreads overlap or there is one count
    alone.
    """
    counts = list(_by_count(variants).values())
    if len(counts) < 2:
        return None
    pairs = [
        (few, many) for i, fewer in enumerate(counts) for more in counts[i + 1 :] for few in fewer for many in more
    ]
    if any(many.high < few.low for few, many in pairs):
        return False
    return True if all(many.low > few.high for few, many in pairs) else None


def joints_claim(variants: Sequence[VariantOptimum]) -> Row:
    """The paper's last claim, judged by the reductions of scenarios that differ in their loose joints alone."""
    counts = _by_count(variants)
    if len(counts) < 2:
        needs = "Needs scenarios in the same run that differ from this one in nothing but which joints are loose."
        return claim(_CLAIM, None, None, "", None, needs)
    fewest, most = (
        float(np.mean([variant.reduction for variant in counts[count]])) for count in (min(counts), max(counts))
    )
    difference = 100 * (most - fewest)
    return claim(_CLAIM, None, difference, "percentage points", more_is_better(variants), _sentence(variants))


def _sentence(variants: Sequence[VariantOptimum]) -> str:
    """The reductions by count of loose joints, and what they say."""
    parts = []
    for count, group in _by_count(variants).items():
        numbers = ", ".join(
            f"{v.reduction:.2%} ({in_words(' + '.join(v.loose))}; 5-95 %: {v.low:.2%} to {v.high:.2%}; "
            f"error {np.degrees(v.original_error):.4f} to {np.degrees(v.error):.4f} deg)"
            for v in group
        )
        parts.append(f"with {count} loose {'joint' if count == 1 else 'joints'} {numbers}")
    return (
        "RMS reduction over the window at the lengths found on each simulation's own motion, simulated again: "
        f"{'; '.join(parts)}. {conclusion(variants)}"
    )


def conclusion(variants: Sequence[VariantOptimum]) -> str:
    """The verdict in plain words."""
    verdict = more_is_better(variants)
    if verdict:
        return "Every scenario with more loose joints gains more than every one with fewer, spreads included."
    if verdict is None:
        return "The spreads overlap, so this cannot be decided."
    ranked = sorted(variants, key=lambda variant: variant.reduction)
    return (
        f"{_with_count(ranked[-1])} gains most and {_with_count(ranked[0])} least, so the number of loose joints is "
        "not what matters. What matters is how much of the error is proportional to the sine of the crank angle, the "
        "only part that another length ratio can remove."
    )


def _with_count(variant: VariantOptimum) -> str:
    count = len(variant.loose)
    return f"{variant.scenario} with {count} loose {'joint' if count == 1 else 'joints'}"
