"""The catalogue of physical effects; docs/how_to/add_effect.md shows how to add one."""

from functools import reduce
from operator import or_
from typing import Annotated

from pydantic import Field

from jointgap.core.errors import MEANINGS
from jointgap.core.sites import SLIDER_CRANK
from jointgap.effects import (  # noqa: F401 importing a module registers its laws
    bodies,
    clearance,
    force_table,
    pins,
    pivots,
    slides,
)
from jointgap.effects.base import (
    CRANK_SIGN_SPEED,
    GROUPS,
    SLIDER_SIGN_SPEED,
    Effect,
    effects_of,
)

#: Every effect of a slider-crank by its name, in the order of the catalogue.
EFFECTS: dict[str, type[Effect]] = effects_of(SLIDER_CRANK)

MEANINGS.update((name, effect.__doc__) for name, effect in EFFECTS.items())

#: One effect of a slider-crank's file, identified by its name.
AnyEffect = Annotated[reduce(or_, EFFECTS.values()), Field(discriminator="name")]

__all__ = [
    "CRANK_SIGN_SPEED",
    "EFFECTS",
    "GROUPS",
    "SLIDER_SIGN_SPEED",
    "AnyEffect",
    "Effect",
    "effects_of",
]
