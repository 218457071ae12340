"""Synthetic measured data of the demonstration campaigns, with hidden effects.

    python -m examples.demonstration

The rig is the mechanism of the campaigns with the changes in `HIDDEN`. The data have a finer
tolerance and another friction regularisation than a fit, sensor noise, irregular times, a gap and a
wrapping encoder.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.load import load_campaign
from jointgap.effects.base import body_data
from jointgap.motion.of_file import simulated_samples

CAMPAIGNS = Path("config/campaigns")

HIDDEN = {
    "demonstration": {
        "name": "discovered_slider_force",
        "parameters": {"formula": "-f*tanh(v/0.004)", "coefficients": {"f": 6.0}},
    },
    "demonstration_clearance": {
        "name": "crank_pin_clearance",
        "parameters": {
            "clearance_m": 5e-4,
            "restitution": 0.6,
            "friction": 0.1,
            "stiffness_factor": 0.8,
        },
    },
    "four_bar": {
        "name": "B_clearance",
        "parameters": {"clearance_m": 2e-4},
    },
}
"""By campaign: Coulomb friction of 6 N between slider and guide; a crank pin with a radial
clearance of 0.5 mm, and a contact of its own, which nobody measured; of a four-bar a pin of coupler
and rocker with 0.2 mm."""

OFF_NOMINAL = {"slider": 1.02, "rod": 0.99, "coupler": 1.02, "rocker": 0.99}
"""True masses over nominal ones, inside of the ranges that the campaign states."""

CHANNELS = {
    "torque_Nm": ("crank_torque", 1.0),
    "acc_g": ("slider_acceleration", 9.80665),
    "rocker_gyro_rad_s": ("rocker_angular_velocity", 1.0),
}
"""Column, quantity of the simulation, and unit in SI."""

NOISE = 0.03  # of a channel's standard deviation
ANGLE_NOISE = 0.1  # deg
SETTLED, REVOLUTIONS, SAMPLES_PER_REVOLUTION = 12, 4, 97
SEED = 20


def rig(nominal: Mechanism | LinkageFile, hidden: dict) -> Mechanism | LinkageFile:
    """The mechanism that is measured."""
    data = nominal.model_dump()
    for body, factor in OFF_NOMINAL.items():
        if body in nominal.sites.bodies:
            body_data(data, body)["mass"] *= factor
    return type(nominal).model_validate(data | {"effects": [*data["effects"], hidden]})


def measured(
    mechanism: Mechanism | LinkageFile, speed: float, random: np.random.Generator
) -> pd.DataFrame:
    """One run as a data logger would write it."""
    per_turn = 40 * SAMPLES_PER_REVOLUTION
    options = Simulate(
        speed=speed,
        revolutions=SETTLED + REVOLUTIONS,
        samples_per_revolution=per_turn,
        tolerance=1e-12,
    )
    samples = simulated_samples(mechanism, options)
    begin = SETTLED * per_turn + int(random.integers(per_turn // 3))
    kept = samples.iloc[begin:-1:40].reset_index(drop=True)
    noisy = {}
    for column, (name, unit) in CHANNELS.items():
        if name in kept:
            values = kept[name] / unit
            noisy[column] = values + random.normal(0.0, NOISE * values.std(), len(kept))
    angle = np.degrees(kept["crank_angle"]) + random.normal(0.0, ANGLE_NOISE, len(kept))
    frame = pd.DataFrame(
        {
            "t_ms": 1e3 * (kept["time"] - kept["time"].iloc[0]),
            "angle_deg": np.mod(angle, 360.0),
            **noisy,
        }
    )
    frame.loc[frame.index[100:110], frame.columns[-1]] = np.nan  # the sensor's cable was loose
    return frame.round({"t_ms": 4, "angle_deg": 2} | dict.fromkeys(noisy, 4))


def main() -> None:
    """Write the runs' files."""
    for name, hidden in HIDDEN.items():
        campaign, random = load_campaign(CAMPAIGNS / f"{name}.yaml"), np.random.default_rng(SEED)
        mechanism = rig(campaign.mechanism, hidden)
        for run in campaign.runs:
            place = campaign.folder / run.file
            place.parent.mkdir(parents=True, exist_ok=True)
            measured(mechanism, run.speed, random).to_csv(place, index=False)


if __name__ == "__main__":
    main()
