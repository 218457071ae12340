"""Small campaigns for the tests of the slider-crank as a model, and recordings made by the
package's plain simulation.
"""

from copy import deepcopy

import numpy as np

from jointgap.config import Simulate
from jointgap.config.campaign import Campaign
from jointgap.config.channels import CHANNELS as UNITS
from jointgap.core.candidates import Candidate
from jointgap.motion.slider_crank import simulate
from jointgap.rig.model import LinkageModel, build_model
from jointgap.rig.recording import Measurements, Recording
from tests.motion.cases import BODIES, joint

CHANNELS = (
    "time crank_angle crank_speed slider_position slider_acceleration rod_acceleration_y"
    " crank_torque guide_force frame_force_y"
).split()


def mechanism(loose: tuple[str, ...] = (), friction: float = 0.1, effects=(), **changes) -> dict:
    """A mechanism file's content: every joint has data, `loose` ones 0.5 mm of clearance."""
    carriers = {"crank_pivot": "crank", "crank_pin": "crank", "piston_pin": "slider"}
    joints = {
        name: joint(name in loose, carrier, 7e-3, 0.5e-3, "steel")
        for name, carrier in carriers.items()
    }
    contacts = {"steel": {"restitution": 0.46, "friction": friction}}
    return (
        deepcopy(BODIES)
        | {"joints": joints, "contacts": contacts, "effects": list(effects)}
        | changes
    )


def campaign(
    content: dict, channels=CHANNELS, speeds=(30.0, 45.0), run=None, sensors=None, **keys
) -> Campaign:
    """A campaign with a run for fitting and one held out; `run` are keys of both, `sensors` of
    channels."""
    runs = [
        {"id": name, "file": f"{name}.csv", "speed": speed, "role": role} | (run or {})
        for name, speed, role in zip(("slow", "fast"), speeds, ("identify", "confirm"), strict=True)
    ]
    own = {
        name: {"column": name, "unit": UNITS[name]} | (sensors or {}).get(name, {})
        for name in channels
    }
    return Campaign.model_validate(
        {"name": "rig", "mechanism": content, "runs": runs, "channels": own} | keys
    )


def recorded(
    own: Campaign,
    dropped: int = 2,
    kept: int = 2,
    per_turn: int = 90,
    tolerance: float = 1e-9,
    **options,
):
    """What sensors without noise read of `own`'s mechanism: the last `kept` of `dropped + kept`
    simulated revolutions.
    """
    runs = {}
    for run in own.runs:
        asked = {
            "speed": run.speed,
            "revolutions": dropped + kept,
            "samples_per_revolution": per_turn,
        }
        frame = simulate(
            own.mechanism, Simulate(**asked | {"tolerance": tolerance} | options)
        ).samples
        frame = frame.iloc[dropped * per_turn :]
        # read as recorded by a clock that was set some time before
        time, angle = (
            frame["time"].to_numpy() - frame["time"].iloc[0],
            frame["crank_angle"].to_numpy(copy=True),
        )
        known = {
            name: frame[name].to_numpy(copy=True)
            for name in own.channels
            if name not in ("time", "crank_angle")
        }
        nothing = np.full(time.size, np.nan)
        runs[run.id] = Recording(
            run.id,
            time if "time" in own.channels else nothing,
            angle if "crank_angle" in own.channels else nothing,
            known,
            dict.fromkeys([*known, "crank_angle"]),
            np.full(time.size, run.role == "confirm"),
        )
    return Measurements(runs)


def rig(content: dict | None = None, channels=CHANNELS, **keys) -> LinkageModel:
    """The model of a campaign with exact readings of its sensors."""
    if "drive" not in keys:  # an angle whose noise is not stated looks computed
        keys["sensors"] = {"crank_angle": {"noise": 1e-6}} | keys.get("sensors", {})
    rig_campaign = campaign(content or mechanism(), channels, **keys)
    return build_model(rig_campaign, recorded(rig_campaign))


def chosen(model: LinkageModel, label: str) -> Candidate:
    """The candidate with this label."""
    return next(item for item in model.candidates if item.label == label)


def read(
    model: LinkageModel, *effects: tuple[str, dict], run="slow", **values: float
) -> dict[str, np.ndarray]:
    """Readings of a model in a run, with effects by their labels and `values` that are not
    nominal."""
    return model.simulate(
        run, model.nominal(run) | values, [(chosen(model, label), own) for label, own in effects]
    )


def seen(model: LinkageModel, run="slow") -> dict[str, np.ndarray]:
    """Readings of a run by channel."""
    return {series.channel: series.value for series in model.series if series.run == run}


def worst(found: dict[str, np.ndarray], expected: dict[str, np.ndarray]) -> float:
    """Largest difference between two sets of channels, in standard deviations of the channel (or of
    1 where it is steady).
    """
    return max(
        float(np.max(np.abs(found[name] - expected[name])) / max(np.std(expected[name]), 1e-3))
        for name in expected
    )
