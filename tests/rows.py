"""A catalogue of cases as one test: it tells all rows that fail."""

import inspect
from collections.abc import Callable, Iterable
from functools import wraps

from tests.catalogue import each as of_all


def each(names: str | Iterable[str], rows: Iterable) -> Callable:
    """Decorator of a test that takes `names` as arguments, as ``pytest.mark.parametrize`` has them:
    once for each of `rows`, in one test.
    """
    keys, rows = (
        [name.strip() for name in (names.split(",") if isinstance(names, str) else names)],
        list(rows),
    )

    def catalogue(test: Callable) -> Callable:
        @wraps(test)
        def whole(**fixtures):
            cases = [row if len(keys) > 1 else (row,) for row in rows]
            of_all(
                lambda *row: test(**fixtures, **dict(zip(keys, row, strict=True))),
                map(tuple, cases),
            )

        own = inspect.signature(test)
        whole.__signature__ = own.replace(
            parameters=[own.parameters[key] for key in own.parameters if key not in keys]
        )
        return whole

    return catalogue
