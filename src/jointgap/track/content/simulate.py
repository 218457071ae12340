"""Simulation: impacts, forces, angles."""

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.track.content.given import Given
from jointgap.track.record import Record

JOINTS = ("crank_pin", "piston_pin")


def records(given: Given) -> list[Record]:
    """One run."""
    if not given.has(tables.TRAJECTORY):
        return []
    metrics = _motion(given.read(tables.TRAJECTORY))
    if given.has(tables.EVENTS):
        metrics |= _impacts(given.read(tables.EVENTS))
    datasets = given.datasets([], ["trajectory", "events"])
    return [
        Record(
            "simulate",
            metrics=metrics,
            datasets=datasets,
            costs=given.cost("simulate"),
            **given.configuration("simulate"),
        )
    ]


def _motion(samples: pd.DataFrame) -> dict[str, float]:
    metrics = {
        "samples": len(samples),
        "smallest_transmission_angle_deg": np.rad2deg(samples["transmission_angle"].min()),
        "largest_transmission_angle_deg": np.rad2deg(samples["transmission_angle"].max()),
        "peak_slider_acceleration_m_s2": samples["slider_acceleration"].abs().max(),
        "peak_crank_torque_N_m": samples["crank_torque"].abs().max(),
    }
    for joint in JOINTS:
        force = samples[f"{joint}_normal_force"]
        metrics |= {f"{joint}_peak_normal_force_N": force.max(), f"{joint}_contact_share": (force > 0).mean()}
    return metrics


def _impacts(events: pd.DataFrame) -> dict[str, float]:
    metrics = {}
    for joint in JOINTS:
        impacts = events[(events["joint"] == joint) & (events["event"] == "impact")]
        metrics[f"{joint}_impacts"] = len(impacts)
        metrics[f"{joint}_peak_approach_speed_m_s"] = impacts["approach_speed"].max() if len(impacts) else 0.0
    return metrics
