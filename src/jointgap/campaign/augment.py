"""Stage augment: the mechanism with what was found written in, ready for every other stage."""

import pandas as pd
import yaml

from jointgap import tables
from jointgap.campaign.clockwise import clockwise, nuisances_as_read
from jointgap.campaign.missing_force import missing_force
from jointgap.campaign.tables_of_identification import Outcome
from jointgap.config import Mechanism
from jointgap.config.campaign_file import Campaign
from jointgap.identification.estimates import effect_estimates
from jointgap.slider_crank import augmented_mechanism

_WIDTH = 110  # [characters] of a line of YAML: short lists stay on one


def mechanisms(campaign: Campaign, outcome: Outcome) -> tuple[Mechanism, Mechanism]:
    """The recalibrated mechanism without and with the effects of the verdict.

    Parameters
    ----------
    campaign : Campaign
    outcome : Outcome

    Raises
    ------
    InputError
        Values that make the mechanism impossible.
    """
    chosen = outcome.chosen
    augmented = augmented_mechanism(campaign.mechanism, chosen.hypothesis, chosen.mapping)
    plain = outcome.base if chosen.hypothesis else chosen
    return augmented_mechanism(campaign.mechanism, (), plain.mapping), augmented


def augment(campaign: Campaign, outcome: Outcome) -> tuple[str, pd.DataFrame]:
    """The augmented mechanism as a YAML file, and what its effects push and turn with.

    Parameters
    ----------
    campaign : Campaign
    outcome : Outcome

    Returns
    -------
    text : str
        `jointgap.config.load_mechanism` accepts it; the uncertainties stand in comments.
    force : DataFrame
        Table `jointgap.tables.MISSING_FORCE`; empty where no effect is named.

    Raises
    ------
    InputError, SimulationError
        The mechanism with what was found cannot be simulated.
    """
    plain, augmented = mechanisms(campaign, outcome)
    body = yaml.safe_dump(augmented.model_dump(mode="json"), sort_keys=False, width=_WIDTH, allow_unicode=True)
    speeds = {run.id: run.speed for run in campaign.runs if run.role != "confirm"}
    columns = [column.name for column in tables.MISSING_FORCE.columns]
    physical = any(not candidate.sensor for candidate in outcome.chosen.hypothesis)
    force = missing_force(plain, augmented, speeds, clockwise(campaign)) if physical else pd.DataFrame(columns=columns)
    return "\n".join([*(f"# {line}" for line in _header(campaign, outcome)), body]), force


def _header(campaign: Campaign, outcome: Outcome) -> list[str]:
    chosen = outcome.chosen
    lines = [f"The mechanism of campaign {campaign.name} with what was found: {outcome.verdict}."]
    for p, estimate in nuisances_as_read(chosen, clockwise(campaign)):
        error = "" if estimate["sd"] is None else f" +- {estimate['sd']:.2g}"
        line = f"{p.key}: {estimate['value']:.6g}{error} {p.unit}".removesuffix(" 1")
        lines.append(line + (f" ({estimate['remark']})" if estimate["sd"] is None else ""))
    for candidate in chosen.hypothesis:
        for name, estimate in effect_estimates(chosen, candidate).items():
            sensor = " (a fault of the sensor, no part of the mechanism)" if candidate.sensor else ""
            lines.append(f"{candidate.label}, {name}: {estimate['value']:.6g}{_error(estimate)}{sensor}")
    return [*lines, "Values that belong to one run, and standard errors, are for reading only. All numbers are SI."]


def _error(estimate: dict) -> str:
    if estimate["sd"] is None:
        return f" ({estimate['remark']})"
    low, high = estimate["interval_90"]
    return f" +- {estimate['sd']:.2g}, 90 % {low:.6g} to {high:.6g}"
