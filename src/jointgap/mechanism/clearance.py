"""The two clearance vectors: what the contact simulation delivers and the networks learn."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from jointgap.mechanism.motion import Motion, rotating_vector

Fit = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""A learned output: crank angles (n,) [rad] to its values (n,) in SI and their derivative by the crank angle (n,)."""


@dataclass(frozen=True)
class ClearanceMotion:
    """The virtual links of the two loose joints.

    r2 at gamma2 points from the crank's pin centre A to the rod's end A', r3 at gamma3 from the slider's pin centre B to
    the rod's end B'.

    Attributes
    ----------
    r2, r3 : Motion
        Lengths of the clearance vectors [m], shape (n,).
    gamma2, gamma3 : Motion
        Their directions from +x [rad], shape (n,); nan where the length is zero.
    """

    r2: Motion
    gamma2: Motion
    r3: Motion
    gamma3: Motion

    @classmethod
    def from_table(cls, table: pd.DataFrame) -> "ClearanceMotion":
        """Read the columns ``r2, r2_dot, r2_ddot, gamma2, ... gamma3_ddot`` of a trajectory."""

        def motion(name: str) -> Motion:
            return Motion.of(*(table[f"{name}{suffix}"].to_numpy(dtype=float) for suffix in ("", "_dot", "_ddot")))

        return cls(r2=motion("r2"), gamma2=motion("gamma2"), r3=motion("r3"), gamma3=motion("gamma3"))

    def paper_form(self) -> "ClearanceMotion":
        """The motion as equations (6)-(9) take it: both lengths constant, only the directions move."""
        return replace(self, r2=self.r2.standing_still(), r3=self.r3.standing_still())

    def crank_pin_vector(self) -> tuple[Motion, Motion]:
        """Components of A -> A', shape (n,) each [m]."""
        return rotating_vector(self.r2, self.gamma2)

    def piston_pin_vector(self) -> tuple[Motion, Motion]:
        """Components of B -> B', shape (n,) each [m]."""
        return rotating_vector(self.r3, self.gamma3)
