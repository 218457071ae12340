"""What turns the crank: constant speed, a measured angle, a motor."""

import math

import pytest

from jointgap.config import Scenario, parse_options, resolve, validate
from tests.catalogue import refused, written
from tests.config.mechanisms import effect, mechanism

MOTOR = {"kind": "motor", "stall_torque": 3, "no_load_speed": 100}


def scenario(drive: dict, *effects: dict, folders=()) -> Scenario:
    data = {
        "mechanism": mechanism(*effects).model_dump(),
        "simulate": {"drive": drive},
        "scenarios": {"mine": {}},
    }
    return resolve(data, folders)["mine"]


def test_a_drive_is_constant_unless_a_motor_has_its_line_and_survives_the_command_line():
    assert (
        validate(Scenario, {"mechanism": mechanism().model_dump()}, "mine").simulate.drive.kind
        == "constant"
    )
    motor = {
        "kind": "motor",
        "stall_torque": "12 N*m",
        "no_load_speed": "60 rpm",
        "inertia": "1 g*m^2",
    }
    drive = scenario(motor).simulate.drive
    assert (drive.stall_torque, drive.no_load_speed, drive.inertia) == pytest.approx(
        (12.0, 2 * math.pi, 1e-3)
    )
    for given in ({"kind": "constant"}, MOTOR):
        made = scenario(given)
        assert parse_options(made.model_dump_json()).simulate == made.simulate


def test_a_measured_file_is_found_beside_the_configuration(tmp_path):
    (tmp_path / "angle.csv").write_text("t,theta\n", encoding="utf-8")
    given = {"kind": "measured", "file": "angle.csv", "time": "t", "angle": "theta"}
    given |= {"angle_unit": "deg", "resolution": "0.1 deg"}
    drive = scenario(given, folders=(tmp_path,)).simulate.drive
    assert (drive.file, drive.resolution) == (
        str(tmp_path / "angle.csv"),
        pytest.approx(math.radians(0.1)),
    )
    text = "simulate: {drive: {kind: measured, file: angle.csv}}\nmechanism: m.yaml\n"
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "m.yaml").write_text(mechanism().model_dump_json(), encoding="utf-8")
    assert parse_options(str(tmp_path / "mine.yaml")).simulate.drive.file == drive.file
    units = [("mm", "requires rad"), ("degg", "not a number with a unit")]
    refused(lambda unit: scenario(given | {"angle_unit": unit}, folders=(tmp_path,)), units)


def test_a_drive_that_makes_no_sense_is_refused():
    rows = """
    {kind: moter} => simulate.drive.kind = 'moter' ~ no such kind ~ did you mean 'motor'
    {stall_torque: 3} => key 'simulate.drive.kind' is missing
    {kind: motor, stall_torque: 3} => no_load_speed' is missing
    {kind: motor, stall_torque: -1, no_load_speed: 3} => stall_torque = -1 ~ greater than or equal to 0
    {kind: constant, inertia: 1} => unknown key ~ inertia
    {kind: motor, stall_torq: 0, no_load_speed: 3} => stall_torq' ~ did you mean 'stall_torque'
    {kind: measured, file: nowhere.csv} => simulate.drive.file ~ no file 'nowhere.csv'
    """
    refused(scenario, written(rows))


def test_a_speed_fluctuates_about_a_constant_one_alone():
    fluctuation = effect("speed_fluctuation", ratio=0.1, order=2)
    assert (
        scenario({"kind": "constant"}, fluctuation).mechanism.effect("speed_fluctuation").order == 2
    )
    refused(scenario, [(MOTOR, fluctuation, "speed_fluctuation requires ~ constant, not motor")])
