"""Mechanisms in Exudyn (https://exudyn.readthedocs.io), a second model for trials and tests.

It imports nothing of `jointgap.motion`. Bodies are open chains; the crank is so heavy that its
speed is constant. Loose joints are Exudyn's spheres in hollow spheres: its Hunt-Crossley law with
the restitution (1 + e^2) / 2 is the law of Lankarani and Nikravesh with the restitution e (J. Mech.
Des. 112 (1990) 369-376); its friction is "ambrosio" without a dead band. Contacts close the loop
with an explicit integrator; with ideal joints a constraint does with an implicit one.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jointgap.config import Joint, Mechanism
from jointgap.core.errors import SimulationError, needs
from jointgap.core.joints import FROM_FRAME, JOINT, PINS

# Local error of a step [m, rad, m/s, rad/s] for readings
TOLERANCE = 1e-8

# Speed up to which friction of the slider [m/s] rises along a straight line
FRICTION_ZONE = 1e-3

# Steps per revolution of the implicit integrator
STEPS = 1500

# Contact force [N] that a step may end with past the beginning or end of contact. Exudyn's default
# of 1 N limits the agreement with other codes to 1e-10 m, 1e-3 N to 1e-12 m at no cost
_EVENT_TOLERANCE = 1e-3

SPECTRAL_RADIUS = 0.8  # of the implicit integrator: multipliers would ring without
IMMOVABLE = 1e30  # inertia [kg m^2] of the crank: no force here changes a digit of its speed


class _Link(NamedTuple):
    """A link of an open chain."""

    joint: str  # type
    at: float = 0.0  # position on the previous link [m]
    mass: float = 0.0
    centre: float = 0.0  # [m]
    inertia: float = 0.0


class _Body(NamedTuple):
    """Exudyn object and node of a body, its link in a chain, and its end towards the pivot [m]."""

    item: int
    node: int
    link: int | None = None
    origin: float = 0.0


def _direction(angle: float) -> complex:
    return complex(math.cos(angle), math.sin(angle))


def _vector(place: complex) -> list[float]:
    return [place.real, place.imag, 0.0]


def add_contact(system: Any, items: Any, joint: Joint, markers: list[int]) -> int:
    """A loose joint between the markers of journal and bearing."""
    law = joint.contact
    data = items.NodeGenericData(initialCoordinates=[1.0, 0.0, 0.0, 0.0], numberOfDataCoordinates=4)
    compliance = 2 * (1 - law.poisson_ratio**2) / law.youngs_modulus
    radius = joint.bearing_radius * joint.journal_radius / joint.clearance
    contact = items.ObjectContactSphereSphere(
        markerNumbers=markers,
        nodeNumber=system.AddNode(data),
        isHollowSphere1=True,
        impactModel=1,
        dynamicFriction=law.friction,
        frictionProportionalZone=law.friction_speed,
        spheresRadii=[joint.journal_radius, joint.bearing_radius],
        contactStiffness=law.stiffness or 4 / (3 * compliance) * math.sqrt(radius),
        contactStiffnessExponent=law.exponent,
        restitutionCoefficient=(1 + law.restitution**2) / 2,
        minimumImpactVelocity=law.least_approach_speed,
    )
    return system.AddObject(contact)


def explicit_settings(exudyn: Any, begin: float, end: float, tolerance: float, longest: float):
    """Settings of the explicit integrator from `begin` to `end` [s]."""
    settings = exudyn.SimulationSettings()
    settings.solution.file.write = False
    time = settings.timeIntegration
    time.startTime, time.endTime, time.verboseMode = begin, end, 0
    time.numberOfSteps = max(1, math.ceil((end - begin) / longest))
    time.initialStepSize, time.minimumStepSize = min(1e-7, end - begin), 1e-16
    time.absoluteTolerance, time.relativeTolerance = tolerance, 0.0
    time.discontinuous.iterationTolerance = _EVENT_TOLERANCE
    time.explicit.computeEndOfStepAccelerations = True
    return settings


class SliderCrank:
    """A `mechanism` whose crank turns at a constant `speed` [rad/s].

    `perturbation` holds clearance vectors at the start [m] by joint. With `recorded` penetration
    and force are kept at every step.
    """

    def __init__(
        self, mechanism: Mechanism, speed: float, start_angle=0.0, perturbation=None, recorded=False
    ):
        with needs("a simulation by Exudyn", "peers"):
            import exudyn
            import exudyn.utilities

        self.exudyn, self.items = exudyn, exudyn.utilities
        exudyn.config.printToConsole = False  # hides a warning on user functions
        self.container = exudyn.SystemContainer()
        self.system = self.container.AddSystem()
        self.mechanism, self.time = mechanism.applied(), 0.0
        self.speed, self.start_angle = speed, start_angle
        self.effects = {effect.name: effect.parameters for effect in self.mechanism.effects}
        self.loose = self.mechanism.loose
        if set(self.loose) == {"crank_pivot"}:
            raise ValueError(
                "neither pin is loose, and this model closes no loop; loosen one of them"
            )
        gravity = getattr(self.effects.get("gravity"), "acceleration_m_s2", 0.0)
        self.gravity = gravity * _direction(self.mechanism.gravity_direction)
        self.bodies = {"frame": _Body(self.system.AddObject(self.items.ObjectGround()), -1)}
        gaps = {name: (perturbation or {}).get(name, (0.0, 0.0)) for name in FROM_FRAME}
        self._add_bodies({name: complex(*gap) for name, gap in gaps.items()})
        self._add_slider_effects()
        self.connectors = {name: self._contact(name) for name in self.loose}
        if not self.loose:
            ends = [self._marker("rod", self.mechanism.rod.length), self._marker("slider", 0.0)]
            joint = self.items.RevoluteJoint2D(markerNumbers=ends)
            self.connectors["piston_pin"] = self.system.AddObject(joint)
        self.recorded = {}
        for name, item in self.connectors.items() if recorded else ():
            for variable in ("DisplacementLocal", "Force"):
                keys = {"objectNumber": item, "storeInternal": True}
                sensor = self._sensor(self.items.SensorObject, variable, **keys)
                self.recorded[name, variable] = sensor
        centre = self._place("rod", self.mechanism.rod.mass_centre)
        make = self.items.SensorBody if "bodyNumber" in centre else self.items.SensorKinematicTree
        watched = ("Position", "Rotation", "AngularVelocity", "Acceleration")
        self.rod = {variable: self._sensor(make, variable, **centre) for variable in watched}
        self.system.Assemble()

    def _add_bodies(self, gaps: dict[str, complex]) -> None:
        """Crank, rod and slider with the speeds that ideal pins give them; open chains where a pin
        is ideal."""
        crank, rod, slider = self.mechanism.crank, self.mechanism.rod, self.mechanism.slider
        angle, speed, pivot = self.start_angle, self.speed, gaps["crank_pivot"]
        end = pivot + crank.length * _direction(angle) + gaps["crank_pin"]
        end_velocity = 1j * speed * crank.length * _direction(angle)
        turn = math.asin((slider.offset + gaps["piston_pin"].imag - end.imag) / rod.length)
        rate = -end_velocity.imag / (rod.length * math.cos(turn))
        x = (end + rod.length * _direction(turn) - gaps["piston_pin"]).real
        velocity = (end_velocity + 1j * rod.length * rate * _direction(turn)).real
        swing = _Link("RevoluteZ", crank.length, rod.mass, rod.mass_centre, rod.inertia)
        heavy = _Link("RevoluteZ", 0.0, crank.mass, crank.mass_centre, IMMOVABLE)
        if "crank_pin" not in self.loose:
            loose = "crank_pivot" in self.loose
            sliding = [_Link("PrismaticX"), _Link("PrismaticY")] if loose else []
            at, still = ([pivot.real, pivot.imag], [0.0, 0.0]) if loose else ([], [])
            q, v = [*at, angle, turn - angle], [*still, speed, rate - speed]
            self._add_chain(("crank", "rod"), [*sliding, heavy, swing], q, v, 0.0)
        else:
            centre = crank.mass_centre if "crank_pivot" in self.loose else 0.0
            mass = crank.mass if "crank_pivot" in self.loose else IMMOVABLE
            arm = centre * _direction(angle)
            self._add_body(
                "crank", mass, IMMOVABLE, centre, pivot + arm, angle, 1j * speed * arm, speed
            )
        if set(PINS) <= set(self.loose):
            arm = rod.mass_centre * _direction(turn)
            motion = end + arm, turn, end_velocity + 1j * rate * arm, rate
            self._add_body("rod", rod.mass, rod.inertia, rod.mass_centre, *motion)
        if "crank_pin" in self.loose and "piston_pin" not in self.loose:
            free_rod = swing._replace(at=0.0, centre=rod.mass_centre - rod.length)
            links = [_Link("PrismaticX", mass=slider.mass), free_rod]
            self._add_chain(("slider", "rod"), links, [x, turn], [velocity, rate], slider.offset)
            self.bodies["rod"] = self.bodies["rod"]._replace(origin=-rod.length)
        else:
            start = {"initialCoordinates": [x], "initialVelocities": [velocity]}
            node = self.system.AddNode(self.items.Node1D(referenceCoordinates=[0.0], **start))
            place = {"nodeNumber": node, "referencePosition": [0.0, slider.offset, 0.0]}
            item = self.system.AddObject(self.items.ObjectMass1D(mass=slider.mass, **place))
            self.bodies["slider"] = _Body(item, node)

    def _add_body(self, name, mass, inertia, centre, place, turn, velocity, rate) -> None:
        """A free body: mass, inertia, `centre` [m] on the body, place [m], angle [rad] and their
        rates."""
        node = self.items.NodeRigidBody2D(
            initialCoordinates=[place.real, place.imag, turn],
            initialVelocities=[velocity.real, velocity.imag, rate],
        )
        node = self.system.AddNode(node)
        body = self.items.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node)
        self.bodies[name] = _Body(self.system.AddObject(body), node, None, -centre)
        if name == "rod":
            marker = self.items.MarkerBodyMass(bodyNumber=self.bodies[name].item)
            keys = {"markerNumber": self.system.AddMarker(marker)}
            weight = self.items.LoadMassProportional(loadVector=_vector(self.gravity), **keys)
            self.system.AddLoad(weight)

    def _add_chain(
        self, names: tuple, links: list[_Link], q: list[float], v: list[float], height: float
    ) -> None:
        """An open chain from (0, `height`) whose last links are the bodies `names`."""
        vectors, matrices, size = self.exudyn.Vector3DList, self.exudyn.Matrix3DList, len(links)
        node = self.items.NodeGenericODE2(
            numberOfODE2Coordinates=size,
            referenceCoordinates=[0.0] * size,
            initialCoordinates=q,
            initialCoordinates_t=v,
        )
        node = self.system.AddNode(node)
        chain = self.items.ObjectKinematicTree(
            nodeNumber=node,
            gravity=_vector(self.gravity),
            baseOffset=[0.0, height, 0.0],
            jointTypes=[getattr(self.exudyn.JointType, link.joint) for link in links],
            linkParents=list(range(-1, size - 1)),
            jointTransformations=matrices([np.eye(3)] * size),
            jointOffsets=vectors([[link.at, 0.0, 0.0] for link in links]),
            linkInertiasCOM=matrices([link.inertia * np.eye(3) for link in links]),
            linkCOMs=vectors([[link.centre, 0.0, 0.0] for link in links]),
            linkMasses=[link.mass for link in links],
        )
        item = self.system.AddObject(chain)
        for number, name in enumerate(names, size - len(names)):
            self.bodies[name] = _Body(item, node, number)

    def _place(self, name: str, distance: float) -> dict:
        """A point on a body at a distance [m] from its end towards the crank pivot."""
        body = self.bodies[name]
        place = {"localPosition": [body.origin + distance, 0.0, 0.0]}
        if body.link is None:
            return place | {"bodyNumber": body.item}
        return place | {"objectNumber": body.item, "linkNumber": body.link}

    def _marker(self, name: str, distance: float) -> int:
        place, items = self._place(name, distance), self.items
        rigid = "bodyNumber" in place
        make = items.MarkerBodyRigid if rigid else items.MarkerKinematicTreeRigid
        return self.system.AddMarker(make(**place))

    def _sensor(self, make: Callable, variable: str, **more: Any) -> int:
        kind = getattr(self.exudyn.OutputVariableType, variable)
        return self.system.AddSensor(make(outputVariableType=kind, writeToFile=False, **more))

    def _contact(self, name: str) -> int:
        joint = self.mechanism.joint(name)
        lengths = {
            ("crank_pin", "crank"): self.mechanism.crank.length,
            ("piston_pin", "rod"): self.mechanism.rod.length,
        }
        bodies = sorted((JOINT[name].partner, JOINT[name].body), key=lambda b: b != joint.journal)
        markers = [self._marker(body, lengths.get((name, body), 0.0)) for body in bodies]
        return add_contact(self.system, self.items, joint, markers)

    def _add_slider_effects(self) -> None:
        """Loads, springs and dampers on the slider."""
        system, items, effects = self.system, self.items, self.effects
        ground, markers = system.AddNode(items.NodePointGround()), []
        for node in (self.bodies["slider"].node, ground):
            marker = items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0)
            markers.append(system.AddMarker(marker))
        ends = {"markerNumbers": markers[::-1]}
        if force := effects.get("slider_constant_force"):
            system.AddLoad(items.LoadCoordinate(markerNumber=markers[0], load=force.force_N))
        if spring := effects.get("slider_spring"):
            keys = {"stiffness": spring.stiffness_N_m, "offset": spring.rest_position_m}
            system.AddObject(items.CoordinateSpringDamper(**ends, **keys))
        if viscous := effects.get("slider_viscous_friction"):
            system.AddObject(items.CoordinateSpringDamper(**ends, damping=viscous.damping_N_s_m))
        if dry := effects.get("slider_coulomb_friction"):
            keys = {"dynamicFrictionForce": dry.force_N, "frictionProportionalZone": FRICTION_ZONE}
            system.AddObject(items.CoordinateSpringDamperExt(**ends, **keys))
        if quadratic := effects.get("slider_quadratic_drag"):

            def drag(mbs, time, item, displacement, velocity, *_):
                return quadratic.drag_N_s2_m2 * velocity * abs(velocity)

            system.AddObject(items.CoordinateSpringDamper(**ends, springForceUserFunction=drag))

    def advance(
        self, end: float, tolerance: float = TOLERANCE, longest: float = 1e-4
    ) -> np.ndarray:
        """Continue to the time `end` [s] with steps of at most `longest` [s]; the `positions`
        there. `tolerance` is absolute (loose joints only)."""
        longest = longest if self.loose else 2 * math.pi / (self.speed * STEPS)
        settings = explicit_settings(self.exudyn, self.time, end, tolerance, longest)
        settings.solution.sensors.writePeriod = 1e-12 if self.recorded else end
        time = settings.timeIntegration
        time.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
        time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-10, 1e-12
        solvers = self.exudyn.DynamicSolverType
        solver = solvers.DOPRI5 if self.loose else solvers.GeneralizedAlpha
        if self.system.SolveDynamic(settings, solverType=solver, updateInitialValues=True) is False:
            raise SimulationError(f"Exudyn's integrator stopped before {end:g} s")
        self.time = end
        return self.positions()

    def _rod(self, variable: str) -> np.ndarray:
        return np.ravel(self.system.GetSensorValues(self.rod[variable]))

    def _slider(self, variable: str) -> float:
        kind = getattr(self.exudyn.OutputVariableType, variable)
        return float(np.atleast_1d(self.system.GetNodeOutput(self.bodies["slider"].node, kind))[0])

    def positions(self) -> np.ndarray:
        """Rod's mass centre x, y [m], rod angle [rad], slider position [m]."""
        return np.array(
            [*self._rod("Position")[:2], self._rod("Rotation")[-1], self._slider("Coordinates")]
        )

    def readings(self, times: np.ndarray, tolerance: float = TOLERANCE) -> dict[str, np.ndarray]:
        """Readings [SI] by channel at `times` [s] after the start, of a mechanism whose crank pivot
        is ideal."""
        rows = []
        for time in times:
            self.advance(time, tolerance)
            rows.append(self._read())
        return {channel: np.array([row[channel] for row in rows]) for channel in rows[0]}

    def _read(self) -> dict[str, float]:
        crank, rod, slider = self.mechanism.crank, self.mechanism.rod, self.mechanism.slider
        angle = self.start_angle + self.speed * self.time
        arm, x = _direction(angle), self._slider("Coordinates")
        centre, acceleration = (
            complex(*self._rod(name)[:2]) for name in ("Position", "Acceleration")
        )
        turn = self._rod("Rotation")[-1]
        foot = centre - rod.mass_centre * _direction(turn)
        forces = {name: self._force_on_rod(name, item) for name, item in self.connectors.items()}
        for name, other in (PINS, PINS[::-1]):
            if name not in forces:  # an ideal pin
                forces[name] = rod.mass * (acceleration - self.gravity) - forces[other]
        point = crank.length * arm
        if "crank_pin" in self.loose:  # journal and bearing touch halfway through their overlap
            joint = self.mechanism.joint("crank_pin")
            journal, bearing = (point, foot) if joint.journal == "crank" else (foot, point)
            gap = abs(journal - bearing)
            reach = joint.journal_radius - 0.5 * (gap - joint.clearance)
            point = journal + (journal - bearing) / gap * reach
        dry = getattr(self.effects.get("crank_coulomb_friction"), "torque_N_m", 0.0)
        viscous = getattr(self.effects.get("crank_viscous_friction"), "damping_N_m_s", 0.0)
        moment = crank.mass * crank.mass_centre * arm
        frame = crank.mass * (crank.mass_centre * self.speed**2 * arm + self.gravity)
        frame -= forces["crank_pin"]
        torque = (point.conjugate() * forces["crank_pin"] - moment.conjugate() * self.gravity).imag
        return {
            "crank_angle": angle,
            "slider_position": x,
            "slider_velocity": self._slider("Coordinates_t"),
            "slider_acceleration": self._slider("Coordinates_tt"),
            "rod_angle": turn,
            "rod_angular_velocity": self._rod("AngularVelocity")[-1],
            "rod_acceleration_x": acceleration.real,
            "rod_acceleration_y": acceleration.imag,
            "crank_torque": torque + dry + viscous * self.speed,
            "guide_force": forces["piston_pin"].imag - slider.mass * self.gravity.imag,
            "frame_force_x": frame.real,
            "frame_force_y": frame.imag,
        }

    def _force_on_rod(self, name: str, item: int) -> complex:
        """Force [N] of a contact, whose output is that on the journal, or of an ideal pin."""
        variable = self.exudyn.OutputVariableType.Force
        force = complex(*self.system.GetObjectOutput(item, variable)[:2])
        on_journal = name in self.loose
        return -force if on_journal and self.mechanism.joint(name).journal != "rod" else force

    def record(self) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Time [s], and by joint penetration [m] and force [N], at every step of the latest
        advance."""
        stored = {key: self.system.GetSensorStoredData(item) for key, item in self.recorded.items()}
        time = next(iter(stored.values()))[:, 0]
        depths = {name: -stored[name, "DisplacementLocal"][:, 1] for name in self.loose}
        forces = {name: np.linalg.norm(stored[name, "Force"][:, 1:], axis=1) for name in self.loose}
        return time, depths, forces
