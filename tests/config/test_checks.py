"""What has to hold between a mechanism and how it is driven, with a scenario around both or without."""

import pytest

from jointgap.config import Simulate, check_drive, check_tolerance
from jointgap.core.errors import InputError
from tests.config.mechanisms import effect, mechanism, paper

MOTOR = {"kind": "motor", "stall_torque": 3, "no_load_speed": 100}


def test_a_tolerance_is_a_ten_thousandth_of_the_smallest_loose_clearance_at_most():
    tight = mechanism(effect("piston_pin_clearance", clearance_m="0.1 mm")).applied()
    check_tolerance(tight, Simulate(tolerance=1e-8))
    with pytest.raises(InputError, match=r"tolerance 1\.1e-08 m .* clearance 0\.0001 m of piston_pin.* give 1e-08 m"):
        check_tolerance(tight, Simulate(tolerance=1.1e-8))
    check_tolerance(paper(), Simulate(tolerance=1e-7))


def test_a_tolerance_needs_no_clearance():
    check_tolerance(mechanism(joints={"crank_pin": "ideal", "piston_pin": "ideal"}), Simulate(tolerance=1e-7))


def test_the_clearance_of_an_ideal_joint_does_not_count():
    tight = {"loose": False, "bearing_radius": "7.001 mm"}
    check_tolerance(mechanism(joints={"piston_pin": tight}), Simulate(tolerance=1e-7))


@pytest.mark.parametrize("drive", [MOTOR, {"kind": "measured", "file": "angle.csv"}])
def test_a_speed_fluctuates_about_a_constant_one_alone(drive):
    fluctuating = mechanism(effect("speed_fluctuation", ratio=0.1, order=2))
    check_drive(fluctuating, Simulate())
    check_drive(paper(), Simulate(drive=drive))
    with pytest.raises(InputError, match=f"kind constant alone, not with {drive['kind']}"):
        check_drive(fluctuating, Simulate(drive=drive))
