"""Ensembles: all combinations of varied values, each from several starts, written to Parquet with
constant memory."""

import itertools
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config import DrivenMechanism, Mechanism, Simulate
from jointgap.config.scenario import Runs
from jointgap.config.variations import VARIED_BY_WORD, stored_value, with_values
from jointgap.core import parquet, schema
from jointgap.core.joints import JOINTS
from jointgap.core.progress import with_progress
from jointgap.dynamics.integrate import EVENT, EVENT_NAMES, MODES, mode_numbers
from jointgap.dynamics.parallel import Outcome, Run, crank_speeds, rod_and_slider, simulate_runs
from jointgap.dynamics.simulation import perturbed_start

ROWS = 50_000
"""Rows per row group."""

SAMPLES, EVENTS, RUNS = "samples.parquet", "events.parquet", "runs.parquet"
"""Files of an ensemble."""

_REPEATED = ("run", "time", "crank_angle", "crank_speed", "rod_deflection", "rod_deflection_dot")
_VECTORS, _PIVOT = ("r2_x", "r2_y", "r3_x", "r3_y"), ("r1_x", "r1_y")
_CATEGORIES = {
    "joint": JOINTS,
    "event": EVENT_NAMES,
    **{f"{joint}_mode": MODES for joint in JOINTS},
}

_KINDS = {"boolean": "bool", "integer": "int"} | dict.fromkeys(
    ("floating", "mixed-integer-float", "empty"), "float"
)
"""Column kind of a varied value, by pandas' inferred type; mixed values are text."""


def ensemble_runs(mechanism: Mechanism, options: Simulate, runs: Runs) -> Iterator[Run]:
    """All combinations of the varied values, each from the same starts."""
    base = DrivenMechanism(mechanism=mechanism.applied(), simulate=options)
    combinations = [
        dict(zip(runs.vary, values, strict=True))
        for values in itertools.product(*runs.vary.values())
    ]
    scenarios = [with_values(base, values, "ensemble.vary") for values in combinations]
    # Initial clearance vectors [m]: zero, then normally distributed in the loose joints
    starts = np.random.default_rng(runs.seed).normal(0.0, runs.perturbation, (runs.members, 6))
    starts[0] = 0.0
    for scenario, values in zip(scenarios, combinations, strict=True):
        varied = {
            key: stored_value(scenario, key, value, "ensemble.vary")
            for key, value in values.items()
        }
        for start in perturbed_start(starts, scenario.mechanism.loose):
            yield Run(scenario.mechanism, scenario.simulate, start, values=varied)


def write_ensemble(
    runs: Iterable[Run], folder: Path | str, workers: int | None = None, total: int | None = None
) -> pd.DataFrame:
    """Simulate runs and write their samples, events and outcomes to three Parquet files in
    `folder`.

    The files `SAMPLES`, `EVENTS` and `RUNS` have rows in order of the runs and appear when all runs
    are finished. The returned table of runs includes failed ones with their reason.
    """
    samples, events, table = places = [Path(folder) / name for name in (SAMPLES, EVENTS, RUNS)]
    parquet.check_writable(*places)
    simulated = with_progress(simulate_runs(runs, workers), "runs of the ensemble", total)
    rows: list[tuple[dict, dict]] = []

    def save(samples_path: str, events_path: str) -> None:
        with (
            _gathered(schema.ENSEMBLE_SAMPLES, samples_path) as add,
            _gathered(schema.ENSEMBLE_EVENTS, events_path) as add_events,
        ):
            for number, outcome in enumerate(simulated):
                rows.append((dict(outcome.run.values), _run_row(number, outcome)))
                if outcome.result is not None:
                    add(_sample_columns(number, outcome))
                    add_events(_event_columns(number, outcome))
        _write_runs(rows, table)  # inside the context: no samples without their runs

    parquet.write_atomically(
        samples,
        lambda path: parquet.write_atomically(events, lambda events_path: save(path, events_path)),
    )
    return pd.DataFrame([row for _, row in rows])


@contextmanager
def _gathered(table: schema.Table, path: str) -> Iterator[Callable[[dict[str, np.ndarray]], None]]:
    """A function that buffers columns of a table and writes them in large row groups."""
    waiting: list[dict[str, np.ndarray]] = []
    repeated = [
        c.name
        for c in table.columns
        if c.name in _REPEATED or c.kind != "float" or "bristle" in c.name
    ]
    settings = {
        "compression": "zstd",
        "compression_level": 1,
        "use_dictionary": repeated,
        "column_encoding": {
            name: "BYTE_STREAM_SPLIT" for name in table.names if name not in repeated
        },
        "write_statistics": ["run"],
    }
    with parquet.writer(path, parquet.schema(table), **settings) as file:

        def flush() -> None:
            frame = pd.DataFrame(
                {name: np.concatenate([own[name] for own in waiting]) for name in table.names}
            )
            for name in _CATEGORIES.keys() & set(table.names):
                frame[name] = pd.Categorical.from_codes(frame[name], _CATEGORIES[name])
            file.write_table(parquet.to_arrow(table, frame))
            waiting.clear()

        def add(columns: dict[str, np.ndarray]) -> None:
            waiting.append(columns)
            if sum(len(own["run"]) for own in waiting) >= ROWS:
                flush()

        yield add
        if waiting:
            flush()


def _run_row(number: int, outcome: Outcome) -> dict:
    given = np.ravel(() if outcome.run.perturbation is None else outcome.run.perturbation)[:6]
    start = np.append(given, np.zeros(6 - given.size)).astype(float)
    result = outcome.result
    return {
        "run": number,
        **dict(zip((f"start_{name}" for name in (*_VECTORS, *_PIVOT)), start, strict=True)),
        "samples": len(result.times) if result else 0,
        "events": len(result.events) if result else 0,
        "steps": result.steps if result else 0,
        "reason": str(outcome.error) if outcome.error else None,
    }


def _sample_columns(number: int, outcome: Outcome) -> dict[str, np.ndarray]:
    """Columns of the table of samples for one successful run; modes as indices in `MODES`."""
    p, result, n = outcome.parameters, outcome.result, len(outcome.crank_angle)
    states, further = result.states, result.auxiliary_states
    rod_angle, position = rod_and_slider(p, outcome.crank_angle, states, further)
    modes = mode_numbers(p, result.times, result.modes, result.events)
    return {
        "run": np.full(n, number),
        "time": result.times,
        "crank_angle": outcome.crank_angle,
        "crank_speed": crank_speeds(p, result.times, further),
        **{name: states[:, i] for i, name in enumerate(_VECTORS)},
        **{name: further[:, i] for i, name in enumerate(_PIVOT)},
        **{f"{name}_dot": states[:, 4 + i] for i, name in enumerate(_VECTORS)},
        **{f"{name}_dot": further[:, 4 + i] for i, name in enumerate(_PIVOT)},
        "rod_deflection": further[:, 3],
        "rod_deflection_dot": further[:, 7],
        **{f"{joint}_bristle": further[:, 8 + i] for i, joint in enumerate(JOINTS)},
        "rod_angle": rod_angle,
        "slider_position": position,
        **{f"{joint}_mode": modes[:, i] for i, joint in enumerate(JOINTS)},
    }


def _event_columns(number: int, outcome: Outcome) -> dict[str, np.ndarray]:
    """Columns of the table of events for one run; joints and events as indices in `JOINTS` and
    `EVENT_NAMES`."""
    columns = dict(zip(EVENT, outcome.result.events.T, strict=True))
    columns |= {
        "joint": columns["joint"].astype(np.int8),
        "event": columns.pop("begins").astype(np.int8),
    }
    return {"run": np.full(len(columns["event"]), number), **columns}


def _write_runs(rows: list[tuple[dict, dict]], path: Path) -> None:
    varied, frame = [], pd.DataFrame([row for _, row in rows])
    for name in rows[0][0] if rows else ():
        own = pd.Series([values.get(name) for values, _ in rows], dtype=object)
        kind, nullable = (
            _KINDS.get(pd.api.types.infer_dtype(own, skipna=True), "text"),
            bool(own.isna().any()),
        )
        if kind == "float" or (
            kind == "int" and nullable
        ):  # in a frame only floats represent missing values
            kind, own = "float", own.astype(float)
        frame[name] = own.map(str, na_action="ignore") if kind == "text" else own
        unit = VARIED_BY_WORD.get(name, "")
        varied.append(schema.Column(name, unit, f"{name}, varied", kind, nullable=nullable))
    table = schema.ENSEMBLE_RUNS.filled(varied=varied)
    parquet.write(table, frame.reindex(columns=list(table.names)), path)
