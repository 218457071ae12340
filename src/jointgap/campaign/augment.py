"""The mechanism with what was found."""

import math
import re
from collections.abc import Collection, Mapping
from typing import Any

import pandas as pd
import yaml

from jointgap.campaign.fits_on_disk import Outcome, clockwise, nuisances_as_read
from jointgap.campaign.sentences import effect_in_words, estimate_row, is_fault, parameter_in_words, unit_of
from jointgap.config import Mechanism, Simulate
from jointgap.config.campaign import Campaign
from jointgap.config.load import validate
from jointgap.core import schema
from jointgap.core.candidates import Parameter
from jointgap.core.errors import InputError
from jointgap.core.units import split_quantity
from jointgap.core.words import nuisance_in_words
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.equations import crank_losses, slider_force
from jointgap.dynamics.simulation import simulate
from jointgap.identification.fit import determined_values, effect_estimates, is_taken_over
from jointgap.rig.simulate_run import augmented_mechanism, tolerance_for

DIGITS = 7  # of a number that was found: far below what it is known to, and far from digits that mean nothing
EXACT = 17  # digits that every number keeps its value with

_MISSING = object()


def as_written(new: Any, old: Any, text: Any = _MISSING, digits: int = DIGITS) -> Any:
    """`new` content of a file in the words of the one that it is changed from."""
    if new == old and text is not _MISSING:
        return text
    if isinstance(new, Mapping):
        before, written = (part if isinstance(part, Mapping) else {} for part in (old, text))
        left_out = text is not _MISSING and isinstance(text, Mapping)
        return {
            key: as_written(value, before.get(key, _MISSING), written.get(key, _MISSING), digits)
            for key, value in new.items()
            if not (left_out and key not in written and key in before and before[key] == value)
        }
    if isinstance(new, list | tuple):
        before, written = (list(part) if isinstance(part, list | tuple) else [] for part in (old, text))
        return [
            as_written(
                value,
                before[place] if place < len(before) else _MISSING,
                written[place] if place < len(written) else _MISSING,
                digits,
            )
            for place, value in enumerate(new)
        ]
    if not isinstance(new, float):
        return new
    if new == old:
        return new
    return _in_its_unit(new, old, text, digits) or float(f"{new:.{digits}g}")


def _in_its_unit(new: float, old: Any, text: Any, digits: int) -> str | None:
    """A number in the unit in which the user wrote the one that it takes the place of; None where that has none."""
    if not isinstance(text, str) or not isinstance(old, float) or not old:
        return None
    number, unit = split_quantity(text)
    if not unit:
        return None
    per_unit = old / float(number)
    own = re.sub(r"^[-+\N{MINUS SIGN}0-9.eE]+\s*", "", text.strip())
    return f"{new / per_unit:.{digits}g} {own}" if own else None


_SAMPLES = 360  # of the one revolution that is shown
_SETTLES = 2  # revolutions


def missing_force(
    base: Mechanism, augmented: Mechanism, speeds: Mapping[str, float], clockwise: Collection[str] = ()
) -> pd.DataFrame:
    """Force on the slider and torque on the crank of the augmented model less those of the base, at the same motion.

    Effects that act otherwise (masses, lengths, clearances, sensors) leave both at zero.
    """
    parts = []
    for run, speed in speeds.items():
        if run not in clockwise:
            parts.append(_along(run, base, augmented, speed))
            continue
        behind = _along(run, base.applied().mirrored(), augmented.applied().mirrored(), speed).iloc[::-1]
        turned = {"crank_angle": math.tau - behind["crank_angle"], "crank_torque": -behind["crank_torque"]}
        parts.append(behind.assign(**turned))
    return pd.concat(parts, ignore_index=True)


def _along(run: str, base: Mechanism, augmented: Mechanism, speed: float) -> pd.DataFrame:
    options = Simulate(
        speed=speed,
        revolutions=_SETTLES + 1,
        samples_per_revolution=_SAMPLES,
        tolerance=tolerance_for(augmented.applied()),
    )
    samples = simulate(augmented, options).samples.tail(_SAMPLES + 1)
    places = samples[["slider_position", "slider_velocity", "crank_speed", "crank_angle", "time"]].to_numpy()
    guide = samples["guide_force"].to_numpy()
    after, before = parameters(augmented, options), parameters(base, options)
    pushes = [slider_force(after, n, *at) - slider_force(before, n, *at) for n, at in zip(guide, places, strict=True)]
    turns = [crank_losses(after, *at) - crank_losses(before, *at) for at in places]
    return pd.DataFrame(
        {
            "run": run,
            "crank_angle": samples["crank_angle"].to_numpy() - math.tau * _SETTLES,
            "slider_position": places[:, 0],
            "slider_velocity": places[:, 1],
            "slider_force": pushes,
            "crank_torque": turns,
        }
    )


_WIDTH = 110  # [characters] of a line of YAML: short lists stay on one


def mechanisms(campaign: Campaign, outcome: Outcome) -> tuple[Mechanism, Mechanism]:
    """The recalibrated mechanism without and with the effects of the verdict; parameters that the data do not determine
    stay as stated.
    """
    chosen = outcome.chosen
    augmented = augmented_mechanism(campaign.mechanism, chosen.hypothesis, determined_values(chosen))
    plain = outcome.base if chosen.hypothesis else chosen
    return augmented_mechanism(campaign.mechanism, (), determined_values(plain)), augmented


def augment(campaign: Campaign, outcome: Outcome, text: Mapping[str, Any] | None = None) -> tuple[str, pd.DataFrame]:
    """The augmented mechanism as a YAML file, and what its effects push and turn with."""
    plain, augmented = mechanisms(campaign, outcome)
    body = yaml.safe_dump(_content(augmented, campaign, text), sort_keys=False, width=_WIDTH, allow_unicode=True)
    speeds = {run.id: run.speed for run in campaign.runs if run.role != "confirm"}
    columns = [column.name for column in schema.MISSING_FORCE.columns]
    physical = any(not candidate.sensor for candidate in outcome.chosen.hypothesis)
    force = missing_force(plain, augmented, speeds, clockwise(campaign)) if physical else pd.DataFrame(columns=columns)
    return "\n".join([*(f"# {line}" for line in _header(campaign, outcome)), body]), force


def _content(augmented: Mechanism, campaign: Campaign, text: Mapping[str, Any] | None) -> dict[str, Any]:
    """The augmented mechanism in the user's words."""
    new, old = (mechanism.model_dump(mode="json") for mechanism in (augmented, campaign.mechanism))
    given = {} if text is None else {"text": text}
    content = as_written(new, old, **given)
    try:
        validate(Mechanism, content, "the mechanism with what was found")
    except InputError:  # a number at its bound, which fewer digits put beyond it
        content = as_written(new, old, digits=EXACT, **given)
    return content


def _header(campaign: Campaign, outcome: Outcome) -> list[str]:
    chosen = outcome.chosen
    lines = [f"The mechanism of campaign {campaign.name} with what was found: {outcome.verdict.replace('_', ' ')}."]
    lines += [
        _line(estimate_row(nuisance_in_words(p.key), estimate, p.unit)) + _kept(p, estimate)
        for p, estimate in nuisances_as_read(chosen, clockwise(campaign))
    ]
    for candidate in chosen.hypothesis:
        effect = {"name": candidate.name, "site": candidate.site}
        note = " (a fault of the sensor, no part of the mechanism)" if is_fault(effect) else ""
        for name, estimate in effect_estimates(chosen, candidate).items():
            words = f"{effect_in_words(effect)}: {parameter_in_words(candidate.name, name)}"
            unit = unit_of(candidate.name, candidate.site, name)
            lines.append(_line(estimate_row(words, estimate, unit)) + note)
    return [
        *lines,
        "Values that belong to one run, and intervals, are for reading only. A number without a unit is SI.",
    ]


def _kept(parameter: Parameter, estimate: Mapping[str, Any]) -> str:
    return "" if parameter.run or is_taken_over(parameter, estimate) else ": not taken over"


def _line(row: tuple[str, str, str, str]) -> str:
    """A row of an estimate as a comment."""
    name, value, interval, remark = row
    sure = f", 90 % interval {interval}" if interval != "–" else ""
    return f"{name}: {value}{sure}" + (f" ({remark})" if remark else "")
