"""The slider-crank with loose joints in Exudyn (https://exudyn.readthedocs.io), written apart from the package.

Exudyn's explicit integrators take no constraints. So bodies move freely in the plane, or hang together in open chains of
relative coordinates where a pin is ideal; and what moves as prescribed is so heavy that nothing disturbs it. A loose
joint is a sphere inside a hollow sphere. Exudyn's Hunt-Crossley law with the restitution (1 + e^2) / 2 is the law of
Lankarani and Nikravesh with the restitution e. Its friction rises along a straight line up to `friction_speed`: the law
"ambrosio" without a dead band.

Exudyn finds where contact begins by repeating a step until it ends there. How close to it (`iterationTolerance`, a force
[N]) limits its accuracy as much as the tolerance of the steps does: with the default of 1 N the motion agrees with other
code to 1e-10 m at best, with 1e-3 N to 1e-12 m at no cost. A body that slides on a line (Mass1D) takes two thirds of the
time of the alternatives (a link of a chain, a body in the plane with constraints eliminated).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jointgap.config import Mechanism

IMMOVABLE = 1e30
"""Mass [kg] or moment of inertia [kg m^2] of what moves as prescribed: no force here changes a digit of its speed."""

BODIES = {"crank_pivot": ("frame", "crank"), "crank_pin": ("crank", "rod"), "piston_pin": ("slider", "rod")}
"""The two bodies of each joint."""

SOLVERS = ("DOPRI5", "ODE23")
"""Exudyn's explicit integrators with control of the step size."""

EVENT_TOLERANCE = 1e-3
"""Contact force [N] that a step may end with past the beginning or end of contact."""


class Link(NamedTuple):
    """Link of an open chain: how it moves on the one before, where its joint is there [m], mass, its centre, inertia."""

    joint: str
    distance: float
    mass: float
    centre: float
    inertia: float


@dataclass(frozen=True)
class Record:
    """What was seen after every step.

    Attributes
    ----------
    time : (n,) array
        [s].
    penetration, force : dict of (n,) arrays
        By joint [m, N]; the force is the size of normal and friction force together.
    """

    time: np.ndarray
    penetration: dict[str, np.ndarray]
    force: dict[str, np.ndarray]


def hertz_stiffness(journal_radius: float, bearing_radius: float, youngs_modulus: float, poisson_ratio: float) -> float:
    """K [N/m^1.5] of a journal in a bearing of the same material."""
    compliance = (1 - poisson_ratio**2) / youngs_modulus
    return 4 / (6 * compliance) * math.sqrt(bearing_radius * journal_radius / (bearing_radius - journal_radius))


def unit(angle: float) -> np.ndarray:
    return np.array([math.cos(angle), math.sin(angle)])


def across(angle: float) -> np.ndarray:
    return np.array([-math.sin(angle), math.cos(angle)])


class SliderCrank:
    """A slider-crank with its crank at constant speed, from its start on.

    Parameters
    ----------
    mechanism : Mechanism
        Loose joints have the law lankarani_nikravesh and no friction or ambrosio's without dead band; no effects.
    speed, start_angle : float
        Of the crank [rad/s, rad].
    perturbation : dict of str to (x, y)
        Clearance vectors at the start [m] by joint; zero where absent.
    recorded : bool
        Whether to keep what is seen after every step, for `record`.

    Raises
    ------
    ValueError
        Neither pin is loose, so that a loop would have to be closed.
    """

    def __init__(self, mechanism: Mechanism, speed: float, start_angle=0.0, perturbation=None, recorded=False):
        import exudyn
        import exudyn.utilities

        self.exudyn, self.parts, self.mechanism = exudyn, exudyn.utilities, mechanism
        self.speed, self.start_angle, self.time = speed, start_angle, 0.0
        self.loose = mechanism.loose
        if set(self.loose) <= {"crank_pivot"}:
            raise ValueError("neither pin is loose, and this model closes no loop; loosen one of them")
        self.container = exudyn.SystemContainer()
        self.system = self.container.AddSystem()
        self.place = self._start({name: np.asarray(vector, float) for name, vector in (perturbation or {}).items()})
        self.sensors = {}
        self._build(recorded)
        self.system.Assemble()

    def advance(self, end: float, tolerance: float, solver: str = "DOPRI5", longest: float = 1e-4) -> np.ndarray:
        """Go on to time `end` [s].

        Parameters
        ----------
        end, tolerance : float
            Time [s], and the absolute tolerance of all coordinates and velocities.
        solver : str
            One of `SOLVERS`.
        longest : float
            Longest step [s].

        Returns
        -------
        (4,) array
            Rod's mass centre x, y [m], rod angle [rad], slider position [m].
        """
        settings = self.exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = 1e-12 if self.sensors else end  # the former: after every step
        integration = settings.timeIntegration
        integration.startTime, integration.endTime = self.time, end
        integration.numberOfSteps = max(1, math.ceil((end - self.time) / longest))
        integration.initialStepSize = min(1e-7, end - self.time)
        integration.minimumStepSize = 1e-16
        integration.absoluteTolerance, integration.relativeTolerance = tolerance, 0.0
        integration.discontinuous.iterationTolerance = EVENT_TOLERANCE
        integration.explicit.computeEndOfStepAccelerations = False
        integration.verboseMode = 0
        done = self.system.SolveDynamic(
            settings, solverType=getattr(self.exudyn.DynamicSolverType, solver), updateInitialValues=True
        )
        if done is False:
            raise RuntimeError(f"Exudyn's {solver} stopped between {self.time:g} s and {end:g} s")
        self.time = end
        return self.positions()

    def positions(self) -> np.ndarray:
        """Rod's mass centre x, y [m], rod angle [rad], slider position [m]."""
        read, mechanism = self.system.GetNodeOutput, self.mechanism
        rod, slider = (
            np.atleast_1d(read(node, self.exudyn.OutputVariableType.Coordinates))
            for node in (self.rod_node, self.slider_node)
        )
        if "crank_pin" not in self.loose:
            pivot = rod[:-2] if "crank_pivot" in self.loose else np.zeros(2)
            angle = rod[-2] + rod[-1]
            centre = pivot + mechanism.crank.length * unit(rod[-2]) + mechanism.rod.mass_centre * unit(angle)
        elif "piston_pin" not in self.loose:
            angle = rod[1]
            end = np.array([rod[0], mechanism.slider.offset])
            centre = end - (mechanism.rod.length - mechanism.rod.mass_centre) * unit(angle)
        else:
            centre, angle = rod[:2], rod[2]
        return np.array([*centre, angle, slider[0]])

    def record(self) -> Record:
        """What was seen after every step so far."""
        stored = {key: self.system.GetSensorStoredData(sensor) for key, sensor in self.sensors.items()}
        time = next(iter(stored.values()))[:, 0]
        return Record(
            time=time,
            penetration={name: -stored[name, "gap"][:, 1] for name in self.loose},
            force={name: np.linalg.norm(stored[name, "force"][:, 1:], axis=1) for name in self.loose},
        )

    def _start(self, perturbation: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Positions and velocities at the start, where the clearance vectors do not change."""
        mechanism, nothing = self.mechanism, np.zeros(2)
        crank, rod = mechanism.crank, mechanism.rod
        pivot, at_pin, at_piston = (perturbation.get(name, nothing) for name in BODIES)
        rod_end = pivot + crank.length * unit(self.start_angle) + at_pin
        velocity = crank.length * self.speed * across(self.start_angle)
        angle = math.asin((mechanism.slider.offset + at_piston[1] - rod_end[1]) / rod.length)
        rate = -velocity[1] / (rod.length * math.cos(angle))
        return {
            "pivot": pivot,
            "rod": rod_end + rod.mass_centre * unit(angle),
            "rod_velocity": velocity + rod.mass_centre * rate * across(angle),
            "rod_angle": angle,
            "rod_rate": rate,
            "slider": (rod_end + rod.length * unit(angle) - at_piston)[0],
            "slider_velocity": (velocity + rod.length * rate * across(angle))[0],
        }

    def _build(self, recorded: bool):
        if "crank_pin" not in self.loose:
            crank, rod = self._crank_with_rod()
            slider = self._slider()
        elif "piston_pin" not in self.loose:
            crank = self._crank()
            slider, rod = self._slider_with_rod()
        else:
            crank, rod, slider = self._crank(), self._rod(), self._slider()
        mechanism = self.mechanism
        frame = self.system.AddObject(self.parts.ObjectGround())
        places = {
            "crank_pivot": {"frame": lambda: self._body_marker(frame, 0.0), "crank": lambda: crank(0.0)},
            "crank_pin": {"crank": lambda: crank(mechanism.crank.length), "rod": lambda: rod(0.0)},
            "piston_pin": {"slider": slider, "rod": lambda: rod(mechanism.rod.length)},
        }
        for name in self.loose:
            self._contact(name, {body: marker() for body, marker in places[name].items()}, recorded)

    def _contact(self, name: str, markers: dict[str, int], recorded: bool):
        joint = self.mechanism.joint(name)
        contact = joint.contact
        bearing = next(body for body in BODIES[name] if body != joint.journal)
        stiffness = contact.stiffness or hertz_stiffness(
            joint.journal_radius, joint.bearing_radius, contact.youngs_modulus, contact.poisson_ratio
        )
        node = self.system.AddNode(
            self.parts.NodeGenericData(initialCoordinates=[1.0, 0.0, 0.0, 0.0], numberOfDataCoordinates=4)
        )
        connector = self.system.AddObject(
            self.parts.ObjectContactSphereSphere(
                markerNumbers=[markers[joint.journal], markers[bearing]],
                nodeNumber=node,
                spheresRadii=[joint.journal_radius, joint.bearing_radius],
                isHollowSphere1=True,
                contactStiffness=stiffness,
                contactStiffnessExponent=contact.exponent,
                impactModel=1,
                restitutionCoefficient=(1 + contact.restitution**2) / 2,
                dynamicFriction=contact.friction,
                frictionProportionalZone=contact.friction_speed,
            )
        )
        if recorded:
            kinds = {"gap": "DisplacementLocal", "force": "Force"}
            for kind, variable in kinds.items():
                self.sensors[name, kind] = self.system.AddSensor(
                    self.parts.SensorObject(
                        objectNumber=connector,
                        outputVariableType=getattr(self.exudyn.OutputVariableType, variable),
                        storeInternal=True,
                        writeToFile=False,
                    )
                )

    def _crank(self):
        """The crank as a body; returns a function from the distance to its pivot [m] to a marker, as do those below."""
        crank, loose = self.mechanism.crank, "crank_pivot" in self.loose
        centre = crank.mass_centre if loose else 0.0
        body, _ = self._body(
            crank.mass if loose else IMMOVABLE,
            IMMOVABLE,
            [*(self.place["pivot"] + centre * unit(self.start_angle)), self.start_angle],
            [*(centre * self.speed * across(self.start_angle)), self.speed],
        )
        return lambda distance: self._body_marker(body, distance - centre)

    def _rod(self):
        rod, place = self.mechanism.rod, self.place
        body, self.rod_node = self._body(
            rod.mass,
            rod.inertia,
            [*place["rod"], place["rod_angle"]],
            [*place["rod_velocity"], place["rod_rate"]],
        )
        return lambda distance: self._body_marker(body, distance - rod.mass_centre)

    def _slider(self):
        slider, place = self.mechanism.slider, self.place
        self.slider_node = self.system.AddNode(
            self.parts.Node1D(
                referenceCoordinates=[0.0],
                initialCoordinates=[place["slider"]],
                initialVelocities=[place["slider_velocity"]],
            )
        )
        body = self.system.AddObject(
            self.parts.ObjectMass1D(
                physicsMass=slider.mass, nodeNumber=self.slider_node, referencePosition=[0.0, slider.offset, 0.0]
            )
        )
        return lambda: self._body_marker(body, 0.0)

    def _slider_with_rod(self):
        rod, place = self.mechanism.rod, self.place
        centre = rod.mass_centre - rod.length  # the rod's joint is its piston end
        chain, node = self._chain(
            [
                Link("PrismaticX", 0.0, self.mechanism.slider.mass, 0.0, 0.0),
                Link("RevoluteZ", 0.0, rod.mass, centre, rod.inertia),
            ],
            [place["slider"], place["rod_angle"]],
            [place["slider_velocity"], place["rod_rate"]],
        )
        self.rod_node = self.slider_node = node
        return (
            lambda: self._chain_marker(chain, 0, 0.0),
            lambda distance: self._chain_marker(chain, 1, distance - rod.length),
        )

    def _crank_with_rod(self):
        crank, rod, place = self.mechanism.crank, self.mechanism.rod, self.place
        mass = crank.mass if "crank_pivot" in self.loose else IMMOVABLE
        links = [
            Link("RevoluteZ", 0.0, mass, crank.mass_centre if "crank_pivot" in self.loose else 0.0, IMMOVABLE),
            Link("RevoluteZ", crank.length, rod.mass, rod.mass_centre, rod.inertia),
        ]
        positions = [self.start_angle, place["rod_angle"] - self.start_angle]
        velocities = [self.speed, place["rod_rate"] - self.speed]
        if "crank_pivot" in self.loose:
            links = [Link("PrismaticX", 0.0, 0.0, 0.0, 0.0), Link("PrismaticY", 0.0, 0.0, 0.0, 0.0), *links]
            positions, velocities = [*place["pivot"], *positions], [0.0, 0.0, *velocities]
        chain, self.rod_node = self._chain(links, positions, velocities, height=0.0)
        last = len(links) - 1
        return (
            lambda distance: self._chain_marker(chain, last - 1, distance),
            lambda distance: self._chain_marker(chain, last, distance),
        )

    def _body(self, mass: float, inertia: float, position: list[float], velocity: list[float]) -> tuple[int, int]:
        """A body in the plane: object and node."""
        node = self.system.AddNode(self.parts.NodeRigidBody2D(initialCoordinates=position, initialVelocities=velocity))
        body = self.parts.ObjectRigidBody2D(physicsMass=mass, physicsInertia=inertia, nodeNumber=node)
        return self.system.AddObject(body), node

    def _chain(self, links: list[Link], positions, velocities, height: float | None = None) -> tuple[int, int]:
        """An open chain of links on the slide's line, or at `height` [m]: object and node."""
        node = self.system.AddNode(
            self.parts.NodeGenericODE2(
                referenceCoordinates=[0.0] * len(links),
                initialCoordinates=positions,
                initialCoordinates_t=velocities,
                numberOfODE2Coordinates=len(links),
            )
        )
        base = self.mechanism.slider.offset if height is None else height
        vectors, matrices = self.exudyn.Vector3DList, self.exudyn.Matrix3DList
        chain = self.parts.ObjectKinematicTree(
            nodeNumber=node,
            baseOffset=[0.0, base, 0.0],
            jointTypes=[getattr(self.exudyn.JointType, link.joint) for link in links],
            linkParents=list(range(-1, len(links) - 1)),
            jointTransformations=matrices([np.eye(3) for _ in links]),
            jointOffsets=vectors([[link.distance, 0.0, 0.0] for link in links]),
            linkInertiasCOM=matrices([link.inertia * np.eye(3) for link in links]),
            linkCOMs=vectors([[link.centre, 0.0, 0.0] for link in links]),
            linkMasses=[link.mass for link in links],
        )
        return self.system.AddObject(chain), node

    def _body_marker(self, body: int, along: float) -> int:
        return self.system.AddMarker(self.parts.MarkerBodyRigid(bodyNumber=body, localPosition=[along, 0.0, 0.0]))

    def _chain_marker(self, chain: int, link: int, along: float) -> int:
        marker = self.parts.MarkerKinematicTreeRigid(
            objectNumber=chain, linkNumber=link, localPosition=[along, 0.0, 0.0]
        )
        return self.system.AddMarker(marker)
