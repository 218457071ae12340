"""The benchmark's peers integrate the package's own equations of motion."""

import numpy as np
import pytest

from benchmarks.right_hand_side import right_hand_side
from jointgap.contact.joints import CONTACT, FLIGHT
from jointgap.motion.rates import evaluate
from jointgap.motion.runge_kutta import VELOCITY_TIME
from jointgap.motion.slider_crank import model_of
from jointgap.motion.workspace import HERE
from tests.motion.cases import mechanism, options

SCALES = np.repeat([1.0, VELOCITY_TIME], 4)


@pytest.mark.integration  # it compiles the equations anew
def test_peer_integrators_use_the_rates_of_the_package():
    model = model_of(mechanism(memory="published"), options())
    workspace = model.workspace()
    slope, gap = right_hand_side(model, workspace)
    state = np.array([1.002e-3, 1e-5, 2e-4, -1e-4, 0.03, 0.1, -0.02, 0.05])
    modes, approaches, rates = (CONTACT, FLIGHT), (0.1, np.inf), np.empty(8)

    def both():
        slope(0.002, SCALES * state, rates, modes, approaches)
        own = workspace.copy().k
        own.y[HERE, :8], own.time[HERE] = state, 0.002
        own.modes[:2], own.approaches[:2] = modes, approaches
        evaluate(model.p, own, HERE)
        return rates / SCALES, own.dy[HERE, :8].copy()

    given, own = both()
    np.testing.assert_allclose(given, own, rtol=1e-13)
    depth = np.hypot(1.002e-3, 1e-5) - 1e-3
    np.testing.assert_allclose(gap(SCALES * state, 0)[0], depth, rtol=1e-9)
    workspace.k.joints[0].stiffness *= 2.0
    stiffer, own = both()
    np.testing.assert_allclose(stiffer, own, rtol=1e-13)
    assert np.abs(stiffer - given).max() > 0.1 * np.abs(given).max()
