"""MLflow records of a campaign: a run with verdict and gaps, and a nested run for each fitted
explanation."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.campaign.campaign_files import MECHANISM, SUMMARIES, VERDICT
from jointgap.campaign.sentences import label_of
from jointgap.campaign.verdict_json import read
from jointgap.core.publish import Dataset, Record
from jointgap.core.results_folder import ResultsFolder

DESCRIPTION = "Identification of missing effects"

_MEASURES = ("chi2", "bic", "delta_bic", "explained_share", "parameters", "simulations", "seconds")
_COSTS = ("simulations", "seconds")


def records(folder: Path) -> list[Record]:
    """The campaign's run, then its nested ones."""
    places, verdict = ResultsFolder(folder), read(folder / VERDICT)
    metrics = {
        f"gap/{role}_{when}": value
        for role, gap in verdict["gap"].items()
        for when, value in gap.items()
    }
    metrics |= {"windows": len(verdict["where"]), "equivalent": len(verdict["equivalent"])}
    for effect in verdict["effects"]:
        own = f"effect/{label_of(effect).replace(':', '_')}"  # some stores reject a colon
        metrics[f"{own}_delta_bic"] = effect["delta_bic"]
        for name, estimate in effect["parameters"].items():
            if not isinstance(estimate["value"], str):
                metrics[f"{own}_{name}"] = estimate["value"]
    named = _labels(verdict["effects"])
    pictures = sorted(
        path for path in (folder / "figures").glob("*") if path.suffix in (".svg", ".png")
    )
    files = {
        name: folder / name
        for name in (VERDICT, MECHANISM, *SUMMARIES)
        if (folder / name).is_file()
    }
    campaign_run = Record(
        "campaign",
        metrics={name: value for name, value in metrics.items() if value is not None},
        datasets=tuple(
            Dataset(name, places.place(name, stage), "result")
            for name, stage in (("ranking", "verdict"), ("gaps", ""), ("residuals", ""))
        ),
        files=files | {f"figures/{path.name}": path for path in pictures},
        notes={
            "verdict": verdict["verdict"],
            "effects": named,
            "certain": _labels(verdict["certain"]),
            "best_known": _labels((verdict["best_known"] or {}).get("effects", ())),
            "because": verdict["because"],
        },
    )
    return [
        campaign_run,
        *(_fit(row) for row in places.read("ranking", "verdict").to_dict("records")),
    ]


def _labels(effects: Sequence[Mapping[str, Any]]) -> str:
    """Effects of a verdict, each with its site."""
    return " + ".join(f"{effect['name']}:{effect['site']}" for effect in effects)


def _fit(row: dict) -> Record:
    numbers = {name: row[name] for name in _MEASURES if pd.notna(row[name])}
    return Record(
        "campaign",
        row["explanation"],
        metrics={name: value for name, value in numbers.items() if name not in _COSTS},
        costs={name: float(value) for name, value in numbers.items() if name in _COSTS},
        notes={name: row[name] or "" for name in ("kind", "status", "place", "remark")},
    )
