"""The slider-crank in Exudyn (https://exudyn.readthedocs.io), for blind trials, tests, benchmarks.

It imports nothing of `jointgap.dynamics`: a second model of the mechanism, on purpose. Bodies are
open chains, the crank so heavy that nothing disturbs it. Loose joints are Exudyn's spheres in
hollow spheres: its Hunt-Crossley law with the restitution (1 + e^2) / 2 is the law of Lankarani and
Nikravesh with the restitution e (H. M. Lankarani and P. E. Nikravesh, J. Mech. Des. 112 (1990)
369-376), its friction is "ambrosio" without a dead band. Explicit integrators take no constraints
and the implicit one does not get through contacts: so with ideal joints a constraint closes the
loop, else contacts do.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jointgap.config import Mechanism
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

_SPECTRAL_RADIUS = 0.8  # of the implicit integrator: multipliers would ring without
_IMMOVABLE = 1e30  # inertia [kg m^2] of the crank: no force here changes a digit of its speed


class _Link(NamedTuple):
    """A link of an open chain: type of its joint, where that is on the link before [m], mass,
    centre [m], inertia."""

    joint: str
    at: float = 0.0
    mass: float = 0.0
    centre: float = 0.0
    inertia: float = 0.0


class _Body(NamedTuple):
    """Object and node of a body, which link of a chain it is, and where the end at the crank pivot
    is on it [m]."""

    item: int
    node: int
    link: int | None = None
    origin: float = 0.0


def _turned(angle: float) -> complex:
    return complex(math.cos(angle), math.sin(angle))


def _vector(place: complex) -> list[float]:
    return [place.real, place.imag, 0.0]


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
        exudyn.config.printToConsole = (
            False  # it warns of the memory that user functions take; errors are raised
        )
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
        self.gravity = gravity * _turned(self.mechanism.gravity_direction)
        self.bodies = {"frame": _Body(self.system.AddObject(self.items.ObjectGround()), -1)}
        self._add_bodies(
            {name: complex(*(perturbation or {}).get(name, (0.0, 0.0))) for name in FROM_FRAME}
        )
        self._add_slider_effects()
        self.connectors = {name: self._contact(name) for name in self.loose}
        if not self.loose:
            ends = [self._marker("rod", self.mechanism.rod.length), self._marker("slider", 0.0)]
            self.connectors["piston_pin"] = self.system.AddObject(
                self.items.RevoluteJoint2D(markerNumbers=ends)
            )
        self.recorded = {
            (name, one): self._sensor(
                self.items.SensorObject, one, objectNumber=item, storeInternal=True
            )
            for name, item in self.connectors.items()
            for one in ("DisplacementLocal", "Force")
            if recorded
        }
        centre = self._place("rod", self.mechanism.rod.mass_centre)
        make = self.items.SensorBody if "bodyNumber" in centre else self.items.SensorKinematicTree
        watched = ("Position", "Rotation", "AngularVelocity", "Acceleration")
        self.rod = {one: self._sensor(make, one, **centre) for one in watched}
        self.system.Assemble()

    def _add_bodies(self, gaps: dict[str, complex]) -> None:
        """Crank, rod and slider with the speeds that ideal pins give them; open chains where a pin
        is ideal."""
        crank, rod, slider = self.mechanism.crank, self.mechanism.rod, self.mechanism.slider
        angle, speed, pivot = self.start_angle, self.speed, gaps["crank_pivot"]
        end = pivot + crank.length * _turned(angle) + gaps["crank_pin"]
        end_velocity = 1j * speed * crank.length * _turned(angle)
        turn = math.asin((slider.offset + gaps["piston_pin"].imag - end.imag) / rod.length)
        rate = -end_velocity.imag / (rod.length * math.cos(turn))
        x = (end + rod.length * _turned(turn) - gaps["piston_pin"]).real
        velocity = (end_velocity + 1j * rod.length * rate * _turned(turn)).real
        swing = _Link("RevoluteZ", crank.length, rod.mass, rod.mass_centre, rod.inertia)
        heavy = _Link("RevoluteZ", 0.0, crank.mass, crank.mass_centre, _IMMOVABLE)
        if "crank_pin" not in self.loose:
            loose = "crank_pivot" in self.loose
            sliding = [_Link("PrismaticX"), _Link("PrismaticY")] if loose else []
            at, still = ([pivot.real, pivot.imag], [0.0, 0.0]) if loose else ([], [])
            q, v = [*at, angle, turn - angle], [*still, speed, rate - speed]
            self._add_chain(("crank", "rod"), [*sliding, heavy, swing], q, v, 0.0)
        else:
            centre = crank.mass_centre if "crank_pivot" in self.loose else 0.0
            mass = crank.mass if "crank_pivot" in self.loose else _IMMOVABLE
            arm = centre * _turned(angle)
            self._add_body(
                "crank", mass, _IMMOVABLE, centre, pivot + arm, angle, 1j * speed * arm, speed
            )
        if set(PINS) <= set(self.loose):
            arm = rod.mass_centre * _turned(turn)
            motion = end + arm, turn, end_velocity + 1j * rate * arm, rate
            self._add_body("rod", rod.mass, rod.inertia, rod.mass_centre, *motion)
        if "crank_pin" in self.loose and "piston_pin" not in self.loose:
            links = [
                _Link("PrismaticX", mass=slider.mass),
                swing._replace(at=0.0, centre=rod.mass_centre - rod.length),
            ]
            self._add_chain(("slider", "rod"), links, [x, turn], [velocity, rate], slider.offset)
            self.bodies["rod"] = self.bodies["rod"]._replace(origin=-rod.length)
        else:
            start = {
                "referenceCoordinates": [0.0],
                "initialCoordinates": [x],
                "initialVelocities": [velocity],
            }
            node = self.system.AddNode(self.items.Node1D(**start))
            place = {"nodeNumber": node, "referencePosition": [0.0, slider.offset, 0.0]}
            item = self.system.AddObject(self.items.ObjectMass1D(mass=slider.mass, **place))
            self.bodies["slider"] = _Body(item, node)

    def _add_body(
        self,
        name: str,
        mass: float,
        inertia: float,
        centre: float,
        place: complex,
        turn: float,
        v: complex,
        w: float,
    ) -> None:
        """A free body whose mass `centre` [m] is at a `place` [m], turned [rad], with the velocity
        `v` and rate `w`."""
        start = {
            "initialCoordinates": [*_vector(place)[:2], turn],
            "initialVelocities": [*_vector(v)[:2], w],
        }
        node = self.system.AddNode(self.items.NodeRigidBody2D(**start))
        body = self.items.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node)
        self.bodies[name] = _Body(self.system.AddObject(body), node, None, -centre)
        if name == "rod":
            marker = self.system.AddMarker(
                self.items.MarkerBodyMass(bodyNumber=self.bodies[name].item)
            )
            load = self.items.LoadMassProportional(
                markerNumber=marker, loadVector=_vector(self.gravity)
            )
            self.system.AddLoad(load)

    def _add_chain(
        self, names: tuple, links: list[_Link], q: list[float], v: list[float], height: float
    ) -> None:
        """An open chain from (0, `height`) whose last links are the bodies `names`."""
        vectors, matrices = self.exudyn.Vector3DList, self.exudyn.Matrix3DList
        size = len(links)
        start = {
            "referenceCoordinates": [0.0] * size,
            "initialCoordinates": q,
            "initialCoordinates_t": v,
        }
        node = self.system.AddNode(
            self.items.NodeGenericODE2(numberOfODE2Coordinates=size, **start)
        )
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
        """A point on a body at a distance [m] from its end at the crank pivot."""
        body = self.bodies[name]
        on = (
            {"bodyNumber": body.item}
            if body.link is None
            else {"objectNumber": body.item, "linkNumber": body.link}
        )
        return {**on, "localPosition": [body.origin + distance, 0.0, 0.0]}

    def _marker(self, name: str, distance: float) -> int:
        place = self._place(name, distance)
        make = (
            self.items.MarkerBodyRigid
            if "bodyNumber" in place
            else self.items.MarkerKinematicTreeRigid
        )
        return self.system.AddMarker(make(**place))

    def _sensor(self, make: Callable, variable: str, **more: Any) -> int:
        kind = getattr(self.exudyn.OutputVariableType, variable)
        return self.system.AddSensor(make(outputVariableType=kind, writeToFile=False, **more))

    def _contact(self, name: str) -> int:
        joint, law = self.mechanism.joint(name), self.mechanism.joint(name).contact
        crank, rod = self.mechanism.crank.length, self.mechanism.rod.length
        lengths = {("crank_pin", "crank"): crank, ("piston_pin", "rod"): rod}
        bodies = sorted(
            (JOINT[name].partner, JOINT[name].body), key=lambda body: body != joint.journal
        )
        data = self.items.NodeGenericData(
            initialCoordinates=[1.0, 0.0, 0.0, 0.0], numberOfDataCoordinates=4
        )
        compliance = 2 * (1 - law.poisson_ratio**2) / law.youngs_modulus
        hertz = (
            4
            / (3 * compliance)
            * math.sqrt(joint.bearing_radius * joint.journal_radius / joint.clearance)
        )
        return self.system.AddObject(
            self.items.ObjectContactSphereSphere(
                markerNumbers=[
                    self._marker(body, lengths.get((name, body), 0.0)) for body in bodies
                ],
                nodeNumber=self.system.AddNode(data),
                isHollowSphere1=True,
                impactModel=1,
                dynamicFriction=law.friction,
                frictionProportionalZone=law.friction_speed,
                spheresRadii=[joint.journal_radius, joint.bearing_radius],
                contactStiffness=law.stiffness or hertz,
                contactStiffnessExponent=law.exponent,
                restitutionCoefficient=(1 + law.restitution**2) / 2,
                minimumImpactVelocity=law.least_approach_speed,
            )
        )

    def _add_slider_effects(self) -> None:
        """Loads, springs and dampers on the slider."""
        add, items = self.system, self.items
        node = self.bodies["slider"].node
        slider = add.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
        ground = add.AddNode(items.NodePointGround())
        ends = {
            "markerNumbers": [
                add.AddMarker(items.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0)),
                slider,
            ]
        }
        for name, own in self.effects.items():
            if name == "slider_constant_force":
                add.AddLoad(items.LoadCoordinate(markerNumber=slider, load=own.force_N))
            elif name == "slider_spring":
                spring = {"stiffness": own.stiffness_N_m, "offset": own.rest_position_m}
                add.AddObject(items.CoordinateSpringDamper(**ends, **spring))
            elif name == "slider_viscous_friction":
                add.AddObject(items.CoordinateSpringDamper(**ends, damping=own.damping_N_s_m))
            elif name == "slider_coulomb_friction":
                dry = {
                    "dynamicFrictionForce": own.force_N,
                    "frictionProportionalZone": FRICTION_ZONE,
                }
                add.AddObject(items.CoordinateSpringDamperExt(**ends, **dry))
            elif name == "slider_quadratic_drag":

                def drag(mbs, time, item, displacement, velocity, *_, factor=own.drag_N_s2_m2):
                    return factor * velocity * abs(velocity)

                add.AddObject(items.CoordinateSpringDamper(**ends, springForceUserFunction=drag))

    def advance(
        self, end: float, tolerance: float = TOLERANCE, longest: float = 1e-4
    ) -> np.ndarray:
        """Go on to the time `end` [s] with steps of at most `longest` [s]; the `positions` there.

        `tolerance` is absolute, of all coordinates and velocities; with ideal joints it does not
        count.
        """
        settings = self.exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = 1e-12 if self.recorded else end
        time = settings.timeIntegration
        time.startTime, time.endTime, time.verboseMode = self.time, end, 0
        longest = longest if self.loose else 2 * math.pi / (self.speed * STEPS)
        time.numberOfSteps = max(1, math.ceil((end - self.time) / longest))
        time.generalizedAlpha.spectralRadius = _SPECTRAL_RADIUS
        time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-10, 1e-12
        time.initialStepSize, time.minimumStepSize = min(1e-7, end - self.time), 1e-16
        time.absoluteTolerance, time.relativeTolerance = tolerance, 0.0
        time.discontinuous.iterationTolerance = _EVENT_TOLERANCE
        time.explicit.computeEndOfStepAccelerations = True
        solver = (
            self.exudyn.DynamicSolverType.DOPRI5
            if self.loose
            else self.exudyn.DynamicSolverType.GeneralizedAlpha
        )
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
        arm, x = _turned(angle), self._slider("Coordinates")
        centre, acceleration = (
            complex(*self._rod(name)[:2]) for name in ("Position", "Acceleration")
        )
        turn = self._rod("Rotation")[-1]
        foot = centre - rod.mass_centre * _turned(turn)
        forces = {name: self._force_on_rod(name, item) for name, item in self.connectors.items()}
        for name, other in (PINS, PINS[::-1]):
            if name not in forces:  # what an ideal pin has to bear
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
        own = crank.mass * crank.mass_centre * arm
        frame = (
            crank.mass * (crank.mass_centre * self.speed**2 * arm + self.gravity)
            - forces["crank_pin"]
        )
        torque = (point.conjugate() * forces["crank_pin"] - own.conjugate() * self.gravity).imag
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
        force = complex(
            *self.system.GetObjectOutput(item, self.exudyn.OutputVariableType.Force)[:2]
        )
        return (
            -force if name in self.loose and self.mechanism.joint(name).journal != "rod" else force
        )

    def record(self) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Time [s], and by joint penetration [m] and size of the force [N], at every step of the
        latest advance."""
        stored = {
            key: self.system.GetSensorStoredData(sensor) for key, sensor in self.recorded.items()
        }
        return (
            next(iter(stored.values()))[:, 0],
            {name: -stored[name, "DisplacementLocal"][:, 1] for name in self.loose},
            {name: np.linalg.norm(stored[name, "Force"][:, 1:], axis=1) for name in self.loose},
        )
