"""The catalogue of physical effects; docs/how_to/add_effect.md shows how to add one."""

from functools import reduce
from operator import or_
from typing import Annotated

from pydantic import Field

from jointgap.core.errors import MEANINGS
from jointgap.effects import (  # noqa: F401 importing a module registers its effects
    bodies,
    clearance,
    crank,
    pins,
    slider,
    slider_force_table,
)
from jointgap.effects.base import CATALOGUE, CRANK_SIGN_SPEED, GROUPS, SLIDER_SIGN_SPEED, Effect

#: Every effect by its name, in the order of the catalogue.
EFFECTS: dict[str, type[Effect]] = {
    effect.NAME: effect for effect in sorted(CATALOGUE, key=lambda effect: effect.ORDER)
}

MEANINGS.update((name, effect.__doc__) for name, effect in EFFECTS.items())

#: One effect of a mechanism file, identified by its name.
AnyEffect = Annotated[reduce(or_, EFFECTS.values()), Field(discriminator="name")]

__all__ = ["CRANK_SIGN_SPEED", "EFFECTS", "GROUPS", "SLIDER_SIGN_SPEED", "AnyEffect", "Effect"]
