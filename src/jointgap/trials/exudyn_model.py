"""The slider-crank with ideal joints and effects in Exudyn (https://exudyn.readthedocs.io).

Bodies, constraints, loads and springs are Exudyn's own: three rigid bodies in the plane, in steps of equal length by
its implicit integrator (generalised alpha). The crank's angle is a constraint at velocity level, whose multiplier is
the drive's torque; the slider's guide is a constraint too.
"""

import math
from collections.abc import Callable, Mapping

import numpy as np

from jointgap.core.errors import SimulationError, needs
from jointgap.core.joints import FROM_FRAME, JOINT

STEPS = 1500
"""Steps per revolution at least: with these, readings agree with the package's to 1e-5 of their standard deviation."""

FRICTION_ZONE = 1e-3
"""Speed up to which friction rises along a straight line: of the slider [m/s], of the crank [rad/s]."""

_DAMPING = 0.8  # spectral radius of the integrator: multipliers would ring without
_BODIES = {name: (JOINT[name].partner, JOINT[name].body) for name in FROM_FRAME}


def simulate(content: Mapping, speed: float, phase: float, times: np.ndarray, settling: int) -> dict[str, np.ndarray]:
    """Readings of all channels at `times`, by the names of measured channels."""
    spacing = float(times[1] - times[0])
    lead = math.ceil(2 * math.pi * settling / speed / spacing)
    return _IdealModel(content, speed, phase - speed * lead * spacing).run(times, lead)


class ExudynSystem:
    """An empty system of Exudyn, the bodies' numbers with the effects that are nothing but data, and the start."""

    def __init__(self, content: Mapping, speed: float, phase: float):
        with needs("a trial of Exudyn", "peers"):
            import exudyn
            import exudyn.utilities

        self.exudyn, self.items = exudyn, exudyn.utilities
        self.container = exudyn.SystemContainer()
        self.system = self.container.AddSystem()
        self.content, self.speed, self.phase = content, speed, phase
        self.effects = {effect["name"]: effect["parameters"] for effect in content["effects"]}
        length_errors = self.effects.get("link_length_error", {})
        crank, rod = content["crank"], content["rod"]
        self.crank, self.rod = (
            link["length"] + length_errors.get(key, 0.0) for link, key in ((crank, "crank_m"), (rod, "rod_m"))
        )
        self.crank_centre = crank["mass_centre"] * self.crank / crank["length"]
        self.rod_centre = rod["mass_centre"] * self.rod / rod["length"]
        self.slider_mass = content["slider"]["mass"] + self.effects.get("added_slider_mass", {}).get("mass_kg", 0.0)
        along, across = directions(phase)
        self.end, self.end_velocity = self.crank * along, self.crank * speed * across
        self.rod_angle = math.asin((content["slider"]["offset"] - self.end[1]) / self.rod)
        self.rod_rate = -self.end_velocity[1] / (self.rod * math.cos(self.rod_angle))
        rod_along, rod_across = directions(self.rod_angle)
        self.start = float((self.end + self.rod * rod_along)[0])
        self.start_velocity = float((self.end_velocity + self.rod * self.rod_rate * rod_across)[0])
        self.fixed = self.system.AddMarker(
            self.items.MarkerNodeCoordinate(nodeNumber=self.system.AddNode(self.items.NodePointGround()), coordinate=0)
        )

    def coordinate(self, node: int, number: int) -> int:
        """Marker of the coordinate `number` of a `node`."""
        return self.system.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=node, coordinate=number))

    def add_slider_effects(self, marker: int, origin: float) -> None:
        """Loads, springs and dampers on the slider."""
        add, items, slider = self.system, self.items, [self.fixed, marker]
        for name, values in self.effects.items():
            if name == "slider_constant_force":
                add.AddLoad(items.LoadCoordinate(markerNumber=marker, load=values["force_N"]))
            elif name == "slider_spring":
                rest = values["rest_position_m"] - origin
                stiffness = values["stiffness_N_m"]
                add.AddObject(items.CoordinateSpringDamper(markerNumbers=slider, stiffness=stiffness, offset=rest))
            elif name == "slider_viscous_friction":
                damping = values["damping_N_s_m"]
                add.AddObject(items.CoordinateSpringDamper(markerNumbers=slider, damping=damping))
            elif name == "slider_coulomb_friction":
                self.add_friction(slider, values["force_N"])
            elif name == "slider_quadratic_drag":
                law = _drag(values["drag_N_s2_m2"])
                add.AddObject(items.CoordinateSpringDamper(markerNumbers=slider, springForceUserFunction=law))

    def add_friction(self, markers: list[int], size: float) -> None:
        """Dry friction of a `size` [N or N m] between two coordinates, given by their `markers`."""
        self.system.AddObject(
            self.items.CoordinateSpringDamperExt(
                markerNumbers=markers, dynamicFrictionForce=size, frictionProportionalZone=FRICTION_ZONE
            )
        )


class _IdealModel(ExudynSystem):
    def __init__(self, content: Mapping, speed: float, phase: float):
        super().__init__(content, speed, phase)
        add = self.system
        crank, rod = (content[name] for name in ("crank", "rod"))
        along, across = directions(phase)
        rod_along, rod_across = directions(self.rod_angle)
        self.nodes, self.bodies = {}, {"frame": add.AddObject(self.items.ObjectGround())}
        for name, mass, inertia, centre, angle, velocity, rate in (
            ("crank", crank["mass"], crank["inertia"], self.crank_centre * along, phase,
             self.crank_centre * speed * across, speed),
            ("rod", rod["mass"], rod["inertia"], self.end + self.rod_centre * rod_along, self.rod_angle,
             self.end_velocity + self.rod_centre * self.rod_rate * rod_across, self.rod_rate),
            ("slider", self.slider_mass, 1e-3, (self.start, content["slider"]["offset"]), 0.0,
             (self.start_velocity, 0.0), 0.0),
        ):  # fmt: skip
            self.nodes[name] = add.AddNode(
                self.items.NodeRigidBody2D(referenceCoordinates=[*centre, angle], initialVelocities=[*velocity, rate])
            )
            self.bodies[name] = add.AddObject(
                self.items.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=self.nodes[name])
            )
        places = {
            "crank_pivot": {"frame": 0.0, "crank": -self.crank_centre},
            "crank_pin": {"crank": self.crank - self.crank_centre, "rod": -self.rod_centre},
            "piston_pin": {"slider": 0.0, "rod": self.rod - self.rod_centre},
        }
        joints = {name: self._joint(name, places[name]) for name in _BODIES}
        constraint = self.items.CoordinateConstraint
        guide = add.AddObject(constraint(markerNumbers=[self.fixed, self.coordinate(self.nodes["slider"], 1)]))
        add.AddObject(constraint(markerNumbers=[self.fixed, self.coordinate(self.nodes["slider"], 2)]))
        turning = [self.fixed, self.coordinate(self.nodes["crank"], 2)]
        drive = add.AddObject(constraint(markerNumbers=turning, velocityLevel=True, offset=speed))
        self._add_effects()
        kinds = self.exudyn.OutputVariableType
        self.sensors = {
            (name, kind): add.AddSensor(
                self.items.SensorNode(
                    nodeNumber=node, storeInternal=True, writeToFile=False, outputVariableType=getattr(kinds, kind)
                )
            )
            for name, node in self.nodes.items()
            for kind in ("Coordinates", "Coordinates_t", "Coordinates_tt")
        } | {
            (name, "Force"): add.AddSensor(
                self.items.SensorObject(
                    objectNumber=item, storeInternal=True, writeToFile=False, outputVariableType=kinds.Force
                )
            )
            for name, item in (("guide", guide), ("drive", drive), ("pivot", joints["crank_pivot"]))
        }
        add.Assemble()

    def _joint(self, name: str, places: Mapping[str, float]) -> int:
        markers = {
            body: self.system.AddMarker(
                self.items.MarkerBodyRigid(bodyNumber=self.bodies[body], localPosition=[along, 0.0, 0.0])
            )
            for body, along in places.items()
        }
        return self.system.AddObject(self.items.RevoluteJoint2D(markerNumbers=list(markers.values())))

    def _add_effects(self) -> None:
        """Loads, springs and dampers for the effects."""
        add, items = self.system, self.items
        self.add_slider_effects(self.coordinate(self.nodes["slider"], 0), self.start)
        crank = [self.fixed, self.coordinate(self.nodes["crank"], 2)]
        for name, values in self.effects.items():
            if name == "gravity":
                for body in ("crank", "rod", "slider"):
                    marker = add.AddMarker(items.MarkerBodyMass(bodyNumber=self.bodies[body]))
                    load = [0.0, -values["acceleration_m_s2"], 0.0]
                    add.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=load))
            elif name == "crank_viscous_friction":
                add.AddObject(items.CoordinateSpringDamper(markerNumbers=crank, damping=values["damping_N_m_s"]))
            elif name == "crank_coulomb_friction":
                self.add_friction(crank, values["torque_N_m"])

    def run(self, times: np.ndarray, lead: int) -> dict[str, np.ndarray]:
        """Readings at `times`, of which the first comes `lead` samples after the start."""
        spacing = float(times[1] - times[0])
        steps = math.ceil(spacing * self.speed * STEPS / (2 * math.pi))
        settings = self.exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = spacing
        time = settings.timeIntegration
        time.endTime = spacing * (lead + times.size - 1)
        time.numberOfSteps = steps * (lead + times.size - 1)
        time.generalizedAlpha.spectralRadius = _DAMPING
        time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-10, 1e-12
        time.verboseMode = 0
        kind = self.exudyn.DynamicSolverType.GeneralizedAlpha
        if self.system.SolveDynamic(settings, solverType=kind) is False:
            raise SimulationError("Exudyn's implicit integrator stopped")
        series = {key: self.system.GetSensorStoredData(sensor)[lead:, 1:] for key, sensor in self.sensors.items()}
        rod_turn, travel = series["rod", "Coordinates"][:, 2], series["slider", "Coordinates"][:, 0]
        return {
            "crank_angle": self.phase + series["crank", "Coordinates"][:, 2],
            "slider_position": self.start + travel,
            "slider_velocity": series["slider", "Coordinates_t"][:, 0],
            "slider_acceleration": series["slider", "Coordinates_tt"][:, 0],
            "rod_angle": self.rod_angle + rod_turn,
            "rod_angular_velocity": series["rod", "Coordinates_t"][:, 2],
            "rod_acceleration_x": series["rod", "Coordinates_tt"][:, 0],
            "rod_acceleration_y": series["rod", "Coordinates_tt"][:, 1],
            "crank_torque": -series["drive", "Force"][:, 0],
            "guide_force": -series["guide", "Force"][:, 0],
            "frame_force_x": series["pivot", "Force"][:, 0],
            "frame_force_y": series["pivot", "Force"][:, 1],
        }


def _drag(factor: float) -> Callable[..., float]:
    """Exudyn's user function of time, item, displacement, velocity and more for a force against the motion."""
    return lambda mbs, time, item, displacement, velocity, *_: factor * velocity * abs(velocity)


def directions(angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors along a link at `angle`, and across it."""
    return np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
