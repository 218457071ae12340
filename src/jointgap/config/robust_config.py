"""What robust lengths are searched over: what is uncertain, what of the error is minimised, and how long."""

from typing import Any, Literal

from pydantic import Field, field_validator

from jointgap.config.sweep_config import Distribution, with_distribution
from jointgap.core.units import OpenFraction, quantity
from jointgap.counts import Seed, count
from jointgap.section import Section

_SEARCH = 10_000, "each candidate is simulated at every draw: some milliseconds times draws"

DrawsOfSearch = count(10_000, "every candidate is simulated at each of them", least=2)
FreshDraws = count(1_000_000, "each is simulated at every pair of lengths that is compared", least=16)
GridPoints = count(100, "the square of it is simulated at every draw", least=3)
Candidates, CandidateGenerations = count(*_SEARCH, least=4), count(*_SEARCH)
Resamples = count(100_000, "each is held in memory", least=100)


class OptimiseRobust(Section):
    """Lengths of crank and rod that keep the transmission angle best whatever is uncertain turns out to be."""

    uncertain: dict[str, Distribution] = Field(
        {},
        description="what is uncertain and how, as in sweep.parameters; crank_length and rod_length here are "
        "tolerances, which are added to the lengths that are searched",
    )
    revolution: Literal["first", "settled"] = Field(
        "settled",
        description="where the RMS of the error is taken: first, over optimise.window of it; settled, over "
        "optimise.ensemble.settled_revolution",
    )
    measure: Literal["mean_plus_deviations", "quantile"] = Field(
        "mean_plus_deviations", description="what of the errors of all draws is minimised"
    )
    deviations: quantity("", ge=0, le=100) = Field(
        2.0, description="of mean_plus_deviations: how many standard deviations are added to the mean"
    )
    quantile: OpenFraction = Field(0.95, description="of quantile: the share of the draws that lie below it")
    probability: OpenFraction = Field(
        0.95, description="share of the draws in which each of optimise.constraints has to hold"
    )
    draws: DrawsOfSearch = Field(32, description="draws of what is uncertain, the same for every candidate")
    grid: GridPoints = Field(9, description="points along each length at which the search begins")
    population: Candidates = Field(16, description="candidates of a generation")
    generations: CandidateGenerations = Field(12, description="generations of each search after the first")
    fresh_draws: FreshDraws = Field(512, description="further draws, on which the lengths found are compared")
    resamples: Resamples = Field(2000, description="bootstrap samples of the fresh draws, for the intervals")
    seed: Seed = Field(0, description="seed of the draws, the search and the intervals")

    @field_validator("uncertain", mode="before")
    @classmethod
    def _distributions_are_named(cls, uncertain: Any) -> Any:
        if isinstance(uncertain, dict):
            return {key: with_distribution(spec) for key, spec in uncertain.items()}
        return uncertain
