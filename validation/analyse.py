"""The identification on one trial, in a folder that holds the campaign alone; and what baseline
methods name."""

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

_THRESHOLDS = (
    0.02,
    0.05,
    0.1,
    0.2,
    0.4,
)  # of the largest coefficient, columns and target of length 1


def analyse_trial(campaign: Path) -> dict[str, Any]:
    """The verdict on a campaign, what the baseline methods name, and the processor time it took
    [s]."""
    from jointgap.campaign.analyse import analyse

    begin = time.process_time()
    record: dict[str, Any] = {"id": campaign.name}
    with tempfile.TemporaryDirectory() as isolated:
        copy, results = Path(isolated) / "campaign", ResultsFolder(Path(isolated) / "results")
        shutil.copytree(campaign, copy)
        try:
            analyse(
                copy / "campaign.yaml", results.path, anyway=True
            )  # data wired wrongly are among the trials
            record["verdict"] = read(results.path / "verdict.json")
        # whatever stops one trial counts against the identification, and the others go on
        except Exception as error:
            record["error"] = f"{type(error).__name__}: {error}"
            record["traceback"] = traceback.format_exc()
        record["seconds"] = round(time.process_time() - begin, 3)
        if results.place(schema.CONTRADICTIONS).is_file():
            doubts = results.read(schema.CONTRADICTIONS)[["run", "channel", "other", "kind"]]
            record["doubts"] = doubts.astype(str).to_dict("records")
        if "verdict" in record:
            flagged = results.read("map_bins").query("flagged")
            keys = flagged["run"].astype(str) + " " + flagged["channel"].astype(str)
            record["map"] = (
                (flagged["start_deg"] / 10).round().astype(int).groupby(keys).agg(list).to_dict()
            )
            paths = sorted(results.path.glob("*/*/fits.parquet"))
            fits = pd.concat([parquet.read(schema.FITS, path) for path in paths])
            record["greedy"] = greedy_names(fits)
            record["bic"] = fits.groupby("explanation")["bic"].min().dropna().round(2).to_dict()
            residuals = parquet.read(
                schema.RESIDUALS, results.path / "confirm" / "residuals.parquet"
            )
            try:
                record["sparse"] = sparse_names(copy / "campaign.yaml", residuals)
            except (
                Exception
            ) as error:  # not installed, or it fails on these data: it counts as not asked
                record |= {"sparse": None, "sparse_error": f"{type(error).__name__}: {error}"}
    return record


def greedy_names(fits: pd.DataFrame) -> list[str]:
    """Labels that steps of least BIC add one at a time, whatever remains unexplained."""
    least = (
        fits.groupby("explanation")["bic"].min().dropna()
    )  # some are fitted twice, from other starts
    bic = {frozenset(name.split(" + ")): value for name, value in least.drop("base").items()}
    chosen, best = frozenset(), least["base"]
    while True:
        larger = {
            bic[labels]: labels
            for labels in bic
            if labels > chosen and len(labels) == len(chosen) + 1
        }
        if not larger or min(larger) >= best:
            return sorted(chosen)
        best = min(larger)
        chosen = larger[best]


def sparse_names(campaign_file: Path, residuals: pd.DataFrame) -> list[str] | None:
    """Names by sparse regression of the residual; empty where a model without any term is best.

    With the crank at constant speed w the power that the model misses is that of a force F on the
    slider and of a torque M on the crank: w dT = -v F - w M, with the crank torque's residual dT.
    Without a measured torque the slider's acceleration gives F = m da; None without either.
    pysindy's thresholded least squares choose from a library of effects (S. L. Brunton, J. L.
    Proctor and J. N. Kutz, PNAS 113 (2016) 3932-3937).
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
            warnings.simplefilter(
                "ignore", UserWarning
            )  # that a threshold leaves nothing is an answer
            regression = STLSQ(threshold=threshold, alpha=1e-6).fit(library, target[:, None])
        choices.append(np.ravel(regression.coef_) != 0)
    return [name for name, picked in zip(names, min(choices, key=bic), strict=True) if picked]


def _library(
    mechanism: Any, speed: np.ndarray, angle: np.ndarray, of_power: bool
) -> dict[str, np.ndarray]:
    """Columns of the library by name, forces or their power; of ideal joints."""
    crank, rod, offset = mechanism.crank.length, mechanism.rod.length, mechanism.slider.offset

    def slope(angle: np.ndarray) -> np.ndarray:
        """dx/dtheta by a complex step."""
        angle = angle + 1e-20j
        x = crank * np.cos(angle) + np.sqrt(rod**2 - (offset - crank * np.sin(angle)) ** 2)
        return x.imag / 1e-20

    x = crank * np.cos(angle) + np.sqrt(rod**2 - (offset - crank * np.sin(angle)) ** 2)
    v = speed * slope(angle)
    a = speed**2 * (slope(angle + 1e-5) - slope(angle - 1e-5)) / 2e-5
    forces = {
        "slider_constant_force": np.ones_like(v),
        "slider_coulomb_friction": -np.sign(v),
        "slider_viscous_friction": -v,
        "slider_quadratic_drag": -v * np.abs(v),
        "slider_spring": -(x - rod),
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
