"""The naming on one trial, in a folder that holds the campaign alone; and what the baselines make of the same data."""

import shutil
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap import tables
from jointgap.campaign.verdict import read
from jointgap.trials.sparse_baseline import sparse


def analysed(campaign: Path, results: Path) -> dict[str, Any]:
    """The verdict on a campaign, what the baselines name, and the time it took.

    Parameters
    ----------
    campaign : Path
        Folder of the campaign; a copy of it is all that the analysis finds around it.
    results : Path
        Folder for the tables of all stages and ``verdict.json``; what is there is replaced.

    Returns
    -------
    dict
        id, seconds, and verdict, greedy and sparse, or error.
    """
    from jointgap.campaign import analyse

    begin = time.monotonic()
    found: dict[str, Any] = {"id": campaign.name}
    with tempfile.TemporaryDirectory() as alone:
        place = Path(alone) / "campaign"
        shutil.copytree(campaign, place)
        try:
            analyse(place / "campaign.yaml", Path(alone) / "results")
            found["verdict"] = read(Path(alone) / "results" / "verdict.json")
        except Exception as error:  # whatever stops one trial counts against the naming, and the others go on
            found["error"] = f"{type(error).__name__}: {error}"
            found["traceback"] = traceback.format_exc()
        found["seconds"] = round(time.monotonic() - begin, 3)
        made = Path(alone) / "results"
        if "verdict" in found:
            found["greedy"] = greedy(_fits(made))
            try:
                residuals = tables.read(tables.RESIDUALS, made / "confirm" / "residuals.parquet")
                found["sparse"] = sparse(place / "campaign.yaml", residuals)
            except Exception as error:  # not installed, or it fails on these data: it counts as not asked
                found |= {"sparse": None, "sparse_error": f"{type(error).__name__}: {error}"}
        shutil.rmtree(results, ignore_errors=True)
        results.mkdir(parents=True)
        if (made / "verdict.json").exists():
            shutil.copy(made / "verdict.json", results)
    return found


def _fits(made: Path) -> pd.DataFrame:
    """Every fit of the analysis, of single effects and of pairs, the base's among them."""
    places = [made / "recalibrate" / "base" / "fits.parquet"]
    places += [place for stage in ("fit", "pair") for place in sorted(made.glob(f"{stage}/*/fits.parquet"))]
    return pd.concat([tables.read(tables.FITS, place) for place in places], ignore_index=True)


def greedy(fits: pd.DataFrame) -> list[str]:
    """Labels that steps of least BIC add one at a time, whatever remains unexplained.

    Parameters
    ----------
    fits : DataFrame
        Table `jointgap.tables.FITS`.
    """
    known = fits.dropna(subset=["bic"])
    (best,) = known.loc[known["kind"] == "base", "bic"]
    chosen: frozenset[str] = frozenset()
    least = known.groupby("explanation")["bic"].min()  # some are fitted twice, from other starts
    sums = {frozenset(name.split(" + ")): bic for name, bic in least.items()}
    while True:
        larger = {
            one: bic for one, bic in sums.items() if one > chosen and len(one) == len(chosen) + 1 and "base" not in one
        }
        if not larger or min(larger.values()) >= best:
            return sorted(chosen)
        chosen = min(larger, key=larger.__getitem__)
        best = larger[chosen]
