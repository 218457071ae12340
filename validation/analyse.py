"""The identification on one trial, in a folder without the ground truth."""

import shutil
import signal
import tempfile
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.campaign.verdict_json import read
from jointgap.core import schema
from jointgap.core.results_folder import ResultsFolder
from jointgap.identification.search import STEPS, Step
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings


def analyse_trial(
    campaign: Path,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
    steps: Sequence[Step] = STEPS,
) -> dict[str, Any]:
    """The verdict on a campaign, the processor time [s], the map's flagged bins and the BIC of all
    fits."""
    from jointgap.campaign.analyse import analyse

    begin = time.process_time()
    record: dict[str, Any] = {"id": campaign.name}
    with tempfile.TemporaryDirectory() as isolated:
        copy, results = Path(isolated) / "campaign", ResultsFolder(Path(isolated) / "results")
        shutil.copytree(campaign, copy)
        try:  # `anyway`: data faults are among the trials
            analyse(copy / "campaign.yaml", results.path, settings, anyway=True, steps=steps)
            record["verdict"] = read(results.path / "verdict.json")
        except Exception as error:  # counts as failed; other trials continue
            record["error"] = f"{type(error).__name__}: {error}"
            record["traceback"] = traceback.format_exc()
        record["seconds"] = round(time.process_time() - begin, 3)
        signal.setitimer(signal.ITIMER_PROF, 0.0)  # a limit is for the identification
        if results.place(schema.CONTRADICTIONS).is_file():
            doubts = results.read(schema.CONTRADICTIONS)[["run", "channel", "other", "kind"]]
            record["doubts"] = doubts.astype(str).to_dict("records")
        if "verdict" in record:
            record |= _map_and_bic(results)
    return record


def _map_and_bic(results: ResultsFolder) -> dict[str, Any]:
    """Flagged bins of the map by run and channel, and the smallest BIC of each hypothesis."""
    flagged = results.read("map_bins").query("flagged")
    keys = flagged["run"].astype(str) + " " + flagged["channel"].astype(str)
    bins = (flagged["start_deg"] / 10).round().astype(int)
    ranking = results.read("ranking")
    base = (ranking["bic"] + ranking["delta_bic"]).dropna().head(1)
    fits = pd.concat([ranking, pd.DataFrame({"explanation": "base", "bic": base})])
    return {
        "map": bins.groupby(keys).agg(list).to_dict(),
        "bic": fits.groupby("explanation")["bic"].min().dropna().round(2).to_dict(),
    }
