"""What turns the crank: constant speed, a measured angle, a motor."""

import math

import pytest

from jointgap.config import Scenario, parse_options, resolve, validate
from jointgap.core.errors import InputError
from tests.config.mechanisms import effect, mechanism


def scenario(drive: dict, *effects: dict, folders=()) -> Scenario:
    data = {"mechanism": mechanism(*effects).model_dump(), "simulate": {"drive": drive}, "scenarios": {"mine": {}}}
    return resolve(data, folders)["mine"]


def test_the_crank_turns_at_constant_speed_unless_told_otherwise():
    assert validate(Scenario, {"mechanism": mechanism().model_dump()}, "mine").simulate.drive.kind == "constant"


def test_a_motor_has_a_torque_speed_line():
    drive = scenario(
        {"kind": "motor", "stall_torque": "12 N*m", "no_load_speed": "60 rpm", "inertia": "1 g*m^2"}
    ).simulate.drive
    assert drive.stall_torque == 12.0
    assert drive.no_load_speed == pytest.approx(2 * math.pi)
    assert drive.inertia == pytest.approx(1e-3)


def test_a_measured_file_is_found_beside_the_configuration(tmp_path):
    (tmp_path / "angle.csv").write_text("t,theta\n", encoding="utf-8")
    given = {
        "kind": "measured",
        "file": "angle.csv",
        "time": "t",
        "angle": "theta",
        "angle_unit": "deg",
        "resolution": "0.1 deg",
    }
    drive = scenario(given, folders=(tmp_path,)).simulate.drive
    assert drive.file == str(tmp_path / "angle.csv")
    assert drive.resolution == pytest.approx(math.radians(0.1))
    (tmp_path / "mine.yaml").write_text(
        "simulate: {drive: {kind: measured, file: angle.csv}}\nmechanism: m.yaml\n", encoding="utf-8"
    )
    (tmp_path / "m.yaml").write_text(mechanism().model_dump_json(), encoding="utf-8")
    assert parse_options(str(tmp_path / "mine.yaml")).simulate.drive.file == drive.file


@pytest.mark.parametrize("drive", [{"kind": "constant"}, {"kind": "motor", "stall_torque": 3, "no_load_speed": 100}])
def test_a_drive_survives_the_command_line(drive):
    made = scenario(drive)
    assert parse_options(made.model_dump_json()).simulate == made.simulate


@pytest.mark.parametrize(
    ("drive", "words"),
    [
        ({"kind": "moter"}, ["simulate.drive.kind = 'moter'", "no such kind", "did you mean 'motor'"]),
        ({"stall_torque": 3}, ["key 'simulate.drive.kind' is missing"]),
        ({"kind": "motor", "stall_torque": 3}, ["no_load_speed' is missing"]),
        ({"kind": "motor", "stall_torque": 0, "no_load_speed": 3}, ["stall_torque = 0", "greater than 0"]),
        ({"kind": "constant", "inertia": 1}, ["unknown key", "inertia"]),
        ({"kind": "motor", "stall_torq": 0, "no_load_speed": 3}, ["stall_torq'", "did you mean 'stall_torque'"]),
        ({"kind": "measured", "file": "nowhere.csv"}, ["simulate.drive.file", "no file 'nowhere.csv'"]),
    ],
)
def test_a_drive_that_makes_no_sense_is_refused(drive, words):
    with pytest.raises(InputError) as caught:
        scenario(drive)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(("unit", "words"), [("mm", "needs rad"), ("degg", "not a number with a unit")])
def test_the_angles_unit_must_be_one(tmp_path, unit, words):
    (tmp_path / "a.csv").touch()
    with pytest.raises(InputError, match=words):
        scenario({"kind": "measured", "file": "a.csv", "angle_unit": unit}, folders=(tmp_path,))


def test_a_prescribed_fluctuation_goes_with_the_constant_drive_alone():
    fluctuation = effect("speed_fluctuation", ratio=0.1, order=2)
    assert scenario({"kind": "constant"}, fluctuation).mechanism.effect("speed_fluctuation").order == 2
    with pytest.raises(InputError, match=r"speed_fluctuation goes with .* constant alone, not with motor"):
        scenario({"kind": "motor", "stall_torque": 3, "no_load_speed": 100}, fluctuation)
