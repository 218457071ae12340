"""The identification on one trial, in a folder that holds the campaign alone; and what baseline methods name."""

import math
import shutil
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jointgap.campaign.verdict_json import read
from jointgap.config.load import load_campaign
from jointgap.core import parquet, schema
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import CONTRADICTIONS

_THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.4)  # of the largest coefficient, columns and target of length 1


def analyse_trial(campaign: Path) -> dict[str, Any]:
    """The verdict on a campaign, what the baseline methods name, and the processor time it took [s]."""
    from jointgap.campaign.analyse import analyse

    begin = time.process_time()
    record: dict[str, Any] = {"id": campaign.name}
    with tempfile.TemporaryDirectory() as isolated:
        copy, results = Path(isolated) / "campaign", Path(isolated) / "results"
        shutil.copytree(campaign, copy)
        try:
            analyse(copy / "campaign.yaml", results, anyway=True)  # data wired wrongly are among the trials
            record["verdict"] = read(results / "verdict.json")
        except Exception as error:  # whatever stops one trial counts against the identification, and the others go on
            record["error"] = f"{type(error).__name__}: {error}"
            record["traceback"] = traceback.format_exc()
        record["seconds"] = round(time.process_time() - begin, 3)
        record["doubts"] = _doubts(ResultsFolder(results))
        if "verdict" in record:
            record["greedy"] = greedy_names(_all_fits(results))
            residuals = parquet.read(schema.RESIDUALS, results / "confirm" / "residuals.parquet")
            try:
                record["sparse"] = sparse_names(copy / "campaign.yaml", residuals)
            except Exception as error:  # not installed, or it fails on these data: it counts as not asked
                record |= {"sparse": None, "sparse_error": f"{type(error).__name__}: {error}"}
    return record


def _doubts(folder: ResultsFolder) -> list[dict[str, str]]:
    """Run, channel, other channel and kind of each contradiction in the data; none where the files were refused."""
    if not folder.place(CONTRADICTIONS).is_file():
        return []
    return folder.read(CONTRADICTIONS)[["run", "channel", "other", "kind"]].astype(str).to_dict("records")


def _all_fits(results: Path) -> pd.DataFrame:
    paths = [results / "recalibrate" / "base" / "fits.parquet"]
    paths += [path for stage in ("fit", "pair") for path in sorted(results.glob(f"{stage}/*/fits.parquet"))]
    return pd.concat([parquet.read(schema.FITS, path) for path in paths], ignore_index=True)


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


def sparse_names(campaign_file: Path, residuals: pd.DataFrame) -> list[str] | None:
    """Names by sparse regression of the residual; empty where a model without any term is best.

    With the crank at constant speed w the power that the model misses is that of a force F on the slider and of a
    torque M on the crank: w dT = -v F - w M, with the crank torque's residual dT. Without a measured torque the
    slider's acceleration gives F = m da; None without either. pysindy's thresholded least squares choose from a library
    of effects (S. L. Brunton, J. L. Proctor and J. N. Kutz, PNAS 113 (2016) 3932-3937).
    """
    from pysindy import STLSQ

    campaign = load_campaign(campaign_file)
    identified = residuals[~residuals["held_out"]].dropna(subset=["measured", "base", "crank_angle"])
    channels = set(identified["channel"])
    channel = next((name for name in ("crank_torque", "slider_acceleration") if name in channels), None)
    if channel is None:
        return None
    chosen = identified[identified["channel"] == channel]
    speed = chosen["run"].map({run.id: run.speed for run in campaign.runs}).to_numpy(float)
    columns, target = _library(campaign.mechanism, channel, speed, chosen)
    names, library = list(columns), np.column_stack(list(columns.values()))
    lengths, size = np.linalg.norm(library, axis=0), np.linalg.norm(target)
    if not size or not (lengths > 0).all():
        return []
    library, target = library / lengths, target / size

    def bic(picked: np.ndarray) -> float:
        left = target - library[:, picked] @ np.linalg.lstsq(library[:, picked], target)[0]
        return target.size * math.log(max(float(left @ left), 1e-12)) + picked.sum() * math.log(target.size)

    best = np.zeros(len(names), bool)
    for threshold in _THRESHOLDS:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that a threshold leaves nothing is an answer
            regression = STLSQ(threshold=threshold, alpha=1e-6).fit(library, target[:, None])
        picked = np.abs(np.ravel(regression.coef_)) > 0
        if picked.any() and bic(picked) < bic(best):
            best = picked
    return [name for name, picked in zip(names, best, strict=True) if picked]


def _library(
    mechanism: Any, channel: str, speed: np.ndarray, part: pd.DataFrame
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Columns of the library by name, and the target; of ideal joints."""
    angle = part["crank_angle"].to_numpy()
    crank, rod = mechanism.crank.length, mechanism.rod.length
    sine = (mechanism.slider.offset - crank * np.sin(angle)) / rod
    cosine = np.sqrt(1 - sine**2)
    x = crank * np.cos(angle) + rod * cosine
    slope = -crank * np.sin(angle) + crank * np.cos(angle) * sine / cosine
    bend = -crank * np.cos(angle) - crank * np.sin(angle) * sine / cosine
    bend = bend - crank**2 * np.cos(angle) ** 2 / (rod * cosine**3)
    v, a = speed * slope, speed**2 * bend
    forces = {
        "slider_constant_force": np.ones_like(v),
        "slider_coulomb_friction": -np.sign(v),
        "slider_viscous_friction": -v,
        "slider_quadratic_drag": -v * np.abs(v),
        "slider_spring": -(x - rod),
        "added_slider_mass": -a,
    }
    residual = (part["measured"] - part["base"]).to_numpy()
    if channel == "slider_acceleration":
        return forces, mechanism.slider.mass * residual
    torques = {
        "crank_coulomb_friction": speed,
        "crank_viscous_friction": speed**2,
        "gravity": speed * np.cos(angle),
    }
    return {name: -v * force for name, force in forces.items()} | torques, speed * residual
