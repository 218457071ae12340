"""Catalogues: many cases of one kind in one test, which tells all that fail."""

from collections.abc import Callable, Iterable

import pytest
import yaml
from _pytest.outcomes import Failed

from jointgap.core.errors import InputError


def each(check: Callable, cases: Iterable) -> None:
    """Call `check` with every case, a tuple of what it is given or the only thing; one failure
    tells of all."""
    told, count = [], 0
    for count, case in enumerate(cases, 1):  # noqa: B007
        try:
            check(*(case if isinstance(case, tuple) else (case,)))
        except (Exception, Failed) as error:
            told.append(f"{repr(case)[:200]}: {type(error).__name__}: {error}")
    assert count, "no cases"
    assert not told, "\n".join([f"{len(told)} of {count} cases fail", *told])


def refused(
    act: Callable, cases: Iterable, error: type[Exception] = InputError, starts: str = ""
) -> None:
    """`act` with what each case gives, all but its last part, raises an error whose text holds the
    words of that part, which ` ~ ` separates, and begins with `starts`.
    """

    def check(*case: object) -> None:
        *given, words = case
        with pytest.raises(error) as caught:
            act(*given)
        said = str(caught.value)
        assert said.startswith(starts), said
        assert [word for word in str(words).split(" ~ ") if word not in said] == [], said

    each(check, cases)


def written(table: str) -> list[tuple]:
    """Rows `a => b => words` of a text; what stands before an arrow is YAML."""
    rows = [line.split(" => ") for line in table.strip().splitlines()]
    return [(*map(yaml.safe_load, given), words.strip()) for *given, words in rows]
