"""Whether the store to publish to is there, asked before hours of work whose results would find no place."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jointgap.track import sqlite_store
from jointgap.track.mlflow_store import Store
from jointgap.track.store_lock import connected, is_postgresql
from jointgap.track.store_trouble import explained

_IMPATIENT = {"MLFLOW_HTTP_REQUEST_TIMEOUT": "5", "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0"}
"""What MLflow reads from the environment meanwhile: seconds to wait for a server, and how often it asks again."""


def check(address: str) -> None:
    """Whether the store at `address` answers; a SQLite file is made when it is first needed."""
    if sqlite_store.file_of(address) is not None:
        return
    if is_postgresql(address):
        with explained(address, reached=False):
            connected(address).close()
        return
    with _environment(_IMPATIENT):
        Store(address, Path())


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """These variables of the environment as long as it lasts."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
