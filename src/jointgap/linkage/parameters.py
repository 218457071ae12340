"""Parameters of compiled code in SI: drive and effects.

Each group is a structured record, which compiled code receives as one pointer. Inactive parts are
zero.
"""

import math
from typing import NamedTuple

import numpy as np

from jointgap.core.formula import Program
from jointgap.core.records import Record, with_data
from jointgap.effects.slider_force_table import MOST_ROWS

DRIVE_KINDS = ("constant", "fluctuating", "measured", "motor")
CONSTANT, FLUCTUATING, MEASURED, MOTOR = range(len(DRIVE_KINDS))
"""Kinds of drive."""

LONGEST_PROGRAM, MOST_KNOTS = 1024, 16384
"""Array sizes of a formula's program and of a measured angle's pieces."""


class DriveParameters(NamedTuple):
    """The drive of the crank."""

    kind: int = CONSTANT  # `CONSTANT`, `FLUCTUATING`, `MEASURED` or `MOTOR`
    speed: float = 0.0  # Speed, for a motor the initial one [rad/s]
    start_angle: float = 0.0  # [rad]
    ratio: float = 0.0  # Of a fluctuating speed w0 (1 + ratio cos(order theta - phase))
    order: float = 1.0
    phase: float = 0.0
    stall_torque: float = 0.0
    no_load_speed: float = 1.0
    rotor_inertia: float = 0.0


class EffectParameters(NamedTuple):
    """Forces on the slider and torques on the crank besides joints and weight; see
    `jointgap.effects`.

    `table_over`: 1 for a load over the crank angle, 2 for one over time, 0 for none.
    """

    on_slider: bool = False
    coulomb: float = 0.0
    viscous: float = 0.0
    drag: float = 0.0
    stribeck: float = 0.0
    stribeck_speed: float = 1.0
    stribeck_share: float = 0.0
    position_friction: float = 0.0
    position_friction_tightest: float = 0.0
    position_friction_length: float = 1.0
    position_friction_share: float = 0.0
    power_drag: float = 0.0
    power_drag_speed: float = 1.0
    power_drag_exponent: float = 0.0
    load_friction: float = 0.0
    constant: float = 0.0
    spring_stiffness: float = 0.0
    spring_rest: float = 0.0
    nonlinear_spring: float = 0.0
    nonlinear_spring_rest: float = 0.0
    nonlinear_spring_length: float = 1.0
    nonlinear_spring_share: float = 0.0
    gas_force: float = 0.0
    gas_length: float = 1.0
    gas_exponent: float = 1.0
    gas_outermost: float = 0.0
    harmonic: float = 0.0
    harmonic_angular_frequency: float = 0.0
    harmonic_phase: float = 0.0
    table_over: int = 0
    table_sign: float = 1.0
    table_begin: float = 0.0
    table_period: float = 1.0
    slider_sign_speed: float = 1.0
    crank_coulomb: float = 0.0
    crank_viscous: float = 0.0
    crank_periodic: float = 0.0
    crank_periodic_order: float = 0.0
    crank_periodic_phase: float = 0.0
    angle_friction: float = 0.0
    angle_friction_tightest: float = 0.0
    angle_friction_share: float = 0.0
    crank_brake: float = 0.0
    crank_brake_speed: float = 1.0
    crank_brake_exponent: float = 0.0
    crank_sign_speed: float = 1.0


class Parameters(NamedTuple):
    """Drive of the crank and laws of effects.

    Records only: compiled code would count references to arrays at every call, which costs more
    than the equations of motion.
    """

    drive: Record  # `DriveParameters`
    knots: Record  # A measured crank angle: see `knots_record`
    effects: Record  # `EffectParameters`
    slider_formula: Record  # Program of a force on the slider: see `program_record`
    crank_formula: Record  # Program of a torque on the crank: see `program_record`
    slider_table: Record  # A measured load on the slider: see `table_record`


_PROGRAM = np.dtype(
    (
        Record,
        [
            ("length", "i8"),
            ("codes", "i8", (LONGEST_PROGRAM, 2)),
            ("numbers", "f8", (LONGEST_PROGRAM,)),
        ],
    )
)
_KNOTS = np.dtype((Record, [("count", "i8"), ("end", "f8"), ("pieces", "f8", (MOST_KNOTS, 7))]))


_TABLE = np.dtype((Record, [("count", "i8"), ("pieces", "f8", (MOST_ROWS, 5))]))


def program_record(program: Program) -> Record:
    """The program of a formula: length, codes and numbers."""
    if not len(program.codes):
        return NO_PROGRAM
    found = with_data(np.zeros(1, _PROGRAM))
    found.length = len(program.codes)
    found.codes[: len(program.codes)] = program.codes
    found.numbers[: len(program.numbers)] = program.numbers
    return found


def knots_record(pieces: np.ndarray, end: float = math.inf) -> Record:
    """A measured crank angle as pieces (k, 7): begin [s] and quintic polynomial from there, highest
    power first.

    `end` [s] is the end of the last piece.
    """
    found = with_data(np.zeros(1, _KNOTS))
    found.count, found.end = len(pieces), end
    found.pieces[: len(pieces)] = pieces
    return found


def table_record(pieces: np.ndarray) -> Record:
    """A measured load as pieces (k, 5) of one period: begin [rad or s] and cubic polynomial from
    there, highest power first.
    """
    found = with_data(np.zeros(1, _TABLE))
    found.count = len(pieces)
    found.pieces[: len(pieces)] = pieces
    return found


NO_PROGRAM, NO_KNOTS, NO_TABLE = (
    with_data(np.zeros(1, kind)) for kind in (_PROGRAM, _KNOTS, _TABLE)
)
