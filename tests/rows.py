"""A catalogue of cases as one test: it tells all rows that fail."""

import inspect
from collections.abc import Callable, Iterable
from functools import wraps

import pytest


def each(names: str | Iterable[str], rows: Iterable) -> Callable:
    """Decorator of a test that takes `names` as arguments, as ``pytest.mark.parametrize`` has them: once for each of
    `rows`, in one test.
    """
    keys, rows = [name.strip() for name in (names.split(",") if isinstance(names, str) else names)], list(rows)

    def catalogue(test: Callable) -> Callable:
        @wraps(test)
        def whole(**fixtures):
            failures = []
            for row in rows:
                values = dict(zip(keys, row if len(keys) > 1 else [row], strict=True))
                try:
                    test(**fixtures, **values)
                except (Exception, pytest.fail.Exception) as error:
                    failures.append((values, error))
            if failures:
                told = "\n".join(f"{values}: {type(error).__name__}: {error}" for values, error in failures)
                raise AssertionError(f"{len(failures)} of {len(rows)} rows fail:\n{told}") from failures[0][1]

        own = inspect.signature(test)
        whole.__signature__ = own.replace(parameters=[own.parameters[key] for key in own.parameters if key not in keys])
        return whole

    return catalogue
