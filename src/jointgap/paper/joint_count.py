"""Are more loose joints better? The paper's last claim, put to scenarios that differ in nothing else."""

from collections.abc import Sequence

import numpy as np

from jointgap.paper.comparison_row import Row, claim
from jointgap.paper.looseness_variants import Member, by_count, more_is_better

ITEM = "better results with an increasing number of joints with clearance"


def joints_claim(members: Sequence[Member]) -> Row:
    """The claim, judged by the reductions of scenarios that differ in their loose joints alone."""
    counts = by_count(members)
    if len(counts) < 2:
        return claim(
            ITEM,
            None,
            None,
            "",
            None,
            "Needs scenarios in the same run that differ from this one in nothing but which joints are loose.",
        )
    fewest, most = (float(np.mean([one.reduction for one in counts[count]])) for count in (min(counts), max(counts)))
    return claim(ITEM, None, 100 * (most - fewest), "percentage points", more_is_better(members), sentence(members))


def sentence(members: Sequence[Member]) -> str:
    """The reductions by count of loose joints, and what they say."""
    parts = []
    for count, ones in by_count(members).items():
        told = ", ".join(
            f"{one.reduction:.2%} ({' + '.join(one.loose).replace('_', ' ')}; 5-95 %: {one.low:.2%} to {one.high:.2%}; "
            f"error {np.degrees(one.original_error):.4f} to {np.degrees(one.error):.4f} deg)"
            for one in ones
        )
        parts.append(f"with {count} loose {'joint' if count == 1 else 'joints'} {told}")
    return (
        "RMS reduction over the window at the lengths found on each simulation's own motion, simulated again: "
        f"{'; '.join(parts)}. {conclusion(members)}"
    )


def conclusion(members: Sequence[Member]) -> str:
    """The verdict in plain words."""
    verdict = more_is_better(members)
    if verdict:
        return "Every scenario with more loose joints gains more than every one with fewer, spreads included."
    if verdict is None:
        return "The spreads overlap, so it cannot be told."
    ranked = sorted(members, key=lambda one: one.reduction)
    least, best = ranked[0], ranked[-1]
    return (
        f"The count does not decide: {_joints(best)} gains most and {_joints(least)} least. What decides is how much of the error "
        "runs with the sine of the crank angle, for that is all that another ratio of the lengths takes away."
    )


def _joints(one: Member) -> str:
    count = len(one.loose)
    return f"{one.scenario} with {count} loose {'joint' if count == 1 else 'joints'}"
