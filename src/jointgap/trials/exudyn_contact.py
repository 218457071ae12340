"""The slider-crank with loose pins in Exudyn (https://exudyn.readthedocs.io), by its explicit integrator.

Exudyn's implicit integrator does not get through contacts, its explicit ones take no constraints. So bodies move freely
in the plane, or hang together in open chains of relative coordinates where a pin is ideal; the crank turns as
prescribed. Bodies, chains, loads, springs and steps are Exudyn's own. The contacts are one user function of Exudyn: the
law of Lankarani and Nikravesh with a memory that fades, and friction that rises along a straight line. It is written
here from docs/simulation.md and shares nothing with the package's own.

H. M. Lankarani and P. E. Nikravesh, J. Mech. Des. 112 (1990) 369-376.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from jointgap.core.errors import SimulationError
from jointgap.core.joints import PINS, REFERENCE_APPROACH_SPEED
from jointgap.dynamics.numba_cache import compiled  # how to compile, nothing of the physics
from jointgap.trials.exudyn_model import ExudynSystem, directions
from jointgap.trials.sensor_readings import CrankRun

TOLERANCE = 1e-7
"""Local error of a step, of all coordinates and velocities [m, rad, m/s, rad/s]: a tenth of it changes readings of
settled motions by less than 3e-5 of their standard deviation."""

FRICTION_SPEED = 1e-3
"""Sliding speed [m/s] up to which friction in a loose pin rises along a straight line."""

_LEAST_APPROACH = 1e-3  # [m/s] a slower impact is damped as one at this speed
_LONGEST_STEP = 1e-4  # [s] a thousandth of a turn of the crank at 600 rpm
_MEMORY = 2.5  # durations of the slowest elastic impact after which a contact forgets, and in which it does
_EXPONENT = 1.5
_IMMOVABLE = 1e30  # mass [kg] or inertia [kg m^2] of the crank: no force here changes a digit of its speed

_FREE, _HANGS_ON_CRANK, _HANGS_ON_SLIDER = 0, 1, 2  # the rod: both pins loose, crank pin ideal, piston pin ideal


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
    if geometry.rod_hangs == _HANGS_ON_SLIDER:
        slider, slider_v, turn, rate = q[0], v[0], q[1], v[1]
    elif geometry.rod_hangs == _HANGS_ON_CRANK:
        slider, slider_v, turn, rate = q[2], v[2], q[0] + q[1], v[0] + v[1]
    else:
        slider, slider_v, turn, rate = q[3], v[3], q[2], v[2]
    cosine, sine = math.cos(turn), math.sin(turn)
    # Where one point of the rod is, and how far along the rod from there its two ends are.
    if geometry.rod_hangs == _HANGS_ON_SLIDER:
        x, y, vx, vy, near = slider, geometry.offset, slider_v, 0.0, -geometry.rod
    elif geometry.rod_hangs == _HANGS_ON_CRANK:
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
        elif geometry.rod_hangs == _HANGS_ON_CRANK:
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


def simulate(content: Mapping, run: CrankRun, tolerance: float = TOLERANCE) -> dict[str, np.ndarray]:
    """Readings of all channels at the samples of a run, by the names of measured channels."""
    return _ContactModel(content, run).readings(tolerance)


def slowest_impact(stiffness: float, mass: float) -> float:
    """Duration [s] of an elastic impact of `mass` [kg] at the slowest speed that is damped as such; stiffness
    [N/m^1.5].
    """
    energy = 0.5 * mass * _LEAST_APPROACH**2
    depth = ((_EXPONENT + 1) * energy / stiffness) ** (1 / (_EXPONENT + 1))
    first = 1 / (_EXPONENT + 1)
    beta = math.gamma(first) * math.gamma(0.5) / math.gamma(first + 0.5)
    return 2 * depth / _LEAST_APPROACH * beta * first


class _ContactModel(ExudynSystem):
    def __init__(self, content: Mapping, run: CrankRun):
        super().__init__(content, run.speed, run.start_angle)
        self.run = run
        self.lead_time = (run.phase - run.start_angle + 2 * math.pi * run.settling) / run.speed
        self.contacts = tuple(self._contact(name) for name in PINS)
        crank_pin, piston_pin = (contact.stiffness > 0.0 for contact in self.contacts)
        hangs = _FREE if crank_pin and piston_pin else _HANGS_ON_SLIDER if crank_pin else _HANGS_ON_CRANK
        offset = content["slider"]["offset"]
        self.geometry = _Geometry(
            self.crank, self.rod, self.rod_centre, run.speed, run.start_angle, float(offset), hangs
        )
        self.gravity = self.effects.get("gravity", {}).get("acceleration_m_s2", 0.0)
        nodes, slider = {_FREE: self._free, _HANGS_ON_CRANK: self._on_crank, _HANGS_ON_SLIDER: self._on_slider}[hangs]()
        self.add_slider_effects(slider, 0.0)
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
        compliance = 2 * (1 - law["poisson_ratio"] ** 2) / law["youngs_modulus"]
        stiffness = 4 / (3 * compliance) * math.sqrt(bearing * journal / (bearing - journal))
        stiffness *= law.get("stiffness_factor", 1.0)
        reference = law.get("reference_approach_speed", REFERENCE_APPROACH_SPEED)
        return _Contact(
            journal,
            bearing,
            stiffness,
            0.75 * (1 - law["restitution"] ** 2),
            float(law["friction"]),
            _MEMORY * slowest_impact(stiffness, self.content["rod"]["mass"] + self.slider_mass),
            reference / law.get("damping_factor", 1.0),
        )

    def _free(self) -> tuple[list[int], int]:
        """The rod as a body of its own; nodes, and the marker of the slider's coordinate."""
        along, across = directions(self.rod_angle)
        rod, items = self.content["rod"], self.items
        node = self.system.AddNode(
            items.NodeRigidBody2D(
                initialCoordinates=[*(self.end + self.rod_centre * along), self.rod_angle],
                initialVelocities=[*(self.end_velocity + self.rod_centre * self.rod_rate * across), self.rod_rate],
            )
        )
        self.system.AddObject(items.ObjectRigidBody2D(mass=rod["mass"], inertia=rod["inertia"], nodeNumber=node))
        self.system.AddLoad(
            items.LoadCoordinate(markerNumber=self.coordinate(node, 1), load=-self.gravity * rod["mass"])
        )
        slider = self._slider()
        return [node, slider], self.coordinate(slider, 0)

    def _slider(self) -> int:
        node = self.system.AddNode(
            self.items.Node1D(
                referenceCoordinates=[0.0],
                initialCoordinates=[self.start],
                initialVelocities=[self.start_velocity],
            )
        )
        self.system.AddObject(self.items.ObjectMass1D(mass=self.slider_mass, nodeNumber=node))
        return node

    def _on_crank(self) -> tuple[list[int], int]:
        """Crank and rod as a chain, likewise."""
        rod, phase, speed = self.content["rod"], self.geometry.phase, self.geometry.speed
        links = [
            ("RevoluteZ", 0.0, _IMMOVABLE, 0.0, _IMMOVABLE),
            ("RevoluteZ", self.crank, rod["mass"], self.rod_centre, rod["inertia"]),
        ]
        chain = self._chain(links, [phase, self.rod_angle - phase], [speed, self.rod_rate - speed], 0.0)
        slider = self._slider()
        return [chain, slider], self.coordinate(slider, 0)

    def _on_slider(self) -> tuple[list[int], int]:
        """Slider and rod as a chain, likewise."""
        rod, offset = self.content["rod"], self.geometry.offset
        links = [
            ("PrismaticX", 0.0, self.slider_mass, 0.0, 0.0),
            ("RevoluteZ", 0.0, rod["mass"], self.rod_centre - self.rod, rod["inertia"]),
        ]
        chain = self._chain(links, [self.start, self.rod_angle], [self.start_velocity, self.rod_rate], offset)
        return [chain], self.coordinate(chain, 0)

    def _chain(self, links, positions, velocities, height: float) -> int:
        """Node of an open chain from (0, `height`); of each link joint, its place on the link before, mass, centre,
        inertia.
        """
        joints, distances, masses, centres, inertias = zip(*links, strict=True)
        vectors, matrices = self.exudyn.Vector3DList, self.exudyn.Matrix3DList
        node = self.system.AddNode(
            self.items.NodeGenericODE2(
                referenceCoordinates=[0.0] * len(links),
                initialCoordinates=positions,
                initialCoordinates_t=velocities,
                numberOfODE2Coordinates=len(links),
            )
        )
        self.system.AddObject(
            self.items.ObjectKinematicTree(
                nodeNumber=node,
                gravity=[0.0, -self.gravity, 0.0],
                baseOffset=[0.0, height, 0.0],
                jointTypes=[getattr(self.exudyn.JointType, joint) for joint in joints],
                linkParents=list(range(-1, len(links) - 1)),
                jointTransformations=matrices([np.eye(3) for _ in links]),
                jointOffsets=vectors([[distance, 0.0, 0.0] for distance in distances]),
                linkInertiasCOM=matrices([inertia * np.eye(3) for inertia in inertias]),
                linkCOMs=vectors([[centre, 0.0, 0.0] for centre in centres]),
                linkMasses=list(masses),
            )
        )
        return node

    def _add_contacts(self, nodes: list[int]) -> None:
        """The contacts as forces on the coordinates of `nodes`, and what is noted at the end of every step."""
        size = {_FREE: 4, _HANGS_ON_CRANK: 3, _HANGS_ON_SLIDER: 2}[self.geometry.rod_hangs]
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
        settings = self.exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = end
        time = settings.timeIntegration
        time.endTime, time.numberOfSteps = end, math.ceil(end / _LONGEST_STEP)
        time.initialStepSize, time.minimumStepSize = 1e-7, 1e-14
        time.absoluteTolerance, time.relativeTolerance = tolerance, 0.0
        time.explicit.computeEndOfStepAccelerations = True
        time.verboseMode = 0
        self.exudyn.config.printToConsole = False  # it warns of the memory that user functions take; errors are raised
        if self.system.SolveDynamic(settings, solverType=self.exudyn.DynamicSolverType.DOPRI5) is False:
            raise SimulationError("Exudyn's explicit integrator stopped")
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
        elif geometry.rod_hangs == _HANGS_ON_CRANK:
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
