"""Modes in a user's words: flight, impact, contact.

An impact is a contact in which the penetration has one maximum at most: the journal hits and rebounds. In a longer one it
stays, swinging about its equilibrium.
"""

import numpy as np

from jointgap.dynamics.model.joint_forces import FLIGHT
from jointgap.dynamics.model.parameters import Parameters
from jointgap.dynamics.solver.contact_episodes import EVENT
from jointgap.joints import JOINTS

EVENT_NAMES = np.array(["separation", "impact"], dtype=object)

MODES = ("ideal", "flight", "impact", "contact")
"""What a sample may be in, by joint."""


def mode_numbers(p: Parameters, times: np.ndarray, modes: np.ndarray, events: np.ndarray) -> np.ndarray:
    """What each joint is in at samples, as places in `MODES`, shape (n, 3), int8.

    Parameters
    ----------
    p : Parameters
    times, modes : (n,), (n, 3) arrays
        Samples [s] and modes of a march.
    events : (m, 9) array
        Its events. A contact that lasts to the end of the march counts as contact.
    """
    found = np.zeros((times.size, 3), np.int8)
    column = {name: i for i, name in enumerate(EVENT)}
    for number, joint in enumerate(JOINTS):
        if not getattr(p, joint).loose:
            continue
        ends = events[(events[:, column["joint"]] == number) & (events[:, column["begins"]] == 0)]
        following = np.searchsorted(ends[:, column["time"]], times)  # the next separation; none: the contact goes on
        maxima = np.append(ends[:, column["maxima"]], np.inf)[following]
        found[:, number] = np.where(modes[:, number] != FLIGHT, np.where(maxima <= 1, 2, 3), 1)
    return found


def sample_modes(p: Parameters, times: np.ndarray, modes: np.ndarray, events: np.ndarray) -> dict[str, np.ndarray]:
    """Columns ``crank_pin_mode``, ... of the table ``trajectory``; parameters as `mode_numbers`."""
    numbers = mode_numbers(p, times, modes, events)
    return {f"{joint}_mode": np.array(MODES, dtype=object)[numbers[:, i]] for i, joint in enumerate(JOINTS)}
