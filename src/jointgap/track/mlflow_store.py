"""The MLflow store: the only module that imports mlflow.

By default a SQLite file with a folder of artifacts in the results folder; a server where an address says so.
"""

import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from jointgap import tables
from jointgap.core.errors import InputError
from jointgap.track import sqlite_store
from jointgap.track.quiet_mlflow import quiet
from jointgap.track.run_record import Dataset, Record
from jointgap.track.store_lock import locked
from jointgap.track.store_trouble import explained

EXPERIMENT = "jointgap-"
COMPLETE = "jointgap.complete"
"""Tag set last: a run without it was cut short."""

_PAUSES = (0.1, 0.3, 1.0)
"""Seconds before each further attempt at what a server of MLflow has refused because another process added the same."""

_DATABASES = ("postgresql", "mysql", "mssql", "sqlite")
"""Kinds of addresses, before `+` and the driver, that are no server of MLflow's: where artifacts lie is ours to say."""

_MOST_PER_CALL = {"metrics": 1000, "params": 100}  # what one request may carry


def default_address(results: Path) -> str:
    """Address of the SQLite store inside the results folder."""
    return f"{sqlite_store.PREFIX}{results.resolve() / 'mlflow.db'}"


def address_for(results: Path, tracking_uri: str | None = None) -> str:
    """The store to use: `tracking_uri`, else ``MLFLOW_TRACKING_URI``, else the one in the folder `results`."""
    address = tracking_uri or os.environ.get("MLFLOW_TRACKING_URI") or default_address(results)
    file = sqlite_store.file_of(address)
    if file is None and not address.startswith("sqlite"):
        return address
    if file is None or file.name in ("", ":memory:") or "?" in str(file):  # what follows '?' would be options
        raise InputError(
            f"MLflow store {address}: names no file, or one with '?' in its path, which an address cannot hold; "
            "name another one: MLFLOW_TRACKING_URI=sqlite:////path/to/mlflow.db"
        )
    return f"{sqlite_store.PREFIX}{file.resolve()}"  # absolute, for the dashboard's server runs in another folder


def artifact_folder(address: str, results: Path) -> Path:
    """Folder of artifacts of the store at `address` without a server: beside the SQLite file, else in `results`."""
    file = sqlite_store.file_of(address)
    return (results if file is None else file.parent).resolve() / "mlflow-artifacts"


@contextmanager
def opened(address: str, results: Path) -> Iterator["Store"]:
    """The store at `address`, made if it is missing, for this process alone until it is done with it.

    MLflow's making of a store fails when two processes start it, SQLite takes one writer, and what one process has
    begun to publish another one would delete as cut short. So there is a lock (`jointgap.track.store_lock.locked`). It
    does not keep everybody out of a server of MLflow: `Store.exclusive` says so.
    """
    with locked(address) as exclusive:
        if (file := sqlite_store.file_of(address)) is not None:
            sqlite_store.make(file, artifact_folder(address, file.parent))
        yield Store(address, results, exclusive)


@dataclass(frozen=True)
class StoredRun:
    """A run that the store holds: its id, its tags, whether it was finished, and when it began [ms since 1970]."""

    run_id: str
    tags: dict[str, str]
    complete: bool
    begun: int


class Store:
    """A connection to one MLflow store, in jointgap's words."""

    def __init__(self, address: str, results: Path, exclusive: bool = False):
        self.address, self.exclusive = address, exclusive
        # a server knows where its artifacts lie; of a database we say it, or they land in the working directory
        database = address.partition("://")[0].partition("+")[0] in _DATABASES
        self._file = sqlite_store.file_of(address)
        self._artifacts = artifact_folder(address, results) if database else None
        self._reached = False
        with quiet():
            import mlflow.entities as entities
            from mlflow.tracking import MlflowClient

        with self._explained():
            self._entities = entities
            self._client = MlflowClient(tracking_uri=address)
            self._client.search_experiments(max_results=1)
        self._reached = True

    def _explained(self) -> AbstractContextManager[None]:
        return explained(self.address, self._reached)

    def experiment(self, stage: str, create: bool = True) -> str | None:
        """Id of the experiment of a `stage`; made (or brought back from deletion) where it is missing, if `create`."""
        name = EXPERIMENT + stage
        with self._explained():
            existing = self._client.get_experiment_by_name(name)
            if existing is None and create:
                from mlflow.exceptions import MlflowException

                location = None if self._artifacts is None else (self._artifacts / stage).as_uri()
                try:
                    # the kind makes the interface show charts of metrics, not traces of language models
                    tags = {"mlflow.experimentKind": "custom_model_development"}
                    return self._client.create_experiment(name, artifact_location=location, tags=tags)
                except MlflowException:
                    existing = self._client.get_experiment_by_name(name)  # another process made it first
                    if existing is None:
                        raise
            if existing is None:
                return None
            if existing.lifecycle_stage == "deleted":
                if not create:
                    return None
                self._client.restore_experiment(existing.experiment_id)
            if create:
                self._still_here(existing)
            return existing.experiment_id

    def describe(self, experiment_id: str, tags: dict[str, str], missing: dict[str, str]) -> None:
        """Set `tags` of experiment `experiment_id` where they differ, and those of `missing` that it has not: people
        may have written their own.
        """
        with self._explained():
            present = self._client.get_experiment(experiment_id).tags
            for key, value in {**{key: value for key, value in missing.items() if key not in present}, **tags}.items():
                if present.get(key) != value:
                    self._while_others_write(partial(self._client.set_experiment_tag, experiment_id, key, value))

    def _while_others_write(self, do: Callable[[], object]) -> None:
        """`do` what may be done twice: of two processes that add the same row at once a server refuses one."""
        from mlflow.exceptions import MlflowException

        for pause in (*_PAUSES, None):
            try:
                do()
                return
            except MlflowException:
                if pause is None or self.exclusive:
                    raise
                time.sleep(pause)

    def _still_here(self, experiment) -> None:
        """Refuse a SQLite store that was moved with its folder: MLflow keeps absolute paths of artifacts."""
        if self._file is None:
            return
        wanted = self._artifacts.as_uri()
        if not experiment.artifact_location.startswith(wanted):
            raise InputError(
                f"MLflow store {self.address} was made elsewhere: its artifacts lie in {experiment.artifact_location}, "
                f"not in {wanted}; put it back there, or move the file away and publish again "
                "(make run ARGS='--forcerun track')"
            )

    def runs(self, experiment_id: str, tags: dict[str, str]) -> list[StoredRun]:
        """Runs of the experiment `experiment_id` that carry all `tags` and are not deleted, newest first."""
        wanted = " and ".join(f"tags.`{key}` = {_quoted(value)}" for key, value in tags.items())
        matching, token = [], None
        with self._explained():
            while True:
                page = self._client.search_runs(
                    [experiment_id], wanted, max_results=500, order_by=["attributes.start_time DESC"], page_token=token
                )
                matching += page
                token = page.token
                if not token:
                    break
        return [
            StoredRun(
                run.info.run_id,
                dict(run.data.tags),
                run.info.status == "FINISHED" and run.data.tags.get(COMPLETE) == "true",
                run.info.start_time,
            )
            for run in matching
        ]

    def write(self, experiment_id: str, name: str, record: Record, tags: dict[str, str], after: int = 0) -> str:
        """Log a `record` whole and mark it complete last."""
        entities, begun = self._entities, max(time.time_ns() // 10**6, after + 1)
        with self._explained():
            run_id = self._client.create_run(experiment_id, begun, tags, name).info.run_id
            metrics = [entities.Metric(key, value, 0, step) for key, value, step in record.points()]
            params = [entities.Param(key, value) for key, value in record.params.items()]
            for kind, items in (("metrics", metrics), ("params", params)):
                size = _MOST_PER_CALL[kind]
                for first in range(0, len(items), size):
                    self._client.log_batch(run_id, **{kind: items[first : first + size]})
            if record.datasets:
                inputs = [self._dataset(dataset) for dataset in record.datasets]
                self._while_others_write(partial(self._client.log_inputs, run_id, inputs))
            self._log_files(run_id, record.files)
            self._client.set_tag(run_id, COMPLETE, "true")
            self._client.set_terminated(run_id, "FINISHED")
        return run_id

    def _log_files(self, run_id: str, files: dict[str, Path | bytes]) -> None:
        with tempfile.TemporaryDirectory(prefix="jointgap-") as folder:
            for target, source in files.items():
                place = Path(folder, target)
                place.parent.mkdir(parents=True, exist_ok=True)
                if isinstance(source, bytes):
                    place.write_bytes(source)
                else:
                    place.symlink_to(source.resolve())
            if files:
                self._client.log_artifacts(run_id, folder)

    def _dataset(self, dataset: Dataset):
        """The table as MLflow's dataset: its digest (36 digits are all that fit), the whole digest as a tag."""
        entities, footers = self._entities, [tables.read_footer(path) for path in dataset.files]
        schema = footers[0].schema.to_arrow_schema()
        columns = [{"name": field.name, "type": str(field.type), "required": not field.nullable} for field in schema]
        return entities.DatasetInput(
            entities.Dataset(
                name=dataset.name,
                digest=dataset.sha256[:36],
                source_type="local",
                source=json.dumps({"uri": str(dataset.path.resolve())}),
                schema=json.dumps({"mlflow_colspec": columns}),
                profile=json.dumps({"num_rows": sum(footer.num_rows for footer in footers)}),
            ),
            [
                entities.InputTag("mlflow.data.context", dataset.context),
                entities.InputTag("jointgap.sha256", dataset.sha256),
            ],
        )

    def tag(self, run_id: str, key: str, value: str) -> None:
        """Set the tag `key` of the run `run_id` to `value`; nothing where another process has deleted the run."""
        self._of_run(lambda: self._client.set_tag(run_id, key, value))

    def delete(self, run_id: str) -> None:
        """Take a run out of sight; `mlflow gc` removes for good what was deleted."""
        self._of_run(lambda: self._client.delete_run(run_id))

    def _of_run(self, do: Callable[[], object]) -> None:
        from mlflow.exceptions import MlflowException

        with self._explained():
            try:
                do()
            except MlflowException as error:
                gone = error.error_code in ("INVALID_PARAMETER_VALUE", "INVALID_STATE", "RESOURCE_DOES_NOT_EXIST")
                if self.exclusive or not gone:
                    raise


def _quoted(value: str) -> str:
    """The `value` as MLflow's searches take it, which know two kinds of quotes and no escape."""
    quote = '"' if "'" in value else "'"
    if quote in value:
        raise InputError(f"name {value}: MLflow cannot search for a name with both kinds of quotes; leave one out")
    return f"{quote}{value}{quote}"
