"""Bodies, open chains and clearance joints of a plane mechanism in Exudyn, as short as the slider-crank needs them."""

import math
from typing import NamedTuple

import numpy as np

EVENT_TOLERANCE = 1e-3
"""Contact force [N] that a step may end with past the beginning or end of contact."""


class Link(NamedTuple):
    """Link of an open chain: how it moves on the one before, where its joint is there [m], mass, its centre,
    inertia.
    """

    joint: str
    distance: float
    mass: float
    centre: float
    inertia: float


def hertz_stiffness(journal_radius: float, bearing_radius: float, youngs_modulus: float, poisson_ratio: float) -> float:
    """K [N/m^1.5] of a journal in a bearing of the same material."""
    compliance = (1 - poisson_ratio**2) / youngs_modulus
    return 4 / (6 * compliance) * math.sqrt(bearing_radius * journal_radius / (bearing_radius - journal_radius))


MEMORY = 2.5
"""Durations of the slowest elastic impact after which a contact begins to forget, and in which it does."""


def slowest_impact(stiffness: float, exponent: float, mass: float, speed: float) -> float:
    """Duration [s] of an elastic impact of `mass` [kg] at `speed` [m/s]."""
    depth = ((exponent + 1) * mass * speed**2 / (2 * stiffness)) ** (1 / (exponent + 1))
    first, half = 1 / (exponent + 1), 0.5
    beta = math.gamma(first) * math.gamma(half) / math.gamma(first + half)
    return 2 * depth / speed * beta / (exponent + 1)


class FadingDamping:
    """What a contact that lasts is damped by beyond Exudyn's own law, which keeps the approach speed: a user function.

    Parameters
    ----------
    numbers : dict
        Of Exudyn's contact, by its own names.
    duration, reference : float
        Of the slowest elastic impact [s]; approach speed as whose impact a lasting contact is damped [m/s].
    """

    def __init__(self, numbers: dict, duration: float, reference: float):
        self.numbers, self.duration, self.reference = numbers, duration, reference
        self.approach, self.begin = 0.0, math.inf

    def begin_step(self, time: float, approach: float):
        """A contact began where Exudyn's approach speed is another one than before; it ends a step there."""
        if approach != self.approach:
            self.approach, self.begin = approach, time

    def force(self, mbs, time, item, displacement, velocity, *_):
        """Exudyn's user function for the force in a spring from the journal's centre to the bearing's."""
        share = min((time - self.begin) / (MEMORY * self.duration) - 1, 1)
        distance = math.hypot(*displacement)
        radii = self.numbers["spheresRadii"]
        depth = distance - (radii[1] - radii[0])
        if share <= 0 or depth <= 0:
            return [0.0, 0.0, 0.0]
        faded = share**5 * sum(math.comb(4 + k, k) * (1 - share) ** k for k in range(5))
        normal = [component / distance for component in displacement]
        rate = sum(n * v for n, v in zip(normal, velocity, strict=True))
        elastic = self.numbers["contactStiffness"] * depth ** self.numbers["contactStiffnessExponent"]
        chi = 1.5 * (1 - self.numbers["restitutionCoefficient"])
        size = faded * (chi / self.reference - chi / self.approach) * elastic * rate
        return [size * n for n in normal]


class Parts:
    """An empty Exudyn system and what can be put into it; everything is addressed by Exudyn's numbers."""

    def __init__(self):
        import exudyn  # here, for it is an optional dependency
        import exudyn.utilities

        self.exudyn, self.items = exudyn, exudyn.utilities
        self.container = exudyn.SystemContainer()
        self.system = self.container.AddSystem()
        self.fading = []

    def body(self, mass: float, inertia: float, position, velocity) -> tuple[int, int]:
        """Body in the plane with x, y [m], angle [rad] of its mass centre and their rates: object and node."""
        node = self.system.AddNode(
            self.items.NodeRigidBody2D(initialCoordinates=list(position), initialVelocities=list(velocity))
        )
        return self.system.AddObject(self.items.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node)), node

    def sliding_mass(self, mass: float, position: float, velocity: float, height: float) -> tuple[int, int]:
        """Body that slides along x at y = `height` [m] and does not turn: object and node."""
        node = self.system.AddNode(
            self.items.Node1D(referenceCoordinates=[0.0], initialCoordinates=[position], initialVelocities=[velocity])
        )
        body = self.items.ObjectMass1D(mass=mass, nodeNumber=node, referencePosition=[0.0, height, 0.0])
        return self.system.AddObject(body), node

    def chain(self, links: list[Link], positions, velocities, height: float) -> tuple[int, int]:
        """Open chain that starts from (0, `height`), with its relative coordinates and their rates: object and node."""
        node = self.system.AddNode(
            self.items.NodeGenericODE2(
                referenceCoordinates=[0.0] * len(links),
                initialCoordinates=list(positions),
                initialCoordinates_t=list(velocities),
                numberOfODE2Coordinates=len(links),
            )
        )
        vectors, matrices = self.exudyn.Vector3DList, self.exudyn.Matrix3DList
        chain = self.items.ObjectKinematicTree(
            nodeNumber=node,
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

    def frame(self) -> int:
        """The body that stands still."""
        return self.system.AddObject(self.items.ObjectGround())

    def on_body(self, body: int, along: float = 0.0) -> int:
        """Marker at a distance [m] from the body's reference point along its own x axis."""
        return self.system.AddMarker(self.items.MarkerBodyRigid(bodyNumber=body, localPosition=[along, 0.0, 0.0]))

    def on_chain(self, chain: int, link: int, along: float = 0.0) -> int:
        """Marker at a distance [m] from the joint of a link along the link's x axis."""
        return self.system.AddMarker(
            self.items.MarkerKinematicTreeRigid(objectNumber=chain, linkNumber=link, localPosition=[along, 0.0, 0.0])
        )

    def clearance_joint(self, joint, journal: int, bearing: int, mass: float) -> int:
        """Contact of the journal with its bearing, each given by the marker at its centre; `joint` is the package's.

        `mass` [kg] is that of all that moves beyond the joint. One that forgets its impact is to have no friction.
        """
        contact = joint.contact
        node = self.system.AddNode(
            self.items.NodeGenericData(initialCoordinates=[1.0, 0.0, 0.0, 0.0], numberOfDataCoordinates=4)
        )
        stiffness = contact.stiffness or hertz_stiffness(
            joint.journal_radius, joint.bearing_radius, contact.youngs_modulus, contact.poisson_ratio
        )
        numbers = {
            "spheresRadii": [joint.journal_radius, joint.bearing_radius],
            "contactStiffness": stiffness,
            "contactStiffnessExponent": contact.exponent,
            "restitutionCoefficient": (1 + contact.restitution**2) / 2,
        }
        if contact.reference_speed is not None:
            duration = slowest_impact(stiffness, contact.exponent, mass, contact.least_approach_speed)
            self._forget(FadingDamping(numbers, duration, contact.reference_speed), node, journal, bearing)
        return self.system.AddObject(
            self.items.ObjectContactSphereSphere(
                markerNumbers=[journal, bearing],
                nodeNumber=node,
                isHollowSphere1=True,
                impactModel=1,
                dynamicFriction=contact.friction,
                frictionProportionalZone=contact.friction_speed,
                **numbers,
            )
        )

    def _forget(self, damping: FadingDamping, node: int, journal: int, bearing: int):
        """Add the forces of `damping`; the contact keeps its approach speed in the third number of its data `node`."""
        self.system.AddObject(
            self.items.ObjectConnectorCartesianSpringDamper(
                markerNumbers=[journal, bearing], springForceUserFunction=damping.force
            )
        )
        self.fading.append((damping, node))
        coordinates = self.exudyn.OutputVariableType.Coordinates

        def begin_step(mbs, time):
            for one, at in self.fading:
                one.begin_step(time, mbs.GetNodeOutput(at, coordinates)[2])
            return True

        self.system.SetPreStepUserFunction(begin_step)

    def sensor(self, item: int, variable: str) -> int:
        """Sensor that keeps `variable` of an object at every step."""
        return self.system.AddSensor(
            self.items.SensorObject(
                objectNumber=item,
                outputVariableType=getattr(self.exudyn.OutputVariableType, variable),
                storeInternal=True,
                writeToFile=False,
            )
        )

    def solve(self, start: float, end: float, tolerance: float, solver: str, longest: float, every_step: bool):
        """Integrate from time `start` to `end` [s] with steps of at most `longest` [s]; the end becomes the next
        start.
        """
        settings = self.exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = 1e-12 if every_step else end
        integration = settings.timeIntegration
        integration.startTime, integration.endTime = start, end
        integration.numberOfSteps = max(1, math.ceil((end - start) / longest))
        integration.initialStepSize = min(1e-7, end - start)
        integration.minimumStepSize = 1e-16
        integration.absoluteTolerance, integration.relativeTolerance = tolerance, 0.0
        integration.discontinuous.iterationTolerance = EVENT_TOLERANCE
        integration.explicit.computeEndOfStepAccelerations = False
        integration.verboseMode = 0
        kind = getattr(self.exudyn.DynamicSolverType, solver)
        if self.system.SolveDynamic(settings, solverType=kind, updateInitialValues=True) is False:
            raise RuntimeError(f"Exudyn's {solver} stopped between {start:g} s and {end:g} s")
