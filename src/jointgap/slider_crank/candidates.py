"""The physical effects that could be missing in a slider-crank, as a fit varies them."""

from jointgap.effects import EFFECTS, GROUPS
from jointgap.effects.base import FitContext
from jointgap.identification.protocol import Candidate


def physical_candidates(context: FitContext) -> list[Candidate]:
    """Effects that could be missing in a mechanism, by what they act on; those that it has, or that cannot act in it,
    are left out.
    """
    placed = [
        (GROUPS.index(effect.GROUP), effect.sites().index(candidate.site) if candidate.has_site else 0, candidate)
        for effect in EFFECTS.values()
        for candidate in effect.candidates(context)
        if context.mechanism.effect(candidate.name, candidate.site if candidate.has_site else None) is None
    ]
    return [candidate for _, _, candidate in sorted(placed, key=lambda entry: entry[:2])]
