"""The MLflow store: the only module that imports mlflow.

By default a SQLite file with a folder of artifacts in the results folder; a server where an address says so.
"""

import errno
import fcntl
import hashlib
import json
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from jointgap import tables
from jointgap.errors import InputError
from jointgap.track import sqlite_store
from jointgap.track.quiet_mlflow import quiet
from jointgap.track.run_record import Dataset, Record

EXPERIMENT = "jointgap-"
COMPLETE = "jointgap.complete"
"""Tag set last: a run without it was cut short."""

_DEFAULT = "unset MLFLOW_TRACKING_URI to use the store in the results folder"
_PACKAGES = {"psycopg2": "psycopg2-binary", "MySQLdb": "mysqlclient"}
"""Drivers of databases, by what Python imports, where that is not the package's own name."""

_MOST_PER_CALL = {"metrics": 1000, "params": 100}  # what one request may carry


def default_address(results: Path) -> str:
    """Address of the SQLite store inside the results folder."""
    return f"{sqlite_store.PREFIX}{results.resolve() / 'mlflow.db'}"


def address_for(results: Path, tracking_uri: str | None = None) -> str:
    """The store to use: `tracking_uri`, else ``MLFLOW_TRACKING_URI``, else the one in the folder `results`.

    Raises
    ------
    InputError
        An address of SQLite that names no file, or one that no address can name.
    """
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


def without_password(address: str) -> str:
    """The `address` of a store as it may be shown."""
    return re.sub(r"(?<=://)([^/@]*):[^/]*@", r"\1:***@", address)


def artifact_folder(address: str, results: Path) -> Path:
    """Folder of artifacts of the store at `address` without a server: beside the SQLite file, else in `results`."""
    file = sqlite_store.file_of(address)
    return (results if file is None else file.parent).resolve() / "mlflow-artifacts"


@contextmanager
def opened(address: str) -> Iterator["Store"]:
    """The store at `address`, made if it is missing, for this process alone until it is done with it.

    MLflow's making of a store fails when two processes start it, SQLite takes one writer, and what one process has
    begun to publish another one would delete as cut short. So the lock lies with the store, whatever the results
    folder: beside the SQLite file. Of a server it lies on this machine; processes of another user or machine do not
    wait, and must not publish the same name at the same time.

    Parameters
    ----------
    address : str
        As `address_for` gives it.

    Raises
    ------
    InputError
        The store cannot be made, reached or opened, or the lock's folder cannot be written.
    """
    file = sqlite_store.file_of(address)
    if file is None:
        name = hashlib.sha256(address.encode()).hexdigest()[:16]
        lock = Path(tempfile.gettempdir(), f"jointgap-{os.getuid()}-{name}.lock")
    else:
        lock = file.with_name(f".{file.name}.lock")
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        # no link that another user laid there is followed, and nothing is emptied
        handle = open(os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600))
    except OSError as error:
        raise InputError(f"{lock}: cannot be written ({error.strerror}); check permission and space") from error
    with handle:
        fcntl.flock(handle, fcntl.LOCK_EX)  # let go when the file closes, also when the process dies
        if file is not None:
            sqlite_store.make(file, artifact_folder(address, file.parent))
        yield Store(address)


@dataclass(frozen=True)
class StoredRun:
    """A run that the store holds: its id, its tags, and whether it was finished."""

    run_id: str
    tags: dict[str, str]
    complete: bool


class Store:
    """A connection to one MLflow store, in jointgap's words.

    Parameters
    ----------
    address : str
        ``sqlite:///...`` or ``http://...``.

    Raises
    ------
    InputError
        The store cannot be reached or opened.
    """

    def __init__(self, address: str):
        self.address = address
        # a server knows where its artifacts lie; with a file we say it, or they land in the working directory
        self._file = sqlite_store.file_of(address)
        self._artifacts = None if self._file is None else artifact_folder(address, Path())
        self._reached = False
        with quiet():
            import mlflow.entities as entities
            from mlflow.tracking import MlflowClient

        with self._explained():
            self._entities = entities
            self._client = MlflowClient(tracking_uri=address)
            self._client.search_experiments(max_results=1)
        self._reached = True

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn what MLflow and its database raise into one sentence that names the store."""
        from requests.exceptions import RequestException

        try:
            yield
        except InputError:
            raise
        except Exception as error:
            kinds = {kind.__module__.partition(".")[0] for kind in type(error).__mro__}
            expected = isinstance(error, RequestException | OSError | ModuleNotFoundError)
            if not (expected or kinds & {"mlflow", "sqlalchemy", "alembic"}):
                raise
            raise InputError(f"MLflow store {without_password(self.address)} {self._trouble(error)}") from error

    def _trouble(self, error: Exception) -> str:
        """What `error` means, and what to do."""
        said = without_password((str(error).strip() or repr(error)).splitlines()[0])[:300]
        if isinstance(error, ModuleNotFoundError):
            package = _PACKAGES.get(error.name, error.name)
            return f"needs the package {package}, which is not installed; pip install {package}, or {_DEFAULT}"
        if cause := sqlite_store.sqlite_error(error):
            return sqlite_store.trouble(cause)
        for one in (error, error.__cause__):
            if isinstance(one, OSError) and one.errno in (errno.ENOSPC, errno.EDQUOT):
                return f"cannot be written ({said}); free some space, then publish again"
        if self._reached and getattr(error, "error_code", None) in (
            "INVALID_PARAMETER_VALUE",
            "RESOURCE_ALREADY_EXISTS",
        ):
            return f"does not take what is published ({said}); the store itself is sound"
        if self._file is not None:
            return f"cannot be used ({said}); check permission and space"
        return f"cannot be reached or refuses ({said}); start the server, correct its address, or {_DEFAULT}"

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
                    self._client.set_experiment_tag(experiment_id, key, value)

    def _still_here(self, experiment) -> None:
        """Refuse a SQLite store that was moved with its folder: MLflow keeps absolute paths of artifacts."""
        if self._artifacts is None:
            return
        wanted = self._artifacts.as_uri()
        if not experiment.artifact_location.startswith(wanted):
            raise InputError(
                f"MLflow store {self.address} was made elsewhere: its artifacts lie in {experiment.artifact_location}, "
                f"not in {wanted}; put it back there, or move the file away and publish again "
                "(make run ARGS='--forcerun track')"
            )

    def runs(self, experiment_id: str, tags: dict[str, str]) -> list[StoredRun]:
        """Runs of the experiment `experiment_id` that carry all `tags` and are not deleted, newest first.

        Raises
        ------
        InputError
            A tag's value cannot be searched for; or as the class.
        """
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
            )
            for run in matching
        ]

    def write(self, experiment_id: str, name: str, record: Record, tags: dict[str, str]) -> str:
        """Log a `record` whole, as a run called `name` with `tags` in `experiment_id`, and mark it complete last; the
        run's id.
        """
        entities = self._entities
        with self._explained():
            run_id = self._client.create_run(experiment_id, run_name=name, tags=tags).info.run_id
            metrics = [entities.Metric(key, value, 0, step) for key, value, step in record.points()]
            params = [entities.Param(key, value) for key, value in record.params.items()]
            for kind, items in (("metrics", metrics), ("params", params)):
                size = _MOST_PER_CALL[kind]
                for first in range(0, len(items), size):
                    self._client.log_batch(run_id, **{kind: items[first : first + size]})
            if record.datasets:
                self._client.log_inputs(run_id, [self._dataset(dataset) for dataset in record.datasets])
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
        """The table as MLflow's dataset: digest of the file (36 digits are all that fit), whole digest as a tag."""
        entities, footer = self._entities, tables.read_footer(dataset.path)
        schema = footer.schema.to_arrow_schema()
        columns = [{"name": field.name, "type": str(field.type), "required": not field.nullable} for field in schema]
        return entities.DatasetInput(
            entities.Dataset(
                name=dataset.name,
                digest=dataset.sha256[:36],
                source_type="local",
                source=json.dumps({"uri": str(dataset.path.resolve())}),
                schema=json.dumps({"mlflow_colspec": columns}),
                profile=json.dumps({"num_rows": footer.num_rows}),
            ),
            [
                entities.InputTag("mlflow.data.context", dataset.context),
                entities.InputTag("jointgap.sha256", dataset.sha256),
            ],
        )

    def tag(self, run_id: str, key: str, value: str) -> None:
        """Set the tag `key` of the run `run_id` to `value`."""
        with self._explained():
            self._client.set_tag(run_id, key, value)

    def delete(self, run_id: str) -> None:
        """Take a run out of sight; `mlflow gc` removes for good what was deleted."""
        with self._explained():
            self._client.delete_run(run_id)


def _quoted(value: str) -> str:
    """The `value` as MLflow's searches take it, which know two kinds of quotes and no escape."""
    quote = '"' if "'" in value else "'"
    if quote in value:
        raise InputError(f"name {value}: MLflow cannot search for a name with both kinds of quotes; leave one out")
    return f"{quote}{value}{quote}"
