"""One set of synthetic tables for all tests of figures."""

import pytest

from tests.figures import synthetic


@pytest.fixture(scope="session")
def scenario():
    return synthetic.scenario()


@pytest.fixture(scope="session")
def tables(scenario):
    return synthetic.tables_of(scenario)
