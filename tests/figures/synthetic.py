"""Small tables of a made-up but consistent motion, for the figures to draw."""

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.config import Scenario, load_mechanism
from jointgap.kinematics import kinematics
from jointgap.mechanism import ClearanceMotion, Motion, linkage_motion

SAMPLES = 72  # a revolution, every 5 deg
TRAINING = 13  # points, every 30 deg


def scenario(**more) -> Scenario:
    """The paper's mechanism, sampled coarsely."""
    return Scenario.model_validate(
        {
            "mechanism": load_mechanism("config/mechanisms/erkaya2009.yaml").model_dump(),
            "simulate": {"samples_per_revolution": SAMPLES, "revolutions": 2},
            "surrogate": {"training_points": TRAINING},
            "optimise": {"ensemble": {"settled_revolution": 2, "members": 3}},
            "figures": {"animation_frames": 6},
        }
        | more
    )


def trajectory(options: Scenario) -> pd.DataFrame:
    """Journals that leave the centre, reach the wall and turn with the crank; undefined directions at the start."""
    simulate = options.simulate
    n = simulate.revolutions * simulate.samples_per_revolution + 1
    angle = simulate.start_angle + np.linspace(0.0, 2 * np.pi * simulate.revolutions, n)
    speed = simulate.speed
    gap = options.mechanism.crank_pin.clearance
    reached = 1.0 - np.exp(-3.0 * angle)
    length = Motion(gap * reached, gap * 3 * speed * np.exp(-3 * angle), -gap * 9 * speed**2 * np.exp(-3 * angle))

    def direction(lag: float, swing: float) -> Motion:
        position = angle - lag + swing * np.sin(2 * angle)
        velocity = speed * (1 + 2 * swing * np.cos(2 * angle))
        acceleration = -4 * swing * speed**2 * np.sin(2 * angle)
        position, velocity, acceleration = position.copy(), velocity.copy(), acceleration.copy()
        for values in (position, velocity, acceleration):
            values[0] = np.nan
        return Motion(position, velocity, acceleration)

    clearance = ClearanceMotion(r2=length, gamma2=direction(0.3, 0.1), r3=length, gamma3=direction(1.0, 0.2))
    motion = linkage_motion(options.mechanism, Motion.of(angle, speed), clearance)
    columns = {"time": (angle - angle[0]) / speed, "crank_angle": angle}
    for name in ("r2", "gamma2", "r3", "gamma3"):
        part = getattr(clearance, name)
        columns |= {name: part.position, f"{name}_dot": part.velocity, f"{name}_ddot": part.acceleration}
    for name, part in (("rod", (motion.rod_x, motion.rod_y)),):
        for axis, values in zip("xy", part, strict=True):
            columns |= {
                f"{name}_position_{axis}": values.position,
                f"{name}_velocity_{axis}": np.nan_to_num(values.velocity),
                f"{name}_acceleration_{axis}": np.nan_to_num(values.acceleration),
            }
    columns |= {
        "rod_angle": motion.rod_angle.position,
        "rod_angular_velocity": np.nan_to_num(motion.rod_angle.velocity),
        "rod_angular_acceleration": np.nan_to_num(motion.rod_angle.acceleration),
        "slider_position": motion.slider_x.position,
        "slider_velocity": np.nan_to_num(motion.slider_x.velocity),
        "slider_acceleration": np.nan_to_num(motion.slider_x.acceleration),
        "transmission_angle": motion.transmission_angle.position,
    }
    force = np.where(reached > 0.9, 800.0 * (1 + 0.5 * np.cos(angle)), 0.0)
    for joint in ("crank_pin", "piston_pin"):
        columns |= {
            f"{joint}_normal_force": force,
            f"{joint}_friction_force": 0.05 * force,
            f"{joint}_force_x": force * np.cos(angle),
            f"{joint}_force_y": force * np.sin(angle),
        }
    for name in ("crank_torque", "guide_force", "frame_force_x", "frame_force_y"):
        columns[name] = 10.0 * np.sin(angle)
    return pd.DataFrame(columns)[[column.name for column in tables.TRAJECTORY.columns]]


def fits(samples: pd.DataFrame) -> dict:
    """Straight lines between the samples in the place of networks, a little off."""

    def fit(output: str):
        known = samples[output].notna()
        angle, value = samples.loc[known, "crank_angle"].to_numpy(), 1.01 * samples.loc[known, output].to_numpy()
        slope = np.gradient(value, angle)
        return lambda x: (np.interp(x, angle, value), np.interp(x, angle, slope))

    return {output: fit(output) for output in tables.OUTPUTS}


def tables_of(options: Scenario) -> dict[str, pd.DataFrame]:
    """Every table that a figure needs, by name."""
    motion = trajectory(options)
    first = motion.iloc[: SAMPLES + 1]
    found = kinematics(options.mechanism, options.simulate, TRAINING, motion, {"networks": fits(first)})
    return {
        "trajectory": motion,
        "kinematics": found.motion,
        "kinematics_errors": found.errors,
        "kinematics_contradictions": found.contradictions,
    }
