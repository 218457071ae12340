"""MLflow without its chatter."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from jointgap.core.errors import needs

_LEVELS = {"mlflow": logging.WARNING, "alembic": logging.WARNING, "mlflow.store.db.utils": logging.CRITICAL}


@contextmanager
def quiet() -> Iterator[None]:
    """Import MLflow here: no deprecations of its imports, then no progress, and no traceback beside what it raises."""
    with needs("publishing to MLflow", "workflow"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
    for name, level in _LEVELS.items():  # importing sets levels of its own
        logging.getLogger(name).setLevel(level)
