"""Drives of the crank: constant speed, measured angle, motor."""

import math

import pytest

from jointgap.config import Scenario, parse_options, resolve
from jointgap.core.errors import InputError
from tests.config.mechanisms import effect, mechanism

MOTOR = {"kind": "motor", "stall_torque": "12 N*m", "no_load_speed": "60 rpm", "inertia": "1 g*m^2"}


def scenario(drive: dict, *effects: dict, folders=()) -> Scenario:
    data = {"mechanism": mechanism(*effects).model_dump(), "simulate": {"drive": drive}}
    return resolve(data | {"scenarios": {"mine": {}}}, folders)["mine"]


def test_a_motor_has_its_line_in_si_and_survives_the_command_line():
    made = scenario(MOTOR)
    drive = made.simulate.drive
    numbers = (drive.stall_torque, drive.no_load_speed, drive.inertia)
    assert numbers == pytest.approx((12.0, 2 * math.pi, 1e-3))
    assert parse_options(made.model_dump_json()).simulate == made.simulate


def test_a_measured_file_is_found_in_the_folder_of_the_configuration(tmp_path):
    (tmp_path / "angle.csv").write_text("t,theta\n", encoding="utf-8")
    keys = {"kind": "measured", "file": "angle.csv", "time": "t", "angle": "theta"}
    keys |= {"angle_unit": "deg", "resolution": "0.1 deg"}
    drive = scenario(keys, folders=(tmp_path,)).simulate.drive
    assert drive.file == str(tmp_path / "angle.csv")
    assert drive.resolution == pytest.approx(math.radians(0.1))
    text = "simulate: {drive: {kind: measured, file: angle.csv}}\nmechanism: m.yaml\n"
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "m.yaml").write_text(mechanism().model_dump_json(), encoding="utf-8")
    assert parse_options(str(tmp_path / "mine.yaml")).simulate.drive.file == drive.file
    for unit, words in {"mm": "requires rad", "degg": "not a number with a unit"}.items():
        with pytest.raises(InputError, match=words):
            scenario(keys | {"angle_unit": unit}, folders=(tmp_path,))


@pytest.mark.parametrize(
    "drive, words",
    [
        ({"kind": "moter"}, "simulate.drive.kind = 'moter': no such kind; did you mean 'motor'"),
        ({"stall_torque": 3}, "key 'simulate.drive.kind' is missing"),
        ({"kind": "motor", "stall_torque": 3}, "no_load_speed' is missing"),
        (MOTOR | {"stall_torque": -1}, "stall_torque = -1.*greater than or equal to 0"),
        (MOTOR | {"stall_torq": 0}, "stall_torq'; did you mean 'stall_torque'"),
        ({"kind": "constant", "inertia": 1}, "unknown key .*inertia"),
        ({"kind": "measured", "file": "none.csv"}, "simulate.drive.file: no file 'none.csv'"),
    ],
)
def test_a_wrong_drive_is_an_error(drive, words):
    with pytest.raises(InputError, match=words):
        scenario(drive)


def test_a_speed_fluctuation_requires_constant_speed():
    fluctuation = effect("speed_fluctuation", ratio=0.1, order=2)
    made = scenario({"kind": "constant"}, fluctuation)
    assert made.mechanism.effect("speed_fluctuation").order == 2
    with pytest.raises(InputError, match=r"speed_fluctuation requires .*constant, not motor"):
        scenario(MOTOR, fluctuation)
