"""As clearances vanish a loose mechanism tends to the ideal one, in proportion to them."""

import numpy as np
import pytest

from jointgap.dynamics.simulation import simulate
from tests.dynamics.cases import ALL, CRANK, MOTOR, PINS, ROD, mechanism, options

CASES = {
    "both pins": ({"loose": PINS}, {}),
    "both pins, offset": ({"loose": PINS, "offset": 0.05}, {}),
    "crank pin": ({"loose": ("crank_pin",)}, {}),
    "piston pin": ({"loose": ("piston_pin",)}, {}),
    "crank pivot": ({"loose": ("crank_pivot",)}, {}),
    "all three": ({"loose": ALL}, {}),
}


@pytest.mark.parametrize("case", CASES)
def test_with_vanishing_clearance_the_motion_tends_to_the_ideal_one(case, worst):
    keys, drive = CASES[case]
    offset, distances = keys.get("offset", 0.0), []
    for clearance in (1e-3, 1e-4, 1e-5):
        made = mechanism(friction=0.1, clearance=clearance, **keys)
        samples = simulate(made, options(tolerance=1e-11, **drive)).samples
        rise = offset - CRANK * np.sin(samples.crank_angle)
        slider = CRANK * np.cos(samples.crank_angle) + np.sqrt(ROD**2 - rise**2)
        apart = samples.r1.max() + samples.r2.max() + samples.r3.max()
        assert apart < len(keys["loose"]) * (clearance + 1e-4)  # the surfaces give way by less than that
        distances.append(np.abs(samples.slider_position - slider).max())
        assert distances[-1] < 1.1 * apart
        assert np.abs(samples.rod_angle - np.arcsin(rise / ROD)).max() < 1.1 * apart / ROD
    # a tenth of the clearance, about a tenth of the distance: down to what the surfaces give way by
    assert distances[0] > 5 * distances[1] > 25 * distances[2]
    worst("distance from the ideal slider at c = 10 um [m]", distances[-1], 5e-5)


def test_with_a_motor_too_the_motion_tends_to_the_ideal_one():
    ideal = simulate(mechanism(loose=()), options(drive=MOTOR)).samples
    distances = []
    for clearance in (1e-3, 1e-4, 1e-5):
        made = mechanism(loose=ALL, clearance=clearance)  # friction would stay
        samples = simulate(made, options(tolerance=1e-11, drive=MOTOR)).samples
        distances.append([np.abs(samples[name] - ideal[name]).max() for name in ("slider_position", "time")])
    for far, near, nearest in np.array(distances).T:
        assert far > 3 * near > 9 * nearest
