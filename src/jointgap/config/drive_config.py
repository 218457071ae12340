"""What turns the crank."""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from jointgap.quantities import PositiveAngle, PositiveAngularSpeed, quantity, unit_factor
from jointgap.section import Section


class ConstantDrive(Section):
    """The crank turns at simulate.speed, whatever it takes."""

    kind: Literal["constant"] = "constant"


class MeasuredDrive(Section):
    """The crank follows a measured angle over time, made smooth."""

    kind: Literal["measured"]
    file: str = Field(description="table of samples, CSV or Parquet; from the working folder or the configuration's")
    time: str = Field("time", description="column of the times in seconds")
    angle: str = Field("crank_angle", description="column of the crank angles")
    angle_unit: str = Field("rad", description="unit of the column of angles, e.g. deg or turn")
    resolution: PositiveAngle | None = Field(
        None, description="step of the encoder, to which the smooth angle keeps; null: not known"
    )

    @field_validator("angle_unit")
    @classmethod
    def _is_a_unit_of_angles(cls, unit: str) -> str:
        unit_factor(unit, "rad")
        return unit


class MotorDrive(Section):
    """A motor on the crank with a falling torque-speed line: M = stall_torque (1 - w / no_load_speed)."""

    kind: Literal["motor"]
    stall_torque: quantity("N*m", gt=0) = Field(description="torque at standstill")
    no_load_speed: PositiveAngularSpeed = Field(description="speed at which the torque is zero")
    inertia: quantity("kg*m^2", ge=0) = Field(
        0.0, description="moment of inertia of rotor and flywheel, on the crank's axis"
    )


Drive = Annotated[ConstantDrive | MeasuredDrive | MotorDrive, Field(discriminator="kind")]
