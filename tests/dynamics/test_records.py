"""Records of numbers: what Python reads and changes is what compiled code receives."""

import copy
import pickle

import numba
import pytest

from jointgap.dynamics.parameters import DriveParameters, record


@numba.njit
def _speed(numbers):
    return numbers.speed


@pytest.fixture
def numbers():
    return record(DriveParameters(speed=10.0, start_angle=0.5))


def test_compiled_code_sees_what_python_changes(numbers):
    numbers.speed *= 2.0
    assert (numbers.speed, _speed(numbers)) == (20.0, 20.0)


@pytest.mark.parametrize("copied", [lambda one: one.copy(), copy.copy, copy.deepcopy])
def test_a_copy_has_numbers_of_its_own(numbers, copied):
    other = copied(numbers)
    other.speed = 20.0
    assert (numbers.speed, _speed(numbers)) == (10.0, 10.0)
    assert (other.speed, _speed(other)) == (20.0, 20.0)


def test_another_process_reads_the_same_numbers(numbers):
    other = pickle.loads(pickle.dumps(numbers))
    assert (other.speed, _speed(other)) == (10.0, 10.0)


def test_a_number_that_is_not_there_is_told_with_those_that_are(numbers):
    with pytest.raises(AttributeError, match=r"there is no sped; there are .*speed"):
        numbers.sped  # noqa: B018
