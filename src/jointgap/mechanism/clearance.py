"""The clearance vectors of the loose joints: what the contact simulation delivers and the networks learn."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.joints import JOINT_NUMBERS
from jointgap.mechanism.motion import Motion, rotating_vector

Fit = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""A learned output: crank angles (n,) [rad] to its values (n,) in SI and their derivative by the crank angle (n,)."""


_NOTHING = Motion.of(0.0)


@dataclass(frozen=True)
class ClearanceMotion:
    """The virtual links of the loose joints; those of ideal joints have no length.

    r1 at gamma1 points from the frame's centre of the crank pivot to the crank's, r2 at gamma2 from the crank's pin
    centre A to the rod's end A', r3 at gamma3 from the slider's pin centre B to the rod's end B'.
    """

    r2: Motion = _NOTHING  # Lengths of the clearance vectors [m], shape (n,)
    gamma2: Motion = _NOTHING  # Their directions from +x [rad], shape (n,); nan where the length is zero
    r3: Motion = _NOTHING  # Lengths of the clearance vectors [m], shape (n,)
    gamma3: Motion = _NOTHING  # Their directions from +x [rad], shape (n,); nan where the length is zero
    r1: Motion = _NOTHING  # Lengths of the clearance vectors [m], shape (n,)
    gamma1: Motion = _NOTHING  # Their directions from +x [rad], shape (n,); nan where the length is zero

    @classmethod
    def from_table(cls, table: pd.DataFrame, loose: Iterable[str]) -> "ClearanceMotion":
        """Read the columns ``r2, r2_dot, r2_ddot, gamma2, ... gamma2_ddot`` and so on for the joints `loose`."""

        def motion(name: str) -> Motion:
            return Motion.of(*(table[f"{name}{suffix}"].to_numpy(dtype=float) for suffix in ("", "_dot", "_ddot")))

        numbers = [JOINT_NUMBERS[joint] for joint in loose]
        return cls(
            **{
                f"{quantity}{number}": motion(f"{quantity}{number}")
                for number in numbers
                for quantity in ("r", "gamma")
            }
        )

    def paper_form(self) -> "ClearanceMotion":
        """The motion as equations (6)-(9) take it: all lengths constant, only the directions move."""
        motions = vars(self)
        return ClearanceMotion(
            **{name: motion.standing_still() if name.startswith("r") else motion for name, motion in motions.items()}
        )

    def crank_pivot_vector(self) -> tuple[Motion, Motion]:
        """Components of the vector from the frame's centre of the crank pivot to the crank's, shape (n,) each [m]."""
        return rotating_vector(self.r1, self.gamma1)

    def crank_pin_vector(self) -> tuple[Motion, Motion]:
        """Components of A -> A', shape (n,) each [m]."""
        return rotating_vector(self.r2, self.gamma2)

    def piston_pin_vector(self) -> tuple[Motion, Motion]:
        """Components of B -> B', shape (n,) each [m]."""
        return rotating_vector(self.r3, self.gamma3)
