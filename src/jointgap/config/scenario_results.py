"""The tables of one scenario."""

import re
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config.load import parse_options
from jointgap.config.mechanism import Mechanism
from jointgap.config.scenario import Scenario
from jointgap.config.yaml_files import plain_speeds
from jointgap.core import joints, parquet, schema
from jointgap.core.errors import InputError
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import TRAJECTORY, Table


def open_results(options: str, results: Path) -> "ScenarioResults":
    """The results of a scenario, given as a file or as JSON text."""
    is_text = options.lstrip().startswith("{")
    for remark in () if is_text else plain_speeds(options):
        print(f"jointgap: {remark}", file=sys.stderr)
    return ScenarioResults(results, parse_options(options), "--options" if is_text else options)


class ScenarioResults(ResultsFolder):
    """Reads and writes the tables of one scenario, which was read from the file `source`."""

    def __init__(self, path: Path, scenario: Scenario, source: str = "--options"):
        super().__init__(path)
        self.scenario, self.source = scenario, source

    def located(self, error: InputError) -> InputError:
        """The `error`; lines about a key begin with the file of the scenario."""
        section = re.compile(rf"(?:{'|'.join(Scenario.model_fields)})[.:]")
        return InputError(
            *(f"{self.source}: {line}" if section.match(line) else line for line in error.args)
        )

    @property
    def name(self) -> str:
        """Name of the scenario: that of its folder."""
        return self.path.resolve().name

    def read(self, table: Table | str, part: str = "") -> pd.DataFrame:
        """The frame of `table`. A table with one file per output is read for the output `part`, or
        for all outputs with an additional column ``output``.
        """
        table = schema.TABLES[table] if isinstance(table, str) else table
        if table == TRAJECTORY:
            return read_trajectory(self.place(table), self.scenario)
        if part or "{output}" not in table.path:
            return super().read(table, part)
        frames = []
        for output in outputs_of(self.scenario.mechanism):
            frame = super().read(table, output)
            frames.append(frame if "output" in frame else frame.assign(output=output))
        return pd.concat(frames, ignore_index=True)

    def files(self, tables: Iterable[Table]) -> dict[str, Path]:
        """Files of the `tables` that exist, by table, or ``table/output`` where there is one per
        output."""
        outputs = joints.outputs(self.scenario.mechanism.applied().loose)
        files = {}
        for table in tables:
            for output in outputs if "{output}" in table.path else ("",):
                files[f"{table.name}/{output}".rstrip("/")] = self.place(table, output)
        return {name: path for name, path in files.items() if path.is_file()}


def outputs_of(mechanism: Mechanism) -> tuple[str, ...]:
    """Columns that networks learn; InputError where all joints are ideal."""
    outputs = joints.outputs(mechanism.applied().loose)
    if not outputs:
        raise InputError(
            "all joints are ideal: without clearance the networks, the optimisation and the"
            " comparison have no data; make a joint loose, or run only the stage simulate"
        )
    return outputs


def read_trajectory(path: Path, scenario: Scenario) -> pd.DataFrame:
    """The trajectory in the file `path`; InputError where it does not match the options of
    `scenario`."""
    frame, options = parquet.read(TRAJECTORY, path), scenario.simulate
    if options.speed < 0:
        raise InputError(
            f"simulate.speed {options.speed:g} rad/s is clockwise; networks and optimisation"
            " require a positive speed: mirror the mechanism (opposite sign of slider.offset,"
            " gravity_direction and phases); the best lengths are the same"
        )
    samples = options.samples_per_revolution * options.revolutions + 1
    end = options.start_angle + 2.0 * np.pi * options.revolutions
    is_same = len(frame) == samples
    is_same &= np.allclose(
        frame["crank_angle"].iloc[[0, -1]], [options.start_angle, end], rtol=1e-9
    )
    if options.drive.kind != "measured":
        speed = options.speed
        if wave := scenario.mechanism.effect("speed_fluctuation"):
            phase = wave.order * options.start_angle - wave.phase_rad
            speed *= 1.0 + wave.ratio * np.cos(phase)
        is_same &= np.isclose(frame["crank_speed"].iloc[0], speed, rtol=1e-9)
    if not is_same:
        raise InputError(
            f"{path}: its {len(frame)} samples are not the {samples} of {options.revolutions}"
            f" revolutions at {options.speed:g} rad/s that the options ask for; give the options it"
            " was simulated with, or simulate again"
        )
    return frame
