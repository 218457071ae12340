"""The slider-crank with loose joints in Exudyn (https://exudyn.readthedocs.io), written apart from the package.

Exudyn's explicit integrators take no constraints. So bodies move freely in the plane, or hang together in open chains
of relative coordinates where a pin is ideal; and what moves as prescribed is so heavy that nothing disturbs it. A loose
joint is a sphere inside a hollow sphere. Exudyn's Hunt-Crossley law with the restitution (1 + e^2) / 2 is the law of
Lankarani and Nikravesh with the restitution e. Its friction rises along a straight line up to `friction_speed`: the law
"ambrosio" without a dead band.

Exudyn finds where contact begins by repeating a step until it ends there. How close to it (`iterationTolerance`, a
force [N]) limits its accuracy as much as the tolerance of the steps does: with the default of 1 N the motion agrees
with other code to 1e-10 m at best, with 1e-3 N to 1e-12 m at no cost. A slider that is a Mass1D takes two thirds of the
time of the alternatives (a link of a chain, a body in the plane with constraints eliminated).
"""

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.exudyn_parts import Link, Parts
from jointgap.config import Mechanism
from jointgap.core.joints import FROM_FRAME, JOINT

IMMOVABLE = 1e30
"""Mass [kg] or moment of inertia [kg m^2] of what moves as prescribed: no force here changes a digit of its speed."""

BODIES = {name: (JOINT[name].partner, JOINT[name].body) for name in FROM_FRAME}
"""The two bodies of each joint."""

SOLVERS = ("DOPRI5", "ODE23")
"""Exudyn's explicit integrators with control of the step size."""


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


def unit(angle: float) -> np.ndarray:
    return np.array([math.cos(angle), math.sin(angle)])


def across(angle: float) -> np.ndarray:
    return np.array([-math.sin(angle), math.cos(angle)])


class SliderCrank:
    """A slider-crank with its crank at constant speed, from its start on.

    Parameters
    ----------
    mechanism : Mechanism
        Loose joints have the law lankarani_nikravesh and no friction or ambrosio's without dead band; no effects. What
        a contact with memory that fades is damped by beyond the published law is a user function, without friction.
    speed, start_angle : float
        Of the crank [rad/s, rad].
    perturbation : dict of str to (x, y)
        Clearance vectors at the start [m] by joint; zero where absent.
    recorded : bool
        Whether to keep what is seen after every step, for `record`.

    Raises
    ------
    ImportError
        Exudyn is not installed.
    ValueError
        Neither pin is loose, so that a loop would have to be closed.
    """

    def __init__(self, mechanism: Mechanism, speed: float, start_angle=0.0, perturbation=None, recorded=False):
        self.mechanism, self.speed, self.start_angle, self.time = mechanism, speed, start_angle, 0.0
        self.loose = mechanism.loose
        if set(self.loose) <= {"crank_pivot"}:
            raise ValueError("neither pin is loose, and this model closes no loop; loosen one of them")
        self.parts = Parts()
        self.place = self._start({name: np.asarray(vector, float) for name, vector in (perturbation or {}).items()})
        self.sensors = {}
        self._build(recorded)
        self.parts.system.Assemble()

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
        self.parts.solve(self.time, end, tolerance, solver, longest, every_step=bool(self.sensors))
        self.time = end
        return self.positions()

    def positions(self) -> np.ndarray:
        """Rod's mass centre x, y [m], rod angle [rad], slider position [m]."""
        mechanism, coordinates = self.mechanism, self.parts.exudyn.OutputVariableType.Coordinates
        rod, slider = (
            np.atleast_1d(self.parts.system.GetNodeOutput(node, coordinates))
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
        """What was seen after every step of the latest advance."""
        stored = {key: self.parts.system.GetSensorStoredData(sensor) for key, sensor in self.sensors.items()}
        return Record(
            time=next(iter(stored.values()))[:, 0],
            penetration={name: -stored[name, "DisplacementLocal"][:, 1] for name in self.loose},
            force={name: np.linalg.norm(stored[name, "Force"][:, 1:], axis=1) for name in self.loose},
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
        """Bodies or chains, each a function from a place on the body to a marker there, and joints between them."""
        if "crank_pin" not in self.loose:
            crank, rod = self._crank_with_rod()
            slider = self._slider()
        elif "piston_pin" not in self.loose:
            crank = self._crank()
            slider, rod = self._slider_with_rod()
        else:
            crank, rod, slider = self._crank(), self._rod(), self._slider()
        frame = self.parts.frame()
        centres = {
            "crank_pivot": {"frame": lambda: self.parts.on_body(frame), "crank": lambda: crank(0.0)},
            "crank_pin": {"crank": lambda: crank(self.mechanism.crank.length), "rod": lambda: rod(0.0)},
            "piston_pin": {"slider": slider, "rod": lambda: rod(self.mechanism.rod.length)},
        }
        for name in self.loose:
            joint = self.mechanism.joint(name)
            markers = {body: centres[name][body]() for body in BODIES[name]}
            journal = markers.pop(joint.journal)
            (bearing,) = markers.values()
            contact = self.parts.clearance_joint(joint, journal, bearing, self._mass_beyond(name))
            for variable in ("DisplacementLocal", "Force") if recorded else ():
                self.sensors[name, variable] = self.parts.sensor(contact, variable)

    def _mass_beyond(self, joint: str) -> float:
        """Mass [kg] of all that moves beyond a joint."""
        mass = self.mechanism.rod.mass + self.mechanism.slider.mass
        return mass + self.mechanism.crank.mass if joint == "crank_pivot" else mass

    def _crank(self):
        crank, loose = self.mechanism.crank, "crank_pivot" in self.loose
        centre = crank.mass_centre if loose else 0.0
        body, _ = self.parts.body(
            crank.mass if loose else IMMOVABLE,
            IMMOVABLE,
            [*(self.place["pivot"] + centre * unit(self.start_angle)), self.start_angle],
            [*(centre * self.speed * across(self.start_angle)), self.speed],
        )
        return lambda distance: self.parts.on_body(body, distance - centre)

    def _rod(self):
        rod, place = self.mechanism.rod, self.place
        body, self.rod_node = self.parts.body(
            rod.mass, rod.inertia, [*place["rod"], place["rod_angle"]], [*place["rod_velocity"], place["rod_rate"]]
        )
        return lambda distance: self.parts.on_body(body, distance - rod.mass_centre)

    def _slider(self):
        slider, place = self.mechanism.slider, self.place
        body, self.slider_node = self.parts.sliding_mass(
            slider.mass, place["slider"], place["slider_velocity"], slider.offset
        )
        return lambda: self.parts.on_body(body)

    def _slider_with_rod(self):
        rod, slider, place = self.mechanism.rod, self.mechanism.slider, self.place
        links = [
            Link("PrismaticX", 0.0, slider.mass, 0.0, 0.0),
            Link("RevoluteZ", 0.0, rod.mass, rod.mass_centre - rod.length, rod.inertia),  # its joint: the piston end
        ]
        chain, node = self.parts.chain(
            links,
            [place["slider"], place["rod_angle"]],
            [place["slider_velocity"], place["rod_rate"]],
            slider.offset,
        )
        self.rod_node = self.slider_node = node
        return (
            lambda: self.parts.on_chain(chain, 0),
            lambda distance: self.parts.on_chain(chain, 1, distance - rod.length),
        )

    def _crank_with_rod(self):
        crank, rod, place = self.mechanism.crank, self.mechanism.rod, self.place
        loose = "crank_pivot" in self.loose
        mass, centre = (crank.mass, crank.mass_centre) if loose else (IMMOVABLE, 0.0)
        links = [
            Link("RevoluteZ", 0.0, mass, centre, IMMOVABLE),
            Link("RevoluteZ", crank.length, rod.mass, rod.mass_centre, rod.inertia),
        ]
        positions = [self.start_angle, place["rod_angle"] - self.start_angle]
        velocities = [self.speed, place["rod_rate"] - self.speed]
        if loose:
            links = [Link("PrismaticX", 0.0, 0.0, 0.0, 0.0), Link("PrismaticY", 0.0, 0.0, 0.0, 0.0), *links]
            positions, velocities = [*place["pivot"], *positions], [0.0, 0.0, *velocities]
        chain, self.rod_node = self.parts.chain(links, positions, velocities, 0.0)
        last = len(links) - 1
        return (
            lambda distance: self.parts.on_chain(chain, last - 1, distance),
            lambda distance: self.parts.on_chain(chain, last, distance),
        )
