import numpy as np
import pytest

from jointgap.dynamics.kinematics import Motion, rotating_vector


def jets(time):
    """Analytic length and direction with their true derivatives, valid for complex times too."""
    length = Motion(1e-3 + 2e-4 * np.sin(7 * time), 1.4e-3 * np.cos(7 * time), -9.8e-3 * np.sin(7 * time))
    direction = Motion(3 * time + time**2, 3 + 2 * time, 2 + 0 * time)
    return length, direction


def test_velocity_and_acceleration_of_a_turning_growing_vector_are_derivatives_to_rounding():
    time, step = np.linspace(0, 2, 41), 1e-30
    for component, complex_component in zip(
        rotating_vector(*jets(time)), rotating_vector(*jets(time + 1j * step)), strict=True
    ):
        velocity = np.imag(complex_component.position) / step
        acceleration = np.imag(complex_component.velocity) / step
        assert component.velocity == pytest.approx(velocity, rel=1e-13, abs=1e-15)
        assert component.acceleration == pytest.approx(acceleration, rel=1e-13, abs=1e-15)


def test_a_vector_of_no_length_is_zero_and_its_derivatives_undefined_where_its_direction_is():
    length = Motion.of(np.array([0.0, 1e-3]), np.array([0.1, 0.0]))
    direction = Motion.of(np.array([np.nan, 0.0]), np.array([np.nan, 1.0]))
    x, y = rotating_vector(length, direction)
    assert x.position[0] == 0.0 and y.position[0] == 0.0
    assert np.isnan(x.velocity[0]) and np.isnan(y.acceleration[0])
    assert x.position[1] == 1e-3 and y.velocity[1] == 1e-3


def test_motions_add_subtract_and_scale_term_by_term():
    one, other = Motion.of(1.0, 2.0, 3.0), Motion.of(10.0, 20.0, 30.0)
    assert one + other == Motion.of(11.0, 22.0, 33.0)
    assert other - one == Motion.of(9.0, 18.0, 27.0)
    assert one * 2.0 == Motion.of(2.0, 4.0, 6.0)


def test_standing_still_keeps_positions_and_drops_both_derivatives():
    still = Motion.of(np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.array([5.0, 6.0])).standing_still()
    assert list(still.position) == [1.0, 2.0]
    assert not still.velocity.any() and not still.acceleration.any()
