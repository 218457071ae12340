"""Which injected effects are none: they leave the motion as it is, or as a stated parameter may make it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jointgap.config.load import load_campaign, validate
from jointgap.config.mechanism_config import Mechanism
from jointgap.core.candidates import Candidate, Parameter
from jointgap.effects import EFFECTS
from jointgap.rig.model import build_model


def idle_effects(campaign_file: Path, effects: Sequence[Mapping[str, Any]]) -> list[bool]:
    """Whether each effect is none: within the range that the campaign states for what it changes, or overwritten.

    A slider of 0.487 kg is no added mass where the file says 0.454 to 0.492 kg: the model without an effect leaves
    noise alone, and a name for it would be wrong. Gaps do not tell where joints are loose, since the recalibration by
    which they are measured is linear. Friction of a pin is none beside a clearance that states its contact's friction.
    """
    if not effects:
        return []
    campaign = load_campaign(campaign_file)
    model = build_model(campaign)
    stated = {nuisance.name: nuisance for nuisance in model.nuisances}
    candidates = {(candidate.name, candidate.site): candidate for candidate in model.candidates}
    return [
        _is_within(candidates.get((effect["name"], effect["site"])), stated, effect["parameters"])
        or _is_overwritten(campaign.mechanism, effect, effects)
        for effect in effects
    ]


def _is_within(candidate: Candidate | None, stated: Mapping[str, Parameter], parameters: Mapping[str, float]) -> bool:
    """Whether `parameters` [SI] of an effect lie between those at either end of the nuisances that it replaces."""
    # Where it leaves the rest of a shared nuisance as it is, the effect is that the two differ.
    if (
        candidate is None
        or not candidate.replaces
        or candidate.replaces.keys() & {coordinate.name for coordinate in candidate.coordinates}
    ):
        return False
    ranges = {amplitude: stated[name] for name, amplitude in reversed(candidate.replaces.items())}

    def at(end: str) -> dict[str, float]:
        """The parameters at one end of all ranges; what no nuisance stands for is absent."""
        values = {key: getattr(p, end) - p.nominal for key, p in ranges.items()}
        return candidate.parameters(dict.fromkeys(candidate.amplitudes, 0.0) | values)

    low, high = at("low"), at("high")
    return all(low[key] <= parameters.get(key, 0.0) <= high[key] for key in low)


def _is_overwritten(mechanism: Mechanism, effect: Mapping[str, Any], effects: Sequence[Mapping[str, Any]]) -> bool:
    """Whether a `mechanism` with all `effects` is the same without this one."""

    def changed(chosen: Sequence[Mapping[str, Any]]) -> Mechanism:
        entries = [
            {"name": one["name"], "parameters": one["parameters"]}
            | ({"site": one["site"]} if EFFECTS[one["name"]].sites() else {})
            for one in chosen
        ]
        content = mechanism.model_dump() | {"effects": entries}
        return validate(Mechanism, content, "the mechanism with what is hidden").applied()

    if effect["name"] not in EFFECTS:
        return False
    moving = [one for one in effects if one["name"] in EFFECTS]
    return changed(moving) == changed([one for one in moving if one is not effect])
