"""The SQLite file of an MLflow store: what it holds, and how it is made whole or not at all."""

import os
import sqlite3
from enum import Enum
from pathlib import Path

from jointgap.core.errors import InputError
from jointgap.track.quiet_mlflow import quiet

PREFIX = "sqlite:///"
"""What the address of such a store begins with."""

_LONGEST_WAIT = 20.0  # s, for another program that is writing; as long as MLflow waits
_BESIDE = ("-journal", "-wal", "-shm")  # files of SQLite's own, by what they add to the name of the database
# a new store holds rows in these: its version, the experiment 'Default' and the workspace 'default'
_OF_A_NEW_STORE = ("alembic_version", "experiments", "workspaces")
_WHILE_MADE = "_alembic_tmp_"  # tables that are rewritten have such names meanwhile


class Holds(Enum):
    """What a file holds that should be a store."""

    ABSENT = "there is no such store"
    HALF_MADE = "it is only half made and holds nothing"
    STORE = "a store"


def file_of(address: str) -> Path | None:
    """The file of the store at `address`; ``None`` where it is no SQLite store."""
    return Path(address.removeprefix(PREFIX)) if address.startswith(PREFIX) else None


def look(file: Path) -> Holds:
    """What `file` holds; it is not changed."""
    try:
        if not file.exists() or file.stat().st_size == 0:  # SQLite makes an empty file first
            return Holds.ABSENT
        # as_uri escapes what has a meaning in an address
        connection = sqlite3.connect(f"{file.absolute().as_uri()}?mode=rw", uri=True, timeout=_LONGEST_WAIT)
        try:
            version = _version(connection)
            held = version is not None and _holds_rows(connection, version)
        finally:
            connection.close()
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}); check permission") from error
    except sqlite3.Error as error:
        raise InputError(f"{file}: {trouble(error)}") from error
    if version is None:
        raise InputError(f"{file}: is a database, but no MLflow store; move it away, or name another file")
    if version == _version_wanted():
        return Holds.STORE
    if held:
        raise InputError(
            f"{file}: was made by another version of MLflow (database schema {version}) and holds runs; copy the file, "
            f"then run: mlflow db upgrade '{PREFIX}{file}'"
        )
    return Holds.HALF_MADE


def _version(connection: sqlite3.Connection) -> str | None:
    """The version of the database's schema; empty if the making did not come to it, ``None`` if it is not MLflow's."""
    tables = _tables(connection)
    whole = {"alembic_version", "experiments", "runs"} <= tables  # with more tables, if it is of a later MLflow
    if not whole and any(not name.startswith(_WHILE_MADE) for name in tables - _tables_of_mlflow()):
        return None
    row = (
        connection.execute("SELECT version_num FROM alembic_version").fetchone()
        if "alembic_version" in tables
        else None
    )
    return row[0] if row else ""


def _tables(connection: sqlite3.Connection) -> set[str]:
    return {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}


def _tables_of_mlflow() -> set[str]:
    with quiet():
        import mlflow.store.model_registry.dbmodels.models  # these two declare the tables
        import mlflow.store.tracking.dbmodels.models  # noqa: F401
        from mlflow.store.db.base_sql_model import Base

    return {"alembic_version", *Base.metadata.tables}


def _holds_rows(connection: sqlite3.Connection, version: str) -> bool:
    """Whether anything was put into it since it was made; before it has a `version` the making puts nothing in."""
    rows_of_the_making = set(_OF_A_NEW_STORE) if version else set()
    asked = [f'SELECT 1 FROM "{table}" LIMIT 1' for table in _tables(connection) - rows_of_the_making]
    if version and "experiments" in _tables(connection):
        asked.append("SELECT 1 FROM experiments WHERE name <> 'Default' LIMIT 1")
    return any(connection.execute(question).fetchone() for question in asked)


def _version_wanted() -> str:
    with quiet():
        from mlflow.store.db.utils import _get_latest_schema_revision

    return _get_latest_schema_revision()


def make(file: Path, artifacts: Path) -> None:
    """Make the store if there is none, or one that was only half made: beside its place, then renamed.

    MLflow makes a store in dozens of steps, and one that was killed between them is never usable again. To be called
    by one process at a time.
    """
    if look(file) is Holds.STORE:
        return
    new = file.with_name(f".{file.name}.new")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        _remove(new)  # of a process that was killed
        try:
            _fill(new, artifacts)
            # what else uses MLflow does not know the lock, and may have made it in these seconds
            if look(file) is not Holds.STORE:
                _remove(file)  # its journal would be played into the new file
                os.replace(new, file)
        finally:
            _remove(new)
    except OSError as error:
        raise InputError(f"{file}: cannot be written ({error.strerror}); check permission and space") from error


def _fill(file: Path, artifacts: Path) -> None:
    """Make the tables of a new store in `file`, and its experiment 'Default' with its artifacts in a folder.

    MLflow would make that experiment when the store is first opened, with artifacts in the working folder, whose path
    it puts into a statement as it is: a path with both kinds of quotes is none.
    """
    with quiet():
        import sqlalchemy
        from mlflow.exceptions import MlflowException
        from mlflow.store.db.utils import _initialize_tables
        from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore

    engine = sqlalchemy.create_engine(sqlalchemy.URL.create("sqlite", database=str(file)))
    try:
        _initialize_tables(engine)
        SqlAlchemyStore(f"{PREFIX}{file}", artifacts.as_uri()).engine.dispose()
    except (sqlalchemy.exc.DBAPIError, MlflowException) as error:
        if cause := sqlite_error(error):
            raise InputError(f"{file}: {trouble(cause)}") from error
        raise
    finally:
        engine.dispose()


def sqlite_error(error: BaseException) -> sqlite3.Error | None:
    """What SQLite raised, where MLflow or SQLAlchemy raised `error` for it."""
    for one in (error, error.__cause__):
        for cause in (one, getattr(one, "orig", None)):
            if isinstance(cause, sqlite3.Error):
                return cause
    return None


def _remove(file: Path) -> None:
    for path in (file, *(file.with_name(file.name + end) for end in _BESIDE)):
        path.unlink(missing_ok=True)


def trouble(error: BaseException) -> str:
    """What SQLite's `error` means, and what to do; a file that may hold runs is never to be deleted."""
    said = str(error)
    match getattr(error, "sqlite_errorname", "").split("_")[1:]:
        case ["NOTADB"]:
            return f"is no MLflow store ({said}); move it away or delete it to publish from nothing"
        case ["CORRUPT", *_]:
            return f"is damaged ({said}); put a copy of it back, or move it away to publish from nothing"
        case ["BUSY" | "LOCKED", *_]:
            return f"is in use ({said}); end what writes to it, or wait, then publish again"
        case ["FULL"]:
            return f"cannot be written: no space left on device ({said}); free some, then publish again"
        case ["IOERR", *_]:
            return f"cannot be read or written ({said}); check the disk and the space on it, then publish again"
        case ["CANTOPEN" | "READONLY" | "PERM" | "AUTH", *_]:
            return f"cannot be opened or written ({said}); check that its folder is there, and permission"
    return f"SQLite refuses ({said})"
