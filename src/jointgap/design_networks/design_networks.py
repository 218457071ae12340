"""The stage design-networks: a scenario in; a network, its errors on held-out designs and its cost out."""

import time
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.errors import InputError
from jointgap.core.progress import followed
from jointgap.design_networks.design_space import Design, DesignSpace, design_space
from jointgap.design_networks.held_out_errors import errors_of, held_out
from jointgap.design_networks.settings import SETTINGS
from jointgap.design_networks.settled_motion import SettledMotion
from jointgap.design_networks.train_network import TrainedNetwork, train

HELD_OUT = 1  # beside the seed: the stream of the held-out designs, which have nothing in common with the trained ones
_LEAST_DESIGNS = 8  # of which motions are learned at all


@dataclass(frozen=True)
class DesignNetworksResult:
    """What the stage finds."""

    space: DesignSpace
    trained: TrainedNetwork
    errors: pd.DataFrame  # Tables design_networks_errors and design_networks_costs
    costs: pd.DataFrame  # Tables design_networks_errors and design_networks_costs

    @property
    def training(self) -> pd.DataFrame:
        """Table design_networks_training."""
        losses = self.trained.losses
        every = self.trained.steps // max(1, len(losses))
        return pd.DataFrame({"step": every * np.arange(1, len(losses) + 1), "loss": losses})


def design_networks(scenario: Scenario, workers: int | None = None) -> DesignNetworksResult:
    """Simulate designs, train a network on their motions, and judge it on further designs."""
    options, space = scenario.design_networks, design_space(scenario)
    motion = SettledMotion(space, SETTINGS.points)
    drawn = list(space.drawn(options.designs, options.seed))
    begun = time.process_time()
    designs, vectors = _simulated(motion, drawn, workers)
    simulated = time.process_time()
    trained = train(motion, designs, vectors, options.hidden, options.seed, SETTINGS, options.steps)
    ended = time.process_time()
    held = held_out(motion, list(space.fresh(options.held_out, [options.seed, HELD_OUT])), workers)
    costs = pd.DataFrame(
        {
            "step": ["simulate", "train"],
            "designs": [len(drawn), len(designs)],
            "failed": [len(drawn) - len(designs), 0],
            "cpu_time": [simulated - begun, ended - simulated],
        }
    )
    return DesignNetworksResult(space, trained, errors_of(motion, trained.network, held), costs)


def _simulated(motion: SettledMotion, drawn: list[Design], workers: int | None) -> tuple[list[Design], np.ndarray]:
    """Those of the designs that can be simulated, and their motions (n, points, joints, 2) [m]."""
    found = list(followed(motion.simulated(drawn, workers), "simulated designs", len(drawn)))
    whole = [number for number, each in enumerate(found) if each is not None]
    if len(whole) < _LEAST_DESIGNS:
        raise InputError(
            f"design_networks: of {len(drawn)} designs {len(whole)} can be simulated, too few to learn from; give "
            "narrower ranges"
        )
    return [drawn[number] for number in whole], np.array([found[number] for number in whole])
