"""The slider-crank in Exudyn (https://exudyn.readthedocs.io), for blind trials, tests, benchmarks.

It imports nothing of `jointgap.dynamics`: a second model of the mechanism, on purpose. Exudyn's implicit integrator
does not get through contacts, and its explicit ones take no constraints. So there are three models:

- `IdealJoints`: three bodies with constraints, implicit integrator (generalised alpha), all effects.
- `OwnContacts`: loose pins by a user function: the law of Lankarani and Nikravesh with a fading memory, and friction
  that rises along a straight line, written from docs/simulation.md.
- `NativeContacts`: loose joints as Exudyn's own spheres in hollow spheres. Its Hunt-Crossley law with the restitution
  (1 + e^2) / 2 is the published law of Lankarani and Nikravesh with the restitution e; its friction is "ambrosio".

In the last two bodies move freely in the plane, or form open chains where a pin is ideal, and the crank turns as
prescribed: it is so heavy that nothing disturbs it.

H. M. Lankarani and P. E. Nikravesh, J. Mech. Des. 112 (1990) 369-376.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numba
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from jointgap.core.errors import SimulationError, needs
from jointgap.core.joints import FROM_FRAME, JOINT, PINS, REFERENCE_APPROACH_SPEED

TOLERANCE = 1e-7
"""Local error of a step of `OwnContacts` [m, rad, m/s, rad/s]: a tenth of it changes readings of settled motions by
less than 3e-5 of their standard deviation."""

FRICTION_SPEED = 1e-3
"""Sliding speed [m/s] up to which friction in a loose pin rises along a straight line."""

FRICTION_ZONE = 1e-3
"""Speed up to which friction of the slider [m/s] and of the crank [rad/s] rises along a straight line."""

STEPS = 1500
"""Steps per revolution of the implicit integrator at least: readings agree with the package's to 1e-5 of their
standard deviation."""

EVENT_TOLERANCE = 1e-3
"""Contact force [N] that a step of `NativeContacts` may end with past the beginning or end of contact. Exudyn's default
of 1 N limits the agreement with other codes to 1e-10 m, 1e-3 N to 1e-12 m at no cost."""

_SPECTRAL_RADIUS = 0.8  # of the implicit integrator: multipliers would ring without
_LEAST_APPROACH = 1e-3  # [m/s] a slower impact is damped as one at this speed
_LONGEST_STEP = 1e-4  # [s] a thousandth of a turn of the crank at 600 rpm
_MEMORY = 2.5  # durations of the slowest elastic impact after which a contact forgets, and in which it does
_EXPONENT = 1.5
_IMMOVABLE = 1e30  # mass [kg] or inertia [kg m^2] of the crank: no force here changes a digit of its speed

_FREE, _ON_CRANK, _ON_SLIDER = 0, 1, 2  # the rod: both pins loose, crank pin ideal, piston pin ideal


def readings(content: Mapping, run: Any) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Readings [SI] by channel at the samples of a `run` (`validation.rig.CrankRun`), and the numerics used.

    Without loose pins samples come in equal steps.
    """
    names = {effect["name"] for effect in content["effects"]}
    if any(content["joints"][pin]["loose"] or f"{pin}_clearance" in names for pin in PINS):
        numerics = {"tolerance": TOLERANCE, "friction_speed": FRICTION_SPEED}
        return OwnContacts(content, run).readings(TOLERANCE), {"code": "exudyn", **numerics}
    spacing = float(run.times[1] - run.times[0])
    lead = math.ceil(2 * math.pi * run.settling / run.speed / spacing)
    model = IdealJoints(content, run.speed, run.phase - run.speed * lead * spacing)
    numerics = {"steps_per_revolution": STEPS, "friction_zone": FRICTION_ZONE}
    return model.readings(run.times, lead), {"code": "exudyn", **numerics}


def _along(angle: float) -> np.ndarray:
    return np.array([math.cos(angle), math.sin(angle)])


def _across(angle: float) -> np.ndarray:
    return np.array([-math.sin(angle), math.cos(angle)])


def hertz_stiffness(journal: float, bearing: float, law: Mapping) -> float:
    """K [N/m^1.5] of a journal in a bearing of the same material; radii in m."""
    compliance = 2 * (1 - law["poisson_ratio"] ** 2) / law["youngs_modulus"]
    return 4 / (3 * compliance) * math.sqrt(bearing * journal / (bearing - journal))


class _Link(NamedTuple):
    """A link of an open chain: joint type, where its joint is on the link before [m], mass, centre [m], inertia."""

    joint: str
    distance: float
    mass: float
    centre: float
    inertia: float


class _System:
    """An empty system of Exudyn, the bodies' numbers with the effects that are nothing but data, and the start.

    `perturbation` holds clearance vectors at the start [m] by joint, zero where absent.
    """

    def __init__(self, content: Mapping, speed: float, phase: float, perturbation: Mapping | None = None):
        with needs("a simulation by Exudyn", "peers"):
            import exudyn
            import exudyn.utilities

        self.exudyn, self.items = exudyn, exudyn.utilities
        self.container = exudyn.SystemContainer()
        self.system = self.container.AddSystem()
        self.content, self.speed, self.phase = content, speed, phase
        self.effects = {effect["name"]: effect["parameters"] for effect in content["effects"]}
        self.gravity = self.effects.get("gravity", {}).get("acceleration_m_s2", 0.0)
        length_errors = self.effects.get("link_length_error", {})
        crank, rod = content["crank"], content["rod"]
        self.crank, self.rod = (
            link["length"] + length_errors.get(key, 0.0) for link, key in ((crank, "crank_m"), (rod, "rod_m"))
        )
        self.crank_centre = crank["mass_centre"] * self.crank / crank["length"]
        self.rod_centre = rod["mass_centre"] * self.rod / rod["length"]
        self.slider_mass = content["slider"]["mass"] + self.effects.get("added_slider_mass", {}).get("mass_kg", 0.0)
        self.offset = content["slider"]["offset"]
        self.pivot, at_pin, at_piston = (np.asarray((perturbation or {}).get(n, (0.0, 0.0))) for n in FROM_FRAME)
        self.end = self.pivot + self.crank * _along(phase) + at_pin
        self.end_velocity = self.crank * speed * _across(phase)
        self.rod_angle = math.asin((self.offset + at_piston[1] - self.end[1]) / self.rod)
        self.rod_rate = -self.end_velocity[1] / (self.rod * math.cos(self.rod_angle))
        self.start = float((self.end + self.rod * _along(self.rod_angle) - at_piston)[0])
        self.start_velocity = float((self.end_velocity + self.rod * self.rod_rate * _across(self.rod_angle))[0])
        ground = self.system.AddNode(self.items.NodePointGround())
        self.fixed = self.coordinate(ground, 0)

    def coordinate(self, node: int, number: int) -> int:
        """Marker of the coordinate `number` of a `node`."""
        return self.system.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=node, coordinate=number))

    def rod_body(self) -> tuple[int, int]:
        """The rod as a body of its own: object and node."""
        rod, angle = self.content["rod"], self.rod_angle
        node = self.system.AddNode(
            self.items.NodeRigidBody2D(
                initialCoordinates=[*(self.end + self.rod_centre * _along(angle)), angle],
                initialVelocities=[
                    *(self.end_velocity + self.rod_centre * self.rod_rate * _across(angle)),
                    self.rod_rate,
                ],
            )
        )
        body = self.items.ObjectRigidBody2D(mass=rod["mass"], inertia=rod["inertia"], nodeNumber=node)
        return self.system.AddObject(body), node

    def sliding_mass(self) -> tuple[int, int]:
        """The slider by itself: object and node. It takes two thirds of the time of a link or a constrained body."""
        node = self.system.AddNode(
            self.items.Node1D(
                referenceCoordinates=[0.0],
                initialCoordinates=[self.start],
                initialVelocities=[self.start_velocity],
            )
        )
        place = [0.0, self.offset, 0.0]
        body = self.items.ObjectMass1D(mass=self.slider_mass, nodeNumber=node, referencePosition=place)
        return self.system.AddObject(body), node

    def crank_and_rod(self, loose_pivot: bool = False) -> tuple[int, int]:
        """Crank and rod as a chain: object and node; the crank hangs on two sliding links where its pivot is loose."""
        crank, rod = self.content["crank"], self.content["rod"]
        mass, centre = (crank["mass"], self.crank_centre) if loose_pivot else (_IMMOVABLE, 0.0)
        links = [
            _Link("RevoluteZ", 0.0, mass, centre, _IMMOVABLE),
            _Link("RevoluteZ", self.crank, rod["mass"], self.rod_centre, rod["inertia"]),
        ]
        q, v = [self.phase, self.rod_angle - self.phase], [self.speed, self.rod_rate - self.speed]
        if loose_pivot:
            links = [_Link(joint, 0.0, 0.0, 0.0, 0.0) for joint in ("PrismaticX", "PrismaticY")] + links
            q, v = [*self.pivot, *q], [0.0, 0.0, *v]
        return self._chain(links, q, v, 0.0)

    def slider_and_rod(self) -> tuple[int, int]:
        """Slider and rod as a chain: object and node."""
        rod = self.content["rod"]
        links = [
            _Link("PrismaticX", 0.0, self.slider_mass, 0.0, 0.0),
            _Link("RevoluteZ", 0.0, rod["mass"], self.rod_centre - self.rod, rod["inertia"]),
        ]
        return self._chain(links, [self.start, self.rod_angle], [self.start_velocity, self.rod_rate], self.offset)

    def _chain(self, links: Sequence[_Link], positions: list, velocities: list, height: float) -> tuple[int, int]:
        """Open chain from (0, `height`): object and node."""
        vectors, matrices = self.exudyn.Vector3DList, self.exudyn.Matrix3DList
        node = self.system.AddNode(
            self.items.NodeGenericODE2(
                referenceCoordinates=[0.0] * len(links),
                initialCoordinates=positions,
                initialCoordinates_t=velocities,
                numberOfODE2Coordinates=len(links),
            )
        )
        chain = self.items.ObjectKinematicTree(
            nodeNumber=node,
            gravity=[0.0, -self.gravity, 0.0],
            baseOffset=[0.0, height, 0.0],
            jointTypes=[getattr(self.exudyn.JointType, link.joint) for link in links],
            linkParents=list(range(-1, len(links) - 1)),
            jointTransformations=matrices([np.eye(3) for _ in links]),
            jointOffsets=vectors([[link.distance, 0.0, 0.0] for link in links]),
            linkInertiasCOM=matrices([link.inertia * np.eye(3) for link in links]),
            linkCOMs=vectors([[link.centre, 0.0, 0.0] for link in links]),
            linkMasses=[link.mass for link in links],
        )
        return self.system.AddObject(chain), node

    def add_slider_effects(self, marker: int, origin: float) -> None:
        """Loads, springs and dampers on the slider."""
        slider, spring = {"markerNumbers": [self.fixed, marker]}, self.items.CoordinateSpringDamper
        for name, values in self.effects.items():
            if name == "slider_constant_force":
                self.system.AddLoad(self.items.LoadCoordinate(markerNumber=marker, load=values["force_N"]))
            elif name == "slider_spring":
                rest = values["rest_position_m"] - origin
                self.system.AddObject(spring(**slider, stiffness=values["stiffness_N_m"], offset=rest))
            elif name == "slider_viscous_friction":
                self.system.AddObject(spring(**slider, damping=values["damping_N_s_m"]))
            elif name == "slider_coulomb_friction":
                self.add_friction(slider["markerNumbers"], values["force_N"])
            elif name == "slider_quadratic_drag":
                factor = values["drag_N_s2_m2"]

                def drag(mbs, time, item, displacement, velocity, *_, factor=factor):
                    return factor * velocity * abs(velocity)

                self.system.AddObject(spring(**slider, springForceUserFunction=drag))

    def add_friction(self, markers: list[int], size: float) -> None:
        """Dry friction of a `size` [N or N m] between two coordinates, given by their `markers`."""
        friction = {"dynamicFrictionForce": size, "frictionProportionalZone": FRICTION_ZONE}
        self.system.AddObject(self.items.CoordinateSpringDamperExt(markerNumbers=markers, **friction))

    def add_sensor(self, kind: str, number: int, variable: str) -> int:
        """Sensor that keeps a `variable` of a node or an object."""
        make = self.items.SensorNode if kind == "node" else self.items.SensorObject
        output = getattr(self.exudyn.OutputVariableType, variable)
        return self.system.AddSensor(
            make(**{f"{kind}Number": number}, storeInternal=True, writeToFile=False, outputVariableType=output)
        )

    def settings(self, end: float, steps: int, write_period: float) -> Any:
        """Settings of a simulation to the time `end` [s]."""
        settings = self.exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = write_period
        settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = end, steps
        settings.timeIntegration.verboseMode = 0
        return settings

    def solve(self, settings: Any, solver: str, **more: bool) -> None:
        """Run, or raise SimulationError."""
        kind = getattr(self.exudyn.DynamicSolverType, solver)
        if self.system.SolveDynamic(settings, solverType=kind, **more) is False:
            raise SimulationError(f"Exudyn's integrator {solver} stopped")


class IdealJoints(_System):
    """All joints ideal: three bodies, constraints at the joints, the guide and the crank's angle."""

    def __init__(self, content: Mapping, speed: float, phase: float):
        super().__init__(content, speed, phase)
        add, items = self.system, self.items
        crank, rod = content["crank"], content["rod"]
        along, across = _along(phase), _across(phase)
        rod_along, rod_across = _along(self.rod_angle), _across(self.rod_angle)
        self.nodes, bodies = {}, {"frame": add.AddObject(items.ObjectGround())}
        for name, mass, inertia, centre, angle, velocity, rate in (
            ("crank", crank["mass"], crank["inertia"], self.crank_centre * along, phase,
             self.crank_centre * speed * across, speed),
            ("rod", rod["mass"], rod["inertia"], self.end + self.rod_centre * rod_along, self.rod_angle,
             self.end_velocity + self.rod_centre * self.rod_rate * rod_across, self.rod_rate),
            ("slider", self.slider_mass, 1e-3, (self.start, self.offset), 0.0, (self.start_velocity, 0.0), 0.0),
        ):  # fmt: skip
            self.nodes[name] = add.AddNode(
                items.NodeRigidBody2D(referenceCoordinates=[*centre, angle], initialVelocities=[*velocity, rate])
            )
            bodies[name] = add.AddObject(
                items.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=self.nodes[name])
            )
        places = {
            "crank_pivot": {"frame": 0.0, "crank": -self.crank_centre},
            "crank_pin": {"crank": self.crank - self.crank_centre, "rod": -self.rod_centre},
            "piston_pin": {"slider": 0.0, "rod": self.rod - self.rod_centre},
        }
        joints = {}
        for name in FROM_FRAME:
            markers = [
                add.AddMarker(items.MarkerBodyRigid(bodyNumber=bodies[body], localPosition=[place, 0.0, 0.0]))
                for body, place in places[name].items()
            ]
            joints[name] = add.AddObject(items.RevoluteJoint2D(markerNumbers=markers))
        constraint = items.CoordinateConstraint
        guide = add.AddObject(constraint(markerNumbers=[self.fixed, self.coordinate(self.nodes["slider"], 1)]))
        add.AddObject(constraint(markerNumbers=[self.fixed, self.coordinate(self.nodes["slider"], 2)]))
        turning = [self.fixed, self.coordinate(self.nodes["crank"], 2)]
        drive = add.AddObject(constraint(markerNumbers=turning, velocityLevel=True, offset=speed))
        self._add_effects(bodies)
        self.sensors = {
            (name, variable): self.add_sensor("node", node, variable)
            for name, node in self.nodes.items()
            for variable in ("Coordinates", "Coordinates_t", "Coordinates_tt")
        } | {
            (name, "Force"): self.add_sensor("object", item, "Force")
            for name, item in (("guide", guide), ("drive", drive), ("pivot", joints["crank_pivot"]))
        }
        add.Assemble()

    def _add_effects(self, bodies: Mapping[str, int]) -> None:
        add, items = self.system, self.items
        self.add_slider_effects(self.coordinate(self.nodes["slider"], 0), self.start)
        crank = [self.fixed, self.coordinate(self.nodes["crank"], 2)]
        for name, values in self.effects.items():
            if name == "gravity":
                for body in ("crank", "rod", "slider"):
                    marker = add.AddMarker(items.MarkerBodyMass(bodyNumber=bodies[body]))
                    add.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=[0.0, -self.gravity, 0.0]))
            elif name == "crank_viscous_friction":
                add.AddObject(items.CoordinateSpringDamper(markerNumbers=crank, damping=values["damping_N_m_s"]))
            elif name == "crank_coulomb_friction":
                self.add_friction(crank, values["torque_N_m"])

    def readings(self, times: np.ndarray, lead: int) -> dict[str, np.ndarray]:
        """Readings by channel at `times` [s], of which the first comes `lead` samples after the start."""
        spacing = float(times[1] - times[0])
        samples = lead + times.size - 1
        steps = math.ceil(spacing * self.speed * STEPS / (2 * math.pi)) * samples
        settings = self.settings(spacing * samples, steps, spacing)
        settings.timeIntegration.generalizedAlpha.spectralRadius = _SPECTRAL_RADIUS
        newton = settings.timeIntegration.newton
        newton.relativeTolerance, newton.absoluteTolerance = 1e-10, 1e-12
        self.solve(settings, "GeneralizedAlpha")
        series = {key: self.system.GetSensorStoredData(sensor)[lead:, 1:] for key, sensor in self.sensors.items()}
        rod, rod_rates, rod_second = (series["rod", f"Coordinates{rate}"] for rate in ("", "_t", "_tt"))
        slider, slider_rates, slider_second = (series["slider", f"Coordinates{rate}"] for rate in ("", "_t", "_tt"))
        return {
            "crank_angle": self.phase + series["crank", "Coordinates"][:, 2],
            "slider_position": self.start + slider[:, 0],
            "slider_velocity": slider_rates[:, 0],
            "slider_acceleration": slider_second[:, 0],
            "rod_angle": self.rod_angle + rod[:, 2],
            "rod_angular_velocity": rod_rates[:, 2],
            "rod_acceleration_x": rod_second[:, 0],
            "rod_acceleration_y": rod_second[:, 1],
            "crank_torque": -series["drive", "Force"][:, 0],
            "guide_force": -series["guide", "Force"][:, 0],
            "frame_force_x": series["pivot", "Force"][:, 0],
            "frame_force_y": series["pivot", "Force"][:, 1],
        }


class NativeContacts(_System):
    """Loose joints by Exudyn's own contacts, the crank at constant speed, no effects; a pin has to be loose.

    `mechanism` is a `jointgap` Mechanism whose loose joints have the published law lankarani_nikravesh, and no friction
    or that of ambrosio without a dead band. With `recorded` penetration and force are kept at every step.
    """

    def __init__(self, mechanism: Any, speed: float, start_angle=0.0, perturbation=None, recorded=False):
        super().__init__(mechanism.model_dump(), speed, start_angle, perturbation)
        self.loose, self.time, self.sensors = mechanism.loose, 0.0, {}
        if set(self.loose) <= {"crank_pivot"}:
            raise ValueError("neither pin is loose, and this model closes no loop; loosen one of them")
        if "crank_pin" not in self.loose:
            (chain, self.rod_node), last = self.crank_and_rod("crank_pivot" in self.loose), 2 * len(self.loose) - 1
            slider, self.slider_node = self.sliding_mass()
            on = {
                "crank": self._on_link(chain, last - 1),
                "rod": self._on_link(chain, last),
                "slider": self._on_body(slider),
            }
        elif "piston_pin" not in self.loose:
            chain, self.rod_node = self.slider_and_rod()
            self.slider_node = self.rod_node
            rod = self._on_link(chain, 1, -self.rod)
            on = {"crank": self._crank_body(), "rod": rod, "slider": self._on_link(chain, 0)}
        else:
            (rod, self.rod_node), (slider, self.slider_node) = self.rod_body(), self.sliding_mass()
            rod = self._on_body(rod, -self.rod_centre)
            on = {"crank": self._crank_body(), "rod": rod, "slider": self._on_body(slider)}
        on["frame"] = self._on_body(self.system.AddObject(self.items.ObjectGround()))
        distances = {"crank_pin": {"crank": self.crank}, "piston_pin": {"rod": self.rod}}
        for name in self.loose:
            markers = {
                body: on[body](distances.get(name, {}).get(body, 0.0))
                for body in (JOINT[name].partner, JOINT[name].body)
            }
            contact = self._contact(mechanism.joint(name), markers)
            for variable in ("DisplacementLocal", "Force") if recorded else ():
                self.sensors[name, variable] = self.add_sensor("object", contact, variable)
        self.system.Assemble()

    def _on_body(self, body: int, origin: float = 0.0) -> Callable[[float], int]:
        """From a distance [m] along a body to a marker there."""

        def marker(distance: float) -> int:
            place = [origin + distance, 0.0, 0.0]
            return self.system.AddMarker(self.items.MarkerBodyRigid(bodyNumber=body, localPosition=place))

        return marker

    def _on_link(self, chain: int, link: int, origin: float = 0.0) -> Callable[[float], int]:
        """From a distance [m] along a link of a chain to a marker there."""

        def marker(distance: float) -> int:
            place = [origin + distance, 0.0, 0.0]
            rigid = self.items.MarkerKinematicTreeRigid
            return self.system.AddMarker(rigid(objectNumber=chain, linkNumber=link, localPosition=place))

        return marker

    def _crank_body(self) -> Callable[[float], int]:
        loose = "crank_pivot" in self.loose
        centre = self.crank_centre if loose else 0.0
        node = self.system.AddNode(
            self.items.NodeRigidBody2D(
                initialCoordinates=[*(self.pivot + centre * _along(self.phase)), self.phase],
                initialVelocities=[*(centre * self.speed * _across(self.phase)), self.speed],
            )
        )
        mass = self.content["crank"]["mass"] if loose else _IMMOVABLE
        body = self.items.ObjectRigidBody2D(mass=mass, inertia=_IMMOVABLE, nodeNumber=node)
        return self._on_body(self.system.AddObject(body), -centre)

    def _contact(self, joint: Any, markers: dict[str, int]) -> int:
        """Contact of a joint's journal with its bearing, whose centres are at the `markers` of the two bodies."""
        law, journal = joint.contact, markers.pop(joint.journal)
        radii = [joint.journal_radius, joint.bearing_radius]
        return self.system.AddObject(
            self.items.ObjectContactSphereSphere(
                markerNumbers=[journal, *markers.values()],
                nodeNumber=self.system.AddNode(
                    self.items.NodeGenericData(initialCoordinates=[1.0, 0.0, 0.0, 0.0], numberOfDataCoordinates=4)
                ),
                isHollowSphere1=True,
                impactModel=1,
                dynamicFriction=law.friction,
                frictionProportionalZone=law.friction_speed,
                spheresRadii=radii,
                contactStiffness=law.stiffness or hertz_stiffness(*radii, law.model_dump()),
                contactStiffnessExponent=law.exponent,
                restitutionCoefficient=(1 + law.restitution**2) / 2,
            )
        )

    def advance(self, end: float, tolerance: float, longest: float = 1e-4) -> np.ndarray:
        """Go on to the time `end` [s] with steps of at most `longest` [s]; the `positions` there.

        `tolerance` is absolute, of all coordinates and velocities.
        """
        steps = max(1, math.ceil((end - self.time) / longest))
        settings = self.settings(end, steps, 1e-12 if self.sensors else end)
        time = settings.timeIntegration
        time.startTime, time.initialStepSize, time.minimumStepSize = self.time, min(1e-7, end - self.time), 1e-16
        time.absoluteTolerance, time.relativeTolerance = tolerance, 0.0
        time.discontinuous.iterationTolerance = EVENT_TOLERANCE
        time.explicit.computeEndOfStepAccelerations = False
        self.solve(settings, "DOPRI5", updateInitialValues=True)
        self.time = end
        return self.positions()

    def positions(self) -> np.ndarray:
        """Rod's mass centre x, y [m], rod angle [rad], slider position [m]."""
        coordinates = self.exudyn.OutputVariableType.Coordinates
        rod, slider = (
            np.atleast_1d(self.system.GetNodeOutput(node, coordinates)) for node in (self.rod_node, self.slider_node)
        )
        if "crank_pin" not in self.loose:
            pivot, angle = rod[:-2] if "crank_pivot" in self.loose else np.zeros(2), rod[-2] + rod[-1]
            centre = pivot + self.crank * _along(rod[-2]) + self.rod_centre * _along(angle)
        elif "piston_pin" not in self.loose:
            angle = rod[1]
            centre = np.array([rod[0], self.offset]) - (self.rod - self.rod_centre) * _along(angle)
        else:
            centre, angle = rod[:2], rod[2]
        return np.array([*centre, angle, slider[0]])

    def record(self) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Time [s], and by joint penetration [m] and size of the force [N], at every step of the latest advance."""
        stored = {key: self.system.GetSensorStoredData(sensor) for key, sensor in self.sensors.items()}
        return (
            next(iter(stored.values()))[:, 0],
            {name: -stored[name, "DisplacementLocal"][:, 1] for name in self.loose},
            {name: np.linalg.norm(stored[name, "Force"][:, 1:], axis=1) for name in self.loose},
        )


def compiled(function: Callable) -> Callable:
    """`function` as machine code; products and sums may fuse, nothing else is reordered."""
    return numba.njit(cache=True, error_model="numpy", fastmath={"contract"})(function)


class _Geometry(NamedTuple):
    """What the pins' places follow from: lengths [m], speed [rad/s], angle at the start [rad], how the rod hangs."""

    crank: float
    rod: float
    rod_centre: float
    speed: float
    phase: float
    offset: float
    rod_hangs: int


class _Contact(NamedTuple):
    """Numbers of a loose pin's contact; of an ideal pin all are 0.

    Radii [m], stiffness [N/m^1.5], chi of the damping chi/v [1], friction [1], memory and as long a fading [s], and the
    approach speed [m/s] as whose impact a lasting contact is damped.
    """

    journal: float = 0.0
    bearing: float = 0.0
    stiffness: float = 0.0
    chi: float = 0.0
    friction: float = 0.0
    memory: float = 0.0
    reference: float = 1.0


_EX, _EY, _VX, _VY, _JOURNAL_TURNS, _BEARING_TURNS = range(6)  # of a pin: from its bearing's centre to its journal's
_TOUCHING, _APPROACH, _BEGIN = range(3)  # what a contact remembers: whether it touches, approach speed, begin
_TIME, _DEPTH, _RATE, _ACCELERATION = range(4)  # of a pin at the end of the step before, along its normal


@compiled
def _move_pins(geometry, time, q, v, pins):
    """Write the motion of both pins into `pins`; the rod's angle and its rate."""
    angle = geometry.phase + geometry.speed * time
    crank_x, crank_y = geometry.crank * math.cos(angle), geometry.crank * math.sin(angle)
    crank_vx, crank_vy = -geometry.speed * crank_y, geometry.speed * crank_x
    if geometry.rod_hangs == _ON_SLIDER:
        slider, slider_v, turn, rate = q[0], v[0], q[1], v[1]
    elif geometry.rod_hangs == _ON_CRANK:
        slider, slider_v, turn, rate = q[2], v[2], q[0] + q[1], v[0] + v[1]
    else:
        slider, slider_v, turn, rate = q[3], v[3], q[2], v[2]
    cosine, sine = math.cos(turn), math.sin(turn)
    # Where one point of the rod is, and how far along the rod from there its two ends are.
    if geometry.rod_hangs == _ON_SLIDER:
        x, y, vx, vy, near = slider, geometry.offset, slider_v, 0.0, -geometry.rod
    elif geometry.rod_hangs == _ON_CRANK:
        x, y, vx, vy, near = crank_x, crank_y, crank_vx, crank_vy, 0.0
    else:
        x, y, vx, vy, near = q[0], q[1], v[0], v[1], -geometry.rod_centre
    far = near + geometry.rod
    pins[0, _EX], pins[0, _EY] = crank_x - (x + near * cosine), crank_y - (y + near * sine)
    pins[0, _VX], pins[0, _VY] = crank_vx - (vx - near * rate * sine), crank_vy - (vy + near * rate * cosine)
    pins[0, _JOURNAL_TURNS], pins[0, _BEARING_TURNS] = geometry.speed, rate
    pins[1, _EX], pins[1, _EY] = slider - (x + far * cosine), geometry.offset - (y + far * sine)
    pins[1, _VX], pins[1, _VY] = slider_v - (vx - far * rate * sine), -(vy + far * rate * cosine)
    pins[1, _JOURNAL_TURNS], pins[1, _BEARING_TURNS] = 0.0, rate
    return turn, rate


@compiled
def _damping(contact, time, approach, begin):
    """chi over the approach speed, going over to chi over the reference speed [s/m]."""
    share = (time - begin) / contact.memory - 1.0
    own, lasting = contact.chi / approach, contact.chi / contact.reference
    if share <= 0.0:
        return own
    if share >= 1.0:
        return lasting
    left = 1.0 - share
    faded = share**5 * (1.0 + left * (5.0 + left * (15.0 + left * (35.0 + left * 70.0))))
    return (1.0 - faded) * own + faded * lasting


@compiled
def _depth_and_rate(contact, pin):
    """Penetration [m], below 0 in flight, and its rate [m/s]."""
    distance = math.hypot(pin[_EX], pin[_EY])
    rate = (pin[_EX] * pin[_VX] + pin[_EY] * pin[_VY]) / distance if distance > 0.0 else 0.0
    return distance - (contact.bearing - contact.journal), rate


@compiled
def _contact_force(contact, time, pin, memory, friction_speed):
    """Force x, y [N] on the journal; moments [N m] on journal and bearing about their centres."""
    depth, rate = _depth_and_rate(contact, pin)
    if depth <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    # A contact that began within this step has no memory yet: what it has now is what it began with.
    began = memory[_TOUCHING] > 0.0
    damping = (
        _damping(contact, time, memory[_APPROACH], memory[_BEGIN])
        if began
        else contact.chi / max(abs(rate), _LEAST_APPROACH)
    )
    normal = contact.stiffness * depth * math.sqrt(depth) * (1.0 + damping * rate)
    if normal <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    distance = depth + contact.bearing - contact.journal
    nx, ny = pin[_EX] / distance, pin[_EY] / distance
    on_journal, on_bearing = contact.journal - 0.5 * depth, contact.bearing + 0.5 * depth  # they touch halfway
    sliding = nx * pin[_VY] - ny * pin[_VX] + on_journal * pin[_JOURNAL_TURNS] - on_bearing * pin[_BEARING_TURNS]
    tangential = -normal * contact.friction * min(max(sliding / friction_speed, -1.0), 1.0)
    return (
        -normal * nx - tangential * ny,
        -normal * ny + tangential * nx,
        on_journal * tangential,
        -on_bearing * tangential,
    )


@compiled
def _generalised_forces(geometry, contacts, time, q, v, memory, friction_speed, pins, forces):
    """Write the contacts' forces on the coordinates `q` into `forces`."""
    turn, _ = _move_pins(geometry, time, q, v, pins)
    cosine, sine = math.cos(turn), math.sin(turn)
    forces[:] = 0.0
    for place in range(2):
        contact = contacts[place]
        if contact.stiffness == 0.0:
            continue
        fx, fy, _, on_rod = _contact_force(contact, time, pins[place], memory[place], friction_speed)
        along = geometry.rod * place  # from the rod's end at the crank
        slider = fx if place == 1 else 0.0
        if geometry.rod_hangs == _FREE:
            forces[0] -= fx
            forces[1] -= fy
            forces[2] += on_rod - (along - geometry.rod_centre) * (cosine * fy - sine * fx)
            forces[3] += slider
        elif geometry.rod_hangs == _ON_CRANK:
            forces[1] += on_rod - along * (cosine * fy - sine * fx)
            forces[2] += slider
        else:
            forces[0] -= fx
            forces[1] += on_rod - (along - geometry.rod) * (cosine * fy - sine * fx)


@compiled
def _remember(geometry, contacts, time, q, v, memory, before, pins):
    """Note at a step's end which contacts have begun, and how fast, and which have ended."""
    _move_pins(geometry, time, q, v, pins)
    for place in range(2):
        contact, own, last = contacts[place], memory[place], before[place]
        if contact.stiffness == 0.0:
            continue
        depth, rate = _depth_and_rate(contact, pins[place])
        elapsed = time - last[_TIME]
        if depth <= 0.0:
            own[_TOUCHING] = 0.0
            if elapsed > 0.0:
                last[_ACCELERATION] = (rate - last[_RATE]) / elapsed
        elif own[_TOUCHING] == 0.0:
            share = last[_DEPTH] / (last[_DEPTH] - depth)
            own[_TOUCHING], own[_BEGIN] = 1.0, last[_TIME] + share * elapsed
            own[_APPROACH] = max(last[_RATE] + last[_ACCELERATION] * share * elapsed, _LEAST_APPROACH)
        last[_TIME], last[_DEPTH], last[_RATE] = time, depth, rate


def slowest_impact(stiffness: float, mass: float) -> float:
    """Duration [s] of an elastic impact of `mass` [kg] at the slowest speed that is damped as such; stiffness
    [N/m^1.5].
    """
    energy = 0.5 * mass * _LEAST_APPROACH**2
    depth = ((_EXPONENT + 1) * energy / stiffness) ** (1 / (_EXPONENT + 1))
    first = 1 / (_EXPONENT + 1)
    beta = math.gamma(first) * math.gamma(0.5) / math.gamma(first + 0.5)
    return 2 * depth / _LEAST_APPROACH * beta * first


class OwnContacts(_System):
    """Loose pins by the compiled contact law above, the crank as prescribed, all effects; a pin has to be loose."""

    def __init__(self, content: Mapping, run: Any):
        super().__init__(content, run.speed, run.start_angle)
        self.run = run
        self.lead_time = (run.phase - run.start_angle + 2 * math.pi * run.settling) / run.speed
        self.contacts = tuple(self._contact(name) for name in PINS)
        crank_pin, piston_pin = (contact.stiffness > 0.0 for contact in self.contacts)
        hangs = _FREE if crank_pin and piston_pin else _ON_SLIDER if crank_pin else _ON_CRANK
        self.geometry = _Geometry(
            self.crank, self.rod, self.rod_centre, run.speed, run.start_angle, float(self.offset), hangs
        )
        if hangs == _ON_SLIDER:
            nodes = [self.slider_and_rod()[1]]
        elif hangs == _ON_CRANK:
            nodes = [self.crank_and_rod()[1], self.sliding_mass()[1]]
        else:
            nodes = [self.rod_body()[1]]
            weight = -self.gravity * content["rod"]["mass"]
            self.system.AddLoad(self.items.LoadCoordinate(markerNumber=self.coordinate(nodes[0], 1), load=weight))
            nodes.append(self.sliding_mass()[1])
        self.add_slider_effects(self.coordinate(nodes[-1], 0), 0.0)
        self.memory, self.pins = np.zeros((2, 3)), np.zeros((2, 6))
        self.before = np.zeros((2, 4))
        self.before[:, _DEPTH] = [contact.journal - contact.bearing for contact in self.contacts]
        self.records: list[tuple] = []
        self._add_contacts(nodes)
        self.system.Assemble()

    def _contact(self, name: str) -> _Contact:
        joint, effect = self.content["joints"][name], self.effects.get(f"{name}_clearance")
        if not joint["loose"] and effect is None:
            return _Contact()
        law, journal = self.content["contacts"][joint["contact"]], joint["journal_radius"]
        law = law | (effect or {})
        bearing = journal + effect["clearance_m"] if effect else joint["bearing_radius"]
        stiffness = hertz_stiffness(journal, bearing, law) * law.get("stiffness_factor", 1.0)
        return _Contact(
            journal,
            bearing,
            stiffness,
            0.75 * (1 - law["restitution"] ** 2),
            float(law["friction"]),
            _MEMORY * slowest_impact(stiffness, self.content["rod"]["mass"] + self.slider_mass),
            law.get("reference_approach_speed", REFERENCE_APPROACH_SPEED) / law.get("damping_factor", 1.0),
        )

    def _add_contacts(self, nodes: list[int]) -> None:
        """The contacts as forces on the coordinates of `nodes`, and what is noted at the end of every step."""
        size = {_FREE: 4, _ON_CRANK: 3, _ON_SLIDER: 2}[self.geometry.rod_hangs]
        forces, begin = np.zeros(size), self.lead_time - 2 * _LONGEST_STEP

        def force(mbs, time, item, q, v):
            place, rate = np.array(q), np.array(v)
            _generalised_forces(
                self.geometry, self.contacts, time, place, rate, self.memory, FRICTION_SPEED, self.pins, forces
            )
            return forces

        def end_step(mbs, time):
            data = mbs.systemData
            q, v = data.GetODE2Coordinates(), data.GetODE2Coordinates_t()
            _remember(self.geometry, self.contacts, time, q, v, self.memory, self.before, self.pins)
            if time > begin:
                self.records.append((time, q, v, data.GetODE2Coordinates_tt(), self.memory.copy()))
            return True

        self.system.AddObject(
            self.items.ObjectGenericODE2(nodeNumbers=nodes, massMatrix=np.zeros((size, size)), forceUserFunction=force)
        )
        self.system.SetPostStepUserFunction(end_step)

    def readings(self, tolerance: float) -> dict[str, np.ndarray]:
        """Go through the settling and the run, and read at its samples."""
        end = self.lead_time + self.run.times[-1] + 2 * _LONGEST_STEP
        settings = self.settings(end, math.ceil(end / _LONGEST_STEP), end)
        time = settings.timeIntegration
        time.initialStepSize, time.minimumStepSize = 1e-7, 1e-14
        time.absoluteTolerance, time.relativeTolerance = tolerance, 0.0
        time.explicit.computeEndOfStepAccelerations = True
        self.exudyn.config.printToConsole = False  # it warns of the memory that user functions take; errors are raised
        self.solve(settings, "DOPRI5")
        steps, q, v, a, memory = (np.array(column) for column in zip(*self.records, strict=True))
        times = self.lead_time + self.run.times
        speeds = CubicHermiteSpline(steps, v, a)
        after = np.searchsorted(steps, times)
        began = memory[after, :, _TOUCHING, None] > 0.0  # within the step at the latest
        remembered = np.where(began, memory[after], memory[after - 1])
        return self._readings(
            times, CubicHermiteSpline(steps, q, v)(times), speeds(times), speeds.derivative()(times), remembered
        )

    def _readings(self, times, q, v, a, memory) -> dict[str, np.ndarray]:
        """Readings from (n, k) coordinates, their rates and second rates, and the contacts' (n, 2, 3) memories."""
        geometry, weight = self.geometry, 1j * self.gravity
        # In the plane of complex numbers; the crank first.
        angle = geometry.phase + geometry.speed * times
        arm = np.exp(1j * angle)
        if geometry.rod_hangs == _FREE:
            turn, rate = q[:, 2], v[:, 2]
            rod_acceleration, slider = a[:, 0] + 1j * a[:, 1], 3
        elif geometry.rod_hangs == _ON_CRANK:
            turn, rate, second = (series[:, 0] + series[:, 1] for series in (q, v, a))
            swing = np.exp(1j * turn) * (1j * second - rate**2)
            rod_acceleration, slider = -self.crank * geometry.speed**2 * arm + self.rod_centre * swing, 2
        else:
            turn, rate, second = q[:, 1], v[:, 1], a[:, 1]
            swing = np.exp(1j * turn) * (1j * second - rate**2)
            rod_acceleration, slider = a[:, 0] + (self.rod_centre - self.rod) * swing, 0
        forces, on_crank = np.zeros((2, times.size), complex), np.zeros(times.size)  # on the rod's ends
        for sample, time in enumerate(times):
            _move_pins(geometry, time, q[sample], v[sample], self.pins)
            for place, contact in enumerate(self.contacts):
                if contact.stiffness > 0.0:
                    fx, fy, moment, _ = _contact_force(
                        contact, time, self.pins[place], memory[sample, place], FRICTION_SPEED
                    )
                    forces[place, sample] = -(fx + 1j * fy)
                    on_crank[sample] += moment if place == 0 else 0.0
        rod_mass, crank_mass = self.content["rod"]["mass"], self.content["crank"]["mass"]
        for place, contact in enumerate(self.contacts):
            if contact.stiffness == 0.0:  # what an ideal pin has to bear
                forces[place] = rod_mass * (rod_acceleration + weight) - forces[1 - place]
        friction = self.effects.get("crank_coulomb_friction", {}).get("torque_N_m", 0.0)
        friction += self.effects.get("crank_viscous_friction", {}).get("damping_N_m_s", 0.0) * geometry.speed
        torque = self.crank * (np.conj(arm) * forces[0]).imag - on_crank + friction
        torque += crank_mass * self.gravity * self.crank_centre * arm.real
        frame = crank_mass * (self.crank_centre * geometry.speed**2 * arm - weight) - forces[0]
        return {
            "crank_angle": angle - 2 * math.pi * self.run.settling,
            "slider_position": q[:, slider],
            "slider_velocity": v[:, slider],
            "slider_acceleration": a[:, slider],
            "rod_angle": turn,
            "rod_angular_velocity": rate,
            "rod_acceleration_x": rod_acceleration.real,
            "rod_acceleration_y": rod_acceleration.imag,
            "crank_torque": torque,
            "guide_force": forces[1].imag + self.slider_mass * self.gravity,
            "frame_force_x": frame.real,
            "frame_force_y": frame.imag,
        }
