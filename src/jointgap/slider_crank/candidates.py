"""The physical effects that could be missing in a slider-crank, as a fit varies them."""

from jointgap.effects import EFFECTS, GROUPS
from jointgap.effects.base import FitContext
from jointgap.errors import InputError
from jointgap.identification.protocol import Candidate
from jointgap.slider_crank.modified_mechanism import augmented_mechanism


def physical_candidates(context: FitContext) -> list[Candidate]:
    """Effects that could be missing in a mechanism, by what they act on; those that it has, or that cannot act in it,
    are left out.
    """
    placed = [
        (GROUPS.index(effect.GROUP), effect.sites().index(candidate.site) if candidate.has_site else 0, candidate)
        for effect in EFFECTS.values()
        for candidate in effect.candidates(context)
        if context.mechanism.effect(candidate.name, candidate.site if candidate.has_site else None) is None
        and _is_possible(context, candidate)
    ]
    return [candidate for _, _, candidate in sorted(placed, key=lambda entry: entry[:2])]


def _is_possible(context: FitContext, candidate: Candidate) -> bool:
    """Whether a mechanism file may hold the effect at a small size: what it refuses would be named in vain."""
    small = {
        f"{candidate.label}.{p.key}": min(max(p.step, p.low), p.high) if p.key in candidate.amplitudes else p.nominal
        for p in candidate.coordinates
    }
    try:
        augmented_mechanism(context.mechanism, (candidate,), small)
    except InputError:
        return False
    return True
