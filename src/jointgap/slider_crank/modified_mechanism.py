"""A mechanism with other values of its nuisances and with effects, as a simulation and a mechanism file see it."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from jointgap.config import EFFECTS, Effect, Mechanism
from jointgap.config.load import validate
from jointgap.errors import InputError
from jointgap.identification.protocol import Candidate
from jointgap.joints import PINS

_DISCOVERED = "discovered_"


def friction_speed(mechanism: Mechanism) -> float | None:
    """Sliding speed [m/s] over which friction is regularised in the first loose pin that has any; None where none has.

    Nobody measures it, and it moves what is read near reversals by many times the noise: so it is fitted as a nuisance,
    which stands for the other pins' in proportion.
    """
    contacts = [mechanism.joint(pin).contact for pin in mechanism.loose]
    return next((contact.friction_speed for contact in contacts if contact.friction > 0), None)


def lasting_damping(mechanism: Mechanism) -> dict[str, str]:
    """Name of the nuisance by loose joint whose contact has a memory that fades: the damping of its lasting contact.

    Nobody measures it, and how each reversal of load rings down depends on it. The nuisance is the natural logarithm of
    damping over what the contact says, on which readings depend about linearly; on the damping itself less so.
    """
    return {
        pin: f"lasting_damping_{pin}"
        for pin in mechanism.loose
        if mechanism.joint(pin).contact.reference_speed is not None
    }


def with_nuisances(mechanism: Mechanism, values: Mapping[str, float]) -> Mechanism:
    """`mechanism` with other masses, lengths, clearances, friction and restitution."""
    get = values.get
    modified = mechanism.with_lengths(
        get("crank_length", mechanism.crank.length), get("rod_length", mechanism.rod.length)
    )
    rod = {key: values[f"rod_{key}"] for key in ("mass", "inertia") if f"rod_{key}" in values}
    slider = {key: values[f"slider_{key}"] for key in ("mass", "offset") if f"slider_{key}" in values}
    joints = {}
    for pin in mechanism.loose:
        joint = mechanism.joint(pin)
        contact = {
            key: values.get(f"{name}_{pin}", values.get(name, getattr(joint.contact, key)))
            for name, key in (("joint_friction", "friction"), ("restitution", "restitution"))
            if pin in PINS and getattr(joint.contact, key) is not None  # not every law of contact has a restitution
        }
        if "friction_speed" in values:
            contact["friction_speed"] = (
                joint.contact.friction_speed * values["friction_speed"] / friction_speed(mechanism)
            )
        if (name := f"lasting_damping_{pin}") in values:
            contact["reference_approach_speed"] = joint.contact.reference_speed * math.exp(-values[name])
        change: dict[str, Any] = {"contact": joint.contact.model_copy(update=contact)}
        if f"{pin}_clearance" in values:
            change["bearing_radius"] = joint.journal_radius + values[f"{pin}_clearance"]
        joints[pin] = joint.model_copy(update=change)
    return modified.model_copy(
        update={
            "rod": modified.rod.model_copy(update=rod),
            "slider": modified.slider.model_copy(update=slider),
            "joints": modified.joints.model_copy(update=joints),
        }
    )


def with_effects(mechanism: Mechanism, effects: Sequence[tuple[Candidate, Mapping[str, float]]]) -> Mechanism:
    """`mechanism` with physical effects added to those that it has."""
    added, formulas = [], {}
    for candidate, values in effects:
        if candidate.sensor:
            continue
        if candidate.name.startswith(_DISCOVERED):
            formulas.setdefault(candidate.name.partition("[")[0], []).append((candidate, values))
        elif EFFECTS[candidate.name].ACTS_AT_ZERO or any(
            value for key, value in values.items() if key in _names(candidate)
        ):
            added.append(_effect(candidate.name, candidate.site, candidate.parameters(values)))
    added += [_formula(name, terms) for name, terms in formulas.items()]
    return mechanism.model_copy(update={"effects": (*mechanism.effects, *added)})


def _names(candidate: Candidate) -> set[str]:
    """Keys of an effect's sizes, and their names within a run."""
    return {name for key in candidate.amplitudes for name in (key, key.partition("@")[0])}


def _effect(name: str, site: str, parameters: Mapping[str, Any]) -> Effect:
    effect = EFFECTS[name]
    data = {"name": name, "parameters": dict(parameters)} | ({"site": site} if "site" in effect.model_fields else {})
    return validate(effect, data, name)


def _formula(name: str, terms: Sequence[tuple[Candidate, Mapping[str, float]]]) -> Effect:
    """One law of several found terms: a candidate ``discovered_slider_force[v^3]`` has one size, its coefficient."""
    parts, coefficients = [], {}
    for place, (candidate, values) in enumerate(terms, 1):
        term = candidate.name.partition("[")[2].removesuffix("]")
        if not term:
            raise InputError(f"{candidate.name}: has no term; name it such as {name}[v^3]")
        parts.append(f"c{place}*({term})")
        coefficients[f"c{place}"] = values[candidate.amplitudes[0]]
    return _effect(name, "", {"formula": " + ".join(parts), "coefficients": coefficients})


def simulated_effects(effects: Sequence[tuple[Candidate, Mapping[str, float]]]) -> tuple[list, list, float]:
    """Effects as they can be simulated, those that can be as they are, and what share of the others' effect acts."""
    limited, exact, share = [], [], 1.0
    for candidate, values in effects:
        page = EFFECTS.get(candidate.name)
        nearest, part = page.simulated(values) if page and not candidate.sensor else (values, 1.0)
        limited.append((candidate, nearest))
        exact += [(candidate, values)] if part == 1.0 else []
        share *= part
    return limited, exact, share


def augmented_mechanism(
    mechanism: Mechanism, hypothesis: Sequence[Candidate] = (), values: Mapping[str, float] | None = None
) -> Mechanism:
    """The mechanism with re-fitted nuisances and physical effects written in."""
    values = values or {}
    modified = with_nuisances(mechanism, {key: v for key, v in values.items() if "@" not in key})
    effects = [(candidate, _own(candidate, values)) for candidate in hypothesis]
    for _, own in effects:
        # a nuisance that an effect replaced in part, such as the other pin's friction
        modified = with_nuisances(modified, own)
    return validate(Mechanism, with_effects(modified, effects).model_dump(), "the mechanism with what was found")


def _own(candidate: Candidate, values: Mapping[str, float]) -> dict[str, float]:
    """Values of an effect's coordinates by key, as far as a fit has them: those of held-out runs it has not."""
    keys = {p.key: f"{candidate.label}.{p.key}" for p in candidate.coordinates}
    return {key: values[name] for key, name in keys.items() if name in values}
