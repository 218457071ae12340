"""A comparison method: sparse regression of the residual."""

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config.campaign import Campaign
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.noise import first_values
from jointgap.identification.problem import values_in_run
from jointgap.rig.model import build_model
from jointgap.rig.read_files import read_measurements

_THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.4)  # of the largest coefficient, unit columns


def answer(campaign: Path, analysis: Mapping[str, Any]) -> list[str] | None:
    """The names by the residuals of the recalibrated model; None without a suitable channel, and
    if that model cannot be fitted."""
    content = load_campaign(campaign / "campaign.yaml")
    try:
        return sparse_names(content, recalibrated_residuals(content))
    except (InputError, SimulationError):
        return None


def recalibrated_residuals(campaign: Campaign) -> pd.DataFrame:
    """Measured values, and the model's with fitted nuisances (`base`), by sample [SI]."""
    model = build_model(campaign, read_measurements(campaign))
    values, parts = first_values(model), []
    predicted = {
        run: model.simulate(run, *values_in_run(model, run, values)) for run in model.plans
    }
    for series in model.series:
        columns = {"run": series.run, "channel": series.channel, "crank_angle": series.angle}
        columns |= {"held_out": series.held_out, "measured": series.value}
        parts.append(pd.DataFrame(columns | {"base": predicted[series.run][series.channel]}))
    return pd.concat(parts, ignore_index=True)


def sparse_names(campaign: Campaign, residuals: pd.DataFrame) -> list[str] | None:
    """Names by sparse regression of the residual; None without a suitable channel.

    At constant crank speed w the missing power is that of a force F on the slider and a torque M on
    the crank: w dT = -v F - w M, with the residual dT of the crank torque. Without a measured
    torque the slider acceleration gives F = m da. Terms are selected by pysindy's thresholded least
    squares (S. L. Brunton, J. L. Proctor and J. N. Kutz, PNAS 113 (2016) 3932-3937).
    """
    from pysindy import STLSQ

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
