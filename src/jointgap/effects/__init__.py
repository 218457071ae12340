"""The catalogue of physical effects: one page each, found by itself; docs/extending.md adds one step by step."""

import pkgutil
from functools import reduce
from importlib import import_module
from operator import or_
from typing import Annotated

from pydantic import Field

from jointgap.effects.base import CRANK_SIGN_SPEED, GROUPS, SLIDER_SIGN_SPEED, Effect

PAGES = "jointgap.effects.*"
"""The modules of which the catalogue is made, for those who follow imports."""


def _pages(base: type[Effect]) -> list[type[Effect]]:
    """`base` and all that is derived from it, as far as these are pages."""
    return [page for child in base.__subclasses__() for page in _pages(child)] + [base] * ("NAME" in vars(base))


for _module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

EFFECTS: dict[str, type[Effect]] = {page.NAME: page for page in sorted(_pages(Effect), key=lambda page: page.ORDER)}
"""Every effect by its name, in the order of the catalogue."""

AnyEffect = Annotated[reduce(or_, EFFECTS.values()), Field(discriminator="name")]
"""One effect of a mechanism file, identified by its name."""

__all__ = ["CRANK_SIGN_SPEED", "EFFECTS", "GROUPS", "SLIDER_SIGN_SPEED", "AnyEffect", "Effect"]
