"""Sections of what simulates many motions: ensembles and the study of clearance, speed and friction."""

import math
import re
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, NonNegativeInt, PositiveInt, WithJsonSchema, model_validator

from jointgap.config.consistency import TOLERANCE_SHARE
from jointgap.quantities import (
    FrictionCoefficient,
    OpenFraction,
    PositiveAngularSpeed,
    PositiveLength,
    quantity,
    refuse_comma,
)
from jointgap.section import Section

_NUMBER = re.compile(r"\s*([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(.*?)\s*$")
_SPAN = {"from", "to", "number"}
_SPAN_SCHEMA = {
    "type": "object",
    "additionalProperties": False,
    "required": sorted(_SPAN),
    "properties": {
        "from": {"type": ["number", "string"]},
        "to": {"type": ["number", "string"]},
        "number": {"type": "integer", "minimum": 2},
    },
}


def spread(values: Any) -> Any:
    """A list of values as it is; ``{from: 200 rpm, to: 1200 rpm, number: 6}`` as a list of values evenly apart.

    Raises
    ------
    ValueError
        Neither of both, an empty list, ends of different units or with a comma.
    """
    if isinstance(values, list | tuple) and values:
        return values
    if not isinstance(values, dict) or set(values) != _SPAN:
        raise ValueError("must be a list of values, or {from: ..., to: ..., number: ...} for values evenly apart")
    for key in ("from", "to"):
        refuse_comma(str(values[key]))
    ends = [_NUMBER.match(str(values[key])) for key in ("from", "to")]
    number = values["number"]
    if not all(ends) or not isinstance(number, int) or number < 2:
        raise ValueError("needs two numbers, with the same unit or none, as from and to, and a number of 2 or more")
    (low, unit), (high, other) = (end.groups() for end in ends)
    if unit != other:
        raise ValueError(f"from has the unit '{unit}' and to the unit '{other}'; give both in one unit")
    between = [float(f"{value:.12g}") for value in np.linspace(float(low), float(high), number)]
    return [f"{value!r} {unit}" for value in between] if unit else between


def _list_of(kind: Any) -> Any:
    """Type of some values of one kind, listed or spread evenly."""
    items = {"type": "array", "minItems": 1}
    return Annotated[
        tuple[kind, ...], BeforeValidator(spread), WithJsonSchema({"anyOf": [items, _SPAN_SCHEMA]}), Field(min_length=1)
    ]


class Runs(Section):
    """What the runs of an ensemble differ in: every combination of values, each from several starts."""

    vary: dict[str, _list_of(Any)] = Field(
        {},
        description="lists of values (or from, to, number) by what they set: speed, clearance, friction, restitution, "
        "or the path of a key such as mechanism.slider.mass",
    )
    members: PositiveInt = Field(10, description="starts of each combination; the first is not perturbed")
    perturbation: PositiveLength = Field(1e-7, description="standard deviation of the perturbed starting positions")
    seed: NonNegativeInt = Field(0, description="seed of the perturbations")


class Study(Section):
    """The map clearance x speed x friction."""

    clearance: _list_of(PositiveLength) = Field(
        (5e-5, 1e-4, 2e-4, 5e-4, 1e-3), description="radial clearances of every loose joint"
    )
    speed: _list_of(PositiveAngularSpeed) = Field(
        tuple(rpm * math.tau / 60 for rpm in (200, 400, 600, 800, 1000, 1200)), description="crank speeds"
    )
    friction: _list_of(FrictionCoefficient) = Field(
        (0.0, 0.05, 0.1, 0.2), description="friction coefficients of every loose joint"
    )
    transient_revolutions: PositiveInt = Field(4, description="revolutions that do not count")
    settled_revolutions: PositiveInt = Field(4, description="revolutions after these, which count")
    members: Annotated[int, Field(ge=2)] = Field(4, description="starts of each point; the first is not perturbed")
    perturbation: OpenFraction = Field(
        1e-4, description="length of the change in the perturbed starting positions, as a share of the clearance"
    )
    seed: NonNegativeInt = Field(0, description="seed of the perturbations")
    tolerance: quantity("", gt=0, le=TOLERANCE_SHARE) = Field(
        1e-6, description="local error of positions that an integration step may make, as a share of the clearance"
    )

    @model_validator(mode="after")
    def _no_value_is_listed_twice(self):
        for name in ("clearance", "speed", "friction"):
            if len(set(getattr(self, name))) < len(getattr(self, name)):
                raise ValueError(f"{name} {list(getattr(self, name))} lists a value twice; give each once")
        return self
