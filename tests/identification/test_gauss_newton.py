"""The parts of a descent by themselves: step, correction of the Jacobian, damping and stopping rule."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.identification.fit import StoppingRule, bounded_step, broyden_update, next_damping
from jointgap.identification.settings import DEFAULT_SETTINGS

DAMPING, STOPPING = DEFAULT_SETTINGS.damping, DEFAULT_SETTINGS.stopping
WIDE = np.full(1, -np.inf), np.full(1, np.inf)


def rule(*course: float, settings=STOPPING, **how) -> StoppingRule:
    """A stopping rule of 100 samples that has seen chi2 take these values."""
    stopping = StoppingRule(settings, 100, **how)
    for chi2 in course:
        stopping.record(chi2)
    return stopping


def test_damping_shortens_a_step_in_units_of_the_columns_length():
    for damping, step in ((0.0, -2.0), (1.0, -1.0), (3.0, -0.5)):
        found, chi2 = bounded_step(np.array([[2.0]]), np.array([4.0]), *WIDE, damping)
        assert found[0] == pytest.approx(step)
        assert chi2 == pytest.approx((4.0 + 2.0 * step) ** 2)  # without the damping


def test_what_no_column_reaches_remains_in_chi2_and_without_room_or_effect_there_is_no_step():
    assert bounded_step(np.array([[1.0], [0.0]]), np.array([2.0, 3.0]), *WIDE)[1] == pytest.approx(9.0)
    assert bounded_step(np.zeros((2, 1)), np.array([2.0, 3.0]), *WIDE)[1] == 13.0
    step, chi2 = bounded_step(np.eye(2), np.ones(2), np.array([0.0, -5.0]), np.array([0.0, 5.0]))
    assert ([*step], chi2) == (pytest.approx([0.0, -1.0]), pytest.approx(1.0))
    step, _ = bounded_step(np.array([[1.0, 0.0], [1.0, 0.0]]), np.ones(2), np.full(2, -5.0), np.full(2, 5.0))
    np.testing.assert_allclose(step, [-1.0, 0.0])


def test_a_corrected_jacobian_agrees_with_the_step_and_is_unchanged_across_it_in_any_units():
    generator = np.random.default_rng(0)
    jacobian, step, change = (generator.standard_normal(shape) for shape in ((6, 3), 3, 6))
    corrected = broyden_update(jacobian, step, change)
    np.testing.assert_allclose(corrected @ step, change)
    across = np.cross(step * np.sum(jacobian**2, axis=0), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(corrected @ across, jacobian @ across)
    units = np.array([1e-3, 1.0, 1e6])
    np.testing.assert_allclose(broyden_update(jacobian / units, step * units, change), corrected / units)
    assert broyden_update(jacobian, np.zeros(3), change) is jacobian  # without a step


def test_damping_falls_and_ends_after_good_steps_and_after_a_bad_one_a_worn_jacobian_is_made_anew():
    for fresh in (True, False):
        falling = [
            next_damping(*given, fresh, DAMPING) for given in ((1.0, 0.26), (1.1e-4, 1.0), (1e-4, 1.0), (0.0, 1.0))
        ]
        assert falling == pytest.approx([0.1, 1.1e-5, 0.0, 0.0])
    for gain_ratio in (0.25, 0.0, -np.inf):
        assert next_damping(1.0, gain_ratio, False, DAMPING) is None
        assert next_damping(0.0, gain_ratio, True, DAMPING) == 1e-3
        assert next_damping(2e-4, gain_ratio, True, DAMPING) == pytest.approx(2e-3)


def test_a_step_has_to_promise_more_the_poorer_the_fit():
    promised = [rule(*course).min_decrease() for course in ((50.0,), (50.0, 300.0), (2000.0,), (1e14,))]
    assert promised == pytest.approx([0.05, 0.05 * 9.0, 20.0, 1e12])  # never more than what one of 100 samples leaves
    assert rule(300.0, numerical_noise_chi2=7.0).min_decrease() == 7.0
    own = rule(100.0, settings=replace(STOPPING, min_decrease=1.0, creeping_after=3))
    assert own.min_decrease() == 1.0 and own.creeping(3) and not own.creeping(2)


def test_a_poor_fit_ends_where_it_gains_little_and_a_beaten_one_sooner():
    assert rule(1000.0, 995.0, 992.0, 990.0, 981.0).poor_and_slow()  # less than two percent in four steps
    assert not rule(1000.0, 995.0, 992.0, 990.0, 980.0).poor_and_slow()
    assert not rule(1000.0, 1000.0, 1000.0, 1000.0).poor_and_slow()  # not yet four steps
    assert rule(*[200.1] * 5).poor_and_slow()
    assert not rule(*[200.0] * 5).poor_and_slow()  # at two per sample it is not poor
    assert rule(1000.0, 950.0, 840.0, sufficient_chi2=100.0).poor_and_slow()  # less than a fifth in two steps
    assert not rule(1000.0, 950.0, 830.0, sufficient_chi2=100.0).poor_and_slow()
    assert not rule(300.0, 300.0, 300.0, sufficient_chi2=100.0).poor_and_slow()  # not beaten yet


def test_a_long_fit_creeps_where_it_gains_less_than_two_in_four_steps_and_gets_a_new_jacobian_while_that_helps():
    assert rule(*[100.0] * 5).creeping(10) and not rule(*[100.0] * 5).creeping(9)
    slow = (102.0, 101.5, 101.0, 100.5, 100.0)
    assert not rule(*slow).creeping(10) and rule(*slow, numerical_noise_chi2=5.0).creeping(10)
    stopping = rule(100.0)
    assert stopping.renew(12)
    assert not stopping.creeping(21) and stopping.creeping(22)
    stopping.record(98.0)
    assert stopping.renew(22)
    stopping.record(96.1)
    assert not stopping.renew(32)
