"""verdict.json: the verdict for programs."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jointgap.campaign.fits_on_disk import JOINED, Outcome, clockwise, nuisances_as_read
from jointgap.campaign.plan import confusable_groups, undetectable
from jointgap.config.campaign import Campaign
from jointgap.core.candidates import Candidate
from jointgap.core.errors import InputError
from jointgap.core.results_folder import Frames
from jointgap.effects import EFFECTS
from jointgap.identification.confirmation import held_out_test
from jointgap.identification.fit import (
    NOT_DETERMINED,
    Fit,
    coordinate_estimate,
    effect_estimates,
    is_taken_over,
    no_estimate,
)
from jointgap.identification.force_law import effect_of, law_of
from jointgap.identification.problem import label_of

SCHEMA_VERSION = 3  # increase when a key of verdict.json changes its meaning or is removed

TABLES = ("detectable", "confusability", "gaps", "map_windows", "map_standout", "law_families")
"""Tables that `document` requires."""


def document(
    outcome: Outcome,
    tables: Frames,
    campaign: Campaign,
    inconsistent: Sequence[str] = (),
    repeats: bool = True,
) -> dict[str, Any]:
    """The content of ``verdict.json``; `repeats`: samples are compared, not statistics over
    cycles."""
    gaps, gains = tables["gaps"], _gains(outcome)
    test = held_out_test(gaps) if outcome.proposed else None
    return {
        "schema_version": SCHEMA_VERSION,
        "campaign": campaign.name,
        "verdict": outcome.verdict,
        "because": outcome.because,
        "basis": "samples" if repeats else "statistics",
        "effects": _with_families(_with_twins(outcome, gains), tables["law_families"]),
        "equivalent": [effects(fit, gains) for fit in outcome.equivalent],
        "certain": _certain(outcome, gains),
        "not_searched": list(outcome.not_searched),
        "separated_by": "",
        "best_known": _best_known(outcome, gains),
        "interval_factor": (outcome.proposed or outcome.chosen).scale,
        "held_out_test": test and test.outcome,
        "doubted_channels": list(inconsistent),
        "nuisances": dict(_nuisances(outcome, tables["detectable"], campaign)),
        "where": [
            {
                "run": row.run,
                "channel": row.channel,
                "crank_angle_deg": [row.start_deg, row.end_deg],
                "p_adjusted": row.p_adjusted,
            }
            for row in tables["map_windows"].itertuples()
        ],
        "orders": tables["map_standout"].to_dict("records"),
        "gap": {role: gap_of(gaps, role) for role in ("identify", "confirm")},
        "held_out": held_out(gaps, {run.id: run.role for run in campaign.runs}),
        "preflight": {
            "undetectable": undetectable(tables["detectable"]),
            "merged": confusable_groups(tables["confusability"]),
        },
        "false_alarm_rate": None,
    }


def _nuisances(
    outcome: Outcome, detectable: pd.DataFrame, campaign: Campaign
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Estimates by key, with whether the mechanism file keeps the stated value.

    No interval where the preflight cannot detect any deviation, such as of a restitution; of a
    nuisance that both pins share at neither of them.
    """
    lost, found = set(undetectable(detectable)), set()
    by_nuisance: dict[str, set[str]] = {}
    for label in detectable["label"]:
        if nuisance := getattr(EFFECTS.get(label.partition(":")[0]), "NUISANCE", None):
            by_nuisance.setdefault(nuisance, set()).add(label)
    for nuisance, labels in by_nuisance.items():
        found |= {f"{nuisance}_{label.partition(':')[2]}" for label in labels & lost}
        found |= {nuisance} if labels <= lost else set()
    for p, estimate in nuisances_as_read(outcome.chosen, clockwise(campaign)):
        kept = {} if is_taken_over(estimate) else {"kept": True}
        if p.name in found and estimate["interval_90"] != [None, None]:
            estimate = no_estimate(estimate["value"], estimate.get("remark", NOT_DETERMINED))
        yield p.key, estimate | kept


def text(verdict: Mapping[str, Any]) -> str:
    """The document as JSON; non-finite numbers are null."""
    return json.dumps(_finite(verdict), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def read(path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: not a verdict ({error}); run the campaign's stages first"
        ) from error
    if not isinstance(content, dict) or content.get("schema_version") != SCHEMA_VERSION:
        raise InputError(
            f"{path}: not a verdict of schema_version {SCHEMA_VERSION}; repeat the campaign's"
            " stages"
        )
    return content


def gap_of(gaps: pd.DataFrame, role: str, run: str = "all") -> dict[str, float | None]:
    """Gap over all channels without and with `Outcome.proposed`; None without samples, or if the
    model with it cannot be simulated."""
    row = gaps[(gaps["role"] == role) & (gaps["run"] == run) & (gaps["channel"] == "all")]
    return {when: next(iter(map(float, row[when].dropna())), None) for when in ("before", "after")}


def held_out(gaps: pd.DataFrame, roles: Mapping[str, str]) -> list[dict[str, Any]]:
    runs = []
    for row in gaps[
        (gaps["role"] == "confirm") & (gaps["channel"] == "all") & (gaps["run"] != "all")
    ].itertuples():
        part = "last_third" if roles[row.run] == "split" else "whole"
        reason = {"not_simulated": row.remark} if isinstance(row.remark, str) else {}
        runs.append(
            {"run": row.run, "part": part, "gap": gap_of(gaps, "confirm", row.run), **reason}
        )
    return runs


def _best_known(outcome: Outcome, gains: Mapping[str, float]) -> dict[str, Any] | None:
    """The best explanation that is not confirmed, with its rival."""
    best = outcome.best_known
    if best is None:
        return None
    ranking, labels = outcome.ranking.set_index("explanation"), set(best.label.split(JOINED))
    share = ranking.loc[best.label, "explained_share"]
    known = {"effects": effects(best, gains), "explained_share": share, "rival": None}
    for row in (
        ranking.dropna(subset=["bic"])
        .query("admissible")
        .sort_values("bic", kind="stable")
        .itertuples()
    ):
        other = set(row.Index.split(JOINED))
        if not other >= labels and not other < labels:
            share = row.explained_share
            known["rival"] = {
                "explanation": row.Index,
                "behind": row.bic - best.bic,
                "explained_share": share,
            }
            break
    return known


def _certain(outcome: Outcome, gains: Mapping[str, float]) -> list[dict[str, Any]]:
    """Effects that all near explanations share, with the values of the first explanation that
    contains them."""
    shared = set() if outcome.named else set(outcome.certain)
    for fit in outcome.explanations if shared else ():
        if shared <= {candidate.label for candidate in fit.hypothesis}:
            return effects(fit, gains, shared)
    return []


def effects(
    fit: Fit, gains: Mapping[str, float], labels: Collection[str] | None = None
) -> list[dict[str, Any]]:
    """The effects of an explanation; the terms of a law are one effect."""
    laws = [candidate for candidate in fit.hypothesis if candidate.name.startswith("discovered_")]
    entries = [
        _effect(
            candidate.name,
            candidate.site,
            fit,
            [candidate],
            gains,
            effect_estimates(fit, candidate),
        )
        for candidate in fit.hypothesis
        if candidate not in laws and (labels is None or candidate.label in labels)
    ]
    if laws:
        law = law_of(tuple(laws), fit.mapping)
        keys = [p.key for p in fit.parameters]
        parameters: dict[str, Any] = {"formula": {"value": law.formula}}
        parameters |= {
            name: coordinate_estimate(fit, keys.index(key)) for name, key in law.keys.items()
        }
        entries.append(_effect(effect_of(laws[0]), law.site, fit, laws, gains, parameters))
    return entries


def _effect(
    name: str,
    site: str,
    fit: Fit,
    own: Sequence[Candidate],
    gains: Mapping[str, float],
    parameters: dict[str, Any],
) -> dict[str, Any]:
    """One effect; delta_bic: BIC without it minus BIC; None if the explanation without it was not
    fitted."""
    left = label_of(tuple(candidate for candidate in fit.hypothesis if candidate not in own))
    cost = gains[left] - fit.bic if left in gains else None
    law = {"formula": own[0].formula} if own[0].formula else {}
    return {"name": name, "site": site, **law, "delta_bic": cost, "parameters": parameters}


def _with_families(named: list[dict[str, Any]], families: pd.DataFrame) -> list[dict[str, Any]]:
    """The effects `named` with the intervals of their law families."""
    for effect in named:
        for row in families.itertuples():
            if (row.effect if row.fits else row.law) not in (
                effect["name"],
                f"{effect['name']}:{effect['site']}",
            ):
                continue
            law, interval = row.law.partition(":")[0], {"interval_99": [row.low, row.high]}
            left = {
                "law": law,
                "shape": row.shape,
                "value": row.value,
                **interval,
                "named": not row.alone,
            }
            effect.setdefault("families", []).append(left)
            # the 99 % interval of a shape that is also a parameter is that of the family, around
            # that of 90 %
            if row.shape in effect["parameters"] and law == effect["name"]:
                own = effect["parameters"][row.shape]
                known = [end for end in own.get("interval_90", ()) if end is not None]
                interval["interval_99"] = [min([row.low, *known]), max([row.high, *known])]
                left |= interval
                own |= interval
    return named


def _with_twins(outcome: Outcome, gains: Mapping[str, float]) -> list[dict[str, Any]]:
    """The effects of the chosen explanation; a sensor fault with the others that predict the
    same."""
    named = effects(outcome.chosen, gains)
    labels = [candidate.label for candidate in outcome.chosen.hypothesis]
    for twin in outcome.twins:
        others = {candidate.label for candidate in twin.hypothesis} - {*labels}
        place = next(i for i, label in enumerate(labels) if label not in twin.label.split(JOINED))
        named[place].setdefault("alternatives", []).extend(effects(twin, gains, others))
    return named


def _gains(outcome: Outcome) -> dict[str, float]:
    return {"base": outcome.base.bic} | outcome.ranking.dropna(subset=["bic"]).set_index(
        "explanation"
    )["bic"].to_dict()


def _finite(value: Any) -> Any:
    """`value` with None for non-finite numbers and Python numbers for NumPy ones."""
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value
