"""Held-out designs: what a network and the paper's frozen motion miss of the simulation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.core.errors import InputError
from jointgap.design_networks.design_network import DesignNetwork
from jointgap.design_networks.design_space import Design
from jointgap.design_networks.settled_motion import SettledMotion

ANGLE, ERROR, LIFT = "transmission angle", "RMS error", "lift"


@dataclass(frozen=True)
class HeldOut:
    """Designs that took no part in a training."""

    designs: tuple[Design, ...]
    simulated: np.ndarray  # Their motions, (designs, points, joints, 2) [m]
    frozen: np.ndarray  # Motions at the original lengths, everything else being theirs; shape as of `simulated`
    failed: int  # Further designs, one of whose simulations failed


def held_out(motion: SettledMotion, designs: Sequence[Design], workers: int | None) -> HeldOut:
    """Simulate held-out designs, at their lengths and at the original ones."""
    own = list(motion.simulated(designs, workers))
    frozen = list(motion.simulated([each.at(motion.space.original) for each in designs], workers))
    whole = [n for n, pair in enumerate(zip(own, frozen, strict=True)) if all(each is not None for each in pair)]
    if not whole:
        raise InputError("design_networks: of the held-out designs none can be simulated; give narrower ranges")
    simulated, original = (np.array([motions[n] for n in whole]) for motions in (own, frozen))
    return HeldOut(tuple(designs[n] for n in whole), simulated, original, len(designs) - len(whole))


def errors_of(motion: SettledMotion, network: DesignNetwork, held: HeldOut) -> pd.DataFrame:
    """Table design_networks_errors."""
    learned = predicted(motion, network, held.designs)
    rows = []
    for number, design in enumerate(held.designs):
        lengths = np.array([design.lengths])
        simulated, *others = (
            _outputs(motion, design, lengths, each[number]) for each in (held.simulated, learned, held.frozen)
        )
        for output, (unit, values) in simulated.items():
            missed = [_size(other[output][1] - values) for other in others]
            rows.append((number, output, unit, _size(values), *missed))
    return pd.DataFrame(rows, columns=["design", "output", "unit", "simulated", "network", "frozen"])


def predicted(motion: SettledMotion, network: DesignNetwork, designs: Sequence[Design]) -> np.ndarray:
    """Motions that a network expects of designs, (designs, points, joints, 2) [m]."""
    vectors = network.at_angles(motion.crank_angle)
    return np.concatenate([vectors(each, np.array([each.lengths])) for each in designs])


def _outputs(
    motion: SettledMotion, design: Design, lengths: np.ndarray, vectors: np.ndarray
) -> dict[str, tuple[str, np.ndarray]]:
    """Unit and values of each output."""
    lift = motion.lift(vectors)
    found = {
        f"{joint.replace('_', ' ')} {axis}": ("m", vectors[:, place, column])
        for place, joint in enumerate(motion.space.joints)
        for column, axis in enumerate("xy")
    }
    found[LIFT] = "m", lift
    found[ANGLE] = "rad", motion.angle(design, lengths, lift)[0]
    found[ERROR] = "rad", motion.error(design, lengths, lift)
    return found


def _size(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
