"""Stage preflight: identifiability of a planned campaign.

Existing files of runs give only the number of samples, the revolutions (chaotic motion) and, if all
exist, the crank motion (driven by a motor or by a measured angle). Missing ones are planned as in
`jointgap.rig.sampling`.
"""

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np
import pandas as pd

from jointgap.campaign.sentences import format_detectable, format_label, names_to_labels, unit_of
from jointgap.config.campaign import Campaign, Channel
from jointgap.config.channels import CHANNELS, PRESSURES
from jointgap.core.candidates import Model
from jointgap.core.schema import CONFUSABILITY
from jointgap.core.words import joined, number
from jointgap.identification.preflight import advise, preflight
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from jointgap.rig.model import build_model
from jointgap.rig.read_files import read_measurements
from jointgap.rig.recording import Measurements, Recording

_FASTER, _SLOWER = 1.5, 0.5
"""Further speeds that are tried [1, of the fastest and of the slowest]."""

_SEPARATOR, _BETWEEN_TEXTS = " | ", "; "
_MOST_ADVICE = 3  # lines
ADVICE = "A further"  # begin of a sentence that advises a run or channel


def preflight_tables(
    campaign: Campaign,
    rate: float,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
    advice: bool = False,
) -> dict[str, pd.DataFrame]:
    """Detectability and confusability of effects; with `advice` the gain of one further speed or
    channel."""
    campaign, recordings = recorded(campaign)
    model, frames = _as_recorded(campaign, recordings), {}
    if advice:
        more = extended(campaign)
        if (
            like := recordings.get(campaign.runs[0].id)
        ) is not None:  # as long as the first run, all for fitting
            for_fitting = replace(like, held_out=np.zeros_like(like.held_out))
            recordings |= {run.id: for_fitting for run in more.runs[len(campaign.runs) :]}
        lengths = revolutions(more, recordings)
        plan, wider = (build_model(each, None, lengths) for each in (campaign, more))
        wider.candidates = plan.candidates  # no faults of the additional sensors
        planned = [series.key for series in plan.series]
        found, changes = advise(wider, planned, None, rate, counts(wider, recordings), settings)
        texts = {name: changes[name].map(", ".join) for name in ("newly_detectable", "separated")}
        frames["advice"] = changes.assign(**texts)
    if model is not None or not advice:
        model = model or build_model(campaign, None, revolutions(campaign, recordings))
        found = preflight(model, None, rate, counts(model, recordings), settings)
    effects = found.effects
    # a stated parameter may differ from the fitted one; its unit is in the catalogue
    units = [
        row.unit or unit_of(*row.label.partition(":")[::2], row.parameter)
        for row in effects.itertuples()
    ]
    failed = [found.failed.get(label) for label in effects["label"]]
    frames["detectable"] = effects.assign(
        unit=units, failed=failed, assumed=_BETWEEN_TEXTS.join(found.assumed)
    )
    together = {frozenset(pair) for group in found.merged for pair in combinations(group, 2)}
    labels = list(found.cosines.columns)
    rows = [
        (a, b, found.cosines.loc[a, b], frozenset((a, b)) in together)
        for a in labels
        for b in labels
    ]
    return frames | {"confusability": pd.DataFrame(rows, columns=CONFUSABILITY.names)}


def confusable_groups(confusability: pd.DataFrame) -> list[list[str]]:
    """Groups of indistinguishable effects, from table `CONFUSABILITY`."""
    merged = confusability[confusability["merged"]].groupby("first", sort=False)["second"]
    return [
        list(group)
        for group in dict.fromkeys(tuple(sorted({first, *others})) for first, others in merged)
    ]


def undetectable(detectable: pd.DataFrame) -> list[str]:
    """Effects that are not detectable within their bounds or cannot be simulated, from table
    `DETECTABLE`."""
    seen = detectable.groupby("label", sort=False)["detectable"].any()
    return list(seen.index[~seen])


def assumed(detectable: pd.DataFrame) -> list[str]:
    """Assumed noise by run and channel, from table `DETECTABLE`."""
    return [
        text
        for texts in detectable["assumed"].unique()
        for text in texts.split(_BETWEEN_TEXTS)
        if text
    ]


def _as_recorded(campaign: Campaign, recordings: Mapping[str, Recording]) -> Model | None:
    """The model with the recorded crank motion; None if that is unknown or constant.

    Inertia at a varying speed separates effects that are indistinguishable at constant speed.
    """
    runs = [run.id for run in campaign.runs]
    if campaign.drive == "constant_speed" or any(run not in recordings for run in runs):
        return None
    return build_model(campaign, Measurements({run: recordings[run] for run in runs}))


def recorded(campaign: Campaign) -> tuple[Campaign, dict[str, Recording]]:
    """The campaign without unusable runs, and the recordings whose files exist."""
    there = tuple(
        run
        for run in campaign.runs
        if all(os.path.isfile(campaign.folder / file) for file in run.files)
    )
    measured = read_measurements(campaign.model_copy(update={"runs": there}), compared=False)
    runs = tuple(run for run in campaign.runs if run.id not in measured.left_out)
    return campaign.model_copy(update={"runs": runs}), dict(measured.runs)


def revolutions(campaign: Campaign, recordings: Mapping[str, Recording]) -> dict[str, float]:
    """Revolutions in each recording; without angles from the run's speed."""
    speeds, turned = {run.id: run.speed for run in campaign.runs}, {}
    for run, recording in recordings.items():
        angle = recording.crank_angle if recording.has_angle else speeds[run] * recording.time
        turned[run] = (
            float(np.ptp(angle[np.isfinite(angle)])) / math.tau * angle.size / (angle.size - 1)
        )
    return turned


def counts(model: Model, recordings: Mapping[str, Recording]) -> dict[tuple[str, str], int]:
    """Number of fitted samples by recording and channel; the number of rows for a channel that is
    not recorded."""
    counted = {}
    for run, channel in (series.key for series in model.series if series.run in recordings):
        recording = recordings[run]
        measured = recording.channels | {"crank_angle": recording.crank_angle}
        values = measured.get(channel, np.zeros(recording.held_out.size))
        counted[run, channel] = int(np.count_nonzero(np.isfinite(values) & ~recording.held_out))
    return counted


def extended(campaign: Campaign) -> Campaign:
    """The campaign with a slower and a faster run and all possible channels."""
    speeds = sorted(run.speed for run in campaign.runs)
    runs = [  # ids of measured runs contain no blank, so these are new ones
        campaign.runs[0].model_copy(
            update={
                "id": f"at {number(speed * 30 / math.pi)} rpm",
                "file": "-",
                "speed": speed,
                "role": "identify",
            }
        )
        for speed in (_SLOWER * speeds[0], _FASTER * speeds[-1])
    ]
    inputs = (
        "time",
        "crank_angle",
        "crank_speed",
        *PRESSURES,
    )  # prescribed by the drive, and known loads
    channels = {
        name: Channel(column=f"({name})", unit=unit.replace("^", "**"))
        for name, unit in CHANNELS.items()
        if name not in (*campaign.channels, *inputs)
    }
    return campaign.model_copy(
        update={"runs": (*campaign.runs, *runs), "channels": campaign.channels | channels}
    )


def separated_by(
    advice: pd.DataFrame, explanations: list[set[str]], merged: Iterable[Iterable[str]]
) -> str:
    """A sentence: the further measurement that separates `explanations`."""
    first, *others = explanations
    differing = {
        frozenset((a, b)) for other in others for a in first - other for b in other - first
    }
    if not any(pair <= set(group) for pair in differing for group in merged):
        return (
            "According to the preflight a longer record, or one with less noise, should separate"
            " them."
        )
    for row in advice.itertuples():
        separated = {
            frozenset(pair.split(_SEPARATOR)) for pair in row.separated.split(", ") if pair
        }
        if differing & separated:
            return f"{ADVICE} {row.change} would separate them."
    return "No single further speed or channel of those that were tested would separate them."


def preflight_summary(
    detectable: pd.DataFrame, confusability: pd.DataFrame, advice: pd.DataFrame | None
) -> str:
    lines = ["Smallest detectable size of each effect:"]
    for row in detectable[detectable["detectable"]].itertuples():
        lines.append(f"  {format_label(row.label)}: {format_detectable(row)}")
    failed = detectable[detectable["failed"].notna()]
    if absent := [label for label in undetectable(detectable) if label not in set(failed["label"])]:
        lines.append(f"Not detectable with these runs: {joined(map(format_label, absent))}")
    for row in failed.itertuples():
        lines.append(
            f"Detectability unknown, simulation failed: {format_label(row.label)} ({row.failed})"
        )
    for group in confusable_groups(confusability):
        lines.append(f"Indistinguishable: {joined(map(format_label, group))}")
    for row in () if advice is None else advice.head(_MOST_ADVICE).itertuples():
        shown = [format_label(label) for label in row.newly_detectable.split(", ") if label]
        pairs = [pair.split(_SEPARATOR) for pair in row.separated.split(", ") if pair]
        gains = [f"detects {joined(shown)}"] if shown else []
        apart = ", ".join(" from ".join(map(format_label, pair)) for pair in pairs)
        gains += [f"separates {apart}"] if pairs else []
        if gains:
            lines.append(f"A further {names_to_labels(row.change)} {' and '.join(gains)}")
    if noise := assumed(detectable):
        lines.append("Assumed noise (the campaign file states none):")
        lines += [f"  {names_to_labels(text)}" for text in noise]
    return "\n".join(lines)
