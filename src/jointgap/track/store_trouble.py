"""What a store that cannot be used says, in one sentence that names it and tells what to do."""

import errno
import re
from collections.abc import Iterator
from contextlib import contextmanager

from jointgap.core.errors import InputError
from jointgap.track import sqlite_store

_DEFAULT = "unset MLFLOW_TRACKING_URI to use the store in the results folder"
_PACKAGES = {"psycopg2": "psycopg2-binary", "MySQLdb": "mysqlclient"}
"""Drivers of databases, by what Python imports, where that is not the package's own name."""


def without_password(address: str) -> str:
    """The `address` of a store as it may be shown."""
    return re.sub(r"(?<=://)([^/@]*):[^/]*@", r"\1:***@", address)


@contextmanager
def explained(address: str, reached: bool) -> Iterator[None]:
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
        raise InputError(f"MLflow store {without_password(address)} {_trouble(error, address, reached)}") from error


def _trouble(error: Exception, address: str, reached: bool) -> str:
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
    if reached and getattr(error, "error_code", None) in ("INVALID_PARAMETER_VALUE", "RESOURCE_ALREADY_EXISTS"):
        return f"does not take what is published ({said}); the store itself is sound"
    if sqlite_store.file_of(address) is not None:
        return f"cannot be used ({said}); check permission and space"
    return (
        f"cannot be reached or refuses ({said}); start the server, correct its address, user or password, or {_DEFAULT}"
    )
