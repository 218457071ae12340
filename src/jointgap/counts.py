"""Whole numbers in configurations, each with the most that it may be, and why."""

from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema


def whole_number(**limits: float) -> Any:
    """Type of a whole number within `limits` (gt, ge, lt, le); true and false, to Python 1 and 0, are none."""

    def no_truth(value: Any) -> Any:
        if isinstance(value, bool):
            raise ValueError("must be a whole number, not true or false")
        return value

    return Annotated[int, Field(**limits), BeforeValidator(no_truth)]


def count(most: int, why: str, least: int = 1) -> Any:
    """Type of a whole number in a configuration."""

    def not_too_many(number: int) -> int:
        if number > most:
            raise ValueError(f"is more than {most}; {why}")
        return number

    schema = {"type": "integer", "minimum": least, "maximum": most}
    return Annotated[whole_number(ge=least), AfterValidator(not_too_many), WithJsonSchema(schema)]


MOST_PARTS = 100
"""Jobs that share the fits of a campaign: beyond that there are more jobs than fits."""

Seed = count(2**32 - 1, "a seed has 32 bits: choose any smaller number", least=0)
_MEMBERS = 10_000, "each member is a simulation of its own, and a few dozen show how much motions scatter"
Members, MembersToCompare = count(*_MEMBERS), count(*_MEMBERS, least=2)
Iterations = count(10_000_000, "the error of each iteration is kept in memory")
