"""The naming on one trial, in a folder that holds the campaign alone; and what baseline methods name."""

import shutil
import tempfile
import time
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap import tables
from jointgap.campaign.fits_on_disk import JOINED
from jointgap.campaign.verdict_json import read
from jointgap.core.results_folder import ResultsFolder
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.tables import CONTRADICTIONS
from jointgap.trials.score import effect_label
from jointgap.trials.sparse_regression import sparse_names

# Log likelihood of the features of the cycle, as much as is asked of held-out data.
_GAIN_OF_AN_EFFECT = DEFAULT_SETTINGS.confirmation.min_fall_of_features


def analyse_trial(campaign: Path, results: Path) -> dict[str, Any]:
    """The verdict on a campaign, what the baseline methods name, and the processor time it took."""
    from jointgap.campaign.analyse import analyse

    begin = time.process_time()
    record: dict[str, Any] = {"id": campaign.name}
    with tempfile.TemporaryDirectory() as isolated:
        copy, own_results = Path(isolated) / "campaign", Path(isolated) / "results"
        shutil.copytree(campaign, copy)
        try:
            analyse(copy / "campaign.yaml", own_results, anyway=True)  # data wired wrongly are among the trials
            record["verdict"] = read(own_results / "verdict.json")
        except Exception as error:  # whatever stops one trial counts against the naming, and the others go on
            record["error"] = f"{type(error).__name__}: {error}"
            record["traceback"] = traceback.format_exc()
        record["seconds"] = round(time.process_time() - begin, 3)
        record["doubts"] = doubts(own_results)
        if "verdict" in record:
            fits = _all_fits(own_results)
            record |= {"greedy": greedy_names(fits), "fits": least_chi2(fits)}
            ranking = ResultsFolder(own_results).read("ranking", "verdict")
            record |= {"statistics": statistics_names(record["verdict"], ranking)}
            try:
                residuals = tables.read(tables.RESIDUALS, own_results / "confirm" / "residuals.parquet")
                record["sparse"] = sparse_names(copy / "campaign.yaml", residuals)
            except Exception as error:  # not installed, or it fails on these data: it counts as not asked
                record |= {"sparse": None, "sparse_error": f"{type(error).__name__}: {error}"}
        shutil.rmtree(results, ignore_errors=True)
        results.mkdir(parents=True)
        if (own_results / "verdict.json").exists():
            shutil.copy(own_results / "verdict.json", results)
    return record


def doubts(results: Path) -> list[dict[str, str]]:
    """Run, channel, other channel and kind of what `measure` found to contradict; none where it refused the files."""
    folder = ResultsFolder(results)
    if not folder.place(CONTRADICTIONS).is_file():
        return []
    return folder.read(CONTRADICTIONS)[["run", "channel", "other", "kind"]].astype(str).to_dict("records")


def _all_fits(results: Path) -> pd.DataFrame:
    """Every fit of the analysis, of single effects and of pairs, the base's among them."""
    paths = [results / "recalibrate" / "base" / "fits.parquet"]
    paths += [path for stage in ("fit", "pair") for path in sorted(results.glob(f"{stage}/*/fits.parquet"))]
    return pd.concat([tables.read(tables.FITS, path) for path in paths], ignore_index=True)


def least_chi2(fits: pd.DataFrame) -> dict[str, Any]:
    """How many ``samples`` count, and the least ``chi2`` by explanation."""
    finished = fits.dropna(subset=["chi2"])
    least = finished.groupby("explanation")["chi2"].min()
    return {"samples": int(finished["samples"].max()), "chi2": {str(name): float(chi2) for name, chi2 in least.items()}}


def greedy_names(fits: pd.DataFrame) -> list[str]:
    """Labels that steps of least BIC add one at a time, whatever remains unexplained."""
    finished = fits.dropna(subset=["bic"])
    (best,) = finished.loc[finished["kind"] == "base", "bic"]
    least = finished.groupby("explanation")["bic"].min()  # some are fitted twice, from other starts
    bic = {frozenset(name.split(" + ")): value for name, value in least.items() if name != "base"}
    chosen: frozenset[str] = frozenset()
    while True:
        larger = {labels: bic[labels] for labels in bic if labels > chosen and len(labels) == len(chosen) + 1}
        if not larger or min(larger.values()) >= best:
            return sorted(chosen)
        chosen = min(larger, key=larger.__getitem__)
        best = larger[chosen]


def statistics_names(verdict: Mapping[str, Any], ranking: pd.DataFrame) -> list[str]:
    """Labels of the explanation whose features of the cycle are best, each effect of it at the price of a fixed gain;
    those of the verdict where statistics decided it.
    """
    if verdict["basis"] == "statistics":
        return _labels(verdict)
    found = {
        row.explanation: row.feature_gain - _GAIN_OF_AN_EFFECT * len(row.explanation.split(JOINED))
        for row in ranking.dropna(subset=["feature_gain"]).itertuples()
    }
    best = max(found, key=found.__getitem__, default=None)
    return sorted(best.split(JOINED)) if best and found[best] > 0.0 else []


def _labels(verdict: Mapping[str, Any]) -> list[str]:
    return sorted(map(effect_label, verdict["effects"]))
