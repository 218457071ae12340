"""The largest deviation of every exact test, printed at the end with -v."""

from collections.abc import Callable

import pytest


@pytest.fixture
def worst(record_property) -> Callable[[str, float, float], None]:
    """A function that checks that a deviation is within its bound, and remembers it under a
    name."""

    def within(name: str, deviation: float, bound: float) -> None:
        record_property("worst", (name, float(deviation), float(bound)))
        assert deviation <= bound, f"{name}: {deviation:.3g} is more than {bound:.3g}"

    return within


def pytest_terminal_summary(terminalreporter, config) -> None:
    found: dict[str, tuple[float, float, str]] = {}
    for report in terminalreporter.getreports("passed"):
        for key, record in report.user_properties:
            if key == "worst" and record[1] >= found.get(record[0], (-1.0,))[0]:
                found[record[0]] = (record[1], record[2], report.nodeid.rpartition("::")[2])
    if found and config.get_verbosity() > 0:
        terminalreporter.section("worst cases")
        for name, (deviation, bound, test) in sorted(found.items()):
            terminalreporter.write_line(f"{name:<60} {deviation:8.1e} (bound {bound:.0e}) {test}")
