"""What decides: of which measures of a sweep it is asked which parameter decides them."""

from pydantic import Field, field_validator

from jointgap.config.measures import ALL_MEASURES
from jointgap.core.errors import did_you_mean
from jointgap.counts import Seed
from jointgap.section import Section


class Sensitivity(Section):
    """Sobol indices of the measures of a sweep, from a surrogate of each."""

    measures: tuple[str, ...] = Field(
        (), description="columns of the sweep's designs such as piston_pin_peak_force; every measure when empty"
    )
    seed: Seed = Field(0, description="seed of which designs are held out, and of the intervals")

    @field_validator("measures")
    @classmethod
    def _measures_are_columns(cls, measures: tuple[str, ...]) -> tuple[str, ...]:
        known = [column.name for column in ALL_MEASURES]
        for name in measures:
            if name not in known:
                raise ValueError(f"'{name}' is no measure of a sweep; {did_you_mean(name, known)}")
        if len(set(measures)) < len(measures):
            raise ValueError(f"{list(measures)} lists a measure twice; give each once")
        return measures
