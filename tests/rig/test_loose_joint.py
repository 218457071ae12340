"""Effects in a mechanism with a loose crank pin and periodic motion are named, independent of the
search has."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.config import Mechanism, Simulate
from jointgap.motion.slider_crank import simulate

PER_TURN, FINE, DROPPED, KEPT = 200, 20, 12, 5
SPEEDS = {"slow": 150.0, "mid": 215.0, "fast": 280.0}  # rpm; mid is held out
PIN = {"journal": "crank", "journal_radius": 7e-3, "bearing_radius": 7.8e-3, "contact": "steel"}
MODEL = {
    "crank": {"length": 0.15, "mass": 0.3704, "inertia": 1.458e-3, "mass_centre": 0.075},
    "rod": {"length": 0.564, "mass": 0.773, "inertia": 2.482e-2, "mass_centre": 0.282},
    "slider": {"mass": 0.4482},
    "joints": {
        "crank_pivot": "ideal",
        "crank_pin": PIN | {"loose": True},
        "piston_pin": PIN | {"loose": False, "journal": "slider", "bearing_radius": 7.02e-3},
    },
    "contacts": {"steel": {"restitution": 0.46, "friction": 0.1}},
    "gravity_direction": "-90 deg",
}
CLEARANCE = {"clearance_m": 1.2e-4, "friction": 0.12, "restitution": 0.5, "stiffness_factor": 1.0}


def measured(folder: Path, hidden: dict, delay: float, seed: int) -> Path:
    """A campaign with position, torque and angle of a rig in which an effect is hidden and the
    torque is late [s]."""
    random = np.random.default_rng(seed)
    true = yaml.safe_load(yaml.safe_dump(MODEL)) | {"effects": [hidden]}
    true["slider"]["mass"] *= 1.02
    true["rod"]["mass"] *= 0.985
    true["contacts"]["steel"]["friction"] = 0.12
    listed, options = (
        [],
        {
            "revolutions": DROPPED + KEPT,
            "samples_per_revolution": PER_TURN * FINE,
            "tolerance": 1e-11,
        },
    )
    for run, rpm in SPEEDS.items():
        speed = float(rpm * np.pi / 30)
        seen = simulate(Mechanism.model_validate(true), Simulate(speed=speed, **options)).samples
        rows = slice(DROPPED * PER_TURN * FINE + int(random.integers(PER_TURN * FINE)), -1, FINE)
        time, clock = seen["time"].to_numpy(), seen["time"].to_numpy()[rows]
        torque = np.interp(clock - delay, time, seen["crank_torque"])
        noise = random.standard_normal((3, clock.size)) * [[3e-3], [2e-4], [0.03 * torque.std()]]
        table = {
            "time": clock - clock[0],
            "crank_angle": seen["crank_angle"].to_numpy()[rows] + noise[0],
        }
        table |= {
            "slider_position": seen["slider_position"].to_numpy()[rows] + noise[1],
            "crank_torque": torque + noise[2],
        }
        pd.DataFrame(table).to_csv(folder / f"{run}.csv", index=False)
        role = "confirm" if run == "mid" else "identify"
        listed.append({"id": run, "file": f"{run}.csv", "speed": speed, "role": role})
    units = {"time": "s", "crank_angle": "rad", "slider_position": "m", "crank_torque": "N*m"}
    channels = {name: {"column": name, "unit": unit} for name, unit in units.items()}
    nuisance = {"slider_mass": "5 %", "rod_mass": "5 %", "joint_friction": [0.02, 0.4]}
    content = {
        "name": "rig",
        "mechanism": MODEL,
        "runs": listed,
        "channels": channels,
        "nuisance": nuisance,
    }
    path = folder / "campaign.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "delay", "effects"),
    [
        ({"name": "piston_pin_clearance", "parameters": CLEARANCE}, 0.0, {"piston_pin_clearance"}),
        (
            {"name": "slider_coulomb_friction", "parameters": {"force_N": 1.0}},
            5e-4,
            {"slider_coulomb_friction", "sensor_delay"},
        ),
    ],
)
def test_the_cause_is_named_with_its_size(tmp_path, hidden, delay, effects):
    verdict = analyse(measured(tmp_path, hidden, delay, seed=1), tmp_path / "results")
    assert {effect["name"] for effect in verdict["effects"]} == effects
    result = next(
        effect["parameters"] for effect in verdict["effects"] if effect["name"] == hidden["name"]
    )
    name, size = next(iter(hidden["parameters"].items()))
    assert result[name]["value"] == pytest.approx(size, rel=0.1)
