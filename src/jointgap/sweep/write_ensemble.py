"""Ensembles to Parquet while they are simulated: memory does not grow with the number of runs."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from jointgap import tables
from jointgap.dynamics.parallel_runs import Outcome, Run, crank_speeds, march_runs, rod_and_slider
from jointgap.dynamics.solver.contact_episodes import EVENT, EVENT_NAMES, MODES, mode_numbers
from jointgap.joints import JOINTS
from jointgap.sweep.variation import WORDS

ROWS = 50_000
"""Rows that are gathered before they are written as one row group."""

SAMPLES, EVENTS, RUNS = "samples.parquet", "events.parquet", "runs.parquet"
"""Files of an ensemble in its folder."""

_REPEATED = ("run", "time", "crank_angle", "crank_speed", "rod_deflection", "rod_deflection_dot")
_VECTORS = ("r2_x", "r2_y", "r3_x", "r3_y")
_PIVOT = ("r1_x", "r1_y")


@dataclass(frozen=True)
class Written:
    """What an ensemble came to.

    Attributes
    ----------
    runs, failed, steps, events : int
    reasons : dict of int to str
        Why runs failed, by number.
    """

    runs: int
    steps: int
    events: int
    reasons: Mapping[int, str]

    @property
    def failed(self) -> int:
        """How many runs failed."""
        return len(self.reasons)


def write_ensemble(runs: Iterable[Run], folder: Path | str, workers: int | None = None) -> Written:
    """Simulate runs and write their samples, events and what became of them to three Parquet files in `folder`.

    The files are ``samples.parquet``, ``events.parquet`` and ``runs.parquet``, tables as in `jointgap.tables.ensemble_tables`, rows
    in order of the runs whatever the number of workers. They appear when all is written. A run that fails is in
    the table of runs with its reason, and has no samples.

    Parameters
    ----------
    runs : iterable of Run
        All with the same names of `values`.
    folder : path
    workers : int, optional
        See `jointgap.dynamics.parallel_runs.march_runs`.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    places = [Path(folder) / name for name in (SAMPLES, EVENTS, RUNS)]
    tables.check_writable(*places)
    told: list[dict] = []

    def save_samples(samples_path):
        def save_events(events_path):
            _stream(runs, samples_path, events_path, workers, told)
            _write_runs(told, places[2])  # inside, so that no samples appear without their runs

        tables.write_whole(places[1], save_events)

    tables.write_whole(places[0], save_samples)
    reasons = {row["run"]: row["reason"] for row in told if row["reason"]}
    return Written(len(told), sum(row["steps"] for row in told), sum(row["events"] for row in told), reasons)


def _stream(runs: Iterable[Run], samples_path: str, events_path: str, workers: int | None, told: list[dict]) -> None:
    with _Rows(tables.ENSEMBLE_SAMPLES, samples_path) as samples, _Rows(tables.ENSEMBLE_EVENTS, events_path) as events:
        for number, outcome in enumerate(march_runs(runs, workers)):
            told.append(_told(number, outcome))
            if outcome.march is not None:
                samples.add(sample_columns(number, outcome))
                events.add(event_columns(number, outcome))


def _told(number: int, outcome: Outcome) -> dict:
    start = np.zeros(6)
    if outcome.run.perturbation is not None:
        given = np.asarray(outcome.run.perturbation, dtype=float).ravel()[:6]
        start[: given.size] = given
    names = [f"start_{name}" for name in (*_VECTORS, *_PIVOT)]
    march = outcome.march
    return {
        "run": number,
        "values": outcome.run.values,
        **dict(zip(names, start, strict=True)),
        "samples": len(march.times) if march else 0,
        "events": len(march.events) if march else 0,
        "steps": march.steps if march else 0,
        "reason": str(outcome.error) if outcome.error else None,
    }


def sample_columns(number: int, outcome: Outcome) -> dict[str, np.ndarray]:
    """Columns of the table of samples for one run that did not fail; modes as places in `MODES`."""
    p, march, n = outcome.parameters, outcome.march, len(outcome.crank_angle)
    further = march.further
    rod_angle, position = rod_and_slider(p, outcome.crank_angle, march.states, further)
    modes = mode_numbers(p, march.times, march.modes, march.events)
    return {
        "run": np.full(n, number),
        "time": march.times,
        "crank_angle": outcome.crank_angle,
        "crank_speed": crank_speeds(p, march.times, further),
        **{name: march.states[:, i] for i, name in enumerate(_VECTORS)},
        **{name: further[:, i] for i, name in enumerate(_PIVOT)},
        **{f"{name}_dot": march.states[:, 4 + i] for i, name in enumerate(_VECTORS)},
        **{f"{name}_dot": further[:, 4 + i] for i, name in enumerate(_PIVOT)},
        "rod_deflection": further[:, 3],
        "rod_deflection_dot": further[:, 7],
        **{f"{joint}_bristle": further[:, 8 + i] for i, joint in enumerate(JOINTS)},
        "rod_angle": rod_angle,
        "slider_position": position,
        **{f"{joint}_mode": modes[:, i] for i, joint in enumerate(JOINTS)},
    }


def event_columns(number: int, outcome: Outcome) -> dict[str, np.ndarray]:
    """Columns of the table of events for one run; joints and events as places in `JOINTS` and `EVENT_NAMES`."""
    found = dict(zip(EVENT, outcome.march.events.T, strict=True))
    found["joint"] = found["joint"].astype(np.int8)
    found["event"] = found.pop("begins").astype(np.int8)
    return {"run": np.full(len(found["event"]), number), **found}


_CATEGORIES = {"joint": JOINTS, "event": tuple(EVENT_NAMES), **{f"{joint}_mode": MODES for joint in JOINTS}}


class _Rows:
    """A Parquet file that takes rows and writes them in large groups."""

    def __init__(self, table: tables.Table, path: str):
        self.table, self.schema = table, table.schema()
        repeated = [c.name for c in table.columns if c.name in _REPEATED or c.kind != "float" or "bristle" in c.name]
        split = {c.name: "BYTE_STREAM_SPLIT" for c in table.columns if c.name not in repeated}
        self.writer = pq.ParquetWriter(
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

    def _array(self, column: tables.Column) -> pa.Array:
        values = np.concatenate([one[column.name] for one in self.waiting])
        if column.kind == "category":
            return pa.DictionaryArray.from_arrays(pa.array(values), pa.array(_CATEGORIES[column.name]))
        return pa.array(values, from_pandas=column.nullable)

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        if kind is None:
            self.flush()
        self.writer.close()


_KINDS = {"bool": (bool, np.bool_), "int": (int, np.integer), "float": (float, np.floating), "text": (str,)}
"""Types of varied values by the kind of their column; a bool is an int too, so it comes first."""

_STORED = {"bool": bool, "int": int, "float": float, "text": str}


def _write_runs(told: list[dict], path: Path) -> None:
    import pandas as pd

    values = {name: [row["values"].get(name) for row in told] for name in (told[0]["values"] if told else {})}
    varied = [_varied(name, own) for name, own in values.items()]
    table = tables.ensemble_runs(varied)
    frame = pd.DataFrame(told, columns=[column.name for column in table.columns])
    for column in varied:
        absent, stored = np.nan if column.kind == "float" else None, _STORED[column.kind]
        own = [absent if value is None else stored(value) for value in values[column.name]]
        frame[column.name] = pd.Series(own, dtype=float if column.kind == "float" else object)
    tables.write(table, frame, path)


def _varied(name: str, values: list) -> tables.Column:
    """The column of a varied value, of a kind that holds the values of all runs; numbers among words become words."""
    kinds = {_kind(value) for value in values if value is not None}
    if kinds <= {"int", "float"}:
        # Only floats tell of no value in a frame.
        kind = "int" if kinds == {"int"} and None not in values else "float"
    else:
        kind = kinds.pop() if len(kinds) == 1 else "text"
    return tables.Column(name, WORDS.get(name, ""), f"{name}, varied", kind, nullable=None in values)


def _kind(value: object) -> str:
    return next((kind for kind, types in _KINDS.items() if isinstance(value, types)), "text")
