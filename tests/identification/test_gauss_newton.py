"""The parts of a descent by themselves: step, correction of the Jacobian, damping and stopping rule."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.identification.fit import StoppingRule, bounded_step, broyden_update, next_damping
from jointgap.identification.settings import DEFAULT_SETTINGS

DAMPING, STOPPING = DEFAULT_SETTINGS.damping, DEFAULT_SETTINGS.stopping


def rule(*course: float, size: int = 100, **how) -> StoppingRule:
    """A stopping rule that has seen chi2 take these values."""
    stopping = StoppingRule(STOPPING, size, **how)
    for chi2 in course:
        stopping.record(chi2)
    return stopping


@pytest.mark.parametrize(("damping", "step"), [(0.0, -2.0), (1.0, -1.0), (3.0, -0.5)])
def test_damping_shortens_a_step_in_units_of_the_columns_length(damping, step):
    wide = np.array([-np.inf]), np.array([np.inf])
    found, chi2 = bounded_step(np.array([[2.0]]), np.array([4.0]), *wide, damping)
    assert found[0] == pytest.approx(step)
    assert chi2 == pytest.approx((4.0 + 2.0 * step) ** 2)  # without the damping


def test_what_no_column_reaches_remains_in_chi2():
    wide = np.full(1, -np.inf), np.full(1, np.inf)
    assert bounded_step(np.array([[1.0], [0.0]]), np.array([2.0, 3.0]), *wide)[1] == pytest.approx(9.0)
    assert bounded_step(np.zeros((2, 1)), np.array([2.0, 3.0]), *wide)[1] == 13.0


def test_a_parameter_without_room_takes_no_step():
    step, chi2 = bounded_step(np.eye(2), np.array([1.0, 1.0]), np.array([0.0, -5.0]), np.array([0.0, 5.0]))
    np.testing.assert_allclose(step, [0.0, -1.0])
    assert chi2 == pytest.approx(1.0)


def test_a_corrected_jacobian_agrees_with_the_step_and_is_unchanged_across_it():
    generator = np.random.default_rng(0)
    jacobian, step, change = (
        generator.standard_normal((6, 3)),
        generator.standard_normal(3),
        generator.standard_normal(6),
    )
    corrected = broyden_update(jacobian, step, change)
    np.testing.assert_allclose(corrected @ step, change)
    weight = step * np.sum(jacobian**2, axis=0)
    across = np.cross(weight, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(corrected @ across, jacobian @ across)


def test_a_correction_does_not_depend_on_units():
    generator = np.random.default_rng(1)
    jacobian, step, change = (
        generator.standard_normal((6, 3)),
        generator.standard_normal(3),
        generator.standard_normal(6),
    )
    units = np.array([1e-3, 1.0, 1e6])
    np.testing.assert_allclose(
        broyden_update(jacobian / units, step * units, change), broyden_update(jacobian, step, change) / units
    )


def test_without_a_step_nothing_is_corrected():
    jacobian = np.ones((2, 1))
    assert broyden_update(jacobian, np.zeros(1), np.ones(2)) is jacobian


@pytest.mark.parametrize("fresh", [True, False])
def test_after_a_good_step_damping_falls_and_ends(fresh):
    assert next_damping(1.0, 0.26, fresh, DAMPING) == pytest.approx(0.1)
    assert next_damping(1.1e-4, 1.0, fresh, DAMPING) == pytest.approx(1.1e-5)
    assert next_damping(1e-4, 1.0, fresh, DAMPING) == 0.0
    assert next_damping(0.0, 1.0, fresh, DAMPING) == 0.0


def test_after_a_bad_step_a_worn_jacobian_is_made_anew_and_a_fresh_one_damped():
    for gain_ratio in (0.25, 0.0, -np.inf):
        assert next_damping(1.0, gain_ratio, False, DAMPING) is None
        assert next_damping(0.0, gain_ratio, True, DAMPING) == 1e-3
        assert next_damping(2e-4, gain_ratio, True, DAMPING) == pytest.approx(2e-3)


def test_a_step_has_to_promise_more_the_poorer_the_fit():
    assert rule(50.0).min_decrease() == 0.05
    assert rule(50.0, 300.0).min_decrease() == pytest.approx(0.05 * 9.0)
    assert rule(2000.0).min_decrease() == pytest.approx(20.0)
    assert rule(1e14).min_decrease() == pytest.approx(1e12)  # never more than what one of 100 samples leaves
    assert rule(300.0, numerical_noise_chi2=7.0).min_decrease() == 7.0


def test_a_poor_fit_ends_where_it_gains_less_than_two_percent_in_four_steps():
    assert rule(1000.0, 995.0, 992.0, 990.0, 981.0).poor_and_slow()
    assert not rule(1000.0, 995.0, 992.0, 990.0, 980.0).poor_and_slow()
    assert not rule(1000.0, 1000.0, 1000.0, 1000.0).poor_and_slow()  # not yet four steps
    assert rule(*[200.1] * 5).poor_and_slow()
    assert not rule(*[200.0] * 5).poor_and_slow()  # at two per sample it is not poor


def test_a_fit_beaten_threefold_ends_where_it_gains_less_than_a_fifth_in_two_steps():
    assert rule(1000.0, 950.0, 840.0, sufficient_chi2=100.0).poor_and_slow()
    assert not rule(1000.0, 950.0, 830.0, sufficient_chi2=100.0).poor_and_slow()
    assert not rule(300.0, 300.0, 300.0, sufficient_chi2=100.0).poor_and_slow()  # not beaten yet


def test_a_long_fit_creeps_where_it_gains_less_than_two_in_four_steps():
    assert rule(*[100.0] * 5).stalled(10)
    assert not rule(*[100.0] * 5).stalled(9)
    slow = (102.0, 101.5, 101.0, 100.5, 100.0)
    assert not rule(*slow).stalled(10)
    assert rule(*slow, numerical_noise_chi2=5.0).stalled(10)


def test_a_creeping_fit_gets_a_new_jacobian_as_long_as_that_helps():
    stopping = rule(100.0)
    assert stopping.renew(12)
    assert not stopping.stalled(21) and stopping.stalled(22)
    stopping.record(98.0)
    assert stopping.renew(22)
    stopping.record(96.1)
    assert not stopping.renew(32)


def test_the_numbers_of_a_rule_are_those_of_its_settings():
    stopping = StoppingRule(replace(STOPPING, min_decrease=1.0, max_steps=7, stalled_after=3), 100)
    stopping.record(100.0)
    assert (stopping.min_decrease(), stopping.settings.max_steps) == (1.0, 7)
    assert stopping.stalled(3) and not stopping.stalled(2)
