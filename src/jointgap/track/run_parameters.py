"""The few parameters by which runs are told apart in MLflow; the whole configuration is an artifact of each run."""

import math
from collections.abc import Iterable

from jointgap.config import Scenario


def run_parameters(options: Scenario, window: bool = False) -> dict[str, str]:
    """What sets a scenario apart, by short names."""
    mechanism = options.mechanism.applied()
    loose = mechanism.loose
    contacts = [mechanism.joint(joint).contact for joint in loose]
    parameters = {
        "loose": ", ".join(joint.replace("_", " ") for joint in loose) or "none",
        "clearance_mm": _shared(1e3 * mechanism.clearance(joint) for joint in loose),
        "restitution": _shared(contact.restitution for contact in contacts),
        "friction": _shared(contact.friction for contact in contacts),
        "drive": options.simulate.drive.kind,
        "speed_rpm": f"{30.0 / math.pi * options.simulate.speed:.6g}",
    }
    if window:
        start, end = (math.degrees(angle) for angle in options.optimise.window)
        parameters["window_deg"] = f"{start:.6g} to {end:.6g}"
    return parameters


def _shared(values: Iterable[float]) -> str:
    texts = [f"{value:.6g}" for value in values]
    return ", ".join(texts if len(set(texts)) > 1 else texts[:1]) or "none"
