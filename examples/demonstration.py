"""Synthetic measured data of the two demonstration campaigns, with hidden effects.

    python -m examples.demonstration

The rig is the mechanism of the campaigns with the changes in `HIDDEN`. The data have a finer
tolerance and another friction regularisation than a fit, sensor noise, irregular times, a gap and a
wrapping encoder.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Simulate
from jointgap.config.load import load_campaign
from jointgap.motion.slider_crank import simulate

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
}
"""By campaign: Coulomb friction of 6 N between slider and guide; a crank pin with a radial
clearance of 0.5 mm, and a contact of its own, which nobody measured."""

OFF_NOMINAL = {"slider": {"mass": 1.02}, "rod": {"mass": 0.99}}
"""True values over nominal ones, inside of the ranges that the campaign states."""

NOISE = 0.03  # of a channel's standard deviation
ANGLE_NOISE = 0.1  # deg
SETTLED, REVOLUTIONS, SAMPLES_PER_REVOLUTION = 12, 4, 97
SEED = 20


def rig(nominal: Mechanism, hidden: dict) -> Mechanism:
    """The mechanism that is measured."""
    data = nominal.model_dump()
    for body, factors in OFF_NOMINAL.items():
        data[body] |= {key: factor * data[body][key] for key, factor in factors.items()}
    return Mechanism.model_validate(data | {"effects": [*data["effects"], hidden]})


def measured(mechanism: Mechanism, speed: float, random: np.random.Generator) -> pd.DataFrame:
    """One run as a data logger would write it."""
    per_turn = 40 * SAMPLES_PER_REVOLUTION
    options = Simulate(
        speed=speed,
        revolutions=SETTLED + REVOLUTIONS,
        samples_per_revolution=per_turn,
        tolerance=1e-12,
    )
    samples = simulate(mechanism, options).samples
    begin = SETTLED * per_turn + int(random.integers(per_turn // 3))
    kept = samples.iloc[begin:-1:40].reset_index(drop=True)
    channels = {"torque_Nm": kept["crank_torque"], "acc_g": kept["slider_acceleration"] / 9.80665}
    noisy = {
        name: values + random.normal(0.0, NOISE * values.std(), len(kept))
        for name, values in channels.items()
    }
    angle = np.degrees(kept["crank_angle"]) + random.normal(0.0, ANGLE_NOISE, len(kept))
    frame = pd.DataFrame(
        {
            "t_ms": 1e3 * (kept["time"] - kept["time"].iloc[0]),
            "angle_deg": np.mod(angle, 360.0),
            **noisy,
        }
    )
    frame.loc[frame.index[100:110], "acc_g"] = np.nan  # the sensor's cable was loose
    return frame.round({"t_ms": 4, "angle_deg": 2, "torque_Nm": 4, "acc_g": 4})


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
