"""A clearance motion made of sines, in the place of a simulated one."""

import numpy as np
import pytest

from jointgap.config import Box, load_mechanism, read_yaml, resolve
from jointgap.lengths.objective import frozen_objective
from jointgap.lengths.region import Region
from jointgap.motion.kinematics import clearance_lift


@pytest.fixture(scope="session")
def mechanism():
    return load_mechanism("config/mechanisms/erkaya2009.yaml")


@pytest.fixture(scope="session")
def clearance():
    """Crank angles, and lengths and directions of the clearance vectors by name."""
    angle = np.radians(np.arange(0.05, 360.0, 0.5))
    length = 1e-3 + 2e-5 * np.sin(3 * angle)
    return angle, {
        "r2": length,
        "gamma2": angle + 0.8 * np.sin(3 * angle),
        "r3": length,
        "gamma3": 0.4 + 1.5 * np.tanh(4 * np.sin(angle)) + 0.3 * np.sin(5 * angle),
    }


@pytest.fixture(scope="session")
def objective(mechanism, clearance):
    angle, vectors = clearance
    return frozen_objective(mechanism, angle, clearance_lift(vectors))


PAPER = resolve(read_yaml("config/config.yaml"))["paper"].optimise


@pytest.fixture(scope="session")
def region():
    return Region.of(PAPER.boxes["paper"], PAPER.ratio_limit)


@pytest.fixture(scope="session")
def cut_region():
    """A box of which the inequality cuts off the part where the optimum would be."""
    return Region.of(Box(crank_length=(0.147, 0.153), rod_length=(0.555, 0.564)), 0.262)
