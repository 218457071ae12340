"""MLflow records of a campaign: a run with verdict and gaps, and a nested run for each fitted
explanation."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.campaign.campaign_files import MECHANISM, SUMMARIES, VERDICT
from jointgap.campaign.facts import facts
from jointgap.campaign.verdict_json import read
from jointgap.core.facts import metrics
from jointgap.core.publish import Dataset, Record
from jointgap.core.results_folder import ResultsFolder

DESCRIPTION = "Identification of missing effects"

_METRICS = ("chi2", "bic", "delta_bic", "explained_share", "parameters")
_COSTS = ("simulations", "seconds")


def records(folder: Path) -> list[Record]:
    """The campaign's run, then its nested ones."""
    tables, verdict = ResultsFolder(folder), read(folder / VERDICT)
    paths = [folder / name for name in (VERDICT, MECHANISM, *SUMMARIES)]
    paths += sorted((folder / "figures").glob("*.png"))
    best = verdict["best_known"] or {"effects": ()}
    campaign_run = Record(
        "campaign",
        metrics=metrics(fact for fact in facts(verdict) if not fact.name.startswith("nuisance/")),
        datasets=tuple(
            Dataset(name, tables.place(name), "result") for name in ("ranking", "gaps", "residuals")
        ),
        files={str(path.relative_to(folder)): path for path in paths if path.is_file()},
        notes={
            "verdict": verdict["verdict"],
            "effects": _labels(verdict["effects"]),
            "certain": _labels(verdict["certain"]),
            "best_known": _labels(best["effects"]),
            "because": verdict["because"],
        },
    )
    return [campaign_run, *map(_fit, tables.read("ranking").to_dict("records"))]


def _labels(effects: Sequence[Mapping[str, Any]]) -> str:
    """Effects of a verdict, each with its site."""
    return " + ".join(f"{effect['name']}:{effect['site']}" for effect in effects)


def _fit(row: dict[str, Any]) -> Record:
    return Record(
        "campaign",
        row["explanation"],
        metrics={name: row[name] for name in _METRICS if pd.notna(row[name])},
        costs={name: float(row[name]) for name in _COSTS if pd.notna(row[name])},
        notes={name: row[name] or "" for name in ("kind", "status", "place", "remark")},
    )
