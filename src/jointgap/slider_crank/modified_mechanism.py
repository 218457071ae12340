"""A mechanism with other values of its nuisances and with effects, as a simulation and a mechanism file see it."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from jointgap.config import EFFECTS, Effect, Mechanism
from jointgap.config.load import validate
from jointgap.errors import InputError
from jointgap.identification.protocol import Candidate
from jointgap.joints import PINS

LEAST_COMPLIANCE = 2.8e-9
"""1 / (2 pi nu)^2 [s^2] of a rod that bends at 3 kHz: one that is stiffer follows its load as a spring does."""

_FOUND = "discovered_"
_OPPOSITE = re.compile(r"\b(theta|w)\b", re.ASCII)  # variables of a formula that have the other sign behind


def friction_speed(mechanism: Mechanism) -> float | None:
    """Sliding speed [m/s] over which friction is regularised in the first loose pin that has any; None where none has.

    Nobody measures it, and it moves what is read near reversals by many times the noise: so it is fitted as a nuisance, which
    stands for the other pins' in proportion.
    """
    contacts = [mechanism.joint(pin).contact for pin in mechanism.loose]
    return next((contact.friction_speed for contact in contacts if contact.friction > 0), None)


def with_nuisances(mechanism: Mechanism, values: Mapping[str, float]) -> Mechanism:
    """`mechanism` with other masses, lengths, clearances, friction and restitution.

    Parameters
    ----------
    mechanism : Mechanism
    values : mapping of str to float
        By name of the nuisance, SI; what does not belong to the mechanism (speed, first_angle) is passed over.
    """
    get = values.get
    made = mechanism.with_lengths(get("crank_length", mechanism.crank.length), get("rod_length", mechanism.rod.length))
    rod = {key: values[f"rod_{key}"] for key in ("mass", "inertia") if f"rod_{key}" in values}
    slider = {"mass": values["slider_mass"]} if "slider_mass" in values else {}
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
        change: dict[str, Any] = {"contact": joint.contact.model_copy(update=contact)}
        if f"{pin}_clearance" in values:
            change["bearing_radius"] = joint.journal_radius + values[f"{pin}_clearance"]
        joints[pin] = joint.model_copy(update=change)
    return made.model_copy(
        update={
            "rod": made.rod.model_copy(update=rod),
            "slider": made.slider.model_copy(update=slider),
            "joints": made.joints.model_copy(update=joints),
        }
    )


def with_effects(mechanism: Mechanism, effects: Sequence[tuple[Candidate, Mapping[str, float]]]) -> Mechanism:
    """`mechanism` with physical effects added to those that it has.

    Parameters
    ----------
    mechanism : Mechanism
    effects : sequence of (Candidate, mapping)
        With the values of their coordinates by name; faults of sensors are passed over.

    Raises
    ------
    InputError
        A parameter out of its bounds.
    """
    added, formulas = [], {}
    for candidate, values in effects:
        if candidate.sensor:
            continue
        if candidate.name.startswith(_FOUND):
            formulas.setdefault(candidate.name.partition("[")[0], []).append((candidate, values))
        elif candidate.name == "pin_friction" or any(
            value for key, value in values.items() if key in _names(candidate)
        ):
            # without size an effect is absent, but friction in one of two pins stands for this pin's even where it is nominal
            added.append(_effect(candidate.name, candidate.site, candidate.parameters(values)))
    added += [_formula(name, terms) for name, terms in formulas.items()]
    return mechanism.model_copy(update={"effects": (*mechanism.effects, *added)})


def _names(candidate: Candidate) -> set[str]:
    """Keys of an effect's sizes, and their names within a run."""
    return {name for key in candidate.amplitudes for name in (key, key.partition("@")[0])}


def _effect(name: str, site: str, parameters: Mapping[str, Any]) -> Effect:
    known = EFFECTS[name]
    data = {"name": name, "parameters": dict(parameters)} | ({"site": site} if "site" in known.model_fields else {})
    return validate(known, data, name)


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


def softened(effects: Sequence[tuple[Candidate, Mapping[str, float]]]) -> tuple[list, float]:
    """Effects in which a rod stiffer than can be simulated is at the limit, and what share of that limit's effect it has."""
    share, found = 1.0, []
    for candidate, values in effects:
        if candidate.name == "rod_flexibility" and 0.0 < values["compliance_s2"] < LEAST_COMPLIANCE:
            share = values["compliance_s2"] / LEAST_COMPLIANCE
            values = {**values, "compliance_s2": LEAST_COMPLIANCE}
        found.append((candidate, values))
    return found, share


def augmented_mechanism(
    mechanism: Mechanism, hypothesis: Sequence[Candidate] = (), values: Mapping[str, float] | None = None
) -> Mechanism:
    """The mechanism with re-fitted nuisances and physical effects written in.

    Parameters
    ----------
    mechanism : Mechanism
    hypothesis : sequence of Candidate
        Faults of sensors are no part of a mechanism and are passed over.
    values : mapping of str to float
        By key as a fit has them: nuisances by name, coordinates as ``label.coordinate``; those of single runs are passed over.

    Raises
    ------
    InputError
        Values that make the mechanism impossible.
    """
    values = values or {}
    made = with_nuisances(mechanism, {key: v for key, v in values.items() if "@" not in key})
    effects = [(one, _own(one, values)) for one in hypothesis]
    for _, own in effects:
        made = with_nuisances(made, own)  # a nuisance that an effect replaced in part, such as the other pin's friction
    return validate(Mechanism, with_effects(made, effects).model_dump(), "the mechanism with what was found")


def _own(candidate: Candidate, values: Mapping[str, float]) -> dict[str, float]:
    """Values of an effect's coordinates by key, as far as a fit has them: those of held-out runs it has not."""
    keys = {p.key: f"{candidate.label}.{p.key}" for p in candidate.coordinates}
    return {key: values[name] for key, name in keys.items() if name in values}


def mirrored(mechanism: Mechanism) -> Mechanism:
    """A mechanism whose effects are applied as seen from behind, where a clockwise crank turns counter-clockwise."""
    turned = {"crank_unbalance": "angle_rad", "speed_fluctuation": "phase_rad"}
    effects = []
    for effect in mechanism.effects:
        if key := turned.get(effect.name):
            own = effect.parameters.model_copy(update={key: -getattr(effect.parameters, key)})
            effect = effect.model_copy(update={"parameters": own})
        elif effect.name.startswith(_FOUND):
            formula = _OPPOSITE.sub(r"(-\1)", effect.parameters.formula)
            formula = f"-({formula})" if effect.name == "discovered_crank_torque" else formula
            effect = effect.model_copy(update={"parameters": effect.parameters.model_copy(update={"formula": formula})})
        effects.append(effect)
    slider = mechanism.slider.model_copy(update={"offset": -mechanism.slider.offset})
    return mechanism.model_copy(
        update={"slider": slider, "gravity_direction": -mechanism.gravity_direction, "effects": tuple(effects)}
    )
