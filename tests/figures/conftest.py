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


@pytest.fixture(scope="session", params=[("crank_pivot",), synthetic.JOINTS], ids="-".join)
def another(request):
    """Scenario and tables of another set of loose joints than the paper's."""
    options = synthetic.scenario(request.param)
    return options, synthetic.tables_of(options)


@pytest.fixture(scope="session")
def without_clearance():
    """Scenario and tables of the mechanism whose joints are all ideal."""
    options = synthetic.scenario(())
    return options, {"trajectory": synthetic.trajectory(options)}


@pytest.fixture(scope="session")
def tables(scenario):
    return synthetic.tables_of(scenario)
