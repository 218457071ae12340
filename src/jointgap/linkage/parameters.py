"""Parameters of compiled code in SI: drive and effects.

Each group is a structured record, which compiled code receives as one pointer. Inactive parts are
zero.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jointgap.core.formula import Program
from jointgap.core.records import Record, kind_of, numbers, with_data
from jointgap.effects.force_table import MOST_ROWS
from jointgap.effects.pivots import PIVOT_LAWS
from jointgap.effects.slides import SLIDE_LAWS

DRIVE_KINDS = ("constant", "fluctuating", "measured", "motor")
CONSTANT, FLUCTUATING, MEASURED, MOTOR = range(len(DRIVE_KINDS))
"""Kinds of drive."""

LONGEST_PROGRAM, MOST_KNOTS = 1024, 16384
"""Array sizes of a formula's program and of a measured angle's pieces."""

MOST_SLIDES, MOST_PIVOTS, MOST_FORMULAS = 4, 8, 4
"""Largest numbers of slides and of pivots besides the crank's with effects, and of formulas."""

CRANK = MOST_PIVOTS
"""Place of the crank's laws in `Parameters.pivots`."""


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


SlideLaws = numbers("SlideLaws", SLIDE_LAWS)
"""Laws of the forces along a slide; see `jointgap.effects.slides`."""

PivotLaws = numbers("PivotLaws", PIVOT_LAWS)
"""Laws of the torques at a pivot; see `jointgap.effects.pivots`."""


class Parameters(NamedTuple):
    """Drive of the crank and laws of effects.

    Records only: compiled code would count references to arrays at every call, which costs more
    than the equations of motion.
    """

    drive: Record  # `DriveParameters`
    knots: Record  # A measured crank angle: see `knots_record`
    slides: Record  # `laws`: `SlideLaws` of each pushed slide
    pivots: Record  # `laws`: `PivotLaws` of each pushed pivot, and of the crank the last
    formulas: Record  # `programs`: see `program_record`
    table: Record  # A measured load: see `table_record`


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
_FORMULAS = np.dtype((Record, [("programs", _PROGRAM, (MOST_FORMULAS,))]))
_SLIDES = np.dtype((Record, [("laws", kind_of(SlideLaws), (MOST_SLIDES,))]))
_PIVOTS = np.dtype((Record, [("laws", kind_of(PivotLaws), (MOST_PIVOTS + 1,))]))
_KNOTS = np.dtype((Record, [("count", "i8"), ("end", "f8"), ("pieces", "f8", (MOST_KNOTS, 7))]))


_TABLE = np.dtype((Record, [("count", "i8"), ("pieces", "f8", (MOST_ROWS, 5))]))


def formulas_record(programs: Sequence[Program]) -> Record:
    """Programs of formulas: length, codes and numbers."""
    if not programs:
        return NO_FORMULAS
    found = with_data(np.zeros(1, _FORMULAS))
    for place, program in zip(found.programs, programs, strict=False):
        place["length"] = len(program.codes)
        place["codes"][: len(program.codes)] = program.codes
        place["numbers"][: len(program.numbers)] = program.numbers
    return found


def slides_record(laws: Sequence[NamedTuple]) -> Record:
    """The `SlideLaws` of slides."""
    found = with_data(np.zeros(1, _SLIDES))
    found.laws[:] = np.array(tuple(SlideLaws()), kind_of(SlideLaws))
    for i, law in enumerate(laws):
        found.laws[i] = tuple(law)
    return found


def pivots_record(laws: Sequence[NamedTuple], crank: NamedTuple) -> Record:
    """The `PivotLaws` of pivots, and of the crank."""
    found = with_data(np.zeros(1, _PIVOTS))
    found.laws[:] = np.array(tuple(PivotLaws()), kind_of(PivotLaws))
    for i, law in enumerate(laws):
        found.laws[i] = tuple(law)
    found.laws[CRANK] = tuple(crank)
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


NO_FORMULAS, NO_KNOTS, NO_TABLE = (
    with_data(np.zeros(1, kind)) for kind in (_FORMULAS, _KNOTS, _TABLE)
)
