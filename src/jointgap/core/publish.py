"""Publishes results to MLflow: `publish_records` writes the content of each `Record`, without
duplicates.

A run is identified by scenario, stage, output and digest of its content. An unchanged run is kept,
a changed one replaced, an incomplete one deleted and written again.
"""

import getpass
import hashlib
import json
import logging
import os
import re
import subprocess
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from jointgap import __version__
from jointgap.core.errors import InputError, needs
from jointgap.core.parquet import read_footer
from jointgap.core.schema import Column, Table
from jointgap.core.words import reading_unit

if TYPE_CHECKING:  # slow imports
    from mlflow.tracking import MlflowClient
    from pydantic import BaseModel

for _name, _value in {
    "MLFLOW_DISABLE_TELEMETRY": "true",  # no network access except to the tracking server
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "1",  # the default, 7, delays errors by four minutes
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "20",
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "GIT_PYTHON_REFRESH": "quiet",  # no warning from mlflow without git
    "PGCONNECT_TIMEOUT": "5",  # [s] of PostgreSQL
}.items():
    os.environ.setdefault(
        _name, _value
    )  # before mlflow is imported; does not override the user's settings

EXPERIMENT = "jointgap-"
"""Prefix of a stage in the name of its experiment."""
SCENARIO, STAGE, OUTPUT, DIGEST = (
    f"jointgap.{key}" for key in ("scenario", "stage", "output", "digest")
)
PARENT = "mlflow.parentRunId"

_SQLITE = "sqlite:///"
_DATABASE = re.compile(r"(postgresql|mysql|mssql|sqlite)(\+\w+)?://")
"""Databases without an MLflow server, which would know the location of artifacts."""
_MOST_METRICS, _MOST_PARAMS, _MOST_RUNS = 1000, 100, 10_000  # per request

CURVE_POINTS = 300
"""Published points per curve; MLflow draws at most 320. The table contains the whole curve."""

_LONGEST_VALUE = 500  # [characters] of a parameter; options.json contains the whole value


@dataclass(frozen=True)
class Dataset:
    """A table that a run has read or written."""

    name: str
    path: Path  # a Parquet file, or a folder of Parquet files of one table
    context: str  # ``'input'`` or ``'result'``

    @property
    def files(self) -> list[Path]:
        """Its Parquet files, sorted by name."""
        return sorted(self.path.glob("[!.]*.parquet")) if self.path.is_dir() else [self.path]

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the file, or of the names and digests of a folder's files."""
        if not self.path.is_dir():
            return sha256(self.path)
        return sha256("".join(f"{sha256(path)}  {path.name}\n" for path in self.files).encode())


@dataclass(frozen=True)
class Record:
    """One run."""

    stage: str  # determines the experiment
    output: str = ""  # name of a nested run; empty for the run of the whole stage
    params: Mapping[str, str] = field(default_factory=dict)
    metrics: Mapping[str, float] = field(default_factory=dict)  # non-finite values are skipped
    curves: Mapping[str, pd.Series] = field(default_factory=dict)  # values by iteration
    datasets: tuple[Dataset, ...] = ()
    files: Mapping[str, Path | bytes] = field(
        default_factory=dict
    )  # artifacts by their path in the run
    costs: Mapping[str, float] = field(
        default_factory=dict
    )  # metrics that are not part of the digest
    notes: Mapping[str, str] = field(default_factory=dict)  # tags

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the run's content without its costs."""
        metrics = {name: float(value) for name, value in self.metrics.items()}
        curves = {
            name: [curve.index.tolist(), curve.tolist()] for name, curve in self.curves.items()
        }
        datasets = sorted(
            [dataset.name, dataset.context, dataset.sha256] for dataset in self.datasets
        )
        files = {name: sha256(source) for name, source in self.files.items()}
        held = [dict(self.params), metrics, curves, datasets, files, dict(self.notes)]
        return sha256(json.dumps(held, sort_keys=True).encode())

    def points(self) -> list[tuple[str, float, int]]:
        """Every metric as (name, value, step); single numbers at step 0."""
        single = [(name, float(value), 0) for name, value in {**self.metrics, **self.costs}.items()]
        curves = ((name, thinned(curve)) for name, curve in self.curves.items())
        along = [
            (name, float(value), int(step))
            for name, curve in curves
            for step, value in curve.items()
        ]
        return [point for point in single + along if np.isfinite(point[1])]


def sha256(source: Path | bytes) -> str:
    """SHA-256 of a file or of bytes, 64 hexadecimal digits."""
    return hashlib.sha256(source if isinstance(source, bytes) else source.read_bytes()).hexdigest()


def thinned(curve: pd.Series, points: int = CURVE_POINTS) -> pd.Series:
    """At most `points` of a curve, evenly spaced on a logarithmic axis, including both ends."""
    if len(curve) <= points:
        return curve
    for number in range(4 * points, 0, -4):  # rounding makes some coincide
        places = np.unique(np.geomspace(1, len(curve), number).round().astype(int)) - 1
        if len(places) <= points:
            break
    return curve.iloc[places]


def configuration(options: "BaseModel", sections: set[str]) -> dict[str, Any]:
    """Parameters, flattened from the `sections` of a configuration, and a file with these
    sections."""
    sections_content = options.model_dump(
        mode="json", by_alias=True, include=sections, exclude_none=True
    )
    flat = pd.json_normalize(sections_content).iloc[0].to_dict()
    params = {
        re.sub(r"[^\w\-./ ]", "_", key): str(value)[:_LONGEST_VALUE] for key, value in flat.items()
    }
    text = options.model_dump_json(include=sections, by_alias=True, indent=2) + "\n"
    return {"params": params, "files": {"options.json": text.encode()}}


def costs(benchmarks: list[Path]) -> dict[str, float]:
    """Total time [s] and peak memory from Snakemake's benchmark files."""
    files = [
        pd.read_csv(path, sep="\t", na_values="-")[["s", "max_rss"]].mean() for path in benchmarks
    ]
    measured = pd.DataFrame(files, columns=["s", "max_rss"])
    return (
        {}
        if measured.empty
        else {"seconds": measured["s"].sum(), "peak_memory_mb": measured["max_rss"].max()}
    )


def name_and_factor(column: Column) -> tuple[str, float]:
    """Name of a metric, with its unit, and its number of units per SI unit; errors and departures
    of an angle in mdeg."""
    unit, factor = reading_unit(column.unit)
    if unit == "deg" and re.search("error|^departure_", column.name):
        unit, factor = "mdeg", 1e3 * np.rad2deg(1.0)
    ending = re.sub(r"[*/]", "_", unit).replace("^", "")
    return (column.name if ending in ("1", "") else f"{column.name}_{ending}"), factor


def numbers(
    table: Table, row: Mapping[str, Any], *names: str, section: str = ""
) -> dict[str, float]:
    """The numbers of a row of `table`, all or those of the columns `names`; shares in percent."""
    metrics = {}
    for column in table.columns:
        if (
            column.kind not in ("int", "float")
            or (names and column.name not in names)
            or pd.isna(row[column.name])
        ):
            continue
        is_share = column.kind == "float" and column.unit == "1"
        name, factor = (f"{column.name}_percent", 100) if is_share else name_and_factor(column)
        metrics[section + name] = factor * row[column.name]
    return metrics


def store_address(results: Path, tracking_uri: str | None = None) -> str:
    """Address of the store: `tracking_uri`, ``MLFLOW_TRACKING_URI``, or a SQLite file in the folder
    `results`."""
    address = (
        tracking_uri or os.environ.get("MLFLOW_TRACKING_URI") or f"{_SQLITE}{results / 'mlflow.db'}"
    )
    return f"{_SQLITE}{file.resolve()}" if (file := sqlite_file(address)) else address


def sqlite_file(address: str) -> Path | None:
    """The file of a SQLite store, or None."""
    return Path(address.removeprefix(_SQLITE)) if address.startswith(_SQLITE) else None


def artifact_folder(address: str, results: Path) -> Path | None:
    """The folder of artifacts: next to a SQLite file, in `results` for other databases; None with a
    server."""
    file = sqlite_file(address)
    folder = results if file is None else file.parent
    return folder.resolve() / "mlflow-artifacts" if _DATABASE.match(address) else None


@contextmanager
def opened(address: str) -> Iterator["MlflowClient"]:
    """A client of the store at `address`, after a successful request; errors of the store become
    one InputError."""
    try:
        with needs("publishing to MLflow", "workflow"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import sqlalchemy
            from mlflow.tracking import MlflowClient
        logging.getLogger("mlflow").setLevel(logging.WARNING)
        logging.getLogger("mlflow.store.db.utils").setLevel(
            logging.CRITICAL
        )  # its errors are raised too
        if (file := sqlite_file(address)) is not None and not file.exists():
            _make(file)
        elif _DATABASE.match(address):
            with sqlalchemy.create_engine(address, poolclass=sqlalchemy.NullPool).connect():
                pass  # one attempt; MLflow would retry for minutes
        client = MlflowClient(tracking_uri=address)
        client.search_experiments(max_results=1)
        yield client
    except InputError:
        raise
    except Exception as error:
        kinds = {kind.__module__.partition(".")[0] for kind in type(error).__mro__}
        if not (
            isinstance(error, OSError | ImportError)
            or kinds & {"mlflow", "sqlalchemy", "alembic", "sqlite3"}
        ):
            raise
        reason = without_password((str(error).strip() or repr(error)).splitlines()[0])[:300]
        fix = (
            "check the file, permissions and disk space, or move the file away to start a new store"
        )
        if sqlite_file(address) is None:
            fix = (
                "start the server, correct its address, user or password, install its driver (pip"
                " install 'jointgap[cluster]'), or unset MLFLOW_TRACKING_URI to use the store in"
                " the results folder"
            )
        raise InputError(
            f"MLflow store {without_password(address)} cannot be reached or used ({reason}); {fix}"
        ) from error


def _make(file: Path) -> None:
    """Create a SQLite store under a temporary name, then rename it: an interrupted one would be
    unusable."""
    from mlflow.tracking import MlflowClient

    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".mlflow-", dir=file.parent) as folder:
        temporary = Path(folder, file.name)
        MlflowClient(tracking_uri=f"{_SQLITE}{temporary}").search_experiments(max_results=1)
        temporary.rename(file)


def without_password(address: str) -> str:
    """The `address` of a store without its password."""
    return re.sub(r"(?<=://)([^/@]*):[^/]*@", r"\1:***@", address)


def check_store(address: str) -> None:
    """InputError where the store at `address` is unavailable; a missing SQLite file is created
    later."""
    if sqlite_file(address) is None:
        with opened(address):
            pass


def user_name() -> str:
    """Name of the user, or the number of a user without a name."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())


def publish_records(
    name: str, description: str, content: Sequence[Record], tracking_uri: str | None, results: Path
) -> dict:
    """Publish the `content` of a scenario, a sweep or a campaign, each run before its nested ones.

    Returns the store, the state of each run, and the number of deleted old runs.
    """
    address = store_address(results, tracking_uri)
    shared = {
        SCENARIO: name,
        "jointgap.version": __version__,
        "mlflow.source.name": "jointgap track",
        "mlflow.source.type": "LOCAL",
        "mlflow.source.git.commit": commit(),
        "mlflow.user": user_name(),
        "mlflow.note.content": description,
    }
    states, deleted = {}, 0
    with opened(address) as client:
        for stage in dict.fromkeys(record.stage for record in content):
            experiment = _experiment(client, stage, address, results)
            runs = client.search_runs(
                [experiment], f"tags.`{SCENARIO}` = '{name}'", max_results=_MOST_RUNS
            )
            finished = {
                (run.data.tags.get(OUTPUT), run.data.tags.get(DIGEST)): run
                for run in reversed(runs)
                if run.info.status == "FINISHED"
            }
            parent, used_ids = None, set()
            for record in (record for record in content if record.stage == stage):
                identity = {STAGE: stage, OUTPUT: record.output, DIGEST: record.digest}
                identity |= {PARENT: parent} if record.output else {}
                present = finished.get((record.output, record.digest))
                if present is None:
                    notes = {f"jointgap.{key}": text for key, text in record.notes.items()}
                    run_id = _write(
                        client,
                        experiment,
                        f"{name} {record.output}".strip(),
                        record,
                        shared | notes | identity,
                    )
                else:
                    run_id = present.info.run_id
                    if record.output and present.data.tags.get(PARENT) != parent:
                        client.set_tag(run_id, PARENT, parent)
                parent = parent if record.output else run_id
                used_ids.add(run_id)
                key = f"{stage}/{record.output}" if record.output else stage
                state = "kept" if present else "written"
                states[key] = {"run_id": run_id, "digest": record.digest, "state": state}
            gone = [run.info.run_id for run in runs if run.info.run_id not in used_ids]
            for run_id in gone:
                client.delete_run(run_id)
            deleted += len(gone)
    return {
        "store": without_password(address),
        "scenario": name,
        "runs": states,
        "deleted": deleted,
    }


def _experiment(client: "MlflowClient", stage: str, address: str, results: Path) -> str:
    """Id of the experiment of a `stage`, created or restored if necessary."""
    folder = artifact_folder(address, results)
    place = None if folder is None else (folder / stage).as_uri()
    experiment = client.get_experiment_by_name(EXPERIMENT + stage)
    if experiment is None:
        # MLflow's pages then show charts of metrics, not traces of language models
        tags = {"mlflow.experimentKind": "custom_model_development"}
        return client.create_experiment(EXPERIMENT + stage, artifact_location=place, tags=tags)
    if sqlite_file(address) and experiment.artifact_location != place:
        raise InputError(
            f"MLflow store {address} was created elsewhere: its artifacts are in"
            f" {experiment.artifact_location}, not in {place}; move it back, or move the file away"
            " and publish again (make run ARGS='--forcerun track')"
        )
    if experiment.lifecycle_stage == "deleted":
        client.restore_experiment(experiment.experiment_id)
    return experiment.experiment_id


def _write(
    client: "MlflowClient", experiment: str, name: str, record: Record, tags: dict[str, str]
) -> str:
    """Log a `record`; the run is marked as finished last."""
    from mlflow.entities import Metric, Param

    run_id = client.create_run(experiment, tags=tags, run_name=name).info.run_id
    metrics = [Metric(key, value, 0, step) for key, value, step in record.points()]
    params = [Param(key, value) for key, value in record.params.items()]
    for start in range(0, len(metrics), _MOST_METRICS):
        client.log_batch(run_id, metrics=metrics[start : start + _MOST_METRICS])
    for start in range(0, len(params), _MOST_PARAMS):
        client.log_batch(run_id, params=params[start : start + _MOST_PARAMS])
    if record.datasets:
        client.log_inputs(run_id, [_input(dataset) for dataset in record.datasets])
    with tempfile.TemporaryDirectory(prefix="jointgap-") as folder:
        for target, source in record.files.items():
            place = Path(folder, target)
            place.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(source, bytes):
                place.write_bytes(source)
            else:
                place.symlink_to(source.resolve())
        if record.files:
            client.log_artifacts(run_id, folder)
    client.set_terminated(run_id, "FINISHED")
    return run_id


def _input(dataset: Dataset):
    """A table as MLflow's dataset, with a short digest (at most 36 digits) and the full one as a
    tag."""
    from mlflow import entities

    footers = [read_footer(path) for path in dataset.files]
    columns = [
        {"name": field.name, "type": str(field.type)}
        for field in footers[0].schema.to_arrow_schema()
    ]
    source, schema = {"uri": str(dataset.path.resolve())}, {"mlflow_colspec": columns}
    profile = {"num_rows": sum(footer.num_rows for footer in footers)}
    described = (json.dumps(part) for part in (source, schema, profile))
    tags = {"mlflow.data.context": dataset.context, "jointgap.sha256": dataset.sha256}
    return entities.DatasetInput(
        entities.Dataset(dataset.name, dataset.sha256[:36], "local", *described),
        [entities.InputTag(key, value) for key, value in tags.items()],
    )


def commit() -> str:
    """The commit of the code, with ``-changed`` if it was modified; ``unknown`` outside git."""
    # the folder may belong to another user; it is only read
    words = ["describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=-changed"]
    command = ["git", "-C", str(Path(__file__).parent), "-c", "safe.directory=*", *words]
    try:
        return (
            subprocess.run(
                command, capture_output=True, text=True, timeout=20, check=False
            ).stdout.strip()
            or "unknown"
        )
    except (OSError, subprocess.TimeoutExpired):
        return "unknown"
