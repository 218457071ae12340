"""The file of any planar linkage: bodies with points, slides, joints where bodies share a point."""

import math
from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
)

from jointgap.config.mechanism import (
    Contact,
    Joint,
    Mechanism,
    OfAnyKind,
    angle_of,
    with_contacts,
)
from jointgap.core.errors import did_you_mean
from jointgap.core.section import ConfigModel, Word, checked, complaints
from jointgap.core.sites import FRAME, Sites
from jointgap.core.units import Angle, Length, PositiveLength, PositiveMass, quantity
from jointgap.core.words import joined
from jointgap.effects import Effect, effects_of

Point = tuple[Length, Length]


def _centre(value: Any) -> Any:
    """A distance along the body, or a point."""
    if isinstance(value, list | tuple) and len(value) != 2:
        raise ValueError("must be a distance, or a point [x, y]")
    return checked(Point if isinstance(value, list | tuple) else Length, value)


class Frame(ConfigModel):
    """What does not move."""

    points: dict[Word, Point] = Field(description="points by name, [x, y]")


class BodyPart(ConfigModel):
    """A rigid body with points in its own axes; a link has a length and two ends instead."""

    mass: PositiveMass = Field(description="mass")
    inertia: quantity("kg*m^2", gt=0) | None = Field(
        None, description="moment of inertia about the mass centre; null: it never turns"
    )
    mass_centre: Annotated[Length | Point, BeforeValidator(_centre)] = Field(
        0.0, description="distance from the first end, or [x, y]"
    )
    length: PositiveLength | None = Field(None, description="of a link, along x from end to end")
    ends: tuple[Word, Word] | None = Field(None, description="names of a link's points")
    points: dict[Word, Point] | None = Field(None, description="points by name, [x, y]")
    angle: Angle | None = Field(
        None,
        description="rough direction of x at the start, where two assemblies exist",
    )

    def errors(self) -> Iterator[str]:
        if (self.length is None) != (self.ends is None):
            given, other = ("length", "ends") if self.ends is None else ("ends", "length")
            yield f"{given} without {other}; a link needs both"
        if (self.length is None) == (self.points is None):
            yield "needs either length with ends, or points"
        if self.ends and self.ends[0] == self.ends[1]:
            yield f"ends are both {self.ends[0]}; give them different names"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its points."""
        return self.ends or tuple(self.points)

    @property
    def places(self) -> dict[str, Point]:
        """Its points by name, of a link its ends."""
        ends = ((0.0, 0.0), (self.length, 0.0))
        return self.points or dict(zip(self.ends, ends, strict=True))

    @property
    def reach(self) -> float:
        """Largest distance [m] of two of its points."""
        places = [*self.places.values()]
        return max(math.dist(one, other) for one in places for other in places)

    def mass_centre_from(self, point: str) -> tuple[float, float]:
        """Vector [m] from one of its points to its mass centre."""
        centre, (x, y) = self.mass_centre, self.places[point]
        along, across = centre if isinstance(centre, tuple) else (centre, 0.0)
        return along - x, across - y

    def with_length(self, length: float) -> "BodyPart":
        """The link with another length [m]; its mass centre is scaled along it."""
        centre, ratio = self.mass_centre, length / self.length
        along = (centre[0] * ratio, centre[1]) if isinstance(centre, tuple) else centre * ratio
        return self.model_copy(update={"length": length, "mass_centre": along})


class Slide(ConfigModel):
    """A body that slides along a line of its carrier and keeps its direction."""

    slide: tuple[Word, Word] = Field(
        description="carrier and body; the body's origin runs on the line"
    )
    at: Point | None = Field(
        None, description="a point of the line in the carrier's axes; null: their origin"
    )
    direction: Annotated[Angle, BeforeValidator(angle_of)] | None = Field(
        None, description="of the line in the carrier's axes; null: along x"
    )
    length: PositiveLength | None = Field(None, description="of a loose slide's block, along it")
    width: PositiveLength | None = Field(None, description="of a loose slide's block, across it")
    clearance: PositiveLength | None = Field(
        None, description="half the play of a loose slide, on each side between block and wall"
    )
    contact: Contact | None = Field(
        None, description="of a loose slide's corners with the walls: name of an entry or content"
    )

    @property
    def loose(self) -> bool:
        return self.clearance is not None

    def errors(self) -> Iterator[str]:
        given = [key for key in _OF_LOOSE_SLIDES if getattr(self, key) is not None]
        missing = [key for key in _OF_LOOSE_SLIDES if key not in given]
        if given and missing:
            yield f"{joined(given)} without {joined(missing)}; a loose slide needs all of them"
        elif self.loose and self.slide[0] != FRAME:
            yield f"a loose slide needs the frame as carrier, not {self.slide[0]}"
        elif self.loose and self.clearance > _LARGEST_PLAY * min(self.length, self.width):
            smaller = "length" if self.length < self.width else "width"
            yield (
                f"clearance {self.clearance:g} m is more than {_LARGEST_PLAY:g} of {smaller}"
                f" {getattr(self, smaller):g} m; the block would not stay between its walls:"
                " lower it"
            )
        elif self.loose and self.contact.stiffness is None:
            yield "contact needs a stiffness; corners have no radii from which it would follow"


_LARGEST_PLAY = 0.2  # of a slide's block
_OF_LOOSE_SLIDES = ("length", "width", "clearance", "contact")


class Pin(Joint):
    """Bearing and contact of a revolute joint of two bodies."""

    journal: Word = Field(description="the body that carries the journal")


def _joint(value: Any) -> Any:
    """A joint's entry: a slide, or a pin."""
    if value == "ideal":
        raise ValueError(
            "is not needed: a joint without an entry is ideal; to keep its bearing for a campaign,"
            " write it with 'loose: false'"
        )
    if isinstance(value, dict):
        return (Slide if "slide" in value else Pin).model_validate(value)
    return value


def _effect(entry: Any, known: dict[str, type[Effect]]) -> Effect:
    """An effect, of those `known` in a linkage."""
    if isinstance(entry, Effect):
        entry = entry.model_dump()
    if not isinstance(entry, dict) or "name" not in entry:
        raise ValueError("each entry must be a mapping with name and parameters")
    name = entry["name"]
    if name not in known:
        raise ValueError(f"{name!r}: no such effect of this linkage; {did_you_mean(name, known)}")
    try:
        return known[name].model_validate(entry)
    except ValidationError as error:
        raise ValueError(f"{name}: {'; '.join(complaints(error, entry))}") from None


_EFFECTS = {
    "type": "array",
    "items": {"type": "object", "required": ["name"], "properties": {"name": {"type": "string"}}},
}


class LinkageFile(OfAnyKind):
    """A planar linkage of one degree of freedom, without its drive.

    A point name that two bodies share is a revolute joint, ideal unless `joints` has its bearing.
    """

    frame: Frame
    bodies: dict[Word, BodyPart] = Field(description="moving bodies by name")
    contacts: dict[str, Contact] = Field(
        {}, description="contacts by name, for the joints to refer to"
    )
    joints: dict[Word, Annotated[Pin | Slide, BeforeValidator(_joint)]] = Field(
        {}, description="bearings of revolute joints by the name of their point, and slides"
    )
    drive: Word = Field(description="joint of frame and crank")
    gravity_direction: Annotated[Angle, BeforeValidator(angle_of)] = Field(
        -math.pi / 2, description="direction of gravity in the plane, from +x; or down, up ..."
    )
    effects: Annotated[tuple[Any, ...], WithJsonSchema(_EFFECTS)] = Field(
        (), description="effects besides contact and friction in the joints"
    )

    @field_validator("drive", mode="before")
    @classmethod
    def _drive_is_a_joint(cls, drive: Any) -> Any:
        if isinstance(drive, dict):
            raise ValueError(
                "must be the name of a joint; how it turns is not part of the linkage, but an"
                " option of the simulation: jointgap.simulate(linkage, drive=...)"
            )
        return drive

    @field_validator("joints", mode="before")
    @classmethod
    def _joints_get_their_contact(cls, joints: Any, info: ValidationInfo) -> Any:
        return with_contacts(joints, info.data.get("contacts"))

    @field_validator("effects", mode="before")
    @classmethod
    def _effects_act_at_its_sites(cls, effects: Any, info: ValidationInfo) -> Any:
        if not {"frame", "bodies", "joints", "drive"} <= info.data.keys():
            return ()  # these have their own errors
        if not isinstance(effects, list | tuple):
            raise ValueError("must be a list")
        known = effects_of(cls.model_construct(**info.data).sites)
        return tuple(_effect(entry, known) for entry in effects)

    def mirrored(self) -> "LinkageFile":
        """Its mirror image in the line y = 0."""

        def opposite(value: Any) -> Any:
            return None if value is None else -value

        def flipped(point: Any) -> Any:
            return (point[0], -point[1]) if isinstance(point, tuple) else point

        def points(named: dict[str, Point] | None) -> dict[str, Point] | None:
            return named and {name: flipped(point) for name, point in named.items()}

        bodies = {
            name: body.model_copy(
                update={
                    "points": points(body.points),
                    "mass_centre": flipped(body.mass_centre),
                    "angle": opposite(body.angle),
                }
            )
            for name, body in self.bodies.items()
        }
        joints = {
            name: joint.model_copy(
                update={"at": flipped(joint.at), "direction": opposite(joint.direction)}
            )
            if isinstance(joint, Slide)
            else joint
            for name, joint in self.joints.items()
        }
        return self.model_copy(
            update={
                "frame": Frame(points=points(self.frame.points)),
                "bodies": bodies,
                "joints": joints,
                "gravity_direction": -self.gravity_direction,
                "effects": tuple(effect.mirrored() for effect in self.effects),
            }
        )

    def errors(self) -> Iterator[str]:
        if FRAME in self.bodies:
            yield f"bodies.{FRAME} does not move; its points are in {FRAME}.points"
        for point, bodies in self.shared.items():
            if len(bodies) > 2:
                yield (
                    f"point {point} belongs to {joined(bodies)}; a joint connects two bodies: give"
                    f" {bodies[-1]} a point of its own at the same place and join it to one of them"
                )
        for name, joint in self.joints.items():
            yield from self._errors_of(name, joint)
        of_frame = [name for name, bodies in self.shared_by_two.items() if FRAME in bodies]
        if self.drive not in of_frame:
            yield (
                f"drive '{self.drive}' is no joint of the frame with a body;"
                f" {did_you_mean(self.drive, of_frame)}"
            )
        owner: dict[str, str] = {}
        for column, what in self._columns():
            if column in owner and owner[column] != what and "the drive" in (what, owner[column]):
                yield (
                    f"{next(each for each in (what, owner[column]) if each != 'the drive')} is not"
                    f" the driven one, which has the columns crank_...; rename it, or correct drive"
                    f" '{self.drive}'"
                )
                return
            if column in owner and owner[column] != what:
                yield f"{what} and {owner[column]} would both have the column {column}; rename one"
                return
            owner[column] = what
        yield from self.errors_of_effects()

    def _columns(self) -> Iterator[tuple[str, str]]:
        """Columns of a simulation that may exist, and what they are of."""
        yield from ((f"crank_{end}", "the drive") for end in _OF_CRANK)
        yield from ((f"{what}_force_{axis}", "the frame") for what in _OF_FRAME for axis in "xy")
        for name, body in self.bodies.items():
            if self.drive not in body.names:
                yield from ((f"{name}_{end}", f"body {name}") for end in _OF_BODIES)
        for name in self.shared_by_two:
            yield from ((f"{name}_force_{axis}", f"joint {name}") for axis in "xy")
        for name in self.loose_pins:
            yield from ((f"{name}_{end}", f"joint {name}") for end in _OF_JOINTS)
            for vector in ("r", "gamma"):
                yield from ((f"{vector}_{name}{end}", f"joint {name}") for end in _RATES)
        for name in self.slides:
            yield from ((f"{name}_{end}", f"slide {name}") for end in _OF_SLIDES)

    def _errors_of(self, name: str, joint: Pin | Slide) -> Iterator[str]:
        bodies = self.points
        if isinstance(joint, Slide):
            for body in joint.slide:
                if body not in bodies:
                    yield f"joints.{name}.slide: there is no body '{body}'; {_hint(body, bodies)}"
            if owners := self.shared.get(name):
                of = joined(owners)
                yield f"joints.{name}: {name} is a point of {of}; give the slide another name"
            if joint.slide[0] == joint.slide[1]:
                yield f"joints.{name}.slide: {joint.slide[0]} cannot slide on itself"
            return
        owners = self.shared.get(name, ())
        if not owners:
            yield f"joints.{name}: there is no point '{name}'; {_hint(name, self.shared)}"
        elif len(owners) == 1:
            yield (
                f"joints.{name}: {name} is a point of {owners[0]} only; name a point of the other"
                f" body {name} too"
            )
        elif joint.journal not in owners:
            yield f"joints.{name}.journal must be {owners[0]} or {owners[1]}, the bodies of it"

    @property
    def points(self) -> dict[str, tuple[str, ...]]:
        """Names of points by body, with the frame."""
        bodies = {name: body.names for name, body in self.bodies.items()}
        return {FRAME: tuple(self.frame.points)} | bodies

    @property
    def sites(self) -> Sites:
        """Its bodies and joints."""
        of_frame, tracks, pivots = {}, {}, {}
        for name, slide in self.slides.items():
            carrier, body = slide.slide
            if carrier == FRAME:
                of_frame[body] = name
            else:
                tracks[name] = slide.slide
        for name, (one, other) in self.shared_by_two.items():
            if one == FRAME:
                pivots[other] = name
        # a drive that is no joint with the frame has its own error
        crank = next((body for body, name in pivots.items() if name == self.drive), "")
        return Sites(
            crank=crank,
            drive=pivots.pop(crank, self.drive),
            bodies=tuple(self.bodies),
            slides=of_frame,
            pivots=pivots,
            tracks=tracks,
            revolutes=self.shared_by_two,
            links=tuple(name for name, body in self.bodies.items() if body.length is not None),
        )

    @property
    def slides(self) -> dict[str, Slide]:
        """The slides by name."""
        return {name: joint for name, joint in self.joints.items() if isinstance(joint, Slide)}

    @property
    def loose(self) -> tuple[str, ...]:
        """Names of the loose joints."""
        return tuple(self.loose_joints)

    @property
    def loose_joints(self) -> dict[str, Pin | Slide]:
        """The loose joints by name."""
        return {name: joint for name, joint in self.joints.items() if joint.loose}

    def with_ideal_joints(self) -> "LinkageFile":
        """The same without clearance."""
        ideal = {
            name: joint.model_copy(
                update=dict.fromkeys(_OF_LOOSE_SLIDES)
                if isinstance(joint, Slide)
                else {"loose": False}
            )
            for name, joint in self.joints.items()
        }
        return self.model_copy(update={"joints": ideal})

    @property
    def loose_pins(self) -> dict[str, Pin]:
        """The loose revolute joints by name."""
        return {name: joint for name, joint in self.loose_joints.items() if isinstance(joint, Pin)}

    def body(self, name: str) -> BodyPart:
        """The data of the body `name`."""
        return self.bodies[name]

    def joint(self, name: str) -> Pin | Slide | None:
        """The data of the joint `name`; None for an ideal one without data."""
        return self.joints.get(name)

    def slide_direction(self, name: str) -> float:
        """Direction [rad] of the slide `name`, in its carrier's axes."""
        return self.slides[name].direction or 0.0

    def check_contacts(self, speed: float) -> None:
        """InputError where a loose joint's contact is too soft for its loads at a crank speed of
        `speed` [rad/s]: about the inertia of all bodies with the acceleration of the crank's end,
        and weight."""
        crank = self.bodies.get(self.sites.crank)
        if crank is None:  # its own error
            return
        mass = sum(body.mass for body in self.bodies.values())
        load = mass * (crank.reach * speed**2 + float(np.hypot(*self.gravity)))
        for name in self.loose_pins:
            self._check_contact(name, load, speed)

    @property
    def shared_by_two(self) -> dict[str, tuple[str, str]]:
        """The two bodies of each revolute joint."""
        return {name: owners for name, owners in self.shared.items() if len(owners) == 2}

    @property
    def shared(self) -> dict[str, tuple[str, ...]]:
        """Bodies by the name of a point."""
        owners: dict[str, tuple[str, ...]] = {}
        for body, names in self.points.items():
            for name in names:
                owners[name] = (*owners.get(name, ()), body)
        return owners


def _of_any_kind(content: Any) -> Mechanism | LinkageFile:
    """A linkage if it has ``bodies``, else a slider-crank."""
    if isinstance(content, LinkageFile):
        return content
    is_linkage = isinstance(content, dict) and "bodies" in content
    return (LinkageFile if is_linkage else Mechanism).model_validate(content)


AnyMechanism = Annotated[Mechanism | LinkageFile, BeforeValidator(_of_any_kind)]
"""The mechanism of a campaign or a sweep."""

_OF_BODIES = ("angle", "angular_velocity", "angular_acceleration")
_OF_BODIES += tuple(
    f"{what}{axis}"
    for what in ("position", "velocity", "acceleration")
    for axis in ("", "_x", "_y")
)
_OF_SLIDES = ("force", "moment", "contacts", "friction_force")
_OF_SLIDES += tuple(
    f"{what}{rate}" for what in ("offset", "tilt") for rate in ("", "_dot", "_ddot")
)
_OF_FRAME = ("shaking", "frame")
_OF_CRANK = ("angle", "speed", "acceleration", "torque")
_OF_JOINTS = ("normal_force", "friction_force", "mode")
_RATES = ("", "_dot", "_ddot")
"""Ends of the columns of bodies and joints."""


def _hint(name: str, known: Any) -> str:
    return did_you_mean(name, known)
