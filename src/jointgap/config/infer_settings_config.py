"""What the paper did not say: how near its printed numbers have to come, and what is trained beside them."""

from pydantic import Field

from jointgap.counts import Iterations, Seed, count
from jointgap.quantities import OpenFraction
from jointgap.section import Section


class InferSettings(Section):
    """The settings that the paper does not print, inferred from the numbers that it prints."""

    within: OpenFraction = Field(
        0.05,
        description="share of a printed number within which it comes out; of the ratio of the lengths, share of its "
        "change from the original one",
    )
    deviation: OpenFraction = Field(
        0.05,
        description="standard deviation of a printed number about what the simulation gives at the paper's settings, "
        "as such a share: for the posterior",
    )
    trained: count(1000, "the eight networks of each take ten seconds", least=0) = Field(
        8,
        description="designs at which the paper's networks are trained: so many of the nearest, and as many drawn at "
        "random; 0: none",
    )
    iterations: Iterations = Field(300, description="of each training; the paper has 20 000")
    seed: Seed = Field(0, description="seed of the random designs, of the trainings and of the intervals")
