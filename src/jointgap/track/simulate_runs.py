"""Simulation: impacts, forces, modes, angles."""

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.track.finished_tables import Given
from jointgap.track.run_record import Record

MODES = ("flight", "impact", "contact")


def records(given: Given) -> list[Record]:
    """One run."""
    if not given.has(tables.TRAJECTORY):
        return []
    loose = given.options.mechanism.applied().loose
    metrics = _motion(given.read(tables.TRAJECTORY), loose)
    if given.has(tables.EVENTS):
        metrics |= _impacts(given.read(tables.EVENTS), loose)
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


def _motion(samples: pd.DataFrame, loose: tuple[str, ...]) -> dict[str, float]:
    metrics = {
        "samples": len(samples),
        "smallest_transmission_angle_deg": np.rad2deg(samples["transmission_angle"].min()),
        "largest_transmission_angle_deg": np.rad2deg(samples["transmission_angle"].max()),
        "peak_slider_acceleration_m_s2": samples["slider_acceleration"].abs().max(),
        "peak_crank_torque_N_m": samples["crank_torque"].abs().max(),
        "peak_guide_moment_N_m": samples["guide_moment"].abs().max(),
        "lowest_crank_speed_rpm": 30.0 / np.pi * samples["crank_speed"].min(),
        "highest_crank_speed_rpm": 30.0 / np.pi * samples["crank_speed"].max(),
    }
    for joint in loose:
        metrics[f"{joint}_peak_normal_force_N"] = samples[f"{joint}_normal_force"].max()
        metrics |= {f"{joint}_{mode}_share": (samples[f"{joint}_mode"] == mode).mean() for mode in MODES}
    return metrics


def _impacts(events: pd.DataFrame, loose: tuple[str, ...]) -> dict[str, float]:
    metrics = {}
    for joint in loose:
        impacts = events[(events["joint"] == joint) & (events["event"] == "impact")]
        metrics[f"{joint}_impacts"] = len(impacts)
        metrics[f"{joint}_peak_approach_speed_m_s"] = impacts["approach_speed"].max() if len(impacts) else 0.0
        rebounds = events[(events["joint"] == joint) & (events["maxima"] <= 1)]
        metrics[f"{joint}_largest_impulse_N_s"] = rebounds["impulse"].max() if len(rebounds) else 0.0
    return metrics
