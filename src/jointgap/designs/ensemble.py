"""Ensembles: every combination of varied values, each from several starts, written to Parquet while they are simulated.

Memory does not grow with the number of runs.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from jointgap.config import DrivenMechanism, Mechanism, Simulate
from jointgap.config.scenario import Runs
from jointgap.config.variations import VARIED_BY_WORD, stored_value, with_values
from jointgap.core import parquet, schema
from jointgap.core.joints import JOINTS
from jointgap.core.progress import followed
from jointgap.dynamics.integrate import EVENT, EVENT_NAMES, MODES, mode_numbers
from jointgap.dynamics.parallel import Outcome, Run, crank_speeds, rod_and_slider, simulate_runs
from jointgap.dynamics.simulation import perturbed_start

ROWS = 50_000
"""Rows that are gathered before they are written as one row group."""

SAMPLES, EVENTS, RUNS = "samples.parquet", "events.parquet", "runs.parquet"
"""Files of an ensemble in its folder."""

_REPEATED = ("run", "time", "crank_angle", "crank_speed", "rod_deflection", "rod_deflection_dot")
_VECTORS = ("r2_x", "r2_y", "r3_x", "r3_y")
_PIVOT = ("r1_x", "r1_y")
_CATEGORIES = {"joint": JOINTS, "event": tuple(EVENT_NAMES), **{f"{joint}_mode": MODES for joint in JOINTS}}

_KINDS = {"boolean": "bool", "integer": "int"} | dict.fromkeys(("floating", "mixed-integer-float", "empty"), "float")
"""Kind of the column of a varied value by what pandas infers of its values; words, or numbers among words, are text."""


def ensemble_runs(mechanism: Mechanism, options: Simulate, runs: Runs) -> Iterator[Run]:
    """Every combination of the varied values, each from several starts, which are the same for all combinations."""
    base = DrivenMechanism(mechanism=mechanism.applied(), simulate=options)
    combinations = [
        (with_values(base, dict(zip(runs.vary, values, strict=True)), "ensemble.vary"), values)
        for values in itertools.product(*runs.vary.values())
    ]
    # Starting clearance vectors [m]: zero first, then normally distributed in the loose joints
    starts = np.random.default_rng(runs.seed).normal(0.0, runs.perturbation, (runs.members, 6))
    starts[0] = 0.0
    for scenario, values in combinations:
        varied = {
            key: stored_value(scenario, key, value, "ensemble.vary")
            for key, value in zip(runs.vary, values, strict=True)
        }
        for start in perturbed_start(starts, scenario.mechanism.loose):
            yield Run(scenario.mechanism, scenario.simulate, start, values=varied)


@dataclass(frozen=True)
class Written:
    """What was written of an ensemble."""

    runs: int
    steps: int
    events: int
    reasons: Mapping[int, str]  # Why runs failed, by number

    @property
    def failed(self) -> int:
        """How many runs failed."""
        return len(self.reasons)


def write_ensemble(
    runs: Iterable[Run], folder: Path | str, workers: int | None = None, total: int | None = None
) -> Written:
    """Simulate runs and write their samples, events and what became of them to three Parquet files in `folder`.

    The files are `SAMPLES`, `EVENTS` and `RUNS`, tables as in `jointgap.core.schema`, rows in order of the
    runs whatever the number of workers. They appear when all is written. A run that fails is in the table of runs with
    its reason, and has no samples.
    """
    places = [Path(folder) / name for name in (SAMPLES, EVENTS, RUNS)]
    parquet.check_writable(*places)
    rows: list[dict] = []
    simulated = followed(simulate_runs(runs, workers), "runs of the ensemble", total)

    def save_samples(samples_path: str) -> None:
        def save_events(events_path: str) -> None:
            _stream(simulated, samples_path, events_path, rows)
            _write_runs(rows, places[2])  # inside, so that no samples appear without their runs

        parquet.write_atomically(places[1], save_events)

    parquet.write_atomically(places[0], save_samples)
    reasons = {row["run"]: row["reason"] for row in rows if row["reason"]}
    return Written(len(rows), sum(row["steps"] for row in rows), sum(row["events"] for row in rows), reasons)


def _stream(outcomes: Iterable[Outcome], samples_path: str, events_path: str, rows: list[dict]) -> None:
    with _Rows(schema.ENSEMBLE_SAMPLES, samples_path) as samples, _Rows(schema.ENSEMBLE_EVENTS, events_path) as events:
        for number, outcome in enumerate(outcomes):
            rows.append(_run_row(number, outcome))
            if outcome.result is not None:
                samples.add(_sample_columns(number, outcome))
                events.add(_event_columns(number, outcome))


def _run_row(number: int, outcome: Outcome) -> dict:
    start = np.zeros(6)
    if outcome.run.perturbation is not None:
        given = np.asarray(outcome.run.perturbation, dtype=float).ravel()[:6]
        start[: given.size] = given
    names = [f"start_{name}" for name in (*_VECTORS, *_PIVOT)]
    result = outcome.result
    return {
        "run": number,
        "values": outcome.run.values,
        **dict(zip(names, start, strict=True)),
        "samples": len(result.times) if result else 0,
        "events": len(result.events) if result else 0,
        "steps": result.steps if result else 0,
        "reason": str(outcome.error) if outcome.error else None,
    }


def _sample_columns(number: int, outcome: Outcome) -> dict[str, np.ndarray]:
    """Columns of the table of samples for one run that did not fail; modes as places in `MODES`."""
    p, result, n = outcome.parameters, outcome.result, len(outcome.crank_angle)
    auxiliary_states = result.auxiliary_states
    rod_angle, position = rod_and_slider(p, outcome.crank_angle, result.states, auxiliary_states)
    modes = mode_numbers(p, result.times, result.modes, result.events)
    return {
        "run": np.full(n, number),
        "time": result.times,
        "crank_angle": outcome.crank_angle,
        "crank_speed": crank_speeds(p, result.times, auxiliary_states),
        **{name: result.states[:, i] for i, name in enumerate(_VECTORS)},
        **{name: auxiliary_states[:, i] for i, name in enumerate(_PIVOT)},
        **{f"{name}_dot": result.states[:, 4 + i] for i, name in enumerate(_VECTORS)},
        **{f"{name}_dot": auxiliary_states[:, 4 + i] for i, name in enumerate(_PIVOT)},
        "rod_deflection": auxiliary_states[:, 3],
        "rod_deflection_dot": auxiliary_states[:, 7],
        **{f"{joint}_bristle": auxiliary_states[:, 8 + i] for i, joint in enumerate(JOINTS)},
        "rod_angle": rod_angle,
        "slider_position": position,
        **{f"{joint}_mode": modes[:, i] for i, joint in enumerate(JOINTS)},
    }


def _event_columns(number: int, outcome: Outcome) -> dict[str, np.ndarray]:
    """Columns of the table of events for one run; joints and events as places in `JOINTS` and `EVENT_NAMES`."""
    columns = dict(zip(EVENT, outcome.result.events.T, strict=True))
    columns["joint"] = columns["joint"].astype(np.int8)
    columns["event"] = columns.pop("begins").astype(np.int8)
    return {"run": np.full(len(columns["event"]), number), **columns}


class _Rows:
    """A Parquet file that takes rows and writes them in large groups."""

    def __init__(self, table: schema.Table, path: str):
        self.table, self.schema = table, parquet.schema(table)
        repeated = [c.name for c in table.columns if c.name in _REPEATED or c.kind != "float" or "bristle" in c.name]
        split = {c.name: "BYTE_STREAM_SPLIT" for c in table.columns if c.name not in repeated}
        self._file = parquet.writer(
            path,
            self.schema,
            compression="zstd",
            compression_level=1,
            use_dictionary=repeated,
            column_encoding=split,
            write_statistics=["run"],
        )
        self.waiting: list[dict[str, np.ndarray]] = []
        self.rows = 0

    def add(self, columns: dict[str, np.ndarray]) -> None:
        """Take the rows of one run."""
        self.waiting.append(columns)
        self.rows += len(columns["run"])
        if self.rows >= ROWS:
            self.flush()

    def flush(self) -> None:
        """Write what waits."""
        if self.rows:
            self.writer.write_table(
                pa.Table.from_arrays([self._array(c) for c in self.table.columns], schema=self.schema)
            )
        self.waiting, self.rows = [], 0

    def _array(self, column: schema.Column) -> pa.Array:
        values = np.concatenate([columns[column.name] for columns in self.waiting])
        if column.kind == "category":
            return pa.DictionaryArray.from_arrays(pa.array(values), pa.array(_CATEGORIES[column.name]))
        return pa.array(values, from_pandas=column.nullable)

    def __enter__(self) -> "_Rows":
        self.writer = self._file.__enter__()
        return self

    def __exit__(self, kind: type | None, *error: object) -> None:
        if kind is None:
            self.flush()
        self._file.__exit__(kind, *error)


def _write_runs(rows: list[dict], path: Path) -> None:
    names = rows[0]["values"] if rows else ()
    values = {name: pd.Series([row["values"].get(name) for row in rows], dtype=object) for name in names}
    varied = [_varied(name, own) for name, own in values.items()]
    table = schema.ENSEMBLE_RUNS.filled(varied=varied)
    frame = pd.DataFrame(rows, columns=list(table.names))
    for column in varied:
        own = values[column.name]
        if column.kind == "float":
            own = own.astype(float)
        frame[column.name] = own.map(str, na_action="ignore") if column.kind == "text" else own
    parquet.write(table, frame, path)


def _varied(name: str, values: pd.Series) -> schema.Column:
    """The column of a varied value, of a kind that holds the values of all runs."""
    kind, nullable = _KINDS.get(pd.api.types.infer_dtype(values, skipna=True), "text"), bool(values.isna().any())
    if kind == "int" and nullable:
        kind = "float"  # only floats tell of no value in a frame
    return schema.Column(name, VARIED_BY_WORD.get(name, ""), f"{name}, varied", kind, nullable=nullable)
