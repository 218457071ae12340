"""Which trials a set holds: what is hidden in each, decided by the set's seed before anything is simulated."""

import hashlib
from dataclasses import dataclass

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt

from jointgap.config.load import read_yaml, validate
from jointgap.errors import InputError, did_you_mean
from jointgap.section import Section
from jointgap.trials.injected_effects import LISTED, OFF_LIST

SIZES = (1.5, 5.0)
"""Whitened gaps that hidden effects cause after recalibration."""

_SHARES = {"ideal": 0.44, "loose": 0.44, "chaotic": 0.12}
_NEED_LOOSE = ("lubricated_joint",)

# What Exudyn's own loads, springs and user functions can do; the rest of the list has no counterpart there.
EXUDYN = (
    "gravity",
    "slider_coulomb_friction",
    "slider_viscous_friction",
    "slider_quadratic_drag",
    "slider_constant_force",
    "slider_spring",
    "crank_coulomb_friction",
    "crank_viscous_friction",
    "added_slider_mass",
    "link_length_error",
)


class Sizes(Section):
    """How many trials of each kind a set has."""

    seed: NonNegativeInt = Field(description="seed of all that is random in the set")
    single: NonNegativeInt = Field(description="one effect of the list hidden")
    nothing: NonNegativeInt = Field(description="nothing hidden")
    pairs: NonNegativeInt = Field(description="two effects of the list hidden")
    off_list: NonNegativeInt = Field(description="an effect hidden that is on nobody's list")
    exudyn: NonNegativeInt = Field(0, description="one effect hidden, motion and effect by Exudyn")
    batch: PositiveInt = Field(12, description="trials that one job takes, one after the other")


class Sets(Section):
    """The content of ``config/blind.yaml``."""

    sets: dict[str, Sizes] = Field(description="sets of trials by name")


@dataclass(frozen=True)
class Plan:
    """What one trial is to hide: kind, base, size (0 where nothing is hidden), names in `hidden.LISTED` or `OFF_LIST`."""

    id: str
    number: int
    kind: str
    base: str
    size: float
    effects: tuple[str, ...]


def read_sets(path) -> dict[str, Sizes]:
    """The sets in a file such as ``config/blind.yaml``.

    Raises
    ------
    InputError
        No such file, or a wrong key or value in it.
    """
    return validate(Sets, read_yaml(path), str(path)).sets


def chosen(sets: dict[str, Sizes], name: str) -> Sizes:
    """The set `name`, or an InputError with the name that was probably meant."""
    if name not in sets:
        raise InputError(f"there is no set of blind trials '{name}'; {did_you_mean(name, sets)}")
    return sets[name]


def plans(sizes: Sizes) -> list[Plan]:
    """All trials of a set, shuffled; their identifiers tell nothing."""
    rng = np.random.default_rng([sizes.seed, 0])
    drawn: list[tuple[str, str, float, tuple[str, ...]]] = [
        ("nothing", base, 0.0, ()) for base in _bases(rng, sizes.nothing)
    ]
    for kind, count, catalogue, several in (
        ("single", sizes.single, tuple(LISTED), 1),
        ("pair", sizes.pairs, tuple(LISTED), 2),
        ("off_list", sizes.off_list, tuple(OFF_LIST), 1),
        ("exudyn", sizes.exudyn, EXUDYN, 1),
    ):
        names = _evenly(rng, catalogue, count * several)
        for place, base in enumerate(_bases(rng, count)):
            effects = _two_kinds(rng, catalogue, names[place * several : (place + 1) * several])
            if base == "ideal" and any(name.startswith(_NEED_LOOSE) for name in effects):
                base = "loose"
            if kind == "exudyn":
                base = "ideal"  # Exudyn's implicit integrator does not get through the contacts
            drawn.append((kind, base, SIZES[place % 2], effects))
    order = rng.permutation(len(drawn))
    return [Plan(_identifier(sizes.seed, place), place, *drawn[which]) for place, which in enumerate(order)]


def batches(sizes: Sizes) -> int:
    """How many batches a set has."""
    count = sizes.single + sizes.nothing + sizes.pairs + sizes.off_list + sizes.exudyn
    return -(-count // sizes.batch)


def _bases(rng, count: int) -> list[str]:
    found = [base for base, share in _SHARES.items() for _ in range(round(share * count))]
    found = (found + ["loose"] * count)[:count]
    return [found[place] for place in rng.permutation(count)]


def _evenly(rng, names: tuple[str, ...], count: int) -> list[str]:
    found: list[str] = []
    while len(found) < count:
        found += [names[place] for place in rng.permutation(len(names))]
    return found[:count]


def _two_kinds(rng, catalogue: tuple[str, ...], names: list[str]) -> tuple[str, ...]:
    """`names`, the second drawn anew while both are one effect."""
    while len(names) == 2 and names[0].split(":")[0] == names[1].split(":")[0]:
        names = [names[0], catalogue[int(rng.integers(len(catalogue)))]]
    return tuple(names)


def _identifier(seed: int, number: int) -> str:
    return hashlib.sha256(f"{seed} {number}".encode()).hexdigest()[:12]
