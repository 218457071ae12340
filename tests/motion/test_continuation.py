"""A motion depends neither on its samples nor on where it is interrupted."""

import math

import numpy as np
import pytest

from jointgap.motion.model import beginning
from jointgap.motion.simulation import integrate_on, integrate_to_angles, observed
from jointgap.motion.slider_crank import model_of, start_state
from tests.motion.cases import ALL, LUGRE, MOTOR, effect, mechanism, options
from tests.motion.test_balance import BENDING, FILMS, PIN_FRICTION

LOADED = effect("slider_load_friction", coefficient=0.2)
CASES = {
    "friction of ideal pins, motor": (PIN_FRICTION, {"loose": ()}, {"drive": MOTOR}),
    "friction under load, motor": ([LOADED], {"loose": ("crank_pin",)}, {"drive": MOTOR}),
    "friction of the other pin": ([PIN_FRICTION[1]], {"loose": ("crank_pin",)}, {}),
    "lugre, three loose": ([LOADED], LUGRE | {"loose": ALL}, {}),
    "bending rod, film": ([BENDING, FILMS[0]], {"friction": 0.1}, {}),
}
END = 4.0


@pytest.mark.parametrize("effects, keys, run", CASES.values(), ids=CASES)
def test_a_motion_depends_neither_on_samples_nor_on_interruptions(effects, keys, run):
    model = model_of(mechanism(*effects, **keys), options(**run))
    start = start_state(model)
    few, many = (
        integrate_to_angles(model, start, np.linspace(0.0, END, n), 1e-9) for n in (2, 401)
    )
    assert few.steps <= many.steps  # samples in nonsmooth steps cost some
    assert np.array_equal(few.events, many.events, equal_nan=True)
    angles = np.linspace(0.0, END, 401)
    workspace = beginning(model, start, 0.0)
    for part in np.split(angles, [1, 50, 300]):
        found, workspace = integrate_on(model, workspace, part, 1e-9)
        here = np.searchsorted(angles, part[0])
        assert np.array_equal(found.states, many.states[here : here + part.size])


@pytest.mark.parametrize("name", ["friction of ideal pins, motor", "friction of the other pin"])
def test_quantities_of_a_sample_do_not_depend_on_the_others(name):
    effects, keys, run = CASES[name]
    model = model_of(mechanism(*effects, **keys), options(**run))
    found = integrate_to_angles(model, start_state(model), np.linspace(0.0, END, 101), 1e-9)
    every, some = observed(model, found), observed(model, found.part(slice(40, None, 7)))
    for column, values in every.items():
        assert np.array_equal(values[40::7], some[column], equal_nan=True), column
    assert math.isfinite(every["guide_force"].sum())
