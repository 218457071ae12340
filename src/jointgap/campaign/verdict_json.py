"""verdict.json: the verdict for programs."""

import json
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jointgap.campaign.outcome import Outcome
from jointgap.campaign.plan import confusable_groups, undetectable
from jointgap.campaign.tables import JOINED, clockwise, nuisances_in_file_convention
from jointgap.config.campaign import NUISANCES, Campaign
from jointgap.config.channels import CHANNELS
from jointgap.core.candidates import Candidate
from jointgap.core.errors import InputError
from jointgap.core.results_folder import Frames
from jointgap.effects import EFFECTS
from jointgap.effects.axis_laws import AXIS_LAWS
from jointgap.effects.base import effects_named
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
from jointgap.identification.problem import Hypothesis, label_of

SCHEMA_VERSION = 3  # increase when a key of verdict.json changes its meaning or is removed

_KNOWN_UNITS = {*NUISANCES, "first_angle", "friction_speed", "clock_offset"}

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
    gaps, detectable = tables["gaps"], tables["detectable"]
    return {
        "schema_version": SCHEMA_VERSION,
        "campaign": campaign.name,
        "verdict": outcome.verdict,
        "because": outcome.because,
        "basis": "samples" if repeats else "statistics",
        "effects": _named_effects(outcome, tables["law_families"]),
        "equivalent": [effects_of(fit, outcome.bic) for fit in outcome.equivalent],
        "certain": _certain(outcome),
        "not_searched": list(outcome.not_searched),
        "separated_by": "",
        "best_known": _best_known(outcome),
        "interval_factor": (outcome.proposed or outcome.chosen).scale,
        "held_out_test": held_out_test(gaps).outcome if outcome.proposed else None,
        "doubted_channels": list(inconsistent),
        "nuisances": _nuisances(outcome, detectable, campaign),
        "where": [
            {
                "run": window.run,
                "channel": window.channel,
                "crank_angle_deg": [window.start_deg, window.end_deg],
                "p_adjusted": window.p_adjusted,
            }
            for window in tables["map_windows"].itertuples()
        ],
        "orders": tables["map_standout"].to_dict("records"),
        "gap": {role: gap_of(gaps, role) for role in ("identify", "confirm")},
        "held_out": held_out(gaps, {run.id: run.role for run in campaign.runs}),
        "preflight": {
            "undetectable": undetectable(detectable),
            "merged": confusable_groups(tables["confusability"]),
        },
        "false_alarm_rate": None,
    }


def text(verdict: Mapping[str, Any]) -> str:
    """The document as JSON; non-finite numbers are null."""
    return json.dumps(_finite(verdict), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    """`value` with None for non-finite numbers and Python numbers for NumPy ones."""
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


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


def _nuisances(
    outcome: Outcome, detectable: pd.DataFrame, campaign: Campaign
) -> dict[str, dict[str, Any]]:
    """Estimates by key, with whether the mechanism file keeps the stated value.

    No interval where no deviation can be detected, such as of a restitution; of a
    nuisance that both pins share at neither of them.
    """
    labels_of: dict[str, set[str]] = {}
    for label in detectable["label"]:
        if nuisance := getattr(EFFECTS.get(label.partition(":")[0]), "NUISANCE", None):
            labels_of.setdefault(nuisance, set()).add(label)
    lost, undetermined = set(undetectable(detectable)), set()
    for nuisance, labels in labels_of.items():
        undetermined |= {f"{nuisance}_{label.partition(':')[2]}" for label in labels & lost}
        undetermined |= {nuisance} if labels <= lost else set()
    estimates = {}
    for parameter, estimate in nuisances_in_file_convention(outcome.chosen, clockwise(campaign)):
        kept = {} if is_taken_over(estimate) else {"kept": True}
        if parameter.name in undetermined and estimate["interval_90"] != [None, None]:
            estimate = no_estimate(estimate["value"], estimate.get("remark", NOT_DETERMINED))
        unit = {} if parameter.name in _KNOWN_UNITS else {"unit": parameter.unit}
        estimates[parameter.key] = estimate | kept | unit
    return estimates


def gap_of(gaps: pd.DataFrame, role: str, run: str = "all") -> dict[str, float | None]:
    """Gap over all channels without and with `Outcome.proposed`; None without samples, or if the
    model with it cannot be simulated."""
    row = gaps[(gaps["role"] == role) & (gaps["run"] == run) & (gaps["channel"] == "all")]
    return {when: next(iter(map(float, row[when].dropna())), None) for when in ("before", "after")}


def held_out(gaps: pd.DataFrame, roles: Mapping[str, str]) -> list[dict[str, Any]]:
    """Gap of each held-out run, and why a run could not be simulated."""
    runs = []
    for row in gaps.query("role == 'confirm' and channel == 'all' and run != 'all'").itertuples():
        part = "last_third" if roles[row.run] == "split" else "whole"
        entry = {"run": row.run, "part": part, "gap": gap_of(gaps, "confirm", row.run)}
        if isinstance(row.remark, str):
            entry["not_simulated"] = row.remark
        runs.append(entry)
    return runs


def _best_known(outcome: Outcome) -> dict[str, Any] | None:
    """The best explanation that is not confirmed, with its rival."""
    best = outcome.best_known
    if best is None:
        return None
    ranking, labels = outcome.ranking.set_index("explanation"), set(best.label.split(JOINED))
    share = ranking.loc[best.label, "explained_share"]
    content = {"effects": effects_of(best, outcome.bic), "explained_share": share, "rival": None}
    fitted = ranking.dropna(subset=["bic"]).query("admissible")
    for row in fitted.sort_values("bic", kind="stable").itertuples():
        rival = set(row.Index.split(JOINED))
        if not rival >= labels and not rival < labels:
            content["rival"] = {
                "explanation": row.Index,
                "behind": row.bic - best.bic,
                "explained_share": row.explained_share,
            }
            break
    return content


def _certain(outcome: Outcome) -> list[dict[str, Any]]:
    """Effects that all near explanations share, with the values of the first explanation that
    contains them."""
    shared = set() if outcome.named else set(outcome.certain)
    for fit in outcome.explanations if shared else ():
        if shared <= {candidate.label for candidate in fit.hypothesis}:
            return effects_of(fit, outcome.bic, shared)
    return []


def effects_of(
    fit: Fit, bic: Mapping[str, float], labels: Collection[str] | None = None
) -> list[dict[str, Any]]:
    """The effects of an explanation; the terms of a law are one effect; `bic` by explanation."""

    def entry(
        name: str, site: str, terms: Hypothesis, parameters: dict[str, Any]
    ) -> dict[str, Any]:
        # BIC without the effect minus BIC; None if the explanation without it was not fitted
        without = label_of(tuple(c for c in fit.hypothesis if c not in terms))
        gain = bic[without] - fit.bic if without in bic else None
        formula = {"formula": terms[0].formula} if terms[0].formula else {}
        return {"name": name, "site": site, **formula, "delta_bic": gain, "parameters": parameters}

    laws = tuple(c for c in fit.hypothesis if c.name.startswith("discovered_"))
    entries = [
        entry(c.name, c.site, (c,), _with_units(c, effect_estimates(fit, c)))
        for c in fit.hypothesis
        if c not in laws and (labels is None or c.label in labels)
    ]
    if laws:
        law, keys = law_of(laws, fit.mapping), [parameter.key for parameter in fit.parameters]
        parameters: dict[str, Any] = {"formula": {"value": law.formula}}
        for name, key in law.keys.items():
            parameters[name] = coordinate_estimate(fit, keys.index(key))
        entries.append(entry(effect_of(laws[0]), law.site, laws, parameters))
    return entries


def _with_units(candidate: Candidate, estimates: dict[str, Any]) -> dict[str, Any]:
    """The estimates of an effect's parameters with their units, where no list of effects or
    channels has them: those of a model of the user."""
    is_listed = candidate.name in {*EFFECTS, *AXIS_LAWS} or effects_named(candidate.name)
    if is_listed or (candidate.sensor and candidate.site in (*CHANNELS, "sensor")):
        return estimates
    units = {p.key: p.unit for p in candidate.coordinates}
    return {
        name: estimate | ({"unit": units[name]} if name in units else {})
        for name, estimate in estimates.items()
    }


def _named_effects(outcome: Outcome, families: pd.DataFrame) -> list[dict[str, Any]]:
    """The effects of the chosen explanation, with alternatives of sensor faults that predict the
    same, and with the intervals of their law families."""
    effects = effects_of(outcome.chosen, outcome.bic)
    labels = [candidate.label for candidate in outcome.chosen.hypothesis]
    for twin in outcome.twins:
        differing = {candidate.label for candidate in twin.hypothesis} - {*labels}
        replaced = [label not in twin.label.split(JOINED) for label in labels].index(True)
        alternatives = effects[replaced].setdefault("alternatives", [])
        alternatives.extend(effects_of(twin, outcome.bic, differing))
    for effect in effects:
        for row in families.itertuples():
            label = row.effect if row.fits else row.law
            if label in (effect["name"], f"{effect['name']}:{effect['site']}"):
                _add_family(effect, row)
    return effects


def _add_family(effect: dict[str, Any], row: Any) -> None:
    """Add a row of table `LAW_FAMILIES` to an effect."""
    law, interval = row.law.partition(":")[0], [row.low, row.high]
    parameter = effect["parameters"].get(row.shape) if law == effect["name"] else None
    if parameter is not None:
        # the 99 % interval of a shape that is also a parameter is that of the family, around that
        # of 90 %
        ends = [end for end in parameter.get("interval_90", ()) if end is not None]
        interval = [min([row.low, *ends]), max([row.high, *ends])]
        parameter["interval_99"] = interval
    family = {"law": law, "shape": row.shape, "value": row.value, "interval_99": interval}
    effect.setdefault("families", []).append(family | {"named": not row.alone})
