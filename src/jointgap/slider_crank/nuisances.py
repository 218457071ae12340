"""The nuisances of a campaign as parameters of a fit."""

import math
from collections.abc import Mapping

from jointgap.config import Mechanism
from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.config.load import validate
from jointgap.config.nuisance_bounds import NUISANCES, RUN_NUISANCES
from jointgap.errors import InputError
from jointgap.identification.protocol import Parameter
from jointgap.joints import PINS
from jointgap.slider_crank.modified_mechanism import friction_speed, lasting_damping, with_nuisances
from jointgap.slider_crank.sample_grid import SampleGrid
from jointgap.slider_crank.settings import DEFAULT_SETTINGS, NuisanceSettings


def shared_nuisances(
    campaign: Campaign, settings: NuisanceSettings = DEFAULT_SETTINGS.nuisances
) -> tuple[Parameter, ...]:
    """Those of the mechanism and its sensors that all runs share."""
    nuisances = []
    for key in campaign.nuisance:
        if key not in RUN_NUISANCES and key not in campaign.idle_nuisances:
            nominal = campaign.nominals(key)[0]
            low, high = campaign.bounds(key, nominal)
            nuisances.append(_parameter(settings, key, nominal, low, high, NUISANCES[key] or "1"))
    if (width := friction_speed(campaign.mechanism)) is not None:
        low, high = width / settings.friction_speed_factor, width * settings.friction_speed_factor
        nuisances.append(_parameter(settings, "friction_speed", width, low, high, "m/s"))
    reach = math.log(settings.lasting_damping_factor)
    for name in lasting_damping(campaign.mechanism).values():
        nuisances.append(_parameter(settings, name, 0.0, -reach, reach, "1"))
    return tuple(nuisances)


def check_bounds(campaign: Campaign) -> None:
    """Make sure that the mechanism is possible at the ends of its nuisances' bounds.

    One at a time, the others at nominal; and where lengths and clearances together leave the crank least room to turn.
    """
    bounds = {p.name: (p.low, p.high) for p in shared_nuisances(campaign) if p.name in campaign.nuisance}
    tightest = {"crank_length": 1, "rod_length": 0} | {f"{pin}_clearance": 1 for pin in PINS}
    together = {key: bounds[key][end] for key, end in tightest.items() if key in bounds}
    alone = [{key: end} for key, ends in bounds.items() for end in ends]
    for values in [*alone, together] if len(together) > 1 else alone:
        _check_possible(campaign, values)


def _check_possible(campaign: Campaign, values: Mapping[str, float]) -> None:
    at = ", ".join(f"{key} = {value:g} {NUISANCES[key]}".rstrip() for key, value in values.items())
    source = f"campaign {campaign.name}, nuisance, at the bound {at}"
    try:
        validate(Mechanism, with_nuisances(campaign.mechanism, values).model_dump(), source)
    except InputError as error:
        raise InputError(f"{error}; or give narrower bounds") from error


def run_nuisances(
    campaign: Campaign,
    run: CampaignRun,
    samples: SampleGrid,
    first_angle_searched: bool,
    settings: NuisanceSettings = DEFAULT_SETTINGS.nuisances,
) -> tuple[Parameter, ...]:
    """What a run has for itself, as far as it is not exact: zeros of its sensors, speed, first angle, motor's line.

    Where the measured angle drives the crank, its speed and first angle are in the drive, and are no nuisances.
    """
    nuisances = []
    for key in RUN_NUISANCES:
        if key != "speed" and key in campaign.nuisance and key not in campaign.idle_nuisances:
            (nominal,) = campaign.nominals(key)
            low, high = campaign.bounds(key, nominal)
            nuisances.append(_parameter(settings, key, nominal, low, high, NUISANCES[key], run.id))
    if campaign.drive == "measured_angle":
        return tuple(nuisances)
    if samples.encoded and samples.speed_reach > 0:
        low, high = samples.speed - samples.speed_reach, samples.speed + samples.speed_reach
        nuisances.append(_parameter(settings, "speed", samples.speed, low, high, "rad/s", run.id))
    elif not samples.encoded and "speed" in campaign.nuisance:
        low, high = campaign.bounds("speed", run.speed)
        nuisances.append(_parameter(settings, "speed", min(max(samples.speed, low), high), low, high, "rad/s", run.id))
    reach = settings.first_angle_reach_rad if first_angle_searched else samples.first_reach
    if reach > 0:
        first = samples.first_angle
        nuisances.append(_parameter(settings, "first_angle", first, first - reach, first + reach, "rad", run.id))
    return tuple(nuisances)


def _parameter(
    settings: NuisanceSettings, name: str, nominal: float, low: float, high: float, unit: str, run: str | None = None
) -> Parameter:
    return Parameter(name, nominal, low, high, settings.step_share_of_bounds * (high - low), unit, run)
