"""One set of synthetic tables for all tests of figures."""

import pytest

from tests.scenario import drawn_tables as synthetic


@pytest.fixture(scope="session")
def scenario():
    return synthetic.scenario()


@pytest.fixture(scope="session")
def tables(scenario):
    return synthetic.tables_of(scenario)
