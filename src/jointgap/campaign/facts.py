"""The numbers of a verdict, listed once for its page, MLflow, Python results and trends."""

from collections.abc import Mapping
from dataclasses import replace

from jointgap.campaign.labels import Estimate, estimates, label_of
from jointgap.campaign.sentences import Verdict
from jointgap.config.campaign import NUISANCES
from jointgap.core.facts import Fact
from jointgap.core.words import format_nuisance

_UNITS = NUISANCES | {"first_angle": "rad", "friction_speed": "m/s", "clock_offset": "s"}
_ROLES = {"identify": "fitted data", "confirm": "held-out data"}


def facts(verdict: Verdict) -> list[Fact]:
    """Gaps, counts, effects and re-fitted parameters of the content of ``verdict.json``."""
    gaps = [
        Fact(f"gap/{role}_{when}", value, "1", f"gap of {_ROLES[role]} {when}")
        for role, gap in verdict["gap"].items()
        for when, value in gap.items()
    ]
    counts = [
        Fact("windows", len(verdict["where"]), "1"),
        Fact("equivalent", len(verdict["equivalent"]), "1"),
    ]
    effects = []
    for effect in verdict["effects"]:
        prefix = f"effect/{label_of(effect).replace(':', '_')}"  # some stores reject a colon
        effects.append(Fact(f"{prefix}_delta_bic", effect["delta_bic"], "1"))
        for estimate in estimates([effect]):
            effects.append(replace(estimate, name=f"{prefix}_{estimate.name}"))
    return [*gaps, *counts, *effects, *nuisances(verdict["nuisances"])]


def nuisances(by_key: Mapping[str, Mapping]) -> list[Estimate]:
    """Re-fitted parameters; ``kept``: the mechanism file keeps the stated value."""
    return [
        Estimate.of(
            format_nuisance(key),
            estimate,
            # the parameter of a model of the user has its unit
            estimate.get("unit") or _UNITS.get(key.partition("@")[0], ""),
            f"nuisance/{key}",
        )
        for key, estimate in by_key.items()
    ]
