"""verdict.json: what was found, in the form that people script against."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from jointgap.campaign.fits_on_disk import JOINED, Outcome, gap_of, nuisances_as_read
from jointgap.core.errors import InputError
from jointgap.identification.confirmation import held_out_test
from jointgap.identification.decide_verdict import certain_effects
from jointgap.identification.fit import MATCHED, Fit, coordinate_estimate, effect_estimates, is_taken_over
from jointgap.identification.force_law import effect_of, law_of
from jointgap.identification.problem import label_of

SCHEMA_VERSION = 1  # one more when a key of verdict.json changes its meaning or goes

_TERM_PREFIX = "discovered_"


@dataclass(frozen=True)
class Conclusion:
    """What a campaign came to, from which ``verdict.json`` follows."""

    campaign: str
    outcome: Outcome
    windows: pd.DataFrame  # Table `MAP_WINDOWS`
    gaps: pd.DataFrame  # Table `GAPS`
    gap: Mapping[str, Mapping[str, float | None]]  # By role: before and after
    held_out: Sequence[Mapping[str, Any]]
    preflight: Mapping[str, Sequence]  # Labels that are undetectable, groups that are merged
    false_alarm_rate: float
    separated_by: str = ""
    clockwise: Collection[str] = ()  # Runs
    standout: pd.DataFrame | None = None  # Table `MAP_STANDOUT`
    doubted_channels: Collection[str] = ()
    families: pd.DataFrame | None = None  # Table `LAW_FAMILIES`
    repeats: bool = True  # Whether samples are compared, and not statistics over cycles


def document(conclusion: Conclusion) -> dict[str, Any]:
    """The content of ``verdict.json``."""
    outcome, gaps, standout = conclusion.outcome, conclusion.gaps, conclusion.standout
    gains = _gains(outcome)
    certain = {candidate.label for candidate in certain_effects(outcome.equivalent, _close(outcome))}
    test = held_out_test(gaps) if outcome.proposed else None
    by_features = any(fit.status == MATCHED for fit in outcome.explanations)
    return {
        "schema_version": SCHEMA_VERSION,
        "campaign": conclusion.campaign,
        "verdict": outcome.verdict,
        "because": outcome.because,
        "basis": "samples" if conclusion.repeats and not by_features else "statistics",
        "effects": _with_families(effects(outcome.chosen, gains), conclusion.families),
        "equivalent": [effects(fit, gains) for fit in outcome.equivalent],
        "certain": effects(outcome.equivalent[0], gains, certain) if certain else [],
        "separated_by": conclusion.separated_by,
        "best_known": _best_known(outcome, gaps, gains),
        "interval_factor": (outcome.proposed or outcome.chosen).scale,
        "held_out_test": test and test.outcome,
        "held_out_features": test and test.features and dict(zip(("before", "after"), test.features, strict=True)),
        "doubted_channels": list(conclusion.doubted_channels),
        "nuisances": _nuisances(outcome.chosen, conclusion.clockwise),
        "where": [
            {
                "run": row["run"],
                "channel": row["channel"],
                "crank_angle_deg": [row["start_deg"], row["end_deg"]],
                "p_adjusted": row["p_adjusted"],
            }
            for row in conclusion.windows.to_dict("records")
        ],
        "orders": [] if standout is None else standout.to_dict("records"),
        "gap": {role: dict(own) for role, own in conclusion.gap.items()},
        "held_out": [dict(run) for run in conclusion.held_out],
        "preflight": {key: list(value) for key, value in conclusion.preflight.items()},
        "false_alarm_rate": conclusion.false_alarm_rate,
    }


def text(verdict: Mapping[str, Any]) -> str:
    """The document as JSON text; what is not a number is null."""
    return json.dumps(_finite(verdict), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def read(path) -> dict[str, Any]:
    """The document in a file."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is no verdict ({error}); run the campaign's stages first") from error
    if not isinstance(content, dict) or content.get("schema_version") != SCHEMA_VERSION:
        raise InputError(f"{path}: is no verdict of schema_version {SCHEMA_VERSION}; run the campaign's stages again")
    return content


def _best_known(outcome: Outcome, gaps: pd.DataFrame, gains: Mapping[str, float]) -> dict[str, Any] | None:
    """What is best but not proven, and how far it goes; None where nothing is."""
    best = outcome.best_known
    if best is None:
        return None
    gap = {role: gap_of(gaps, role) for role in ("identify", "confirm")}
    if best.status == MATCHED:  # samples, by which the others are ranked, say nothing of it
        return {"effects": effects(best, gains), "explained_share": None, "gap": gap, "rival": None}
    ranking = outcome.ranking.set_index("explanation")
    own, labels = ranking.loc[best.label], set(best.label.split(JOINED))
    rivals = [
        row
        for row in ranking.dropna(subset=["bic"]).query("admissible").itertuples()
        if not set(row.Index.split(JOINED)) >= labels and not set(row.Index.split(JOINED)) < labels
    ]
    nearest = min(rivals, key=lambda row: row.bic, default=None)
    return {
        "effects": effects(best, gains),
        "explained_share": own["explained_share"],
        "gap": gap,
        "rival": nearest
        and {
            "explanation": nearest.Index,
            "behind": nearest.bic - best.bic,
            "explained_share": nearest.explained_share,
        },
    }


def effects(fit: Fit, gains: Mapping[str, float], labels: Collection[str] | None = None) -> list[dict[str, Any]]:
    """The effects of one explanation; terms of a law are one effect."""
    laws = [candidate for candidate in fit.hypothesis if candidate.name.startswith(_TERM_PREFIX)]
    entries = [
        _effect(candidate.name, candidate.site, fit, [candidate], gains, effect_estimates(fit, candidate))
        for candidate in fit.hypothesis
        if candidate not in laws and (labels is None or candidate.label in labels)
    ]
    if laws:
        law = law_of(tuple(laws), fit.mapping)
        keys = [p.key for p in fit.parameters]
        parameters: dict[str, Any] = {"formula": {"value": law.formula}}
        for name, key in law.keys.items():
            parameters[name] = coordinate_estimate(fit, keys.index(key))
        entries.append(_effect(effect_of(laws[0]), law.site, fit, laws, gains, parameters))
    return entries


def _effect(name, site, fit: Fit, own, gains, parameters) -> dict[str, Any]:
    """One effect; its delta_bic is what leaving it out costs; None where the rest cannot be simulated by itself,
    or where samples do not decide. Its choices by run, where it has such, such as the start of its motion."""
    left = label_of(tuple(candidate for candidate in fit.hypothesis if candidate not in own))
    cost = gains[left] - fit.bic if left in gains and fit.status != MATCHED else None
    values = fit.mapping
    choices = {
        p.key: round(values[key])
        for candidate in own
        for p in candidate.coordinates
        if p.choices and (key := f"{candidate.label}.{p.key}") in values
    }
    return {"name": name, "site": site, "delta_bic": cost, "parameters": parameters} | (
        {"choices": choices} if choices else {}
    )


def _with_families(named: list[dict[str, Any]], families: pd.DataFrame | None) -> list[dict[str, Any]]:
    """The effects `named`, each with what the data leave of its families, if it has any."""
    found: dict[str, list[dict[str, Any]]] = {}
    for row in () if families is None else families.itertuples():
        left = {"law": row.law.partition(":")[0], "shape": row.shape, "value": row.value}
        left |= {"interval_99": [row.low, row.high], "named": not row.alone}
        found.setdefault(row.effect if row.fits else row.law, []).append(left)

    def with_own(effect: dict[str, Any]) -> dict[str, Any]:
        own = found.get(effect["name"], found.get(f"{effect['name']}:{effect['site']}", []))
        if not own:
            return effect
        # a shape that is a parameter too has one 99 % interval, that of its family
        parameters = dict(effect["parameters"])
        for family in own:
            if (shape := family["shape"]) in parameters and family["law"] == effect["name"]:
                parameters[shape] = parameters[shape] | {"interval_99": family["interval_99"]}
        return effect | {"parameters": parameters, "families": own}

    return [with_own(effect) for effect in named]


def _close(outcome: Outcome) -> list[list[str]]:
    """Effects of each admissible explanation whose BIC is no farther from the best than those that are equivalent."""
    if not outcome.equivalent:
        return []
    ranking = outcome.ranking.query("admissible").set_index("explanation")["bic"]
    farthest = ranking.reindex([fit.label for fit in outcome.equivalent]).max()
    return [label.split(JOINED) for label in ranking.index[ranking <= farthest]]


def _gains(outcome: Outcome) -> dict[str, float]:
    ranked = outcome.ranking.dropna(subset=["bic"])
    return {"base": outcome.base.bic} | dict(zip(ranked["explanation"], ranked["bic"], strict=True))


def _nuisances(fit: Fit, clockwise: Collection[str]) -> dict[str, dict[str, Any]]:
    return {
        p.key: estimate | ({} if is_taken_over(p, estimate) else {"kept": True})
        for p, estimate in nuisances_as_read(fit, clockwise)
    }


def _finite(value: Any) -> Any:
    """`value` with null for numbers that are not finite, and plain numbers for numpy's."""
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value
