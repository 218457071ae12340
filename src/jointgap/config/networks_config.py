"""Networks of many designs: what they know, and how they are trained."""

from typing import Any

from pydantic import Field, field_validator

from jointgap.config.sweep_config import Distribution, with_distribution
from jointgap.counts import Seed, count
from jointgap.section import Section

DesignsOfNetworks = count(20_000, "all of them are held in memory, and a step of the training uses all", least=16)
HeldOutDesigns = count(20_000, "each is simulated", least=8)
TrainingSteps = count(1_000_000, "each uses all designs: some hundredths of a second")
NeuronsOfLayer = count(1000, "each step of the training multiplies matrices of this size")


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
