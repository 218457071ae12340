"""One set of synthetic tables for all tests of figures."""

import importlib.util
from pathlib import Path

import pytest

_spec = importlib.util.spec_from_file_location("figures_synthetic", Path(__file__).with_name("synthetic.py"))
synthetic = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(synthetic)


@pytest.fixture(scope="session")
def scenario():
    return synthetic.scenario()


@pytest.fixture(scope="session")
def tables(scenario):
    return synthetic.tables_of(scenario)
