"""Motions of the joints over the settled revolution, and the error of the transmission angle that follows from them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from jointgap.design_networks.design_space import Design, DesignSpace
from jointgap.dynamics.kinematics import transmission_angle
from jointgap.dynamics.parallel import Outcome, Run, simulate_runs
from jointgap.lengths.objective import measure

_SIGN = {"crank_pivot": 1.0, "crank_pin": 1.0, "piston_pin": -1.0}
"""Of each joint's y in what the clearances add to the height of the rod (`jointgap.mechanism.clearance_lift`)."""


@dataclass(frozen=True)
class SettledMotion:
    """The settled revolution of the designs of a space, at some crank angles."""

    space: DesignSpace
    points: int  # Crank angles, evenly apart

    @property
    def crank_angle(self) -> np.ndarray:
        """Of the points, shape (points,) [rad]."""
        first = self.space.base.simulate.start_angle + (self.space.settled_revolution - 1) * 2.0 * np.pi
        return first + np.arange(self.points) * (2.0 * np.pi / self.points)

    def simulated(self, designs: Iterable[Design], workers: int | None = None) -> Iterator[np.ndarray | None]:
        """Clearance vectors of each design, (points, joints, 2) [m]; None where the simulation fails."""
        start = self.space.base.simulate.start_angle
        samples = self.crank_angle if self.space.settled_revolution == 1 else np.append(start, self.crank_angle)
        runs = (Run(each.mechanism, each.simulate, crank_angle=samples) for each in designs)
        for outcome in simulate_runs(runs, workers):
            yield None if outcome.error is not None else self._vectors(outcome)

    def _vectors(self, outcome: Outcome) -> np.ndarray:
        states, others = (each[-self.points :] for each in (outcome.result.states, outcome.result.auxiliary_states))
        of_joint = {"crank_pin": states[:, 0:2], "piston_pin": states[:, 2:4], "crank_pivot": others[:, 0:2]}
        return np.stack([of_joint[joint] for joint in self.space.joints], axis=1)

    def lift(self, vectors: np.ndarray) -> np.ndarray:
        """What the clearances add to the height of the rod, (..., points) [m], of vectors (..., points, joints, 2)."""
        return vectors[..., 1] @ np.array([_SIGN[joint] for joint in self.space.joints])

    def angle(self, design: Design, lengths: np.ndarray, lift: np.ndarray) -> np.ndarray:
        """Transmission angle, equation (10), (m, points) [rad]."""
        crank, rod = lengths[:, 0, None], lengths[:, 1, None]
        return transmission_angle(crank, rod, self.crank_angle, lift, design.mechanism.slider.offset)

    def error(self, design: Design, lengths: np.ndarray, lift: np.ndarray) -> np.ndarray:
        """RMS error of the transmission angle, equation (12), (m,) [rad]: the angle that was designed, which is that
        of the original lengths without clearance, less that of the motion. Parameters as of `angle`.
        """
        designed = self.angle(design, np.array([self.space.original]), np.zeros(self.points))
        return measure(designed - self.angle(design, lengths, lift)).rms
