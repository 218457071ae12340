"""A baseline method: sparse regression of the residual, as for the identification of dynamics.

With the crank at constant speed w the power that the model misses is that of a force F on the slider and of a torque
M on the crank: w dT = -v F - w M, with the crank torque's residual dT. Without a measured torque the slider's
acceleration gives F = m da, or its velocity and position do, differentiated. The library holds those of the list of
effects that such a balance can show; pysindy's sequentially thresholded least squares choose from it.

S. L. Brunton, J. L. Proctor and J. N. Kutz, PNAS 113 (2016) 3932-3937.
"""

import math
import warnings
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config.campaign_file import Campaign
from jointgap.config.load import load_campaign
from jointgap.core.errors import needs
from jointgap.rig.read_files import read_measurements

_THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.4)  # of the largest coefficient, columns and target of length 1
_DERIVATIVE = {
    "slider_acceleration": 0,
    "slider_velocity": 1,
    "slider_position": 2,
}  # order that gives the acceleration


def sparse_names(campaign_file: Path, residuals: pd.DataFrame) -> list[str] | None:
    """Names that sparse regression gives; empty where a model without any term is best, None where no channel
    serves.
    """
    with needs("a sparse regression", "peers"):
        from pysindy import STLSQ

    campaign = load_campaign(campaign_file)
    identified = residuals[~residuals["held_out"]].dropna(subset=["measured", "base", "crank_angle"])
    channels = set(identified["channel"])
    channel = next((name for name in ("crank_torque", *_DERIVATIVE) if name in channels), None)
    if channel is None:
        return None
    chosen = identified[identified["channel"] == channel]
    times = {run: recording.time for run, recording in read_measurements(campaign).runs.items()}
    speeds = {run.id: run.speed for run in campaign.runs}
    parts = [_library(campaign, channel, speeds[run], part, times[run]) for run, part in chosen.groupby("run")]
    names = list(parts[0][0])
    library = np.vstack([np.column_stack(list(columns.values())) for columns, _ in parts])
    target = np.concatenate([values for _, values in parts])
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
    campaign: Campaign, channel: str, speed: float, part: pd.DataFrame, time: np.ndarray
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Columns of the library by name, and the target, of one run."""
    mechanism, angle = campaign.mechanism, part["crank_angle"].to_numpy()
    crank, rod, offset = mechanism.crank.length, mechanism.rod.length, mechanism.slider.offset
    sine = (offset - crank * np.sin(angle)) / rod
    x = crank * np.cos(angle) + rod * np.sqrt(1 - sine**2)
    v = speed * (-crank * np.sin(angle) + crank * np.cos(angle) * sine / np.sqrt(1 - sine**2))
    a = np.gradient(v, angle) * speed
    forces = {
        "slider_constant_force": np.ones_like(v),
        "slider_coulomb_friction": -np.sign(v),
        "slider_viscous_friction": -v,
        "slider_quadratic_drag": -v * np.abs(v),
        "slider_spring": -(x - rod),
        "added_slider_mass": -a,
    }
    residual = (part["measured"] - part["base"]).to_numpy()
    if channel == "crank_torque":
        columns = {name: -v * force for name, force in forces.items()}
        columns |= {
            "crank_coulomb_friction": np.full_like(v, speed),
            "crank_viscous_friction": np.full_like(v, speed**2),
            "gravity": speed * np.cos(angle),
        }
        return columns, speed * residual
    times = time[part["sample"].to_numpy()]
    if not np.isfinite(times).all():
        times = angle / speed
    for _ in range(_DERIVATIVE[channel]):
        residual = np.gradient(residual, times)
    return forces, mechanism.slider.mass * residual
