"""Accuracy: against independent code, against itself at tighter tolerances, at samples and at events."""

import numpy as np
import pytest

from jointgap.dynamics.contact import LAWS
from jointgap.dynamics.equations import CLAMPED
from tests.dynamics import plain
from tests.dynamics.cases import SPEED, marched, mechanism

DEGREES = np.arange(0.0, 45.5, 0.5)


@pytest.mark.parametrize(
    ("law", "restitution", "friction", "friction_speed"),
    [
        ("lankarani_nikravesh", 0.46, 0.0, 1e-3),
        ("exact_restitution", 0.46, 0.1, 0.1),
    ],
)
def test_independent_code_gives_the_same_motion(law, restitution, friction, friction_speed):
    made = mechanism(law=law, restitution=restitution, friction=friction, friction_speed=friction_speed)
    _, run = marched(made, DEGREES, tolerance=1e-14)
    states, impacts = plain.simulate(
        np.radians(DEGREES), SPEED, LAWS[law](restitution), friction, friction_speed, tolerance=1e-15
    )
    assert np.abs(run.states[:, [0, 1, 3]] - states[:, [0, 1, 3]]).max() < 1e-10
    assert np.abs(run.states[:, 2] - states[:, 2]).max() < 1e-10
    ours = run.events[run.events[:, 2] == 1]
    assert len(ours) >= 5
    np.testing.assert_array_equal(ours[:, 1], impacts[:, 1])
    np.testing.assert_allclose(ours[:, 0], impacts[:, 0], rtol=1e-8)
    np.testing.assert_allclose(ours[:, 3], impacts[:, 2], rtol=1e-6)


@pytest.mark.slow
def test_independent_code_agrees_where_heavy_damping_holds_the_force_at_zero():
    degrees = np.arange(0.0, 221.0)
    made = mechanism(law="exact_restitution", restitution=0.1)
    _, run = marched(made, degrees, tolerance=1e-14)
    assert (run.modes == CLAMPED).any()
    states, impacts = plain.simulate(np.radians(degrees), SPEED, LAWS["exact_restitution"](0.1), 0.0, 1e-3, 1e-15)
    assert np.abs(run.states - states)[:, :4].max() < 1e-11
    assert len(impacts) == (run.events[:, 2] == 1).sum()


@pytest.mark.parametrize(
    ("case", "bound"),
    [({}, 1e-11), ({"friction": 0.1}, 1e-10), ({"restitution": 0.9, "law": "exact_restitution"}, 1e-10)],
)
def test_the_error_at_samples_falls_with_the_tolerance(case, bound):
    made = mechanism(**case)
    degrees = np.arange(0.0, 20.01, 0.1)
    _, exact = marched(made, degrees, tolerance=1e-15)
    tolerances = 10.0 ** -np.arange(8, 14)
    errors = []
    for tolerance in tolerances:
        _, run = marched(made, degrees, tolerance)
        errors.append(np.abs(run.states - exact.states)[:, [0, 1, 3]].max())
    assert errors[-1] < bound
    # one more power of ten in the tolerance is worth nearly one in the error
    assert 0.75 < np.polyfit(np.log10(tolerances), np.log10(errors), 1)[0] < 1.25


def test_samples_do_not_change_the_motion():
    made = mechanism()
    _, fine = marched(made, np.arange(0, 3601) / 10, 1e-11)
    _, coarse = marched(made, np.arange(0, 361), 1e-11)
    np.testing.assert_array_equal(fine.states[::10], coarse.states)
    np.testing.assert_array_equal(fine.events, coarse.events)
    assert fine.steps == coarse.steps


def test_a_longer_run_begins_with_the_shorter_one():
    made = mechanism(friction=0.1)
    _, one = marched(made, np.arange(0, 361), 1e-11)
    _, two = marched(made, np.arange(0, 721), 1e-11)
    np.testing.assert_array_equal(one.states, two.states[:361])
