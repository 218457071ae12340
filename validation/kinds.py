"""What each trial of a set hides: decided by the set's seed before anything is simulated."""

import hashlib
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
from jointgap.rig.sensors import ENCODER_OFFSET
from validation.rig import LISTED, OFF_LIST, RECIPE
from validation.wiring import DAMAGES

CLEARANCES = tuple(f"{joint}_clearance" for joint in JOINTS)

# Names that one word of the recipe stands for
_NAMES = {"listed": LISTED, "off_list": OFF_LIST, "clearances": CLEARANCES, "damages": DAMAGES}
_NAMES["exudyn"] = RECIPE["exudyn"]

# How many trials of each kind a set has, the share of them whose crank follows the angle read, and
# the share of these whose speed drifts slowly
TrialSet = create_model(
    "TrialSet",
    __base__=ConfigModel,
    seed=(Seed, ...),
    measured_angle=(quantity("", ge=0, le=1), 0.0),
    drift=(quantity("", ge=0, le=1), 0.0),
    **{key: (whole_number(ge=0, le=10_000), 0) for key in RECIPE["kinds"]},
)


class Sets(ConfigModel):
    """The content of ``config/blind.yaml``."""

    sets: dict[Word, TrialSet]


@dataclass(frozen=True)
class Trial:
    """What one trial is to hide."""

    kind: str
    base: str  # The motion without an effect: ideal, loose or chaotic
    size: float = 0.0  # Gap that each effect is to cause; 0 where nothing is injected
    effects: tuple[str, ...] = ()
    damage: str = ""
    loose: str = (
        ""  # A joint that has to be loose in the analyst's model; empty where it may be any
    )
    measured_angle: bool = False
    drift: bool = False  # Whether the speed of a measured crank drifts slowly
    shown: tuple[float, float] | None = (
        None  # Between which the gap has to lie of a size that is drawn
    )
    number: int = 0  # Its place in the set
    id: str = ""  # Says nothing about it

    @property
    def needs_encoder(self) -> bool:
        """Whether the crank angle has to be measured."""
        return self.measured_angle or self.damage == "zero_off" or ENCODER_OFFSET in self.effects


def read_set(path: Path | str, name: str) -> Any:
    """The set `name` of a file such as ``config/blind.yaml``."""
    sets = validate(Sets, read_yaml(path), str(path)).sets
    if name not in sets:
        raise InputError(f"there is no set of blind trials '{name}'; {did_you_mean(name, sets)}")
    return sets[name]


def plan_trials(chosen: Any, count: int | None = None) -> list[Trial]:
    """The trials of a set, shuffled: all, or the first `count`, which are a random part."""
    trials = [
        trial
        for stream, key in enumerate(RECIPE["kinds"], 1)
        for trial in _of_kind(chosen, key, stream)
    ]
    if count is not None and (
        isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= len(trials)
    ):
        raise InputError(
            f"trials: is {count!r}; give a whole number from 1 to {len(trials)}, how many the"
            " set has"
        )
    rng = np.random.default_rng([chosen.seed, 0])
    ids = [
        hashlib.sha256(f"{chosen.seed} {number}".encode()).hexdigest()[:12]
        for number in range(len(trials))
    ]
    order = rng.permutation(len(trials))
    shuffled = [
        replace(trials[place], id=ids[number], number=number) for number, place in enumerate(order)
    ]
    steady = {name for name, effect in EFFECTS.items() if effect.DRIVE == "constant"}
    able = [
        trial.number for trial in shuffled if not trial.damage and not steady & set(trial.effects)
    ]
    measured = set(rng.permutation(able)[: round(chosen.measured_angle * len(able))])
    drifting = set(rng.permutation(sorted(measured))[: round(chosen.drift * len(measured))])
    return [
        replace(trial, measured_angle=trial.number in measured, drift=trial.number in drifting)
        for trial in shuffled
    ][:count]


def _of_kind(chosen: Any, key: str, stream: int) -> list[Trial]:
    """Trials of one kind; they do not depend on how many there are of other kinds."""
    kind, count = RECIPE["kinds"][key], getattr(chosen, key)
    rng, trials = np.random.default_rng([chosen.seed, stream]), []
    hidden = [name for word in kind["hidden"] for name in _NAMES.get(word, (word or "",))]
    each, bases = kind.get("each", 1), kind.get("bases", RECIPE["bases"])
    names = [
        str(name)
        for _ in range(-(-each * count // len(hidden)))
        for name in rng.permutation(hidden)
    ]
    for number in range(count):
        base, loose = str(rng.choice(list(bases), p=list(bases.values()))), ""
        own = [name for name in names[each * number : each * (number + 1)] if name]
        while len(own) == 2 and _parts(own[0]) & _parts(own[1]):
            own[1] = str(rng.choice(hidden))
        if "damages" in kind["hidden"]:
            trials.append(Trial(kind["kind"], base, damage=own[0]))
            continue
        for name in own:
            joint = name.removesuffix("_clearance")
            if name.startswith("lubricated_joint"):
                base, loose = "loose" if base == "ideal" else base, name.partition(":")[2]
            elif name in CLEARANCES and key == "exudyn_loose":
                base = str(rng.choice(["ideal", "loose"]))
            elif (
                name in CLEARANCES
                and key == "clearances"
                and base != "ideal"
                and rng.random() < 0.5
            ):
                loose = joint if joint in PINS else ""
        shown = tuple(kind["shown"]) if "shown" in kind else None
        size = RECIPE["gaps"][number % len(RECIPE["gaps"])] if own and not shown else 0.0
        trials.append(Trial(kind["kind"], base, size, tuple(own), loose=loose, shown=shown))
    return trials


def _parts(label: str) -> set[str]:
    """Name and joint of an effect: in a joint one effect may overwrite another."""
    name, _, site = label.partition(":")
    return {name, site or name.removesuffix("_clearance")}
