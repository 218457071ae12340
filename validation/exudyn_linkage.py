"""Linkages in Exudyn, a second model for trials and tests.

It imports nothing of `jointgap.motion` and `jointgap.linkage`. With ideal joints they are rigid
bodies with constraints and an implicit integrator. With loose joints they are open chains, so the
ideal joints must not close a loop; contacts are those of `validation.exudyn` and the integrator is
explicit.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from jointgap.config.linkage_file import LinkageFile
from jointgap.core.errors import SimulationError, needs
from jointgap.core.sites import FRAME
from jointgap.effects.own_law import formula_effect
from validation.exudyn import (
    FRICTION_ZONE,
    IMMOVABLE,
    SPECTRAL_RADIUS,
    STEPS,
    TOLERANCE,
    add_contact,
    explicit_settings,
)

# Speed up to which friction of a pivot [rad/s] rises along a straight line
PIVOT_FRICTION_ZONE = 1e-2

# Place, angle, and their rates [m, rad, m/s, rad/s] of a body's mass centre
Start = tuple[complex, float, complex, float]

# Force or torque [N, N m] at the speed and place of a body, speed and angle of the crank, and time
# [m/s or rad/s, m or rad, rad/s, rad, s]
Formula = Callable[[float, float, float, float, float], float]

# Generalised force [N, N m] at the time, place and speed of a coordinate [s, m or rad, ...]
Law = Callable[[float, float, float], float]


class _Link(NamedTuple):
    """Object and number of a body in a chain, and the local place of its origin [m]."""

    item: int
    number: int
    origin: complex
    node: int
    coordinates: tuple[int, ...]  # those that turn it


def _resistance(name: str, given: Any, zone: float) -> Law | None:
    """The law of a resistance with its `given` parameters; None if it has none of that name."""
    size = next(iter(given.model_dump().values()), 0.0)
    laws: dict[str, Law] = {
        "coulomb_friction": lambda t, x, v: size * min(max(v / zone, -1.0), 1.0),
        "viscous_friction": lambda t, x, v: size * v,
        "quadratic_drag": lambda t, x, v: size * v * abs(v),
        "constant_force": lambda t, x, v: -size,
        "spring": lambda t, x, v: size * (x - given.rest_position_m),
    }
    return laws.get(name)


class Linkage:
    """A linkage whose crank turns at a constant `speed` [rad/s] from `start_angle` [rad]; `steps`
    per revolution with ideal joints.

    `starts`: of each body, with ideal joints; `formulas`: of bodies with a discovered law.
    """

    def __init__(
        self,
        file: LinkageFile,
        speed: float,
        start_angle: float,
        starts: Mapping[str, Start],
        formulas: Mapping[str, Formula] = {},
        steps: int = STEPS,
    ):
        with needs("a simulation by Exudyn", "peers"):
            import exudyn
            import exudyn.utilities

        self.exudyn, self.items = exudyn, exudyn.utilities
        exudyn.config.printToConsole = False
        self.container = exudyn.SystemContainer()
        self.system = self.container.AddSystem()
        self.file, self.speed, self.start_angle = file.applied(), speed, start_angle
        self.sites, self.time, self.steps = file.sites, 0.0, steps
        self.gravity = complex(*self.file.gravity)
        self.points = {FRAME: {name: complex(*at) for name, at in file.frame.points.items()}}
        self.centres = {FRAME: 0j}
        for name, body in self.file.bodies.items():
            self.points[name] = {point: complex(*at) for point, at in body.places.items()}
            centre = body.mass_centre
            self.centres[name] = complex(*centre) if isinstance(centre, tuple) else complex(centre)
        self.starts, self.formulas = starts, formulas
        self.ground = self.system.AddObject(self.items.ObjectGround())
        self.fixed = self.system.AddNode(self.items.NodePointGround())
        self.nodes: dict[str, int] = {}
        self.links: dict[str, _Link] = {}
        self.contacts: dict[str, int] = {}
        self.on_crank: list[Law] = []  # resistance of a crank in a chain, which no force moves
        if self.file.loose:
            self._add_chains()
            for name, joint in self.file.loose_pins.items():
                bodies = sorted(file.shared[name], key=lambda body, j=joint: body != j.journal)
                markers = [self._marker(body, self.points[body][name]) for body in bodies]
                self.contacts[name] = add_contact(self.system, self.items, joint, markers)
        else:
            self._add_bodies()
            self._add_joints()
        self._add_effects()
        self.watched = {body: self._watched(body) for body in self.links}
        self.system.Assemble()

    # ---- ideal joints

    def _add_bodies(self) -> None:
        items, self.objects = self.items, {FRAME: self.ground}
        for name, body in self.file.bodies.items():
            place, turn, velocity, rate = self.starts[name]
            node = items.NodeRigidBody2D(
                initialCoordinates=[place.real, place.imag, turn],
                initialVelocities=[velocity.real, velocity.imag, rate],
            )
            self.nodes[name] = self.system.AddNode(node)
            rigid = items.ObjectRigidBody2D(
                mass=body.mass, inertia=body.inertia or 1.0, nodeNumber=self.nodes[name]
            )
            self.objects[name] = self.system.AddObject(rigid)
            marker = items.MarkerBodyMass(bodyNumber=self.objects[name])
            load = [self.gravity.real, self.gravity.imag, 0.0]
            keys = {"markerNumber": self.system.AddMarker(marker), "loadVector": load}
            self.system.AddLoad(items.LoadMassProportional(**keys))

    def _add_joints(self) -> None:
        items, add = self.items, self.system.AddObject
        for name, bodies in self.file.shared_by_two.items():
            markers = [self._marker(body, self.points[body][name]) for body in bodies]
            add(items.RevoluteJoint2D(markerNumbers=markers))
        for name, slide in self.file.slides.items():
            carrier, body = slide.slide
            axis = complex(math.cos(angle := self.file.slide_direction(name)), math.sin(angle))
            turned = self.starts[body][1] - (self.starts[carrier][1] if carrier != FRAME else 0.0)
            normal = 1j * axis * complex(math.cos(turned), -math.sin(turned))
            at = complex(*(slide.at or (0.0, 0.0)))
            markers = [self._marker(carrier, at), self._marker(body, 0j)]
            joint = items.PrismaticJoint2D(
                markerNumbers=markers,
                axisMarker0=[axis.real, axis.imag, 0.0],
                normalMarker1=[normal.real, normal.imag, 0.0],
            )
            add(joint)
        markers = self._coordinate(self.nodes[self.sites.crank], 2)
        drive = items.CoordinateConstraint(
            markerNumbers=markers, velocityLevel=True, offset=self.speed
        )
        self.drive = add(drive)

    # ---- loose joints

    def _add_chains(self) -> None:
        """Every body in a tree of the ideal joints from the frame, or from itself if it is free."""
        if self.file.slides:
            raise ValueError("chains with slides are not modelled")
        ideal = {
            name: bodies
            for name, bodies in self.file.shared_by_two.items()
            if name not in self.file.loose
        }
        placed, joints = {FRAME}, dict(ideal)
        roots: list[tuple[str, str]] = []
        parents: dict[str, tuple[str, str]] = {}
        while len(placed) <= len(self.file.bodies):
            found = next(
                ((name, a, b) for name, (a, b) in joints.items() if (a in placed) != (b in placed)),
                None,
            )
            if found is None:  # a free body
                body = next(name for name in self.file.bodies if name not in placed)
                roots.append((body, ""))
            else:
                name, first, second = found
                del joints[name]
                parent, body = (first, second) if first in placed else (second, first)
                if parent == FRAME:
                    roots.append((body, name))
                else:
                    parents[body] = parent, name
            placed.add(body)
        if joints:
            raise ValueError(f"{' and '.join(joints)} close a loop of ideal joints")
        for body, joint in roots:
            self._add_chain(body, joint, parents)

    def _add_chain(self, root: str, pivot: str, parents: Mapping[str, tuple[str, str]]) -> None:
        """The chain of `root`, on a `pivot` of the frame or free."""
        bodies = [root]
        for body in bodies:
            bodies += [child for child, (parent, _) in parents.items() if parent == body]
        place, turn, velocity, rate = self.starts[root]
        kinds, above, offsets, q, v = [], [], [], [], []
        origins = {root: self.points[root][pivot] if pivot else self.centres[root]}
        base = self.points[FRAME][pivot] if pivot else 0j
        if not pivot:
            kinds, above, offsets = ["PrismaticX", "PrismaticY"], [-1, 0], [0j, 0j]
            q, v = [place.real, place.imag], [velocity.real, velocity.imag]
        empty = len(kinds)
        for body in bodies:
            parent, name = parents.get(body, ("", ""))
            turn, rate = self.starts[body][1], self.starts[body][3]
            kinds.append("RevoluteZ")
            above.append(empty + bodies.index(parent) if parent else empty - 1)
            if parent:
                origins[body] = self.points[body][name]
                offsets.append(self.points[parent][name] - origins[parent])
                turn, rate = turn - self.starts[parent][1], rate - self.starts[parent][3]
            else:
                offsets.append(0j)
            q.append(turn)
            v.append(rate)
        data = [self.file.bodies[body] for body in bodies]
        heavy = [body == self.sites.crank for body in bodies]
        centres = [self.centres[body] - origins[body] for body in bodies]
        masses = [0.0 if fixed else body.mass for body, fixed in zip(data, heavy, strict=True)]
        inertias = [IMMOVABLE if fixed else b.inertia for b, fixed in zip(data, heavy, strict=True)]
        vectors, matrices, size = self.exudyn.Vector3DList, self.exudyn.Matrix3DList, len(kinds)
        node = self.items.NodeGenericODE2(
            numberOfODE2Coordinates=size,
            referenceCoordinates=[0.0] * size,
            initialCoordinates=q,
            initialCoordinates_t=v,
        )
        node = self.system.AddNode(node)
        chain = self.items.ObjectKinematicTree(
            nodeNumber=node,
            gravity=[self.gravity.real, self.gravity.imag, 0.0],
            baseOffset=[base.real, base.imag, 0.0],
            jointTypes=[getattr(self.exudyn.JointType, kind) for kind in kinds],
            linkParents=above,
            jointTransformations=matrices([np.eye(3)] * size),
            jointOffsets=vectors([[at.real, at.imag, 0.0] for at in offsets]),
            linkInertiasCOM=matrices([x * np.eye(3) for x in [0.0] * empty + inertias]),
            linkCOMs=vectors([[c.real, c.imag, 0.0] for c in [0j] * empty + centres]),
            linkMasses=[0.0] * empty + masses,
        )
        item = self.system.AddObject(chain)
        for number, body in enumerate(bodies, empty):
            above_it = self.links[parents[body][0]].coordinates if body in parents else ()
            turning = (*above_it, number)
            self.links[body] = _Link(item, number, origins[body], node, turning)

    def _watched(self, body: str) -> dict[str, int]:
        """Sensors at the mass centre of a body in a chain."""
        link, sensors = self.links[body], {}
        at = self.centres[body] - link.origin
        for variable in ("Position", "Velocity", "Acceleration"):
            sensor = self.items.SensorKinematicTree(
                objectNumber=link.item,
                linkNumber=link.number,
                localPosition=[at.real, at.imag, 0.0],
                outputVariableType=getattr(self.exudyn.OutputVariableType, variable),
                writeToFile=False,
            )
            sensors[variable] = self.system.AddSensor(sensor)
        return sensors

    # ---- both

    def _marker(self, body: str, at: complex) -> int:
        """A marker at a local place [m] of a body."""
        if body in self.links:
            link = self.links[body]
            local, keys = at - link.origin, {"linkNumber": link.number, "objectNumber": link.item}
            make = self.items.MarkerKinematicTreeRigid
        else:
            item = self.ground if body == FRAME else self.objects[body]
            local, keys, make = (
                at - self.centres[body],
                {"bodyNumber": item},
                self.items.MarkerBodyRigid,
            )
        return self.system.AddMarker(make(localPosition=[local.real, local.imag, 0.0], **keys))

    def _coordinate(self, node: int, coordinate: int) -> list[int]:
        """Markers of the ground and of a coordinate of a node."""
        make = self.items.MarkerNodeCoordinate
        ends = (self.fixed, 0), (node, coordinate)
        return [self.system.AddMarker(make(nodeNumber=n, coordinate=c)) for n, c in ends]

    def _add_effects(self) -> None:
        """Forces and torques on bodies on slides and pivots of the frame."""
        for effect in self.file.effects:
            if effect.name == "gravity":
                continue
            body, law = self._law(effect)
            if body == self.sites.crank and self.links:
                self.on_crank.append(law)
                continue

            def force(mbs, time, item, place, speed, *_, law=law):
                return law(time, place, speed)

            if self.links and len(self.links[body].coordinates) > 1:
                raise ValueError(f"{effect.name}: {body} has no ideal pivot")
            node = self.links[body].node if self.links else self.nodes[body]
            turning = self.links[body].number if self.links else 2
            markers = self._coordinate(node, 0 if body in self.sites.slides else turning)
            spring = self.items.CoordinateSpringDamper(
                markerNumbers=markers, springForceUserFunction=force
            )
            self.system.AddObject(spring)

    def _law(self, effect: Any) -> tuple[str, Law]:
        """Body and law of an effect, as a resistance."""
        given, sites = effect.parameters, self.sites
        for body in (*sites.slides, *sites.pivots, sites.crank):
            zone = FRICTION_ZONE if body in sites.slides else PIVOT_FRICTION_ZONE
            if effect.name == formula_effect(sites, body):
                return body, self._formula(self.formulas[body])
            if law := _resistance(effect.name.removeprefix(f"{body}_"), given, zone):
                return body, law
        raise ValueError(f"{effect.name} is not modelled")

    def _formula(self, formula: Formula) -> Law:
        def law(t: float, x: float, v: float) -> float:
            return -formula(v, x, self.speed, self.start_angle + self.speed * t, t)

        return law

    def advance(self, end: float, tolerance: float = TOLERANCE, longest: float = 1e-4) -> None:
        """Continue to the time `end` [s] with steps of at most `longest` [s]; `tolerance` is
        absolute (loose joints only)."""
        longest = longest if self.links else 2 * math.pi / (self.speed * self.steps)
        settings = explicit_settings(self.exudyn, self.time, end, tolerance, longest)
        settings.solution.sensors.writePeriod = end
        time = settings.timeIntegration
        time.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
        time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-10, 1e-12
        solvers = self.exudyn.DynamicSolverType
        solver = solvers.DOPRI5 if self.links else solvers.GeneralizedAlpha
        if self.system.SolveDynamic(settings, solverType=solver, updateInitialValues=True) is False:
            raise SimulationError(f"Exudyn's integrator stopped before {end:g} s")
        self.time = end

    def readings(self, times: Sequence[float]) -> dict[str, np.ndarray]:
        """Readings [SI] by channel at `times` [s] after the start."""
        rows = []
        for time in times:
            if time > self.time:
                self.advance(time)
            rows.append(self._read())
        return {channel: np.array([row[channel] for row in rows]) for channel in rows[0]}

    def _read(self) -> dict[str, float]:
        row = {"crank_angle": self.start_angle + self.speed * self.time}
        motions = {body: self._motion(body) for body in self.file.bodies}
        for body, (place, turn, velocity, rate, acceleration, _) in motions.items():
            if body == self.sites.crank:
                continue
            if body in self.sites.slides:
                along = self.file.slide_direction(self.sites.slides[body])
                axis = complex(math.cos(along), -math.sin(along))
                values = {"position": place, "velocity": velocity, "acceleration": acceleration}
                row |= {f"{body}_{key}": (axis * value).real for key, value in values.items()}
                continue
            row |= {f"{body}_angle": turn, f"{body}_angular_velocity": rate}
            row[f"{body}_acceleration_x"] = acceleration.real
            row[f"{body}_acceleration_y"] = acceleration.imag
        row["crank_torque"] = self._torque(motions)
        return row

    def angle(self, body: str) -> float:
        """Angle [rad] of a body."""
        return self._motion(body)[1]

    def _motion(self, body: str) -> tuple[complex, float, complex, float, complex, float]:
        """Place, angle, velocity, speed, acceleration of a body's mass centre, and angular
        acceleration [SI]."""
        kinds = self.exudyn.OutputVariableType
        variables = (kinds.Coordinates, kinds.Coordinates_t, kinds.Coordinates_tt)
        if body not in self.links:
            node = self.nodes[body]
            q, v, a = (self.system.GetNodeOutput(node, kind) for kind in variables)
            return complex(*q[:2]), q[2], complex(*v[:2]), v[2], complex(*a[:2]), a[2]
        link, watched = self.links[body], self.watched[body]
        turns = (np.atleast_1d(self.system.GetNodeOutput(link.node, kind)) for kind in variables)
        turn, rate, spin = (float(sum(values[k] for k in link.coordinates)) for values in turns)
        place, velocity, acceleration = (
            complex(*self.system.GetSensorValues(watched[key])[:2])
            for key in ("Position", "Velocity", "Acceleration")
        )
        return place, turn, velocity, rate, acceleration, spin

    def _torque(self, motions: Mapping[str, tuple]) -> float:
        """Driving torque [N m]: of the constraint, or from the angular momentum of the crank's
        chain about its pivot."""
        crank, kinds = self.sites.crank, self.exudyn.OutputVariableType
        if not self.links:
            return -float(np.ravel(self.system.GetObjectOutput(self.drive, kinds.Force))[0])
        pivot = self.points[FRAME][self.sites.drive]
        turn, chain = motions[crank][1], self.links[crank].item
        torque = sum(law(self.time, turn, self.speed) for law in self.on_crank)
        for body, link in self.links.items():
            if link.item != chain:
                continue
            place, turn, *_, acceleration, spin = motions[body]
            data = self.file.bodies[body]
            if body == crank:
                arm = self.centres[crank] - self.points[crank][self.sites.drive]
                arm *= complex(math.cos(turn), math.sin(turn))
                torque -= (arm.conjugate() * data.mass * self.gravity).imag
                continue
            force = data.mass * (acceleration - self.gravity)
            torque += ((place - pivot).conjugate() * force).imag + data.inertia * spin
        for name, item in self.contacts.items():
            force = complex(*self.system.GetObjectOutput(item, kinds.Force)[:2])  # on the journal
            joint = self.file.joints[name]
            one, other = self.file.shared[name]
            bearer = other if one == joint.journal else one
            journal, bearing = (
                self._place(body, name, motions) for body in (joint.journal, bearer)
            )
            gap = abs(journal - bearing)  # they touch halfway through their overlap
            reach = joint.journal_radius - 0.5 * (gap - joint.clearance)
            point = journal + (journal - bearing) / max(gap, 1e-300) * reach - pivot
            for body, sign in ((joint.journal, 1.0), (bearer, -1.0)):
                if body in self.links and self.links[body].item == chain:
                    torque -= sign * (point.conjugate() * force).imag
        return torque

    def _place(self, body: str, point: str, motions: Mapping[str, tuple]) -> complex:
        """Place [m] of a point of a body."""
        if body == FRAME:
            return self.points[FRAME][point]
        place, turn, *_ = motions[body]
        arm = self.points[body][point] - self.centres[body]
        return place + arm * complex(math.cos(turn), math.sin(turn))
