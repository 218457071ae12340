"""The identification on one trial, in a folder without the ground truth; comparison methods."""

import math
import shutil
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jointgap.campaign.verdict_json import read
from jointgap.config.load import load_campaign
from jointgap.core import schema
from jointgap.core.results_folder import ResultsFolder
from jointgap.identification.search import STEPS, Step
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings

_THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.4)  # of the largest coefficient, unit columns


def analyse_trial(
    campaign: Path,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
    steps: Sequence[Step] = STEPS,
    others: bool = True,
) -> dict[str, Any]:
    """The verdict on a campaign, the processor time [s], and answers of comparison methods, of
    `others` than the package too."""
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
            record |= _fit_answers(results)
            if others:
                record |= _sparse_answer(results, copy / "campaign.yaml")
    return record


def _fit_answers(results: ResultsFolder) -> dict[str, Any]:
    """Flagged bins of the map, BIC of the fits, and the answer by the smallest BIC."""
    flagged = results.read("map_bins").query("flagged")
    keys = flagged["run"].astype(str) + " " + flagged["channel"].astype(str)
    bins = (flagged["start_deg"] / 10).round().astype(int)
    ranking = results.read("ranking")
    base = (ranking["bic"] + ranking["delta_bic"]).dropna().head(1)
    fits = pd.concat([ranking, pd.DataFrame({"explanation": "base", "bic": base})])
    return {
        "map": bins.groupby(keys).agg(list).to_dict(),
        "greedy": greedy_names(fits),
        "bic": fits.dropna(subset=["bic"]).set_index("explanation")["bic"].round(2).to_dict(),
    }


def _sparse_answer(results: ResultsFolder, campaign_file: Path) -> dict[str, Any]:
    """The answer by sparse regression, or its error."""
    residuals = results.read("residuals")
    try:
        return {"sparse": sparse_names(campaign_file, residuals)}
    except Exception as error:  # not installed, or it fails on these data
        return {"sparse": None, "sparse_error": f"{type(error).__name__}: {error}"}


def greedy_names(fits: pd.DataFrame) -> list[str]:
    """Labels added one at a time, each with the smallest BIC, while the BIC decreases."""
    if "base" not in set(fits["explanation"]):
        return []
    smallest = fits.groupby("explanation")["bic"].min().dropna()
    bic = {frozenset(name.split(" + ")): value for name, value in smallest.drop("base").items()}
    named, best = frozenset(), smallest["base"]
    while True:
        larger = {bic[key]: key for key in bic if key > named and len(key) == len(named) + 1}
        if not larger or min(larger) >= best:
            return sorted(named)
        best = min(larger)
        named = larger[best]


def sparse_names(campaign_file: Path, residuals: pd.DataFrame) -> list[str] | None:
    """Names by sparse regression of the residual; None without a suitable channel.

    At constant crank speed w the missing power is that of a force F on the slider and a torque M on
    the crank: w dT = -v F - w M, with the residual dT of the crank torque. Without a measured
    torque the slider acceleration gives F = m da. Terms are selected by pysindy's thresholded least
    squares (S. L. Brunton, J. L. Proctor and J. N. Kutz, PNAS 113 (2016) 3932-3937).
    """
    from pysindy import STLSQ

    campaign = load_campaign(campaign_file)
    part = residuals[~residuals["held_out"]].dropna(subset=["measured", "base", "crank_angle"])
    measured = set(part["channel"])
    channel = next(
        (name for name in ("crank_torque", "slider_acceleration") if name in measured), None
    )
    if channel is None:
        return None
    part = part[part["channel"] == channel]
    speed = part["run"].map({run.id: run.speed for run in campaign.runs}).to_numpy(float)
    columns = _library(
        campaign.mechanism, speed, part["crank_angle"].to_numpy(), channel == "crank_torque"
    )
    target = (part["measured"] - part["base"]).to_numpy()
    target = target * (speed if channel == "crank_torque" else campaign.mechanism.slider.mass)
    names, library = list(columns), np.column_stack(list(columns.values()))
    lengths, size = np.linalg.norm(library, axis=0), np.linalg.norm(target)
    if not size or not (lengths > 0).all():
        return []
    library, target = library / lengths, target / size

    def bic(picked: np.ndarray) -> float:
        left = target - library[:, picked] @ np.linalg.lstsq(library[:, picked], target)[0]
        return target.size * math.log(max(float(left @ left), 1e-12)) + picked.sum() * math.log(
            target.size
        )

    choices = [np.zeros(len(names), bool)]
    for threshold in _THRESHOLDS:
        with warnings.catch_warnings():
            # that a threshold leaves nothing is an answer
            warnings.simplefilter("ignore", UserWarning)
            regression = STLSQ(threshold=threshold, alpha=1e-6).fit(library, target[:, None])
        choices.append(np.ravel(regression.coef_) != 0)
    return [name for name, picked in zip(names, min(choices, key=bic), strict=True) if picked]


def _library(
    mechanism: Any, speed: np.ndarray, angle: np.ndarray, of_power: bool
) -> dict[str, np.ndarray]:
    """Columns of the library by name: forces, or their power, for ideal joints."""
    crank, rod, offset = mechanism.crank.length, mechanism.rod.length, mechanism.slider.offset

    def position(angle: np.ndarray) -> np.ndarray:
        return crank * np.cos(angle) + np.sqrt(rod**2 - (offset - crank * np.sin(angle)) ** 2)

    def slope(angle: np.ndarray) -> np.ndarray:
        """dx/dtheta by a complex step."""
        return position(angle + 1e-20j).imag / 1e-20

    v = speed * slope(angle)
    a = speed**2 * (slope(angle + 1e-5) - slope(angle - 1e-5)) / 2e-5
    forces = {
        "slider_constant_force": np.ones_like(v),
        "slider_coulomb_friction": -np.sign(v),
        "slider_viscous_friction": -v,
        "slider_quadratic_drag": -v * np.abs(v),
        "slider_spring": -(position(angle) - rod),
        "added_slider_mass": -a,
    }
    if not of_power:
        return forces
    torques = {
        "crank_coulomb_friction": speed,
        "crank_viscous_friction": speed**2,
        "gravity": speed * np.cos(angle),
    }
    return {name: -v * force for name, force in forces.items()} | torques
