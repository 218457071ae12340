"""Small tables for the figures to draw: of a coarse simulation, and made up of what takes long."""

from itertools import product

import numpy as np
import pandas as pd

from jointgap.config import Scenario, load_mechanism
from jointgap.core import joints, schema
from jointgap.core.joints import PINS
from jointgap.motion.slider_crank import simulate
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
        angle = samples.loc[known, "crank_angle"].to_numpy()
        value = 1.01 * samples.loc[known, output].to_numpy()
        slope = np.gradient(value, angle)
        return lambda x: (np.interp(x, angle, value), np.interp(x, angle, slope))

    return {output: fit(output) for output in learned}


def fit_history(learned: tuple[str, ...]) -> pd.DataFrame:
    """Errors that fall from two starts."""
    step = np.arange(401)
    starts = [(output, seed) for output in learned for seed in (0, 1)]
    frames = [
        pd.DataFrame({"iteration": step, "mse": (1.0 + seed) / (1.0 + step) ** 2}).assign(
            output=output, seed=seed
        )
        for output, seed in starts
    ]
    return pd.concat(frames, ignore_index=True).assign(held_out_mse=np.nan, model="network")


def constants(table, number: float) -> dict:
    """A row with this number in all columns of numbers and none in the others."""
    return {column.name: number if column.kind == "float" else None for column in table.columns}


def fit_errors(learned: tuple[str, ...]) -> pd.DataFrame:
    """Two networks and a regularised one, in both regions; the paper has no error for the crank
    pivot."""
    rows = []
    numbers = constants(schema.FIT_ERRORS, 1e-5)
    numbers |= {column.name: 10 for column in schema.FIT_ERRORS.columns if column.kind == "int"}
    models = (("network", 0), ("network", 1), ("regularised", 0))
    for place, output in enumerate(learned):
        words = {"output": output, "unit": "1", "stop": "done"}
        words["paper_mse"] = np.nan if joints.number_of(output) == 1 else 1e-5
        for region, (model, seed) in product(("all", "past_60_deg"), models):
            errors = {"training_mse": 1e-8 * (place + 1), "held_out_mse": 10.0 ** -(5 + seed)}
            key = {"model": model, "seed": seed, "region": region}
            rows.append(numbers | errors | words | key)
    return pd.DataFrame(rows)


def optimisation() -> dict[str, pd.DataFrame]:
    """A straight line of equal ratio with low objective, and made-up results of optimisers."""
    cranks, rods = np.meshgrid(np.linspace(0.147, 0.153, 9), np.linspace(0.555, 0.564, 7))
    size = (1e-3 + np.abs(cranks / rods - 0.2655)).ravel()
    point = {"source": "networks", "box": "paper"}
    grid = pd.DataFrame({"crank_length": cranks.ravel(), "rod_length": rods.ravel()})
    grid = grid.assign(**point, rms=size, objective=size**2, allowed=True)
    rod = np.linspace(0.555, 0.564, 5)
    lengths = pd.DataFrame({"crank_length": 0.2655 * rod, "rod_length": rod, "ratio": 0.2655})
    measures = ("rms", "mean_absolute", "peak", "sum_of_squares")
    floor = pd.concat(
        lengths.assign(**point, measure=measure, value=1e-3, reduction=factor * (rod - 0.55))
        for factor, measure in enumerate(measures, 1)
    )
    steps = pd.DataFrame({"crank_length": [0.1485, 0.1497], "rod_length": [0.556, 0.564]})
    steps = steps.assign(**point, objective=[2.0, 1.0])
    paths = pd.concat(steps.assign(start=start, iteration=[0, 1]) for start in range(6))
    population = pd.concat(
        steps.assign(generation=generation, individual=[0, 1], origin="first")
        for generation in range(3)
    )
    optima, resimulated = [], []
    lengths = {"crank_length": 0.1497, "rod_length": 0.563}
    for source in ("networks", "simulation"):
        for name, box, method in (
            ("original", None, "original"),
            ("printed_genetic", None, "printed"),
            (f"{source}_paper_genetic", "paper", "genetic"),
            (f"{source}_paper_local", "paper", "local"),
        ):
            key = {"source": source, "point": name, "box": box, "method": method}
            optima.append(constants(schema.OPTIMISE_OPTIMA, 0.1) | lengths | key)
            if source == "simulation" and box is None:
                continue  # named once
            for stretch, measure in product(("window", "settled"), measures):
                spread = {"reduction_low": -0.02, "reduction_high": 0.09}
                words = {"point": name, "stretch": stretch, "measure": measure, "members": 3}
                numbers = constants(schema.OPTIMISE_RESIMULATED, 0.05)
                resimulated.append(numbers | spread | words | lengths)
    counts = [column.name for column in schema.OPTIMISE_OPTIMA.columns if column.kind == "int"]
    return {
        "optimise_valley": grid,
        "optimise_floor": floor.reset_index(drop=True),
        "optimise_paths": paths.reset_index(drop=True),
        "optimise_population": population.reset_index(drop=True),
        "optimise_optima": pd.DataFrame(optima).astype(dict.fromkeys(counts, "Int64")),
        "optimise_resimulated": pd.DataFrame(resimulated),
    }


def tables_of(options: Scenario) -> dict[str, pd.DataFrame]:
    """Every table that a figure needs, by name."""
    done = simulate(options.mechanism, options.simulate)
    learned = joints.outputs(options.mechanism.loose)
    first = done.samples.iloc[: SAMPLES + 1]
    surrogates = {"networks": fits(first, learned)}
    found = kinematics(options.mechanism, options.simulate, TRAINING, done.samples, surrogates)
    tables = {"trajectory": done.samples, "events": done.events, "kinematics": found["kinematics"]}
    tables |= {"predictions": predictions(surrogates, first), "fit_history": fit_history(learned)}
    return tables | {"fit_errors": fit_errors(learned)} | optimisation()
