"""Small tables for the figures to draw: of a coarse simulation, and made up of what takes long."""

import numpy as np
import pandas as pd

from jointgap.config import Scenario, load_mechanism
from jointgap.core import joints, schema
from jointgap.core.joints import PINS
from jointgap.dynamics.simulation import simulate
from jointgap.scenario.kinematics import kinematics
from jointgap.scenario.trained import predictions

SAMPLES = 360  # a revolution: so fine that an impact has some
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
            "simulate": {"samples_per_revolution": SAMPLES, "revolutions": 2, "tolerance": 1e-8},
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


def fits(samples: pd.DataFrame, learned: tuple[str, ...]) -> dict:
    """Straight lines between the samples in the place of networks, a little off."""

    def fit(output: str):
        known = samples[output].notna()
        angle, value = (
            samples.loc[known, "crank_angle"].to_numpy(),
            1.01 * samples.loc[known, output].to_numpy(),
        )
        slope = np.gradient(value, angle)
        return lambda x: (np.interp(x, angle, value), np.interp(x, angle, slope))

    return {output: fit(output) for output in learned}


def fit_history(learned: tuple[str, ...]) -> pd.DataFrame:
    """Errors that fall from two starts, outputs below each other."""
    step = np.arange(401)
    own = [
        {"output": output, "seed": seed, "mse": (1.0 + seed) / (1.0 + step) ** 2}
        for output in learned
        for seed in (0, 1)
    ]
    frames = [pd.DataFrame(one | {"iteration": step}) for one in own]
    return pd.concat(frames, ignore_index=True).assign(held_out_mse=np.nan, model="network")


def fit_errors(learned: tuple[str, ...]) -> pd.DataFrame:
    """Two networks and a regularised one, for both regions; the paper has no error for the crank
    pivot."""
    rows = []
    numbers = {column.name: 1e-5 for column in schema.FIT_ERRORS.columns if column.kind == "float"}
    numbers |= {column.name: 10 for column in schema.FIT_ERRORS.columns if column.kind == "int"}
    for place, output in enumerate(learned):
        for region in ("all", "past_60_deg"):
            for model, seed in (("network", 0), ("network", 1), ("regularised", 0)):
                errors = {
                    "training_mse": 1e-8 * (place + 1),
                    "held_out_mse": 10.0 ** -(5 + seed),
                }
                words = {
                    "output": output,
                    "unit": "1",
                    "model": model,
                    "region": region,
                    "stop": "done",
                }
                paper = {"paper_mse": np.nan if joints.number_of(output) == 1 else 1e-5}
                rows.append(numbers | errors | words | paper | {"seed": seed})
    return pd.DataFrame(rows)


def optimisation() -> dict[str, pd.DataFrame]:
    """A straight valley along one ratio, and what optimisers might have done on it."""
    cranks, rods = np.meshgrid(np.linspace(0.147, 0.153, 9), np.linspace(0.555, 0.564, 7))
    off_ratio = np.abs(cranks / rods - 0.2655)
    size = (1e-3 + off_ratio).ravel()
    point = {"source": "networks", "box": "paper"}
    valley = pd.DataFrame(
        {"crank_length": cranks.ravel(), "rod_length": rods.ravel(), "allowed": True}
    )
    valley = valley.assign(**point, rms=size, objective=size**2)
    rod = np.linspace(0.555, 0.564, 5)
    floor = pd.concat(
        pd.DataFrame(
            point
            | {
                "measure": measure,
                "crank_length": 0.2655 * rod,
                "rod_length": rod,
                "ratio": 0.2655,
                "value": 1e-3,
            }
            | {"reduction": factor * (rod - 0.55)}
        )
        for factor, measure in enumerate(("rms", "mean_absolute", "peak", "sum_of_squares"), 1)
    )
    steps = pd.DataFrame(
        {
            "crank_length": [0.1485, 0.1497],
            "rod_length": [0.556, 0.564],
            "objective": [2.0, 1.0],
        }
    )
    paths = pd.concat(steps.assign(**point, start=start, iteration=[0, 1]) for start in range(6))
    population = pd.concat(
        steps.assign(**point, generation=generation, individual=[0, 1], origin="first")
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
            numbers = {
                column.name: 0.1
                for column in schema.OPTIMISE_OPTIMA.columns
                if column.kind == "float"
            }
            numbers |= {
                column.name: None
                for column in schema.OPTIMISE_OPTIMA.columns
                if column.kind != "float"
            }
            lengths = {"crank_length": 0.1497, "rod_length": 0.563}
            optima.append(
                numbers | lengths | {"source": source, "point": name, "box": box, "method": method}
            )
            if source == "simulation" and box is None:
                continue  # named once
            for stretch in ("window", "settled"):
                for measure in ("rms", "mean_absolute", "peak", "sum_of_squares"):
                    numbers = {
                        column.name: 0.05
                        for column in schema.OPTIMISE_RESIMULATED.columns
                        if column.kind == "float"
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
    done, learned = (
        simulate(options.mechanism, options.simulate),
        joints.outputs(options.mechanism.loose),
    )
    first = done.samples.iloc[: SAMPLES + 1]
    surrogates = {"networks": fits(first, learned)}
    found = kinematics(options.mechanism, options.simulate, TRAINING, done.samples, surrogates)
    tables = {"trajectory": done.samples, "events": done.events, "kinematics": found["kinematics"]}
    tables |= {"predictions": predictions(surrogates, first), "fit_history": fit_history(learned)}
    return tables | {"fit_errors": fit_errors(learned)} | optimisation()
