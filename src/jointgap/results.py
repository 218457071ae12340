"""A scenario's results folder: where each table lies. One list for the rules and the command line."""

from collections.abc import Iterable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.config import Mechanism, Scenario
from jointgap.errors import InputError
from jointgap.joints import JOINT_NUMBERS
from jointgap.mechanism import Fit
from jointgap.surrogate.clearance_network import ClearanceNetwork
from jointgap.surrogate.crank_speed import CrankSpeed
from jointgap.surrogate.evaluate import values_and_slopes
from jointgap.surrogate.network import Network
from jointgap.tables import Table

PLACES = {
    "trajectory": "simulate/trajectory.parquet",
    "events": "simulate/events.parquet",
    "fit": "surrogate/{output}/fit.parquet",
    "fit_history": "surrogate/{output}/history.parquet",
    "fit_errors": "surrogate/{output}/errors.parquet",
    "clearance_fit": "surrogate/clearance/fit.parquet",
    "kinematics": "kinematics/motion.parquet",
    "kinematics_errors": "kinematics/errors.parquet",
    "kinematics_contradictions": "kinematics/contradictions.parquet",
    "optimise_optima": "optimise/optima.parquet",
    "optimise_population": "optimise/population.parquet",
    "optimise_paths": "optimise/paths.parquet",
    "optimise_tolerance": "optimise/tolerance.parquet",
    "optimise_valley": "optimise/valley.parquet",
    "optimise_floor": "optimise/floor.parquet",
    "optimise_resimulated": "optimise/resimulated.parquet",
    "optimise_worth": "optimise/worth.parquet",
    "comparison": "comparison.parquet",
}
"""Path of each table within ``results/{scenario}``; ``{output}`` stands for an output of a loose joint."""

CLEARANCE = "clearance"
"""Stands for an output where the second surrogate has all of them in one file."""

TABLES = {table.name: table for table in vars(tables).values() if isinstance(table, Table)}


def outputs_of(mechanism: Mechanism) -> tuple[str, ...]:
    """What networks learn of a mechanism.

    Raises
    ------
    InputError
        All its joints are ideal.
    """
    outputs = tables.outputs(mechanism.applied().loose)
    if not outputs:
        raise InputError(
            "all joints are ideal: without clearance there is nothing to learn, to optimise or to compare; make a joint loose, or "
            "run the stage simulate alone"
        )
    return outputs


def parts(table: str, mechanism: Mechanism) -> tuple[str, ...]:
    """What ``{output}`` stands for in the place of `table`; errors as `outputs_of`."""
    outputs = outputs_of(mechanism)
    return (*outputs, CLEARANCE) if table == "fit_errors" else outputs


def tables_of(stage: str) -> dict[str, str]:
    """The tables that `stage` writes, by name, and their paths within the scenario's folder."""
    return {name: place for name, place in PLACES.items() if place.startswith(f"{stage}/")}


def read_trajectory(path: Path, scenario: Scenario) -> pd.DataFrame:
    """The trajectory in `path`, which has to be the one that `scenario` asks for.

    Raises
    ------
    InputError
        As `jointgap.tables.read`, or the file was simulated with other samples, revolutions, start or speed.
    """
    frame, options = tables.read(tables.TRAJECTORY, path), scenario.simulate
    samples, turned = options.samples_per_revolution * options.revolutions + 1, 2.0 * np.pi * options.revolutions
    ends, speed = [options.start_angle, options.start_angle + turned], _starting_speed(scenario)
    fits = len(frame) == samples and np.allclose(frame["crank_angle"].iloc[[0, -1]], ends, rtol=1e-9, atol=1e-9)
    if not fits or (speed is not None and not np.isclose(frame["crank_speed"].iloc[0], speed, rtol=1e-9)):
        raise InputError(
            f"{path}: its {len(frame)} samples are not the {samples} of {options.revolutions} revolutions at "
            f"{options.speed:g} rad/s that the options ask for; give the options it was simulated with, or simulate again"
        )
    return frame


def _starting_speed(scenario: Scenario) -> float | None:
    """The crank's speed at the start [rad/s]; None where it is measured."""
    options, wave = scenario.simulate, scenario.mechanism.effect("speed_fluctuation")
    if options.drive.kind == "measured":
        return None
    factor = 1.0 + wave.ratio * np.cos(wave.order * options.start_angle - wave.phase_rad) if wave else 1.0
    return options.speed * factor


class Results:
    """Tables of one scenario, read from and written to their places.

    Parameters
    ----------
    folder : Path
        ``results/{scenario}``.
    scenario : Scenario
        What the tables were made with; a trajectory that was not is refused.
    """

    def __init__(self, folder: Path, scenario: Scenario):
        self.folder = folder
        self.scenario = scenario

    def read(self, table: Table) -> pd.DataFrame:
        """The frame of `table`; where there is a file per output, all below each other, with a column output.

        Raises
        ------
        InputError
            A file is missing or is not that table, or the trajectory is not the one that the options ask for.
        """
        place = PLACES[table.name]
        if table is tables.TRAJECTORY:
            return read_trajectory(self.folder / place, self.scenario)
        if "{output}" not in place:
            return tables.read(table, self.folder / place)
        frames = []
        for output in parts(table.name, self.scenario.mechanism):
            frame = tables.read(table, self.folder / place.format(output=output))
            frames.append(frame if "output" in frame else frame.assign(output=output))
        return pd.concat(frames, ignore_index=True)

    def frames(self, names: Iterable[str]) -> dict[str, pd.DataFrame]:
        """The frames of the tables `names`."""
        return {name: self.read(TABLES[name]) for name in names}

    def check_writable(self, stage: str) -> None:
        """Make sure that the tables of `stage` can be written before it starts; an `InputError` where they cannot."""
        tables.check_writable(*(self.folder / place for place in tables_of(stage).values()))

    def write(self, table: Table, frame: pd.DataFrame) -> None:
        """Write `frame` to the table's place."""
        tables.write(table, frame, self.folder / PLACES[table.name])

    def files(self) -> dict[str, Path]:
        """The tables' files that exist, by table, or ``table/output`` where there is one per output."""
        found, mechanism = {}, self.scenario.mechanism
        for name, place in PLACES.items():
            if "{output}" not in place:
                found[name] = self.folder / place
            elif mechanism.applied().loose:
                outputs = parts(name, mechanism)
                found |= {f"{name}/{output}": self.folder / place.format(output=output) for output in outputs}
        return {name: path for name, path in found.items() if path.is_file()}

    def surrogates(self) -> dict[str, dict[str, Fit]]:
        """The trained surrogates as functions of the crank angle: ``networks`` (default seed) and ``clearance``, by output."""
        fits = self.read(tables.FIT)
        networks = {output: Network.from_frame(fit) for output, fit in fits.groupby("output", sort=False)}
        fit = self.read(tables.CLEARANCE_FIT)
        speed = CrankSpeed.of(self.read(tables.TRAJECTORY)) if fit["speed"].isna().any() else None
        numbers = [JOINT_NUMBERS[joint] for joint in self.scenario.mechanism.applied().loose]
        joints = {number: ClearanceNetwork.from_frame(fit, number, speed) for number in numbers}
        outputs = outputs_of(self.scenario.mechanism)
        return {
            "networks": {output: partial(values_and_slopes, network) for output, network in networks.items()},
            CLEARANCE: {output: partial(joints[tables.number_of(output)].output, output) for output in outputs},
        }
