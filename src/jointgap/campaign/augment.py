"""The mechanism file with the identified effects."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from itertools import zip_longest
from typing import Any

import pandas as pd
import yaml

from jointgap.campaign.fits_on_disk import Outcome, clockwise, nuisances_as_read
from jointgap.campaign.sentences import (
    estimate_row,
    format_effect,
    format_estimate,
    is_fault,
    parameter_rows,
)
from jointgap.config import Effect, Mechanism, Simulate
from jointgap.config.campaign import Campaign
from jointgap.config.load import validate
from jointgap.core.errors import InputError
from jointgap.core.schema import MISSING_FORCE
from jointgap.core.units import split_quantity
from jointgap.core.words import format_nuisance
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.equations import crank_losses, slider_force
from jointgap.dynamics.simulation import simulate
from jointgap.identification.fit import determined_values, effect_estimates, is_taken_over
from jointgap.rig.cylinder_pressure import with_loads
from jointgap.rig.simulate_run import augmented_mechanism, tolerance_for

DIGITS = 7  # significant digits of identified values
EXACT = 17  # digits that preserve every double
_WIDTH = 110  # [characters] of a YAML line, so that short lists stay on one line
_SAMPLES = 360  # per revolution
_SETTLES = 2  # revolutions


def in_file_convention(new: Any, old: Any, text: Any = None, digits: int = DIGITS) -> Any:
    """`new` content of a file with the keys and units of the `text` that contained the `old`
    content."""
    if new == old and text is not None:
        return text
    if isinstance(new, Mapping):
        before, written = (part if isinstance(part, Mapping) else {} for part in (old, text))
        return {
            key: in_file_convention(value, before.get(key), written.get(key), digits)
            for key, value in new.items()
            if key in written or not isinstance(text, Mapping) or before.get(key) != value
        }
    if isinstance(new, list | tuple):
        before, written = (part if isinstance(part, list | tuple) else () for part in (old, text))
        parts = zip_longest(new, before[: len(new)], written[: len(new)])
        return [in_file_convention(*part, digits) for part in parts]
    if not isinstance(new, float) or new == old:
        return new
    if isinstance(text, str) and isinstance(old, float) and old:
        number, unit = split_quantity(text)
        own = re.sub(r"^[-+\N{MINUS SIGN}0-9.eE]+\s*", "", text.strip())
        if unit and own:
            return f"{new / (old / float(number)):.{digits}g} {own}"
    return float(f"{new:.{digits}g}")


def missing_force(
    base: Mechanism,
    augmented: Mechanism,
    speeds: Mapping[str, float],
    clockwise: Collection[str] = (),
    loads: Mapping[str, Sequence[Effect]] | None = None,
) -> pd.DataFrame:
    """Slider force and crank torque of the augmented model minus those of the base, at the same
    motion; `loads` are those of single runs.

    Both are zero for masses, lengths, clearances and sensor faults.
    """
    parts = []
    for run, speed in speeds.items():
        models = [
            one.applied().mirrored() if run in clockwise else one for one in (base, augmented)
        ]
        models = [with_loads(one, (loads or {}).get(run, ())) for one in models]
        if run in clockwise:
            part = _along(run, *models, speed).iloc[::-1]
            turned = {
                "crank_angle": math.tau - part["crank_angle"],
                "crank_torque": -part["crank_torque"],
            }
            parts.append(part.assign(**turned))
        else:
            parts.append(_along(run, *models, speed))
    return pd.concat(parts, ignore_index=True)


def _along(run: str, base: Mechanism, augmented: Mechanism, speed: float) -> pd.DataFrame:
    steps = {"revolutions": _SETTLES + 1, "samples_per_revolution": _SAMPLES}
    options = Simulate(speed=speed, tolerance=tolerance_for(augmented.applied()), **steps)
    samples = simulate(augmented, options).samples.tail(_SAMPLES + 1)
    shown = samples[["crank_angle", "slider_position", "slider_velocity"]].reset_index(drop=True)
    places = samples[
        ["slider_position", "slider_velocity", "crank_speed", "crank_angle", "time"]
    ].to_numpy()
    after, before = parameters(augmented, options), parameters(base, options)
    guide = samples["guide_force"]
    pushes = [
        slider_force(after, n, *at) - slider_force(before, n, *at)
        for n, at in zip(guide, places, strict=True)
    ]
    turns = [crank_losses(after, *at) - crank_losses(before, *at) for at in places]
    angle = shown["crank_angle"] - math.tau * _SETTLES
    return shown.assign(run=run, crank_angle=angle, slider_force=pushes, crank_torque=turns)


def mechanisms(campaign: Campaign, outcome: Outcome) -> tuple[Mechanism, Mechanism]:
    """The mechanism with re-fitted parameters, without and with the effects of the verdict;
    parameters that the data do not determine keep the stated values.
    """
    chosen = outcome.chosen
    augmented = augmented_mechanism(
        campaign.mechanism, chosen.hypothesis, determined_values(chosen)
    )
    plain = outcome.base if chosen.hypothesis else chosen
    return augmented_mechanism(campaign.mechanism, (), determined_values(plain)), augmented


def augment(
    campaign: Campaign,
    outcome: Outcome,
    text: Mapping[str, Any] | None = None,
    loads: Mapping[str, Sequence[Effect]] | None = None,
) -> tuple[str, pd.DataFrame]:
    """The augmented mechanism as YAML with the user's keys and units, and table `MISSING_FORCE`,
    under the `loads` of single runs.
    """
    plain, augmented = mechanisms(campaign, outcome)
    new, old = (mechanism.model_dump(mode="json") for mechanism in (augmented, campaign.mechanism))
    content = in_file_convention(new, old, text)
    try:
        validate(Mechanism, content, "the augmented mechanism")
    except InputError:  # rounding moved a value beyond its bound
        content = in_file_convention(new, old, text, EXACT)
    body = yaml.safe_dump(content, sort_keys=False, width=_WIDTH, allow_unicode=True)
    speeds = {run.id: run.speed for run in campaign.runs if run.role != "confirm"}
    force = pd.DataFrame(columns=MISSING_FORCE.names)
    if any(not candidate.sensor for candidate in outcome.chosen.hypothesis):
        force = missing_force(plain, augmented, speeds, clockwise(campaign), loads)
    return "\n".join([*(f"# {line}" for line in _header(campaign, outcome)), body]), force


def _header(campaign: Campaign, outcome: Outcome) -> list[str]:
    chosen = outcome.chosen
    lines = [
        f"Augmented mechanism of campaign {campaign.name}. Verdict:"
        f" {outcome.verdict.replace('_', ' ')}."
    ]
    for p, estimate in nuisances_as_read(chosen, clockwise(campaign)):
        kept = "" if p.run or is_taken_over(estimate) else ": stated value kept"
        name, *row = estimate_row(format_nuisance(p.key), estimate, p.unit)
        lines.append(f"{name}: {format_estimate(*row)}{kept}")
    for candidate in chosen.hypothesis:
        effect = {
            "name": candidate.name,
            "site": candidate.site,
            "parameters": effect_estimates(chosen, candidate),
        }
        note = " (a sensor fault, not part of the mechanism)" if is_fault(effect) else ""
        for name, *row in parameter_rows([effect]):
            lines.append(f"{format_effect(effect)}: {name}: {format_estimate(*row)}{note}")
    if campaign.own_loads:
        lines.append(
            "Known loads of runs, which the analysis used and which this file does not contain:"
        )
        lines += [f"  {load}" for load in campaign.own_loads]
    return [
        *lines,
        (
            "Run-specific values and intervals are for information only. Numbers without a unit are"
            " in SI."
        ),
    ]
