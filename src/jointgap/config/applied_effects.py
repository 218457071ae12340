"""Folding effects that merely change a mechanism's data into these data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from jointgap.effects import Effect
from jointgap.errors import InputError
from jointgap.joints import FROM_FRAME

if TYPE_CHECKING:
    from jointgap.config.mechanism_config import Mechanism

_CLEARANCES = {f"{joint}_clearance": joint for joint in FROM_FRAME}
_ALWAYS = {"added_slider_mass", "slider_offset", "link_length_error", *_CLEARANCES}


def changes_data(mechanism: Mechanism, effect: Effect) -> bool:
    """Whether `effect` is nothing but other data of `mechanism`: friction in an ideal pin is more, in a loose one it is not."""
    if effect.name != "pin_friction":
        return effect.name in _ALWAYS
    clearance = mechanism.effect(f"{effect.site}_clearance")
    return effect.site in mechanism.loose if clearance is None else clearance.clearance_m > 0


def apply_effects(mechanism: Mechanism) -> dict[str, Any]:
    """Content of a mechanism file in which the effects that change data are folded into these; the rest stay effects.

    Raises
    ------
    InputError
        A clearance for a joint that has no data.
    """
    data = mechanism.model_dump()
    folded = [effect for effect in mechanism.effects if changes_data(mechanism, effect)]
    data["effects"] = [effect.model_dump() for effect in mechanism.effects if effect not in folded]
    for effect in folded:
        values = effect.parameters
        if effect.name == "added_slider_mass":
            data["slider"]["mass"] += values.mass_kg
        elif effect.name == "slider_offset":
            data["slider"]["offset"] += values.offset_m
        elif effect.name == "link_length_error":
            for link, error in ((data["crank"], values.crank_m), (data["rod"], values.rod_m)):
                link["mass_centre"] *= (link["length"] + error) / link["length"]
                link["length"] += error
        else:
            _fold_into_joint(data["joints"], effect)
    return data


def _fold_into_joint(joints: dict[str, Any], effect: Effect) -> None:
    name = _CLEARANCES.get(effect.name) or effect.site
    if joints[name] == "ideal":
        raise InputError(
            f"effects: {effect.name} needs the data of {name}; write the joint as a mapping with journal, journal_radius, "
            "bearing_radius and contact, and 'loose: false' where it is to be ideal otherwise"
        )
    if effect.name == "pin_friction":
        joints[name]["contact"] |= {"friction": effect.parameters.coefficient}
    elif effect.parameters.clearance_m > 0:
        radius = joints[name]["journal_radius"] + effect.parameters.clearance_m
        joints[name] |= {"loose": True, "bearing_radius": radius}
    else:
        joints[name]["loose"] = False
