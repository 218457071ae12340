"""Equations of motion of any planar linkage in the coordinates of its clearances.

State: the clearance vector of each loose joint with its rate, and the angle and speed of the crank
where no drive prescribes them. The equations stand here once, in plain Python. All loops run over
bodies and joints, never over values, so the same code works on floats (reference), on arrays
(kinematics of many angles) and on symbols (machine code).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from jointgap.linkage.topology import FRAME, Body, Dyad, Joint, Linkage, Place, Vector, number

Number = Any
"""A float, an array or a symbol."""

Pair = tuple[Number, Number]


def add(a: Pair, b: Pair) -> Pair:
    return a[0] + b[0], a[1] + b[1]


def subtract(a: Pair, b: Pair) -> Pair:
    return a[0] - b[0], a[1] - b[1]


def times(factor: Number, a: Pair) -> Pair:
    return factor * a[0], factor * a[1]


def dot(a: Pair, b: Pair) -> Number:
    return a[0] * b[0] + a[1] * b[1]


def cross(a: Pair, b: Pair) -> Number:
    return a[0] * b[1] - a[1] * b[0]


def across(a: Pair) -> Pair:
    """A vector turned by a quarter turn."""
    return -a[1], a[0]


def negative(a: Pair) -> Pair:
    return -a[0], -a[1]


NOTHING = (0.0, 0.0)


@dataclass(frozen=True)
class Arithmetic:
    """What the equations ask of their numbers."""

    parameter: Callable[[str, float], Number] = lambda _, value: value
    """A parameter of the linkage by name, with its value"""
    sqrt: Callable[[Number], Number] = math.sqrt
    cos_sin: Callable[[Number], Pair] = lambda angle: (math.cos(angle), math.sin(angle))
    angle: Callable[[Pair], Number] = lambda direction: math.atan2(*direction[::-1])


class Crank(NamedTuple):
    """Motion of the crank: cosine and sine of its angle, speed [rad/s], acceleration [rad/s^2];
    None where it follows from the torque."""

    cosine: Number
    sine: Number
    speed: Number
    acceleration: Number | None = 0.0


class JointForce(NamedTuple):
    """Force of the partner on the body in a loose joint, and moments on both."""

    fx: Number
    fy: Number
    on_body: Number = 0.0
    on_partner: Number = 0.0


class Pose:
    """Positions and velocities of all bodies.

    Parameters
    ----------
    linkage : Linkage
    signs : sequence of float
        Of each dyad: 1.0 or -1.0, its assembly.
    crank : Crank
    clearances : mapping
        By loose joint, vector [m] and rate [m/s]; of a loose slide offset across it [m] and tilt
        [rad], and their rates.
    arithmetic : Arithmetic, optional
    bends : mapping, optional
        Of bending bodies: deflection at midspan [m] and its rate [m/s].
    """

    def __init__(
        self,
        linkage: Linkage,
        signs: Sequence[float],
        crank: Crank,
        clearances: Mapping[str, tuple[Pair, Pair]],
        arithmetic: Arithmetic = Arithmetic(),
        bends: Mapping[str, Pair] | None = None,
    ):
        self.linkage, self.clearances, self.arithmetic = linkage, clearances, arithmetic
        self.bends = bends or {}
        self.crank = crank
        self.directions: dict[str, Pair] = {FRAME: (1.0, 0.0)}  # Cosine and sine
        self.speeds: dict[str, Number] = {FRAME: 0.0}  # [rad/s]
        self.slips: dict[str, Number] = {}  # [m/s] Of the ideal slides
        # of the transmission angles, by inner joint of the dyads; beyond 1 where it does not close
        self.cosines: dict[str, Number] = {}
        self._anchors: dict[str, tuple[str, Pair, Pair]] = {}
        self.directions[linkage.crank] = crank.cosine, crank.sine
        self.speeds[linkage.crank] = crank.speed
        self._anchor(linkage.joints[linkage.drive], linkage.crank)
        for dyad, sign in zip(linkage.dyads, signs, strict=False):
            {"RRR": self._rrr, "RRP": self._rrp, "RPR": self._rpr}[dyad.kind](dyad, sign)

    # ---- vectors

    def local(self, body: str, point: str | None, origin: str | None = None) -> Pair:
        """Vector [m] from a point to another in a body's axes; None: its mass centre."""
        ends = [_place(self.linkage.bodies[body], name) for name in (origin, point)]
        name = f"{body}.{point or 'mass_centre'}-{origin or 'mass_centre'}"
        return self._parameters(name, ends[1], ends[0])

    def turned(self, body: str, vector: Pair) -> Pair:
        """A vector in a body's axes, turned to those of the frame."""
        c, s = self.directions[body]
        return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]

    def point(self, body: str, point: str | None) -> tuple[Pair, Pair]:
        """Position [m] and velocity [m/s] of a point of a placed body; None: its mass centre."""
        if body == FRAME:
            place = _place(self.linkage.bodies[FRAME], point)
            return self._parameters(f"{FRAME}.{point}", place), NOTHING
        anchor, position, velocity = self._anchors[body]
        if point == anchor:
            return position, velocity
        arm = self.turned(body, self.local(body, point, anchor))
        return add(position, arm), add(velocity, times(self.speeds[body], across(arm)))

    def line(self, joint: Joint) -> Pair:
        """Direction of a slide in its carrier's axes."""
        if joint.direction is None:
            return 1.0, 0.0
        name, angle = f"{joint.name}.direction", joint.direction
        parameter = self.arithmetic.parameter
        return parameter(f"{name}.x", math.cos(angle)), parameter(f"{name}.y", math.sin(angle))

    @property
    def gravity(self) -> Pair:
        """Gravitational acceleration [m/s^2]."""
        return self._parameters("gravity", self.linkage.gravity)

    def travel(self, joint: Joint) -> Pair:
        """Coordinate of a joint and its rate: of a slide the place [m] of the body along the line
        from the carrier's point, of a pivot the angle [rad] of its body."""
        if joint.kind == "revolute":
            body = joint.other(FRAME).body
            return self.arithmetic.angle(self.directions[body]), self.speeds[body]
        carrier = joint.partner.body
        line = self.turned(carrier, self.line(joint))
        (place, velocity), (start, _) = self.point(*joint.body), self.point(*joint.partner)
        rate = dot(line, velocity) if carrier == FRAME else self.slips[joint.name]
        return dot(line, subtract(place, start)), rate

    def _parameters(self, name: str, end: Vector, begin: Vector = (None, None)) -> Pair:
        """A difference of two vectors as parameters; coordinates that are zero by the form of the
        file stay the number 0."""
        return tuple(
            0.0
            if one is None and other is None
            else self.arithmetic.parameter(f"{name}.{axis}", number(one) - number(other))
            for axis, one, other in zip("xy", end, begin, strict=True)
        )

    # ---- bodies

    def _gap(self, joint: Joint, body: str) -> tuple[Pair, Pair]:
        """The body's point minus that of the other body, and its rate."""
        if joint.name not in self.clearances:
            return NOTHING, NOTHING
        vector, rate = self.clearances[joint.name]
        if joint.body.body == body:
            return vector, rate
        return negative(vector), negative(rate)

    def _beside(self, joint: Joint, body: str) -> tuple[Pair, Pair]:
        """Position and velocity of the body's point in a joint whose other body is placed."""
        (position, velocity), (gap, rate) = self.point(*joint.other(body)), self._gap(joint, body)
        return add(position, gap), add(velocity, rate)

    def _anchor(self, joint: Joint, body: str) -> tuple[Pair, Pair]:
        """Place a body's point in a joint."""
        position, velocity = self._beside(joint, body)
        self._anchors[body] = joint.place(body).point, position, velocity
        return position, velocity

    def _square(self, body: str, point: str, origin: str) -> Number:
        """Squared distance [m^2] of two points of a body."""
        ends = [_place(self.linkage.bodies[body], name) for name in (point, origin)]
        x, y = (number(one) - number(two) for one, two in zip(*ends, strict=True))
        return self.arithmetic.parameter(f"{body}.{point}-{origin}.squared", x * x + y * y)

    def _orient(self, body: str, vector: Pair, point: str, origin: str) -> None:
        """Turn a body so that the vector between two of its points is the given one."""
        ends = [_place(self.linkage.bodies[body], name) for name in (point, origin)]
        x, y = (number(one) - number(two) for one, two in zip(*ends, strict=True))
        shares = [
            0.0
            if one is None and two is None
            else self.arithmetic.parameter(
                f"{body}.{point}-{origin}.share.{axis}", value / (x * x + y * y)
            )
            for axis, value, one, two in zip("xy", (x, y), *ends, strict=True)
        ]
        self.directions[body] = dot(vector, shares), cross(shares, vector)

    # ---- dyads

    def _rrr(self, dyad: Dyad, sign: float) -> None:
        """Two bodies with revolute joints: the corner of a triangle."""
        one, two = dyad.bodies
        ends = [
            (body, dyad.inner.place(body).point, joint.place(body).point)
            for body, joint in ((one, dyad.first), (two, dyad.second))
        ]
        begin, begin_rate = self._anchor(dyad.first, one)
        end, end_rate = self._anchor(dyad.second, two)
        gap, gap_rate = self._gap(dyad.inner, one)
        span = subtract(add(end, gap), begin)
        rate = subtract(add(end_rate, gap_rate), begin_rate)
        squares = [self._square(*each) for each in ends]
        square = dot(span, span)
        inverse = 1.0 / square
        along = 0.5 + 0.5 * (squares[0] - squares[1]) * inverse
        root = self.arithmetic.sqrt
        self.cosines[dyad.inner.name] = (
            0.5 * (squares[0] + squares[1] - square) / root(squares[0] * squares[1])
        )
        height = sign * root(squares[0] * inverse - along * along)
        first = add(times(along, span), times(height, across(span)))
        second = subtract(first, span)
        for (body, point, origin), vector in zip(ends, (first, second), strict=True):
            self._orient(body, vector, point, origin)
        share = inverse / height
        self.speeds[one] = dot(rate, second) * share
        self.speeds[two] = dot(rate, first) * share

    def _rrp(self, dyad: Dyad, sign: float) -> None:
        """A body whose end runs on the line of a slide."""
        one, two = dyad.bodies
        slide, carrier = dyad.second, dyad.second.partner.body
        begin, begin_rate = self._anchor(dyad.first, one)
        gap, gap_rate = self._gap(dyad.inner, one)
        start, start_rate = self.point(*slide.partner)
        line = self.turned(carrier, self.line(slide))
        turning = self.speeds[carrier]
        self.directions[two], self.speeds[two] = self.directions[carrier], turning
        if slide.name in self.clearances:  # carried by the frame
            (offset, tilt), (offset_rate, tilt_rate) = self.clearances[slide.name]
            self.directions[two], self.speeds[two] = self.arithmetic.cos_sin(tilt), tilt_rate
            start = add(start, times(offset, across(line)))
            start_rate = add(start_rate, times(offset_rate, across(line)))
        pin = dyad.inner.place(two).point
        arm = self.turned(two, self.local(two, pin, slide.body.point))
        start = add(start, arm)
        start_rate = add(start_rate, times(self.speeds[two], across(arm)))
        span = subtract(add(start, gap), begin)
        rate = subtract(add(start_rate, gap_rate), begin_rate)
        point, origin = dyad.inner.place(one).point, dyad.first.place(one).point
        height = cross(line, span)
        square = self._square(one, point, origin)
        self.cosines[dyad.inner.name] = -height / self.arithmetic.sqrt(square)
        along = sign * self.arithmetic.sqrt(square - height * height)
        self._orient(one, add(times(along, line), times(height, across(line))), point, origin)
        place = along - dot(line, span)
        self.speeds[one] = (cross(line, rate) + turning * place) / along
        position, velocity = self.point(one, point)
        self._anchors[two] = pin, subtract(position, gap), subtract(velocity, gap_rate)
        moved = subtract(self._anchors[two][2], start_rate)
        self.slips[slide.name] = dot(line, moved)

    def _rpr(self, dyad: Dyad, sign: float) -> None:
        """A block that slides on a pivoted body."""
        block, carrier = dyad.bodies
        slide = dyad.inner
        pin, pin_rate = self._anchor(dyad.first, block)
        pivot, pivot_rate = self._anchor(dyad.second, carrier)
        span, rate = subtract(pin, pivot), subtract(pin_rate, pivot_rate)
        line = self.line(slide)
        to_line = self.local(carrier, slide.partner.point, dyad.second.place(carrier).point)
        to_pin = self.local(block, dyad.first.place(block).point, slide.body.point)
        height = cross(line, add(to_line, to_pin))
        square = dot(span, span)
        self.cosines[dyad.inner.name] = height / self.arithmetic.sqrt(square)
        along = sign * self.arithmetic.sqrt(square - height * height)
        vector = add(times(along, line), times(height, across(line)))
        inverse = 1.0 / square
        self.directions[carrier] = dot(vector, span) * inverse, cross(vector, span) * inverse
        axis = self.turned(carrier, line)
        self.speeds[carrier] = dot(across(axis), rate) / along
        self.directions[block] = self.directions[carrier]
        self.speeds[block] = self.speeds[carrier]
        self.slips[slide.name] = dot(axis, rate) + self.speeds[carrier] * height


def _place(body: Body, point: str | None) -> Vector:
    return body.centre if point is None else body.points[point]


Key = tuple[str, str]
"""A generalised acceleration: body, and ``x``, ``y``, ``turn``, ``slide``, or for a bending body
``along``, ``beside``, ``turn``."""

Row = dict[Key, Number]

_MEAN = 2.0 / math.pi  # of the bending mode sin(pi s / l), of which the mean square is 1/2
_STILL = 1.0 - 2.0 * _MEAN * _MEAN
"""Share of a bending body's transverse inertia that its mode does not relieve."""


class _Beam:
    """A bending body: a uniform beam, pinned at both ends, in its first mode w = q sin(pi s / l),
    with a floating frame through the ends.

    With the speed v of the frame, the kinetic energy is 1/2 int rho [(v_t - W w)^2 + (v_n +
    w')^2] ds; stiffness and damping are those of a mode of the given frequency. The Lagrange
    equations include all terms. A force along and across acts on rotation by the `levers`; in the
    accelerations along and across minus levers times the angular acceleration, and in that one, the
    inertia is diagonal.
    """

    def __init__(self, pose: Pose, name: str):
        body, parameter = pose.linkage.bodies[name], pose.arithmetic.parameter
        self.axis, (bend, self._bend_rate) = pose.directions[name], pose.bends[name]
        speed = pose.speeds[name]
        ends = [tuple(map(number, point)) for point in body.points.values()][:2]
        to_midspan = 0.5 * (ends[0][0] + ends[1][0]) - number(body.centre[0])
        m = parameter(f"{name}.mass", body.mass)
        self.beyond = parameter(f"{name}.beyond", to_midspan)
        frequency, damping = body.bending
        square = parameter(f"{name}.stiffness", frequency**2)
        damping = parameter(f"{name}.damping", 2.0 * damping * frequency)
        self.free = -(damping * self._bend_rate) - (square - speed * speed) * bend
        self.levers = (
            _MEAN * bend,
            parameter(f"{name}.lever", 2.0 * _MEAN**2 * to_midspan / _STILL),
        )
        stiff = body.inertia - 2.0 * _MEAN**2 * (1.0 + 2.0 * _MEAN**2 / _STILL) * (
            body.mass * to_midspan**2
        )
        inertia = parameter(f"{name}.stiff_inertia", stiff) + m * (0.5 - _MEAN**2) * (bend * bend)
        inverse = parameter(f"{name}.inverse_mass", 1 / body.mass)
        self.inverse = {
            (name, "along"): inverse,
            (name, "beside"): (1.0 / _STILL) * inverse,
            (name, "turn"): 1.0 / inertia,
        }
        along = 2.0 * _MEAN * (m * speed * self._bend_rate)
        beside = _MEAN * (m * (speed * speed * bend - self.free))
        turn = -(m * speed * bend * self._bend_rate) - _MEAN * (m * self.beyond * self.free)
        self.loads = {
            (name, "along"): along,
            (name, "beside"): beside,
            (name, "turn"): turn + self.levers[0] * along + self.levers[1] * beside,
        }

    def arm(self) -> Pair:
        """What rotation adds to the accelerations along and across, in the axes of the frame."""
        (c, s), (along, beside) = self.axis, self.levers
        return c * along - s * beside, s * along + c * beside

    def bend_acceleration(self, name: str, accelerations: Mapping[Key, Number]) -> Number:
        """Second rate of the deflection [m/s^2]."""
        turn = accelerations[name, "turn"]
        beside = accelerations[name, "beside"] + self.levers[1] * turn
        return self.free - 2.0 * _MEAN * (beside + turn * self.beyond)


class Dynamics:
    """Reactions of the ideal joints, and accelerations, in a pose.

    Parameters
    ----------
    pose : Pose
    forces : mapping of str to JointForce
        Of each loose joint.
    torque : Number, optional
        On the crank [N m], where its motion is not prescribed.
    loads : mapping, optional
        Of bodies: force on the mass centre [N] and moment [N m].
    moments : mapping, optional
        Friction moment on the body [N m] of ideal revolute joints; the opposite acts on the
        partner.
    along : mapping, optional
        Force [N] on bodies along their slides of the frame.

    Attributes
    ----------
    rates : dict
        Second rates of the clearance vectors of the loose joints.
    crank_acceleration : Number
        [rad/s^2]
    reactions : dict of str to pair
        Force of the partner on the body [N] in ideal joints of two moving bodies; of a slide the
        force across it and the moment.
    bend_accelerations : dict of str to Number
        Second rates of the deflections of bending bodies [m/s^2].
    """

    def __init__(
        self,
        pose: Pose,
        forces: Mapping[str, JointForce],
        torque: Number = 0.0,
        loads: Mapping[str, tuple[Pair, Number]] | None = None,
        moments: Mapping[str, Number] | None = None,
        along: Mapping[str, Number] | None = None,
    ):
        self.pose, self.linkage = pose, pose.linkage
        self._beams = {name: _Beam(pose, name) for name in self.linkage.bending}
        self._across: dict[str, Pair] = {}  # Forces on sliding bodies, without their slides
        self._parameter = pose.arithmetic.parameter
        self._loads: dict[Key, Number] = {}
        self._inverse: dict[Key, Number] = {}
        self._begin(torque)
        for body, (force, moment) in (loads or {}).items():
            self._push(body, force, moment)
        for name, force in (along or {}).items():
            self._push_along(self.linkage.joints[name], force)
        for joint in self.linkage.loose:
            self._press(joint, forces[joint.name])
        for name, moment in (moments or {}).items():
            joint = self.linkage.joints[name]
            self._turn(joint.body.body, moment)
            self._turn(joint.partner.body, -moment)
        self._solve()

    # ---- bodies

    def is_driven(self, body: str) -> bool:
        """Whether the motion of a body is prescribed, or at least its rotation."""
        return body == self.linkage.crank and self.pose.crank.acceleration is not None

    def origin(self, body: str) -> str | None:
        """The point about which a body's motion is counted: its pivot, or its mass centre."""
        if self.linkage.kinds[body] == "pivoted":
            return self.linkage.joint_with_frame(body).place(body).point
        return None

    def axis(self, body: str) -> Pair:
        """Direction of the slide of the frame on which a body moves."""
        return self.pose.line(self.linkage.joint_with_frame(body))

    def _begin(self, torque: Number) -> None:
        """Inverse inertia and weight of each free coordinate."""
        gravity = self.pose.gravity
        for name in self.linkage.moving:
            body, kind = self.linkage.bodies[name], self.linkage.kinds[name]
            if kind == "bending":
                self._inverse |= self._beams[name].inverse
                self._loads |= self._beams[name].loads
                continue
            weight = times(self._parameter(f"{name}.mass", body.mass), gravity)
            if kind == "sliding":
                self._inverse[name, "slide"] = self._parameter(
                    f"{name}.inverse_mass", 1 / body.mass
                )
                self._loads[name, "slide"] = dot(self.axis(name), weight)
                self._across[name] = weight
            if kind == "free":
                for axis, load in zip("xy", weight, strict=True):
                    inverse = self._parameter(f"{name}.inverse_mass", 1 / body.mass)
                    self._inverse[name, axis], self._loads[name, axis] = inverse, load
            if kind == "sliding" or self.is_driven(name):
                continue
            moment, inertia = 0.0, body.inertia
            if kind == "pivoted":
                arm = self.pose.local(name, None, self.origin(name))
                moment = cross(self.pose.turned(name, arm), weight)
                ends = _place(body, None), _place(body, self.origin(name))
                arm = [number(one) - number(two) for one, two in zip(*ends, strict=True)]
                inertia += body.mass * dot(arm, arm)
            self._inverse[name, "turn"] = self._parameter(f"{name}.inverse_inertia", 1 / inertia)
            self._loads[name, "turn"] = moment + torque if name == self.linkage.crank else moment

    def _push(self, body: str, force: Pair, moment: Number = 0.0, point: str | None = None) -> None:
        """Apply a force at a point of a body (None: the mass centre), and a moment."""
        if body == FRAME:
            return
        for axis, component in zip("xy", force, strict=True):
            if (body, axis) in self._loads:
                self._loads[body, axis] = self._loads[body, axis] + component
        if (body, "slide") in self._loads:
            along = dot(self.axis(body), force)
            self._loads[body, "slide"] = self._loads[body, "slide"] + along
            self._across[body] = add(self._across[body], force)
        if body in self._beams:
            (c, s), levers = self._beams[body].axis, self._beams[body].levers
            own = c * force[0] + s * force[1], c * force[1] - s * force[0]
            for key, component in zip(("along", "beside"), own, strict=True):
                self._loads[body, key] = self._loads[body, key] + component
            self._turn(body, dot(levers, own))
        if (body, "turn") in self._loads:
            arm = self._arm(body, point)
            self._turn(body, cross(arm, force) + moment)

    def _push_along(self, joint: Joint, force: Number) -> None:
        """Apply a force along a slide, or a moment at a pivot, to its body and its carrier."""
        (body, point), (carrier, other) = joint.body, joint.partner
        if joint.kind == "revolute":
            self._turn(joint.other(FRAME).body, force)
        elif joint == self.linkage.joint_with_frame(body):
            self._loads[body, "slide"] = self._loads[body, "slide"] + force
        else:
            along = times(force, self.pose.turned(carrier, self.pose.line(joint)))
            self._push(body, along, 0.0, point)
            self._push(carrier, negative(along), 0.0, other)

    def _turn(self, body: str, moment: Number) -> None:
        """Apply a moment to a body."""
        if (body, "turn") in self._loads:
            self._loads[body, "turn"] = self._loads[body, "turn"] + moment

    def _press(self, joint: Joint, force: JointForce) -> None:
        """Apply the force in a loose joint to its two bodies."""
        (body, point), (partner, other) = joint.body, joint.partner
        self._push(body, (force.fx, force.fy), force.on_body, point)
        self._push(partner, (-force.fx, -force.fy), force.on_partner, other)

    def _arm(self, body: str, point: str | None) -> Pair:
        """From the origin of a body's motion to a point of it."""
        origin = self.origin(body)
        if point == origin:
            return NOTHING
        return self.pose.turned(body, self.pose.local(body, point, origin))

    # ---- accelerations

    def _acceleration(self, place: Place, arm: Pair | None = None) -> tuple[Row, Row, Pair]:
        """Acceleration of a body's point, or of that at an `arm` from its origin: coefficients of
        the generalised accelerations in x and y, and the rest."""
        body, point = place
        if body == FRAME:
            return {}, {}, NOTHING
        kind = self.linkage.kinds[body]
        if kind == "sliding":
            x, y = self.axis(body)
            return {(body, "slide"): x}, {(body, "slide"): y}, NOTHING
        arm = self._arm(body, point) if arm is None else arm
        speed = self.pose.speeds[body]
        rest = times(-(speed * speed), arm)
        if kind == "bending":
            c, s = self.pose.directions[body]
            turn = add(across(arm), self._beams[body].arm())
            x = {(body, "along"): c, (body, "beside"): -s, (body, "turn"): turn[0]}
            y = {(body, "along"): s, (body, "beside"): c, (body, "turn"): turn[1]}
            return x, y, add(rest, self.pose.gravity)
        x: Row = {(body, "x"): 1.0} if kind == "free" else {}
        y: Row = {(body, "y"): 1.0} if kind == "free" else {}
        if self.is_driven(body):
            return x, y, add(rest, times(self.pose.crank.acceleration, across(arm)))
        x[body, "turn"], y[body, "turn"] = across(arm)
        return x, y, rest

    def _opening(self, joint: Joint) -> tuple[tuple[Row, Row], Pair]:
        """Second rate of the vector between the two points of a joint."""
        x, y, rest = self._acceleration(joint.body)
        other_x, other_y, other_rest = self._acceleration(joint.partner)
        return (_minus(x, other_x), _minus(y, other_y)), subtract(rest, other_rest)

    def _closed(self) -> list[tuple[str, Row, Number]]:
        """Equations of the ideal joints between moving bodies: row times accelerations plus rest is
        zero."""
        rows = []
        for joint in self.linkage.joints.values():
            if joint.loose or FRAME in joint.bodies:
                continue
            if joint.kind == "revolute":
                each, rest = self._opening(joint)
                rows += [(joint.name, row, left) for row, left in zip(each, rest, strict=True)]
                continue
            carrier, body = joint.bodies
            rows.append((joint.name, *self._across_slide(joint)))
            turn = _minus(self._turning(body), self._turning(carrier))
            rest = self._turning_rest(body) - self._turning_rest(carrier)
            rows.append((joint.name, turn, rest))
        return rows

    def _across_slide(self, joint: Joint) -> tuple[Row, Number]:
        """The point of a slide's body does not leave its line."""
        carrier = joint.partner.body
        normal = across(self.pose.turned(carrier, self.pose.line(joint)))
        here = self.pose.point(*joint.body)[0]
        arm = subtract(here, self.pose.point(carrier, self.origin(carrier))[0])
        other_x, other_y, other_rest = self._acceleration(joint.partner, arm)
        x, y, rest = self._acceleration(joint.body)
        row = _sum(_scaled(_minus(x, other_x), normal[0]), _scaled(_minus(y, other_y), normal[1]))
        turning = 2.0 * self.pose.speeds[carrier] * self.pose.slips[joint.name]
        return row, dot(normal, subtract(rest, other_rest)) - turning

    def _turning(self, body: str) -> Row:
        return {} if self.is_driven(body) else {(body, "turn"): 1.0}

    def _turning_rest(self, body: str) -> Number:
        return self.pose.crank.acceleration if self.is_driven(body) else 0.0

    def _solve(self) -> None:
        """Reactions, then accelerations with them."""
        rows = self._closed()
        free = {key: self._inverse[key] * load for key, load in self._loads.items()}
        forces = _reactions([row for _, row, _ in rows], [r for *_, r in rows], self._inverse, free)
        self.accelerations = {}
        for key, value in free.items():
            pulls = [
                row[key] * f for (_, row, _), f in zip(rows, forces, strict=True) if key in row
            ]
            total = sum(pulls[1:], pulls[0]) if pulls else 0.0
            self.accelerations[key] = value + self._inverse[key] * total
        names = [name for name, *_ in rows]
        self.reactions = {
            name: tuple(f for f, own in zip(forces, names, strict=True) if own == name)
            for name in dict.fromkeys(names)
        }
        self.rates = {joint.name: self._rate(joint) for joint in self.linkage.loose}
        self.bend_accelerations = {
            name: beam.bend_acceleration(name, self.accelerations)
            for name, beam in self._beams.items()
        }
        crank = self.pose.crank.acceleration
        turn = self.accelerations.get((self.linkage.crank, "turn"))
        self.crank_acceleration = turn if crank is None else crank

    def _rate(self, joint: Joint) -> Pair:
        """Second rate of a loose joint's clearance."""
        rows, rest = self._opening(joint)
        vector = tuple(self._value(row, left) for row, left in zip(rows, rest, strict=True))
        if joint.kind == "revolute":
            return vector
        normal = across(self.pose.turned(joint.partner.body, self.pose.line(joint)))
        return dot(normal, vector), self._value(self._turning(joint.body.body), 0.0)

    def guide_force(self, joint: Joint) -> Number:
        """Force [N] across an ideal slide of the frame on the body that it guides; 0 elsewhere."""
        body = joint.body.body
        if joint.kind == "revolute" or joint != self.linkage.joint_with_frame(body):
            return 0.0
        total = self._across[body]
        for name, force in self.reactions.items():
            other = self.linkage.joints[name]
            if body in other.bodies:
                if other.kind == "slide":
                    carrier = other.partner.body
                    line = self.pose.turned(carrier, self.pose.line(other))
                    force = times(force[0], across(line))
                total = (add if other.body.body == body else subtract)(total, force)
        return -dot(across(self.pose.line(joint)), total)

    def acceleration(self, body: str, point: str | None = None) -> Pair:
        """Acceleration [m/s^2] of a point of a body; None: its mass centre."""
        x, y, rest = self._acceleration(Place(body, point))
        return self._value(x, rest[0]), self._value(y, rest[1])

    def angular_acceleration(self, body: str) -> Number:
        """[rad/s^2]"""
        if self.linkage.kinds[body] == "sliding":
            return 0.0
        return self._value(self._turning(body), self._turning_rest(body))

    def _value(self, row: Row, rest: Number) -> Number:
        """A row times the accelerations, plus the rest."""
        total = rest
        for key, factor in row.items():
            total = total + factor * self.accelerations[key]
        return total


def _scaled(row: Row, factor: Number) -> Row:
    return {key: factor * value for key, value in row.items()}


def _sum(one: Row, two: Row) -> Row:
    return {
        key: one[key] + two[key] if key in one and key in two else one.get(key, two.get(key))
        for key in {**one, **two}
    }


def _minus(one: Row, two: Row) -> Row:
    return _sum(one, {key: -value for key, value in two.items()})


def _reactions(
    rows: Sequence[Row], rests: Sequence[Number], inverse: Row, free: Row
) -> list[Number]:
    """Forces f with rows (a + M^-1 rows^T f) + rests = 0, where a are the accelerations `free` of
    them, by Cholesky's L D L^T without structural zeros."""
    count = len(rows)
    lower: dict[tuple[int, int], Number] = {}
    pivots: list[Number] = []
    for i in range(count):
        for j in range(i + 1):
            terms = [
                rows[i][key] * inverse[key] * rows[j][key] for key in rows[i] if key in rows[j]
            ]
            terms += [
                -(lower[i, k] * lower[j, k] * pivots[k])
                for k in range(j)
                if (i, k) in lower and (j, k) in lower
            ]
            if not terms:
                continue
            value = sum(terms[1:], terms[0])
            if i == j:
                pivots.append(value)
            else:
                lower[i, j] = value / pivots[j]
    forces: list[Number] = []
    for i in range(count):
        value = -rests[i]
        for key, factor in rows[i].items():
            value = value - factor * free[key]
        for k in range(i):
            if (i, k) in lower:
                value = value - lower[i, k] * forces[k]
        forces.append(value)
    for i in reversed(range(count)):
        value = forces[i] / pivots[i]
        for k in range(i + 1, count):
            if (k, i) in lower:
                value = value - lower[k, i] * forces[k]
        forces[i] = value
    return forces
