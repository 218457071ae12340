"""Forces and torques as functions of the lengths, from a grid of simulations."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import RectBivariateSpline

from jointgap.config import Mechanism, Optimise, Simulate
from jointgap.core.errors import InputError
from jointgap.lengths.objective import GOALS, Objective, evaluation_samples, joint_forces
from jointgap.lengths.region import Constraint, Region, regions
from jointgap.motion.parallel import Run, simulate_runs
from jointgap.motion.simulation import observed

GRID = 21, 41  # points of crank and rod length


@dataclass(frozen=True)
class Surface:
    """A quantity [SI] over lengths (L2, L3), shape (..., 2) [m], by a spline through a grid."""

    spline: RectBivariateSpline

    def value(self, lengths: ArrayLike) -> np.ndarray:
        """The quantity, shape (...)."""
        return self.spline.ev(*np.moveaxis(np.asarray(lengths), -1, 0))

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        """Its gradient with respect to the lengths, shape (..., 2)."""
        crank, rod = np.moveaxis(np.asarray(lengths), -1, 0)
        slopes = [self.spline.ev(crank, rod, dx=1), self.spline.ev(crank, rod, dy=1)]
        return np.stack(slopes, axis=-1)

    def limited(self, limit: float) -> Constraint:
        """The constraint that the quantity, a pin force, is at most `limit` [N]."""
        words = "largest force in a pin"
        return Constraint(
            "largest_pin_force", words, "N", -math.inf, limit, self.value, self.gradient
        )


def simulated_surface(
    mechanism: Mechanism, simulate: Simulate, options: Optimise, region: Region, name: str
) -> Surface:
    """The force or torque `name` (key of `GOALS`) over a region, one simulation per grid point."""
    settled = evaluation_samples(simulate, options, 2)["settled"]
    cranks, rods = (
        np.linspace(low, high, points)
        for low, high, points in zip(region.lower, region.upper, GRID, strict=True)
    )
    runs = (Run(mechanism.with_lengths(crank, rod), simulate) for crank in cranks for rod in rods)
    values = []
    for outcome in simulate_runs(runs):
        if outcome.error is not None:
            raise outcome.error
        columns = observed(outcome.model, outcome.result)
        quantities = joint_forces(columns, outcome.model.linkage.joints)
        quantities["crank_torque"] = columns["crank_torque"]
        at_samples = {key: quantity[settled] for key, quantity in quantities.items()}
        values.append(float(GOALS[name].load(at_samples)))
    return Surface(RectBivariateSpline(cranks, rods, np.reshape(values, GRID)))


@dataclass(frozen=True)
class SimulatedObjective(Objective):
    """A force or torque of simulations; measures and reductions remain those of the transmission
    angle."""

    name: str  # Key of `GOALS`
    surface: Surface

    def value(self, lengths: ArrayLike) -> np.ndarray:
        return self.surface.value(lengths)

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        return self.surface.gradient(lengths)


def simulated_objectives(
    mechanism: Mechanism, simulate: Simulate, options: Optimise, angle: Objective
) -> dict[str, Objective]:
    """The configured force or torque over all boxes, with ideal joints and with clearance, by
    source; `angle` is the error of the transmission angle."""
    boxes = regions(mechanism, options).values()
    lower = np.min([box.lower for box in boxes], axis=0)
    upper = np.max([box.upper for box in boxes], axis=0)
    if upper[0] + abs(mechanism.slider.offset) >= lower[1]:
        raise InputError(
            f"optimise.boxes: {options.objective} is simulated over all boxes together, where a"
            f" crank of {1e3 * upper[0]:g} mm cannot turn with a rod of {1e3 * lower[1]:g} mm;"
            " optimise in one box at a time"
        )
    ideal_joints = {
        name: mechanism.joint(name).model_copy(update={"loose": False}) for name in mechanism.loose
    }
    joints = mechanism.joints.model_copy(update=ideal_joints)
    sources = {
        "ideal_joints": mechanism.model_copy(update={"joints": joints}),
        "with_clearance": mechanism,
    }
    union, name = Region(lower, upper, 1.0), options.objective
    return {
        source: SimulatedObjective(
            **vars(angle),
            name=name,
            surface=simulated_surface(simulated, simulate, options, union, name),
        )
        for source, simulated in sources.items()
    }
