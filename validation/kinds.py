"""Plan of a set of trials: its seed determines the hidden effects of each trial."""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import create_model

from jointgap.config import EFFECTS, read_yaml, validate
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import JOINTS, PINS
from jointgap.core.section import ConfigModel, Seed, Word, whole_number
from jointgap.core.units import quantity
from jointgap.rig.sensors import ENCODER_COUPLING, ENCODER_FAULTS
from validation.data_faults import DATA_FAULTS
from validation.linkages import exudyn_models, names_to_hide
from validation.rig import LISTED, OFF_LIST, RECIPE

CLEARANCES = tuple(f"{joint}_clearance" for joint in JOINTS)

# Groups of effects that the recipe abbreviates
_GROUPS = {
    "listed": LISTED,
    "off_list": OFF_LIST,
    "clearances": CLEARANCES,
    "damages": DATA_FAULTS,
    "exudyn": RECIPE["exudyn"],
}

# Seed, absent until the analysing commit is fixed; number of trials of each kind; share of measured
# cranks; share of these with drift
TrialSet = create_model(
    "TrialSet",
    __base__=ConfigModel,
    seed=(Seed | None, None),
    measured_angle=(quantity("", ge=0, le=1), 0.0),
    drift=(quantity("", ge=0, le=1), 0.0),
    **{kind: (whole_number(ge=0, le=10_000), 0) for kind in RECIPE["kinds"]},
)


class Sets(ConfigModel):
    """The content of ``config/blind.yaml``."""

    sets: dict[Word, TrialSet]


@dataclass(frozen=True)
class Trial:
    """The plan of one trial."""

    kind: str
    base: str  # motion without an effect: ideal, loose or chaotic
    size: float = 0.0  # gap that each effect causes; 0 without effects or if `shown` is given
    effects: tuple[str, ...] = ()
    damage: str = ""
    loose: str = ""  # joint that is loose in the model; empty: any
    mechanism: str = ""  # the shipped linkage that is varied; empty: a slider-crank
    peer: bool = False  # the data of a linkage are by Exudyn
    measured_angle: bool = False
    drift: bool = False  # the speed of a measured crank drifts slowly
    shown: tuple[float, float] | None = None  # range of the gap if the size is drawn
    number: int = 0  # position in the set
    id: str = ""  # anonymous

    @property
    def by_exudyn(self) -> bool:
        return self.kind == "exudyn" or self.peer

    @property
    def needs_encoder(self) -> bool:
        faulty = self.damage == "zero_off" or not {*ENCODER_FAULTS}.isdisjoint(self.effects)
        return faulty or self.measured_angle or self.kind == "counter"


def read_set(path: Path | str, name: str, seed: int | None = None) -> Any:
    """The set `name` of a file such as ``config/blind.yaml``, with its own seed or a given one."""
    sets = validate(Sets, read_yaml(path), str(path)).sets
    if name not in sets:
        raise InputError(f"there is no set of blind trials '{name}'; {did_you_mean(name, sets)}")
    trial_set = sets[name]
    if seed is not None and trial_set.seed not in (None, seed):
        raise InputError(f"{path}: sets.{name}.seed is {trial_set.seed}; remove --seed {seed}")
    if seed is None and trial_set.seed is None:
        raise InputError(
            f"{path}: sets.{name} has no seed; give the first eight digits of the hash of the"
            " analysing commit, such as --seed 0x1a2b3c4d, or write them there"
        )
    return trial_set if seed is None else trial_set.model_copy(update={"seed": seed})


def plan_trials(trial_set: Any, count: int | None = None) -> list[Trial]:
    """The shuffled trials of a set; the first `count` of them are a random part."""
    trials = []
    for stream, kind in enumerate(RECIPE["kinds"], 1):
        make = _trials_of_linkages if "linkages" in RECIPE["kinds"][kind] else _trials_of_kind
        trials += make(trial_set, kind, stream)
    if count is not None and (type(count) is not int or not 1 <= count <= len(trials)):
        raise InputError(
            f"trials: is {count!r}; give a whole number from 1 to {len(trials)}, how many the"
            " set has"
        )
    rng = np.random.default_rng([trial_set.seed, 0])
    shuffled = []
    for number, index in enumerate(rng.permutation(len(trials))):
        digest = hashlib.sha256(f"{trial_set.seed} {number}".encode()).hexdigest()
        shuffled.append(replace(trials[index], id=digest[:12], number=number))
    constant_speed = {name for name, effect in EFFECTS.items() if effect.DRIVE == "constant"}
    constant_speed |= {*ENCODER_COUPLING}
    drivable = [
        trial.number
        for trial in shuffled
        if not trial.damage and not trial.mechanism and not constant_speed & set(trial.effects)
    ]
    measured = set(rng.permutation(drivable)[: round(trial_set.measured_angle * len(drivable))])
    drifting = set(rng.permutation(sorted(measured))[: round(trial_set.drift * len(measured))])
    return [
        replace(trial, measured_angle=trial.number in measured, drift=trial.number in drifting)
        for trial in shuffled[:count]
    ]


def chosen_trials(plans: Sequence[Trial], choice: str) -> list[Trial]:
    """The trials with `even` or `odd` numbers, `all`, every fourth from the second as ``2/4``, or
    those with numbers or ids as ``0,4``."""
    parts = {"all": (1, 1), "even": (1, 2), "odd": (2, 2)}
    if found := re.fullmatch(r"([1-9]\d*)/([1-9]\d*)", choice):
        parts[choice] = tuple(map(int, found.groups()))
    if choice in parts and parts[choice][0] <= parts[choice][1]:
        part, count = parts[choice]
        return [plan for plan in plans if plan.number % count == part - 1]
    by_name = {name: plan for plan in plans for name in (str(plan.number), plan.id)}
    names = choice.split(",")
    if unknown := [name for name in names if name not in by_name]:
        raise InputError(
            f"trials: '{unknown[0]}' is no trial; give even, odd, all, a part such as 2/4, or ids"
            f" or numbers from 0 to {len(plans) - 1} with commas"
        )
    return [by_name[name] for name in names]


def _trials_of_kind(trial_set: Any, key: str, stream: int) -> list[Trial]:
    """Trials of one kind, independent of the number of other kinds."""
    kind, count = RECIPE["kinds"][key], getattr(trial_set, key)
    bases, each = kind.get("bases", RECIPE["bases"]), kind.get("each", 1)
    hidden = [name for word in kind.get("hidden", []) for name in _GROUPS.get(word, (word or "",))]
    rng, trials = np.random.default_rng([trial_set.seed, stream]), []
    if "one_of_each" in kind:
        sequences = [_names_in_turn(rng, names, count) for names in kind["one_of_each"]]
    else:
        names = _names_in_turn(rng, hidden, each * count)
        sequences = [names[start::each] for start in range(each)]
    for number in range(count):
        base, loose = str(rng.choice(list(bases), p=list(bases.values()))), ""
        effects = [names[number] for names in sequences if names[number]]
        while len(effects) == 2 and _name_and_joint(effects[0]) & _name_and_joint(effects[1]):
            effects[1] = str(rng.choice(hidden))
        if "damages" in kind.get("hidden", []):
            trials.append(Trial(kind["kind"], base, damage=effects[0]))
            continue
        for name in effects:
            if name.startswith("lubricated_joint"):
                base, loose = "loose" if base == "ideal" else base, name.partition(":")[2]
            elif name in CLEARANCES and key == "exudyn_loose":
                base = str(rng.choice(["ideal", "loose"]))
            elif name in CLEARANCES and key == "clearances":
                if base != "ideal" and rng.random() < 0.5:
                    joint = name.removesuffix("_clearance")
                    loose = joint if joint in PINS else ""
        shown = tuple(kind["shown"]) if "shown" in kind else None
        size = RECIPE["gaps"][number % len(RECIPE["gaps"])] if effects and not shown else 0.0
        trials.append(Trial(kind["kind"], base, size, tuple(effects), loose=loose, shown=shown))
    return trials


def _trials_of_linkages(trial_set: Any, key: str, stream: int) -> list[Trial]:
    """Trials of one kind, of the shipped linkages in turn."""
    kind, count = RECIPE["kinds"][key], getattr(trial_set, key)
    rng, trials, each = np.random.default_rng([trial_set.seed, stream]), [], kind.get("each", 1)
    mechanisms, gaps = RECIPE["linkages"]["joints"], RECIPE["gaps"]
    names = {
        mechanism: _names_in_turn(rng, names_to_hide(mechanism, kind["linkages"]), each * count)
        for mechanism in mechanisms
    }
    shown = tuple(kind["shown"]) if "shown" in kind else None
    for number in range(count):
        mechanism = list(mechanisms)[number % len(mechanisms)]
        start = each * (number // len(mechanisms))
        effects = tuple(name for name in names[mechanism][start : start + each] if name)
        base = str(rng.choice(list(kind["bases"]), p=list(kind["bases"].values())))
        size = gaps[number % len(gaps)] if effects and not shown else 0.0
        can = exudyn_models(mechanism, base, effects)
        peer = bool(rng.random() < RECIPE["linkages"]["exudyn"]) and can
        keys = {"shown": shown, "mechanism": mechanism, "peer": peer}
        trials.append(Trial(kind["kind"], base, size, effects, **keys))
    return trials


def _names_in_turn(rng: np.random.Generator, names: Sequence[str], count: int) -> list[str]:
    """At least `count` names, each as often as the others but for the last round."""
    sequence: list[str] = []
    while len(sequence) < count:
        sequence += map(str, rng.permutation(names))
    return sequence


def _name_and_joint(label: str) -> set[str]:
    """In one joint an effect may overwrite another."""
    name, _, joint = label.partition(":")
    return {name, joint or name.removesuffix("_clearance")}
