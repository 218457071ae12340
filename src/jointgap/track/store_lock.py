"""One writer at a time: what keeps other processes out of a store while one is written."""

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from jointgap.core.errors import InputError
from jointgap.track import sqlite_store
from jointgap.track.store_trouble import explained

if TYPE_CHECKING:  # takes a while to load
    from sqlalchemy import Connection

_KEY = 0x6A6F696E74676170
"""Of the lock in a database of PostgreSQL: the name jointgap in its eight bytes."""

_PATIENCE = 5
"""Seconds until a server of PostgreSQL has to answer."""

_PROBED = {"tcp_keepalives_idle": 30, "tcp_keepalives_interval": 10, "tcp_keepalives_count": 3}
"""Settings of PostgreSQL: a machine that is gone without a word loses the lock after a minute, not after two hours."""


def is_postgresql(address: str) -> bool:
    """Whether the store at `address` is a database of PostgreSQL itself, without a server of MLflow."""
    return address.partition("://")[0].partition("+")[0] == "postgresql"


@contextmanager
def locked(address: str) -> Iterator[bool]:
    """Keep others from writing to the store at `address`; gives whether everybody is kept out.

    Of a SQLite file the lock lies beside it, of a database of PostgreSQL in the server: whoever writes to these is kept
    out, from any machine. A server of MLflow has no locks; then it lies on this machine, and processes of another
    machine or user write too. Each lock is let go when its process ends, however it ends.
    """
    if is_postgresql(address):
        with explained(address, reached=False):
            connection = connected(address)
        try:
            with explained(address, reached=True):
                _hold(connection)
            yield True
        finally:
            connection.close()
        return
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
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield file is not None


def connected(address: str) -> "Connection":
    """A connection to the database of PostgreSQL at `address`, to be closed; tried once, where MLflow tries for
    long.
    """
    import sqlalchemy

    url = sqlalchemy.make_url(address)
    patience = {"connect_timeout": _PATIENCE} if url.get_driver_name().startswith("psycopg") else {}
    engine = sqlalchemy.create_engine(
        url, poolclass=sqlalchemy.NullPool, isolation_level="AUTOCOMMIT", connect_args=patience
    )
    return engine.connect()


def _hold(connection: "Connection") -> None:
    """Wait for the lock of the database; the server keeps it until the connection ends."""
    from sqlalchemy import text

    for setting, seconds in _PROBED.items():
        connection.execute(text(f"SET {setting} = {seconds}"))
    connection.execute(text("SELECT pg_advisory_lock(:key)"), {"key": _KEY})
