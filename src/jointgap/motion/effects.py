"""Effects of a mechanism file as parameters of the equations of motion."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from jointgap.core.errors import InputError
from jointgap.core.records import Record
from jointgap.core.sites import Sites
from jointgap.effects import Effect
from jointgap.effects.base import Records
from jointgap.linkage.parameters import (
    DRIVE_KINDS,
    MOST_FORMULAS,
    MOST_PIVOTS,
    MOST_SLIDES,
    NO_TABLE,
    DriveParameters,
    PivotLaws,
    SlideLaws,
    formulas_record,
    pivots_record,
    slides_record,
    table_record,
)
from jointgap.linkage.topology import Bending, Linkage, number


def compiled_effects(
    effects: Iterable[Effect],
    drive: DriveParameters,
    joints: Mapping[str, Mapping[str, Any]],
    crank_length: float,
) -> Records:
    """What the effects write: numbers of the `drive` and of the `joints`, which they change, of
    ``bodies`` and ``sites``, and the programs of ``formulas``."""
    records: Records = {
        "bodies": {"crank_length": crank_length},
        "joints": {name: dict(values) for name, values in joints.items()},
        "drive": drive._asdict() | {"kind": DRIVE_KINDS[drive.kind]},
        "sites": {},
        "formulas": {},
        "tables": {},
    }
    for effect in effects:
        effect.compile_into(records)
    records["drive"]["kind"] = DRIVE_KINDS.index(records["drive"]["kind"])
    return records


def crank_radius(linkage: Linkage) -> float:
    """Distance [m] of the crank's pivot from its joint with the first moving body."""
    points = linkage.bodies[linkage.crank].points
    joint = next(
        joint
        for name, joint in linkage.joints.items()
        if linkage.crank in joint.bodies and name != linkage.drive
    )
    ends = [*map(number, points[linkage.joints[linkage.drive].place(linkage.crank).point])]
    return math.dist(ends, [*map(number, points[joint.place(linkage.crank).point])])


class Laws(NamedTuple):
    """Laws of effects for compiled code."""

    pushed: tuple[str, ...]  # Joints with forces of effects: slides, then pivots
    slides: Record
    pivots: Record
    formulas: Record
    table: Record
    load_friction: bool  # Whether a force depends on that of a slide


def laws_of(
    records: Records,
    sites: Sites,
    outermost: Mapping[str, float],
    swing: Callable[[str], tuple[float, float]],
) -> Laws:
    """The laws that effects have written; `outermost` [m] is the farthest place of each body on its
    slide, `swing` returns the ``middle`` and ``turns`` of a body on a pivot, see `PivotLaws`.

    Raises
    ------
    InputError
        More bodies have effects, or formulas, than compiled code holds.
    """
    written, programs = records["sites"], records["formulas"]
    slides = {**sites.slides, **{name: name for name in sites.tracks}}
    followed = [*sites.slides][:1] if sites.crank in programs else []  # by the crank's formula
    pushed = [body for body in slides if body in written or body in followed]
    turned = [body for body in sites.pivots if body in written]
    for what, count, most in (
        ("bodies on slides", len(pushed), MOST_SLIDES),
        ("bodies on pivots", len(turned), MOST_PIVOTS),
        ("bodies with formulas", len(programs), MOST_FORMULAS),
    ):
        if count > most:
            raise InputError(
                f"effects: {count} {what} have effects; the simulation holds {most}: remove some"
            )
    place = {body: number for number, body in enumerate(programs, 1)}

    def of_pivot(body: str) -> Any:
        middle, turns = swing(body)
        return law(PivotLaws, body, middle=middle, turns=turns)

    def law(kind: type, body: str, **numbers: float) -> Any:
        return kind(**(numbers | written.get(body, {})), formula=place.get(body, 0))

    of_slides = [law(SlideLaws, body, gas_outermost=outermost.get(body, 0.0)) for body in pushed]
    return Laws(
        (*(slides[body] for body in pushed), *(sites.pivots[body] for body in turned)),
        slides_record(of_slides),
        pivots_record(
            [*map(of_pivot, turned)],
            law(PivotLaws, sites.crank, turns=1.0, follows_slide=int(bool(sites.slides))),
        ),
        formulas_record([*programs.values()]),
        table_record(records["table"]) if "table" in records else NO_TABLE,
        any(each.load_friction != 0.0 for each in of_slides),
    )


def rubs_in(bearings: Mapping[str, Record]) -> bool:
    """Whether an ideal joint has friction by its reaction."""
    return any(each.pin_friction != 0.0 and not each.loose for each in bearings.values())


def with_changed_bodies(linkage: Linkage, changes: Mapping[str, Any]) -> Linkage:
    """The linkage with an unbalance of the crank and a bending rod."""
    bodies = dict(linkage.bodies)
    if "unbalance" in changes:
        mass, place = changes["unbalance"]
        crank = bodies[linkage.crank]
        total = crank.mass + mass
        old = tuple(c or 0.0 for c in crank.centre)
        centre = tuple((crank.mass * c + mass * x) / total for c, x in zip(old, place, strict=True))
        inertia = crank.inertia + crank.mass * mass / total * math.dist(old, place) ** 2
        bodies[linkage.crank] = replace(crank, mass=total, centre=centre, inertia=inertia)
    if "bending" not in changes:
        return replace(linkage, bodies=bodies)
    bodies["rod"] = replace(bodies["rod"], bending=Bending(*changes["bending"]))
    return replace(linkage, bodies=bodies, kinds={**linkage.kinds, "rod": "bending"})
