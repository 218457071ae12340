"""Identifiability of effects: in a planned campaign, and in measured data.

Existing files of runs give only the number of samples, the revolutions (chaotic motion) and, if all
exist, the crank motion (driven by a motor or by a measured angle). Missing ones are planned as in
`jointgap.rig.sampling`.
"""

import math
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import pandas as pd

from jointgap.campaign.labels import format_detectable, format_label, names_to_labels, unit_of
from jointgap.campaign.tables import BETWEEN_TEXTS
from jointgap.config.campaign import Campaign, Channel
from jointgap.config.channels import PRESSURES
from jointgap.core.candidates import Candidate, Model
from jointgap.core.results_folder import Frames
from jointgap.core.schema import CONFUSABILITY
from jointgap.core.words import joined, number
from jointgap.identification.baseline import Baseline
from jointgap.identification.preflight import Preflight, advise, detectability, preflight
from jointgap.identification.screening import Sensitivities
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from jointgap.rig.model import build_model
from jointgap.rig.read_files import read_measurements
from jointgap.rig.recording import Measurements, Recording

_FASTER, _SLOWER = 1.5, 0.5
"""Speeds of further runs [1, of the fastest and of the slowest run]."""

_PRESCRIBED = ("time", "crank_angle", "crank_speed", *PRESSURES)
"""Channels that the drive or known loads prescribe: no candidates for a further channel."""

_SEPARATOR = " | "
_MOST_ADVICE = 3  # lines
ADVICE = "A further"  # begin of a sentence that advises a run or channel


def preflight_tables(
    campaign: Campaign,
    rate: float,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
    advice: bool = False,
) -> Frames:
    """Detectability and confusability of effects; with `advice` the gain of one further speed or
    channel."""
    campaign, recordings = recorded(campaign)
    model, frames = _model_of_recorded_motion(campaign, recordings), {}
    if advice:
        result, frames["advice"] = _advise(campaign, recordings, rate, settings)
    if model is not None or not advice:
        model = model or build_model(campaign, None, revolutions(campaign, recordings))
        result = preflight(model, None, rate, counts(model, recordings), settings)
    return detectability_of(result) | frames


def detectability_tables(baseline: Baseline, sensitivities: Sensitivities, rate: float) -> Frames:
    """Detectability and confusability of effects in the measured data, from the `sensitivities`
    about the fitted model."""
    problem, base, differences = baseline.problem, baseline.base, baseline.differences
    return detectability_of(detectability(problem, base, differences, sensitivities, rate))


def detectability_of(result: Preflight) -> Frames:
    """Tables `DETECTABLE` and `CONFUSABILITY` of a preflight."""
    effects, labels = result.effects, list(result.cosines.columns)
    detectable = effects.assign(
        # a stated parameter may differ from the fitted one; its unit is in the catalogue
        unit=[
            row.unit or unit_of(*row.label.partition(":")[::2], row.parameter)
            for row in effects.itertuples()
        ],
        failed=[result.failed.get(label) for label in effects["label"]],
        assumed=BETWEEN_TEXTS.join(result.assumed),
    )
    merged = {frozenset(pair) for group in result.merged for pair in combinations(group, 2)}
    rows = [
        (first, second, cosine, frozenset((first, second)) in merged)
        for first, cosines in zip(labels, result.cosines.to_numpy(), strict=True)
        for second, cosine in zip(labels, cosines, strict=True)
    ]
    confusability = pd.DataFrame(rows, columns=CONFUSABILITY.names)
    return {"detectable": detectable, "confusability": confusability}


def _advise(
    campaign: Campaign,
    recordings: Mapping[str, Recording],
    rate: float,
    settings: IdentificationSettings,
    labels: Collection[str] = (),
) -> tuple[Preflight, pd.DataFrame]:
    """The preflight of the campaign, and table `ADVICE`; for the effects `labels` only, if any."""
    extension = extended(campaign)
    if (recording := recordings.get(campaign.runs[0].id)) is not None:
        # further runs are as long as the first one, all for fitting
        fitted = replace(recording, held_out=np.zeros_like(recording.held_out))
        further = extension.runs[len(campaign.runs) :]
        recordings = {**recordings, **{run.id: fitted for run in further}}
    lengths = revolutions(extension, recordings)
    plan, wider = (build_model(model, None, lengths) for model in (campaign, extension))
    wider.candidates = _with_carriers(plan.candidates, labels)  # no faults of additional sensors
    planned = [series.key for series in plan.series]
    result, advice = advise(wider, planned, None, rate, counts(wider, recordings), settings)
    lists = {name: advice[name].map(", ".join) for name in ("newly_detectable", "separated")}
    return result, advice.assign(**lists)


def _with_carriers(candidates: Sequence[Candidate], labels: Collection[str]) -> tuple:
    """The candidates `labels` and those that they modulate; all without labels."""
    chosen = [candidate for candidate in candidates if not labels or candidate.label in labels]
    carriers = {candidate.carrier for candidate in chosen}
    return tuple(c for c in candidates if c in chosen or c.label in carriers)


def confusable_groups(confusability: pd.DataFrame) -> list[list[str]]:
    """Groups of indistinguishable effects, from table `CONFUSABILITY`."""
    merged = confusability[confusability["merged"]].groupby("first", sort=False)["second"]
    groups = (tuple(sorted({label, *similar})) for label, similar in merged)
    return [list(group) for group in dict.fromkeys(groups)]


def undetectable(detectable: pd.DataFrame) -> list[str]:
    """Effects that are not detectable within their bounds, from table `DETECTABLE`; those whose
    detectability is unknown are not among them."""
    known = detectable[detectable["failed"].isna()]
    is_detectable = known.groupby("label", sort=False)["detectable"].any()
    return list(is_detectable.index[~is_detectable])


def assumed(detectable: pd.DataFrame) -> list[str]:
    """Assumed noise by run and channel, from table `DETECTABLE`."""
    texts = BETWEEN_TEXTS.join(detectable["assumed"].unique()).split(BETWEEN_TEXTS)
    return [text for text in texts if text]


def _model_of_recorded_motion(
    campaign: Campaign, recordings: Mapping[str, Recording]
) -> Model | None:
    """The model with the recorded crank motion; None if that is unknown or constant.

    Inertia at a varying speed separates effects that are indistinguishable at constant speed.
    """
    runs = [run.id for run in campaign.runs]
    if campaign.drive == "constant_speed" or any(run not in recordings for run in runs):
        return None
    return build_model(campaign, Measurements({run: recordings[run] for run in runs}))


def recorded(campaign: Campaign) -> tuple[Campaign, dict[str, Recording]]:
    """The campaign without unusable runs, and the recordings whose files exist."""
    existing = tuple(
        run
        for run in campaign.runs
        if all(os.path.isfile(campaign.folder / file) for file in run.files)
    )
    measured = read_measurements(campaign.model_copy(update={"runs": existing}), compared=False)
    runs = tuple(run for run in campaign.runs if run.id not in measured.left_out)
    return campaign.model_copy(update={"runs": runs}), dict(measured.runs)


def revolutions(campaign: Campaign, recordings: Mapping[str, Recording]) -> dict[str, float]:
    """Revolutions in each recording; without angles from the run's speed."""
    speeds, turned = {run.id: run.speed for run in campaign.runs}, {}
    for run, recording in recordings.items():
        angle = recording.crank_angle
        if not recording.has_angle:
            angle = speeds[run] * recording.time
        span, samples = float(np.ptp(angle[np.isfinite(angle)])), angle.size
        turned[run] = span / math.tau * samples / (samples - 1)
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
    speeds = [run.speed for run in campaign.runs]
    runs = list(campaign.runs)
    for speed in (_SLOWER * min(speeds), _FASTER * max(speeds)):
        # ids of measured runs contain no blank, so these are new ones
        name = f"at {number(speed * 30 / math.pi)} rpm"
        changes = {"id": name, "file": "-", "speed": speed, "role": "identify"}
        runs.append(campaign.runs[0].model_copy(update=changes))
    channels = {
        name: Channel(column=f"({name})", unit=kind.unit.replace("^", "**"))
        for name, kind in campaign.channel_kinds.items()
        if name not in (*campaign.channels, *_PRESCRIBED)
    }
    update = {"runs": tuple(runs), "channels": campaign.channels | channels}
    return campaign.model_copy(update=update)


def separated_by(
    campaign: Campaign,
    explanations: Sequence[Collection[str]],
    merged: Iterable[Collection[str]],
    rate: float,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> str:
    """A sentence: the further measurement that separates the first of the `explanations` from the
    others; `merged`: groups of effects that the present data cannot distinguish."""
    best, *rivals = map(frozenset, explanations)
    differing = {
        frozenset((effect, alternative))
        for rival in rivals
        for effect in best - rival
        for alternative in rival - best
    }
    confusable = {pair for pair in differing for group in merged if pair <= {*group}}
    if not confusable:
        return "A longer record, or one with less noise, should separate them."
    campaign, recordings = recorded(campaign)
    labels = frozenset().union(*confusable)
    _, advice = _advise(campaign, recordings, rate, settings, labels)
    return _advised(advice, differing)


def _advised(advice: pd.DataFrame, differing: Collection[frozenset[str]]) -> str:
    """The most useful change that separates effects of a `differing` pair."""
    for row in advice.itertuples():
        if {*differing} & {frozenset(pair) for pair in _pairs(row.separated)}:
            return f"{ADVICE} {row.change} would separate them."
    return "No single further speed or channel of those that were tested would separate them."


def _pairs(separated: str) -> list[list[str]]:
    """Pairs of effects, from a row of table `ADVICE`."""
    return [pair.split(_SEPARATOR) for pair in separated.split(", ") if pair]


def preflight_summary(
    detectable: pd.DataFrame, confusability: pd.DataFrame, advice: pd.DataFrame | None = None
) -> str:
    """The preflight for the terminal."""
    lines = ["Smallest detectable size of each effect:"]
    for row in detectable[detectable["detectable"]].itertuples():
        lines.append(f"  {format_label(row.label)}: {format_detectable(row)}")
    failed = detectable.dropna(subset=["failed"])
    if absent := [label for label in undetectable(detectable) if label not in set(failed["label"])]:
        lines.append(f"Not detectable with these runs: {joined(map(format_label, absent))}")
    for row in failed.itertuples():
        label = format_label(row.label)
        lines.append(f"Detectability unknown: {label} ({row.failed})")
    for group in confusable_groups(confusability):
        lines.append(f"Indistinguishable: {joined(map(format_label, group))}")
    for row in () if advice is None else advice.head(_MOST_ADVICE).itertuples():
        labels = [format_label(label) for label in row.newly_detectable.split(", ") if label]
        pairs = [" from ".join(map(format_label, pair)) for pair in _pairs(row.separated)]
        gains = [f"detects {joined(labels)}"] if labels else []
        gains += [f"separates {', '.join(pairs)}"] if pairs else []
        if gains:
            lines.append(f"A further {names_to_labels(row.change)} {' and '.join(gains)}")
    if noise := assumed(detectable):
        lines.append("Assumed noise (none is stated):")
        lines += [f"  {names_to_labels(text)}" for text in noise]
    return "\n".join(lines)
