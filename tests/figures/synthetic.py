"""Small tables of a made-up but consistent motion, for the figures to draw."""

import numpy as np
import pandas as pd

from jointgap.config import Scenario, load_mechanism
from jointgap.core import joints, schema
from jointgap.core.joints import JOINT_NUMBERS, PINS
from jointgap.dynamics.kinematics import ClearanceMotion, Motion, linkage_motion
from jointgap.scenario.kinematics import kinematics
from jointgap.scenario.trained import predictions

SAMPLES = 72  # a revolution, every 5 deg
TRAINING = 13  # points, every 30 deg


JOINTS = ("crank_pivot", *PINS)


def scenario(loose=PINS, **more) -> Scenario:
    """The paper's mechanism with these joints loose, sampled coarsely."""
    mechanism = load_mechanism("config/mechanisms/erkaya2009.yaml").model_dump()
    for joint in JOINTS:
        mechanism["joints"][joint]["loose"] = joint in loose
    return Scenario.model_validate(
        {
            "mechanism": mechanism,
            "simulate": {"samples_per_revolution": SAMPLES, "revolutions": 2},
            "surrogate": {"training_points": TRAINING},
            "optimise": {
                "boxes": {"paper": {"crank_length": (0.147, 0.153), "rod_length": (0.555, 0.564)}},
                "ratio_limit": 0.27,
                "ensemble": {"settled_revolution": 2, "members": 3},
            },
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
    loose = options.mechanism.loose
    gap = 1e-3
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

    vectors = {}
    for joint, lag, swing in zip(JOINTS, (0.6, 0.3, 1.0), (0.3, 0.1, 0.2), strict=True):
        if joint in loose:
            number = JOINT_NUMBERS[joint]
            vectors |= {f"r{number}": length, f"gamma{number}": direction(lag, swing)}
    clearance = ClearanceMotion(**vectors)
    motion = linkage_motion(options.mechanism, Motion.of(angle, speed), clearance)
    columns = {
        "time": (angle - angle[0]) / speed,
        "crank_angle": angle,
        "crank_speed": speed,
        "crank_acceleration": 0.0,
    }
    ideal = {"r": Motion.of(np.zeros(n)), "gamma": Motion.of(*[np.full(n, np.nan)] * 3)}
    for name in (f"{quantity}{number}" for number in (1, 2, 3) for quantity in ideal):
        part = vectors.get(name, ideal[name[:-1]])
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
    for joint in JOINTS:
        mode = np.where(force > 0.0, np.where(angle < 2.0, "impact", "contact"), "flight")
        columns |= {
            f"{joint}_mode": mode if joint in loose else "ideal",
            f"{joint}_normal_force": force,
            f"{joint}_friction_force": 0.05 * force,
            f"{joint}_force_x": force * np.cos(angle),
            f"{joint}_force_y": force * np.sin(angle),
        }
    columns["rod_deflection"] = 0.0
    for name in ("crank_torque", "guide_force", "guide_moment", "frame_force_x", "frame_force_y"):
        columns[name] = 10.0 * np.sin(angle)
    return pd.DataFrame(columns)[[column.name for column in schema.TRAJECTORY.columns]]


def events(options: Scenario) -> pd.DataFrame:
    """Two rebounds and a contact that lasts to the end, in each loose joint."""
    rows = []
    for joint in options.mechanism.loose:
        for place, (angle, event) in enumerate(((0.5, "impact"), (0.6, "separation")) * 2 + ((2.0, "impact"),)):
            ends = (
                {"impulse": 0.1, "peak_force": 900.0, "maxima": 1.0, "duration": 1e-3} if event == "separation" else {}
            )
            ends |= {"approach_speed": 0.3 / (1 + place)} if event == "impact" else {}
            angle += options.simulate.start_angle + place / 4
            rows.append({"time": angle / 60.0, "crank_angle": angle, "joint": joint, "event": event} | ends)
    return pd.DataFrame(rows)[[column.name for column in schema.EVENTS.columns]]


def fits(samples: pd.DataFrame, learned: tuple[str, ...]) -> dict:
    """Straight lines between the samples in the place of networks, a little off."""

    def fit(output: str):
        known = samples[output].notna()
        angle, value = samples.loc[known, "crank_angle"].to_numpy(), 1.01 * samples.loc[known, output].to_numpy()
        slope = np.gradient(value, angle)
        return lambda x: (np.interp(x, angle, value), np.interp(x, angle, slope))

    return {output: fit(output) for output in learned}


def fit_history(learned: tuple[str, ...]) -> pd.DataFrame:
    """Errors that fall from two starts, outputs below each other."""
    iteration = np.arange(401)
    frames = [
        pd.DataFrame(
            {
                "output": output,
                "model": "network",
                "seed": seed,
                "iteration": iteration,
                "mse": (1.0 + seed) / (1.0 + iteration) ** 2,
            }
        )
        for output in learned
        for seed in (0, 1)
    ]
    return pd.concat(frames, ignore_index=True).assign(held_out_mse=np.nan)


def fit_errors(learned: tuple[str, ...]) -> pd.DataFrame:
    """Two networks and the second surrogate, for both regions; the paper has no error for the crank pivot."""
    rows = []
    numbers = {column.name: 1e-5 for column in schema.FIT_ERRORS.columns if column.kind == "float"}
    numbers |= {column.name: 10 for column in schema.FIT_ERRORS.columns if column.kind == "int"}
    for place, output in enumerate(learned):
        for region in ("all", "past_60_deg"):
            for model, seed in (("network", 0), ("network", 1), ("regularised", 0), ("clearance", None)):
                errors = {"training_mse": 1e-8 * (place + 1), "held_out_mse": 10.0 ** -(5 + (seed or 0))}
                words = {"output": output, "unit": "1", "model": model, "region": region, "stop": "done"}
                paper = {"paper_mse": np.nan if joints.number_of(output) == 1 else 1e-5}
                rows.append(numbers | errors | words | paper | {"seed": seed})
    return pd.DataFrame(rows).astype({"seed": "Int64"})


def optimisation() -> dict[str, pd.DataFrame]:
    """A straight valley along one ratio, and what optimisers might have done on it."""
    cranks, rods = np.meshgrid(np.linspace(0.147, 0.153, 9), np.linspace(0.555, 0.564, 7))
    off_ratio = np.abs(cranks / rods - 0.2655)
    size = (1e-3 + off_ratio).ravel()
    point = {"source": "networks", "box": "paper"}
    valley = pd.DataFrame({"crank_length": cranks.ravel(), "rod_length": rods.ravel(), "allowed": True})
    valley = valley.assign(**point, rms=size, mean_absolute=0.8 * size, peak=3.0 * size, sum_of_squares=size**2)
    rod = np.linspace(0.555, 0.564, 5)
    floor = pd.concat(
        pd.DataFrame(
            point
            | {"measure": measure, "crank_length": 0.2655 * rod, "rod_length": rod, "ratio": 0.2655, "value": 1e-3}
            | {"reduction": factor * (rod - 0.55), "invariant": 0.5}
        )
        for factor, measure in enumerate(("rms", "mean_absolute", "peak", "sum_of_squares"), 1)
    )
    steps = pd.DataFrame({"crank_length": [0.1485, 0.1497], "rod_length": [0.556, 0.564], "sum_of_squares": [2.0, 1.0]})
    paths = pd.concat(steps.assign(**point, start=start, iteration=[0, 1]) for start in range(6))
    population = pd.concat(
        steps.assign(**point, generation=generation, individual=[0, 1], origin="first", evaluations=2)
        for generation in range(3)
    )
    optima, resimulated = [], []
    for source in ("networks", "simulation"):
        for name, box, method in (
            ("original", None, "original"),
            ("printed_genetic", None, "printed"),
            (f"{source}_paper_genetic", "paper", "genetic"),
            (f"{source}_paper_local", "paper", "local"),
        ):
            numbers = {column.name: 0.1 for column in schema.OPTIMISE_OPTIMA.columns if column.kind == "float"}
            numbers |= {column.name: None for column in schema.OPTIMISE_OPTIMA.columns if column.kind != "float"}
            lengths = {"crank_length": 0.1497, "rod_length": 0.563}
            optima.append(numbers | lengths | {"source": source, "point": name, "box": box, "method": method})
            if source == "simulation" and box is None:
                continue  # named once
            for stretch in ("window", "settled"):
                for measure in ("rms", "mean_absolute", "peak", "sum_of_squares"):
                    numbers = {
                        column.name: 0.05 for column in schema.OPTIMISE_RESIMULATED.columns if column.kind == "float"
                    }
                    spread = {"reduction_low": -0.02, "reduction_high": 0.09}
                    words = {"point": name, "stretch": stretch, "measure": measure, "members": 3}
                    resimulated.append(numbers | spread | words | lengths)
    counts = [column.name for column in schema.OPTIMISE_OPTIMA.columns if column.kind == "int"]
    return {
        "optimise_valley": valley,
        "optimise_floor": floor.reset_index(drop=True),
        "optimise_paths": paths.reset_index(drop=True),
        "optimise_population": population.reset_index(drop=True),
        "optimise_optima": pd.DataFrame(optima).astype(dict.fromkeys(counts, "Int64")),
        "optimise_resimulated": pd.DataFrame(resimulated),
    }


def tables_of(options: Scenario) -> dict[str, pd.DataFrame]:
    """Every table that a figure needs, by name."""
    motion, learned = trajectory(options), joints.outputs(options.mechanism.loose)
    surrogates = {"networks": fits(motion.iloc[: SAMPLES + 1], learned)}
    found = kinematics(options.mechanism, options.simulate, TRAINING, motion, surrogates)
    return {
        "trajectory": motion,
        "events": events(options),
        "kinematics": found["kinematics"],
        "predictions": predictions(surrogates, motion.iloc[: SAMPLES + 1]),
        "fit_history": fit_history(learned),
        "fit_errors": fit_errors(learned),
    } | optimisation()
