"""The model of a slider-crank: its linkage, bearings, drive and effects; each effect adds its own
numbers."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from jointgap.config import Mechanism, Simulate, check_drive, check_tolerance
from jointgap.contact.bearings import bearing_parameters
from jointgap.contact.parameters import JointParameters
from jointgap.core.errors import InputError
from jointgap.core.formula import NOTHING
from jointgap.core.joints import JOINT, JOINTS
from jointgap.core.records import record
from jointgap.effects.base import CRANK_SIGN_SPEED, SLIDER_SIGN_SPEED
from jointgap.linkage.compiled import Kind, variant_of
from jointgap.linkage.from_file import linkage_of_slider_crank
from jointgap.linkage.parameters import (
    DRIVE_KINDS,
    NO_TABLE,
    DriveParameters,
    EffectParameters,
    Parameters,
    program_record,
    table_record,
)
from jointgap.linkage.topology import FRAME, Bending, Linkage
from jointgap.motion.model import Columns, Model, drive_records

_SLIDER = ("slider",)


def joint_parameters(mechanism: Mechanism, name: str) -> JointParameters:
    """Parameters of the joint `name` of a `mechanism` without effects."""
    joint = mechanism.joint(name)
    if joint is None:
        return JointParameters()
    # total mass beyond the joint: the largest mass that can rebound there
    beyond = ("crank", "rod", "slider") if name == "crank_pivot" else ("rod", "slider")
    mass = sum(getattr(mechanism, body).mass for body in beyond)
    return bearing_parameters(joint, joint.journal == JOINT[name].body, mass)


def model_of(mechanism: Mechanism, options: Simulate) -> Model:
    """The model of `mechanism`, with its effects, under the drive of `options`.

    Raises
    ------
    InputError
        The drive, the tolerance or a contact does not suit the mechanism.
    """
    if options.speed < 0:
        raise InputError(
            f"simulate.speed {options.speed:g} rad/s is clockwise, which only single simulations"
            " support; mirror the mechanism (opposite sign of slider.offset, gravity_direction and"
            " phases) and give a positive speed"
        )
    made = mechanism.applied()
    check_drive(made, options)
    check_tolerance(made, options)
    drive, knots = drive_records(options)
    made.check_contacts(max(abs(drive.speed), options.highest_speed))
    fields = _fields(made, drive)
    effects, bodies = EffectParameters(**fields["effects"]), fields["bodies"]
    bearings = {name: record(JointParameters(**fields[name])) for name in JOINTS}
    linkage = _with_effects(linkage_of_slider_crank(made), bodies)
    is_free = options.drive.FREES_CRANK
    if is_free:
        linkage = linkage.with_inertia(linkage.crank, drive.rotor_inertia)
    formulas = {name: program_record(program) for name, program in fields["formulas"].items()}
    table = fields["tables"].get("slider_table")
    is_pushed = effects.on_slider or formulas["crank_formula"].length > 0
    rubs = effects.load_friction != 0.0 or any(
        bearing.pin_friction != 0.0 and not bearing.loose for bearing in bearings.values()
    )
    p = Parameters(
        drive=record(DriveParameters(**fields["drive"])),
        knots=knots,
        effects=record(effects),
        slider_table=NO_TABLE if table is None else table_record(table),
        **formulas,
    )
    kind = Kind(is_free, _SLIDER if is_pushed else (), bool(rubs))
    return Model(linkage, bearings, p, variant_of(linkage, (1.0,), kind), short_form)


def _fields(made: Mechanism, drive: DriveParameters) -> dict[str, dict[str, Any]]:
    """Numbers by group and name, with those of the effects."""
    outermost = math.sqrt((made.crank.length + made.rod.length) ** 2 - made.slider.offset**2)
    signs = {"slider_sign_speed": SLIDER_SIGN_SPEED, "crank_sign_speed": CRANK_SIGN_SPEED}
    fields: dict[str, dict[str, Any]] = {
        "bodies": {"crank_length": made.crank.length},
        **{name: joint_parameters(made, name)._asdict() for name in JOINTS},
        "drive": drive._asdict(),
        "effects": EffectParameters(gas_outermost=outermost, **signs)._asdict(),
        "formulas": {"slider_formula": NOTHING, "crank_formula": NOTHING},
        "tables": {},
    }
    fields["drive"]["kind"] = DRIVE_KINDS[drive.kind]
    for effect in made.effects:
        effect.compile_into(fields)
    fields["drive"]["kind"] = DRIVE_KINDS.index(fields["drive"]["kind"])
    return fields


def _with_effects(linkage: Linkage, changes: dict[str, Any]) -> Linkage:
    """The linkage with an unbalance of the crank and a bending rod."""
    bodies = dict(linkage.bodies)
    if "unbalance" in changes:
        mass, place = changes["unbalance"]
        crank = bodies["crank"]
        total = crank.mass + mass
        centre = tuple(
            (crank.mass * c + mass * x) / total for c, x in zip(crank.centre, place, strict=True)
        )
        apart = math.dist(crank.centre, place)
        inertia = crank.inertia + crank.mass * mass / total * apart**2
        bodies["crank"] = replace(crank, mass=total, centre=centre, inertia=inertia)
    if "bending" not in changes:
        return replace(linkage, bodies=bodies)
    bodies["rod"] = replace(bodies["rod"], bending=Bending(*changes["bending"]))
    return replace(linkage, bodies=bodies, kinds={**linkage.kinds, "rod": "bending"})


_NAMES = {
    each.format(f"_{name}"): each.format(joint.number)
    for name, joint in JOINT.items()
    for quantity in ("r", "gamma")
    for each in (f"{quantity}{{}}", f"{quantity}{{}}_dot", f"{quantity}{{}}_ddot")
}
"""Names of clearance vectors by number."""


def short_form(model: Model, columns: Columns) -> Columns:
    """The quantities of a slider-crank: with its numbered clearances, those of ideal joints too."""
    found = {_NAMES.get(name, name): values for name, values in columns.items()}
    count = found["time"].size
    zeros, undefined = np.zeros(count), np.full(count, math.nan)
    found["transmission_angle"] = math.pi / 2 + found["rod_angle"]
    found.setdefault("rod_deflection", zeros)
    for name, joint in JOINT.items():
        if name in model.loose:
            continue
        x, y = found[f"{name}_force_x"], found[f"{name}_force_y"]
        found[f"{name}_normal_force"] = np.sqrt(x * x + y * y)
        found[f"{name}_friction_force"] = zeros
        for rate in ("", "_dot", "_ddot"):
            found[f"r{joint.number}{rate}"] = zeros
            found[f"gamma{joint.number}{rate}"] = undefined
    return found


def lengths_of(model: Model) -> tuple[float, float, float]:
    """Lengths of crank and rod, and the offset of the slide [m]."""
    bodies = model.linkage.bodies
    crank, rod = bodies["crank"].points["crank_pin"][0], bodies["rod"].points["piston_pin"][0]
    return crank, rod, bodies[FRAME].points["guide"][1]


def clearance_vectors(model: Model, states: np.ndarray) -> np.ndarray:
    """Clearance vectors r2, r3, r1 (n, 6) [m] at samples."""
    return np.hstack([model.vector(states, name)[0] for name in JOINTS])


def rod_sine(model: Model, crank_angle: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Sine (n,) of the rod's angle at samples."""
    crank, rod, offset = lengths_of(model)
    pivot, pin, piston = (
        model.vector(states, name)[0][:, 1] for name in ("crank_pivot", "crank_pin", "piston_pin")
    )
    return (offset + piston - crank * np.sin(crank_angle) - pin - pivot) / rod


def rod_and_slider(
    model: Model, crank_angle: np.ndarray, states: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rod angle [rad] and slider position [m] of samples."""
    crank, rod, _ = lengths_of(model)
    pivot, pin, piston = (
        model.vector(states, name)[0][:, 0] for name in ("crank_pivot", "crank_pin", "piston_pin")
    )
    sine = rod_sine(model, crank_angle, states)
    end = crank * np.cos(crank_angle) + pin + pivot
    return np.arcsin(sine), end + rod * np.sqrt(1.0 - sine**2) - piston
