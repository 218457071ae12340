"""Which trials a set holds: what is injected in each, decided by the set's seed before anything is simulated."""

import hashlib
from dataclasses import dataclass, replace
from itertools import cycle
from pathlib import Path

import numpy as np
from pydantic import Field

from jointgap.config import read_yaml, validate
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import JOINTS, PINS
from jointgap.core.section import Section, Seed, Word, whole_number
from jointgap.core.units import Fraction
from jointgap.effects import EFFECTS
from jointgap.rig.sensors import SENSOR_DELAY
from validation.campaign import DAMAGES
from validation.effects import DRAWN_APART, LISTED, OFF_LIST

TARGET_GAPS = (1.5, 5.0)
"""Whitened gaps that injected effects cause after recalibration: just visible, and plain."""

_BASE_SHARES = {"ideal": 0.44, "loose": 0.44, "chaotic": 0.12}
_NEED_LOOSE = ("lubricated_joint",)
_NEED_CONSTANT_SPEED = {name for name, effect in EFFECTS.items() if effect.DRIVE == "constant"}

EXUDYN_EFFECTS = (
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
"""What Exudyn's own loads, springs and user functions can do; the rest of the list has no counterpart there."""

CLEARANCES = tuple(f"{joint}_clearance" for joint in JOINTS)

EXUDYN_LOOSE_EFFECTS = (*EXUDYN_EFFECTS, *(f"{pin}_clearance" for pin in PINS))
"""What Exudyn can do beside loose pins; with a loose crank pivot its explicit integrator would have to close a loop."""

_NOTHING_IN_EXUDYN = 4
"""Of so many trials from Exudyn with loose joints one has nothing hidden."""

_DRAWN = tuple(name for name in LISTED if name not in DRAWN_APART)

Trials = whole_number(ge=0, le=10_000)


class TrialSet(Section):
    """How many trials of each kind a set has."""

    seed: Seed = Field(description="seed of all that is random in the set")
    single: Trials = Field(description="one effect of the list injected")
    nothing: Trials = Field(description="nothing injected")
    pairs: Trials = Field(description="two effects of the list injected")
    off_list: Trials = Field(description="an effect injected that is not on the list")
    exudyn: Trials = Field(0, description="one effect injected, joints ideal, motion and effect by Exudyn")
    exudyn_loose: Trials = Field(
        0, description="as exudyn with loose joints; a quarter with nothing injected, and clearances among the effects"
    )
    clearances: Trials = Field(
        0, description="a clearance injected: of a joint that the model has as ideal, or of a loose one"
    )
    delays: Trials = Field(0, description="a pure delay of a sensor injected, counted as single")
    wiring: Trials = Field(0, description="nothing injected, but the data are wired wrongly")
    measured_angle: Fraction = Field(
        0.0, description="share of these, those wired wrongly left out, whose crank follows the angle that was read"
    )


class Sets(Section):
    """The content of ``config/blind.yaml``."""

    sets: dict[Word, TrialSet] = Field(description="sets of trials by name")


@dataclass(frozen=True)
class TrialPlan:
    """What one trial is to hide."""

    id: str  # Of the trial; says nothing about it
    number: int  # Its place in the set
    kind: str  # nothing, single, pair, off_list, exudyn, clearance or wiring
    base: str  # One of `validation.rig.BASES`
    size: float  # Gap that each effect is to cause; 0 where nothing is injected
    effects: tuple[str, ...]  # Names in `validation.effects.LISTED` or `OFF_LIST`
    damage: str = ""  # Of the kind wiring
    loose: str = ""  # A joint that has to be loose in the analyst's model; empty where it may be any
    measured_angle: bool = False


def read_sets(path: Path | str) -> dict[str, TrialSet]:
    """The sets in a file such as ``config/blind.yaml``."""
    return validate(Sets, read_yaml(path), str(path)).sets


def trial_set(sets: dict[str, TrialSet], name: str) -> TrialSet:
    """The one of `sets` called `name`, or an InputError with the name that was probably meant."""
    if name not in sets:
        raise InputError(f"there is no set of blind trials '{name}'; {did_you_mean(name, sets)}")
    return sets[name]


def plan_trials(chosen: TrialSet) -> list[TrialPlan]:
    """All trials of a set, shuffled."""
    rng = np.random.default_rng([chosen.seed, 0])
    drawn: list[tuple] = [("nothing", base, 0.0, ()) for base in _draw_bases(rng, chosen.nothing)]
    for kind, count, catalogue, effects_each in (
        ("single", chosen.single, _DRAWN, 1),
        ("pair", chosen.pairs, _DRAWN, 2),
        ("off_list", chosen.off_list, tuple(OFF_LIST), 1),
        ("exudyn", chosen.exudyn, EXUDYN_EFFECTS, 1),
    ):
        names = _draw_evenly(rng, catalogue, count * effects_each)
        for trial, base in enumerate(_draw_bases(rng, count)):
            effects = _two_kinds(rng, catalogue, names[trial * effects_each : (trial + 1) * effects_each])
            if base == "ideal" and any(name.startswith(_NEED_LOOSE) for name in effects):
                base = "loose"
            if kind == "exudyn":
                base = "ideal"
            drawn.append((kind, base, TARGET_GAPS[trial % 2], effects))
    own = np.random.default_rng([chosen.seed, 2])  # what other kinds draw does not depend on how many these are
    damages = _draw_evenly(own, DAMAGES, chosen.wiring)
    drawn += [
        ("wiring", base, 0.0, (), damage) for base, damage in zip(_draw_bases(own, chosen.wiring), damages, strict=True)
    ]
    drawn += _draw_clearances(np.random.default_rng([chosen.seed, 3]), chosen.clearances)
    drawn += _draw_loose_exudyn(np.random.default_rng([chosen.seed, 4]), chosen.exudyn_loose)
    bases = _draw_bases(np.random.default_rng([chosen.seed, 5]), chosen.delays)
    drawn += [("single", base, TARGET_GAPS[trial % 2], (SENSOR_DELAY,)) for trial, base in enumerate(bases)]
    order = rng.permutation(len(drawn))
    plans = [TrialPlan(_identifier(chosen.seed, number), number, *drawn[index]) for number, index in enumerate(order)]
    able = [p.number for p in plans if p.kind != "wiring" and not set(p.effects) & _NEED_CONSTANT_SPEED]
    of_drives = np.random.default_rng([chosen.seed, 6])
    measured = set(of_drives.permutation(able)[: round(chosen.measured_angle * len(able))])
    return [replace(p, measured_angle=p.number in measured) for p in plans]


def first_trials(chosen: TrialSet, count: int | None = None) -> list[TrialPlan]:
    """The first `count` trials of a set, which are a random part since trials are shuffled; all of them without it."""
    plans = plan_trials(chosen)
    if count is None:
        return plans
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= len(plans):
        raise InputError(f"trials: is {count!r}; give a whole number from 1 to {len(plans)}, how many the set has")
    return plans[:count]


def _draw_clearances(rng: np.random.Generator, count: int) -> list[tuple]:
    """Trials that hide a clearance: of joints in turn, every second pin of a rig with loose joints loose already."""
    drawn, is_loose = [], cycle((True, False))
    for trial, (base, name) in enumerate(
        zip(_draw_bases(rng, count), _draw_evenly(rng, CLEARANCES, count), strict=True)
    ):
        joint = name.removesuffix("_clearance")
        loose = joint if base != "ideal" and joint in PINS and next(is_loose) else ""
        drawn.append(("clearance", base, TARGET_GAPS[trial % 2], (name,), "", loose))
    return drawn


def _draw_loose_exudyn(rng: np.random.Generator, count: int) -> list[tuple]:
    """Trials from Exudyn with loose joints; every second one that hides a clearance is of a rig with ideal joints."""
    nothing = count // _NOTHING_IN_EXUDYN
    drawn: list[tuple] = [("exudyn", "loose", 0.0, ())] * nothing
    is_ideal = cycle((True, False))
    for trial, name in enumerate(_draw_evenly(rng, EXUDYN_LOOSE_EFFECTS, count - nothing)):
        base = "ideal" if name in CLEARANCES and next(is_ideal) else "loose"
        drawn.append(("exudyn", base, TARGET_GAPS[trial % 2], (name,)))
    return drawn


def _draw_bases(rng: np.random.Generator, count: int) -> list[str]:
    bases = [base for base, share in _BASE_SHARES.items() for _ in range(round(share * count))]
    bases = (bases + ["loose"] * count)[:count]
    return [bases[index] for index in rng.permutation(count)]


def _draw_evenly(rng: np.random.Generator, catalogue: tuple[str, ...], count: int) -> list[str]:
    """`count` names, each of the catalogue about as often."""
    names: list[str] = []
    while len(names) < count:
        names += [catalogue[index] for index in rng.permutation(len(catalogue))]
    return names[:count]


def _two_kinds(rng: np.random.Generator, catalogue: tuple[str, ...], names: list[str]) -> tuple[str, ...]:
    """`names`, the second drawn anew while both are one effect."""
    while len(names) == 2 and names[0].split(":")[0] == names[1].split(":")[0]:
        names = [names[0], catalogue[int(rng.integers(len(catalogue)))]]
    return tuple(names)


def _identifier(seed: int, number: int) -> str:
    return hashlib.sha256(f"{seed} {number}".encode()).hexdigest()[:12]
