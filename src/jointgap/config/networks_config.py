"""Networks of many designs, and how ways to the best lengths are compared: what they know, and what they may cost."""

import math
from typing import Annotated, Any

from pydantic import AfterValidator, Field, field_validator

from jointgap.config.sweep_config import Distribution, with_distribution
from jointgap.counts import Seed, count
from jointgap.quantities import PositiveTime
from jointgap.section import Section

DesignsOfNetworks = count(20_000, "all of them are held in memory, and a step of the training uses all", least=16)
HeldOutDesigns = count(20_000, "each is simulated", least=8)
TrainingSteps = count(1_000_000, "each uses all designs: some hundredths of a second")
NeuronsOfLayer = count(1000, "each step of the training multiplies matrices of this size")
Optima = count(1000, "each is searched for in each of the four ways")
Repetitions = count(100, "each takes the whole budget of all ways", least=2)

MOST_BUDGETS = 8
"""Budgets: each trains networks and surrogates anew."""


class DesignNetworks(Section):
    """Networks that know the design: from crank angle and design to the motion in the joints."""

    parameters: dict[str, Distribution] = Field(
        {},
        description="what a design varies besides the lengths, as in sweep.parameters: numbers such as clearance, "
        "friction, speed; lengths lie in the first of optimise.boxes",
    )
    designs: DesignsOfNetworks = Field(768, description="designs that are simulated and trained on")
    held_out: HeldOutDesigns = Field(256, description="further designs, on which the networks are judged")
    steps: TrainingSteps = Field(2000, description="steps of the training")
    hidden: tuple[NeuronsOfLayer, ...] = Field(
        (48, 48), min_length=1, max_length=4, description="neurons of each hidden layer"
    )
    seed: Seed = Field(0, description="seed of the designs and of the training")

    @field_validator("parameters", mode="before")
    @classmethod
    def _distributions_are_named(cls, parameters: Any) -> Any:
        if isinstance(parameters, dict):
            return {key: with_distribution(spec) for key, spec in parameters.items()}
        return parameters


def _rising(budgets: tuple[float, ...]) -> tuple[float, ...]:
    if list(budgets) != sorted(set(budgets)):
        raise ValueError(f"{[f'{budget:g} s' for budget in budgets]} do not rise; write the smallest first, each once")
    if not all(math.isfinite(budget) and budget <= _LONGEST for budget in budgets):
        raise ValueError(f"a budget is a time of {_LONGEST:g} s at most")
    return budgets


_LONGEST = 86_400.0


class CompareSearches(Section):
    """Four ways to the best lengths at equal CPU time: frozen motion, networks, surrogate of the error, simulation."""

    optima: Optima = Field(
        8, description="designs, drawn from design_networks.parameters, for each of which the best lengths are wanted"
    )
    budgets: Annotated[tuple[PositiveTime, ...], AfterValidator(_rising)] = Field(
        (0.2, 0.8, 3.2),
        min_length=1,
        max_length=MOST_BUDGETS,
        description="CPU time that a way may take for each optimum, its simulations and training included",
    )
    repetitions: Repetitions = Field(
        3, description="how often all is done anew, with other training designs and other random numbers"
    )
    held_out: HeldOutDesigns = Field(
        256, description="designs, the same for all ways, on which predicted errors are held against simulated ones"
    )
    seed: Seed = Field(0, description="seed of the designs wanted, of the training and of the searches")
