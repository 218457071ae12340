"""Stage augment: the mechanism with what was found written in, ready for every other stage."""

from collections.abc import Mapping
from typing import Any

import pandas as pd
import yaml

from jointgap import tables
from jointgap.campaign.as_written import EXACT, as_written
from jointgap.campaign.clockwise import clockwise, nuisances_as_read
from jointgap.campaign.missing_force import missing_force
from jointgap.campaign.phrasing import effect_in_words, estimate_row, is_fault, parameter_in_words, unit_of
from jointgap.campaign.tables_of_identification import Outcome
from jointgap.config import Mechanism
from jointgap.config.campaign_file import Campaign
from jointgap.config.load import validate
from jointgap.errors import InputError
from jointgap.identification.estimates import determined_values, effect_estimates, is_taken_over
from jointgap.identification.protocol import Parameter
from jointgap.report.plain_words import nuisance_in_words
from jointgap.slider_crank import augmented_mechanism

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
    columns = [column.name for column in tables.MISSING_FORCE.columns]
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
