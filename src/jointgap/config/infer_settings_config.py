"""The settings that the paper does not print: how near its printed numbers have to come."""

from typing import ClassVar

from pydantic import Field

from jointgap.core.units import OpenFraction
from jointgap.section import Section


class InferSettings(Section):
    """The settings that the paper does not print, inferred from the numbers that it prints."""

    removed: ClassVar = dict.fromkeys(
        ("deviation", "trained", "iterations", "seed"), "designs are accepted by `within` alone; leave it out"
    )

    within: OpenFraction = Field(
        0.05,
        description="share of a printed number within which it is reproduced; of the ratio of the lengths, share of "
        "its change from the original one",
    )
