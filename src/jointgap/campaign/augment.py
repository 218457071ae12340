"""The mechanism file with the identified effects."""

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np
import pandas as pd
import yaml

from jointgap.campaign.labels import format_label
from jointgap.campaign.outcome import Outcome
from jointgap.campaign.tables import clockwise
from jointgap.config import Effect, Mechanism, Simulate
from jointgap.config.campaign import Campaign
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.load import validate
from jointgap.core.errors import InputError
from jointgap.core.schema import MISSING_FORCE
from jointgap.core.units import split_quantity
from jointgap.identification.fit import determined_values
from jointgap.linkage.laws import force_along, torque_at
from jointgap.linkage.parameters import CRANK
from jointgap.motion.model import Model
from jointgap.motion.of_file import model_of, simulated_samples
from jointgap.rig.cylinder_pressure import with_loads
from jointgap.rig.simulate_run import augmented_mechanism, tolerance_for

DIGITS = 7  # significant digits of identified values
EXACT = 17  # digits that preserve every double
_WIDTH = 110  # [characters] of a YAML line, so that short lists stay on one line
_SAMPLES = 360  # per revolution
_SETTLES = 2  # revolutions


def in_file_convention(value: Any, old: Any, text: Any = None, digits: int = DIGITS) -> Any:
    """The content `value` of a file with the keys and units of the `text` that contained the `old`
    content."""
    if value == old and text is not None:
        return text
    if isinstance(value, Mapping):
        has_text = isinstance(text, Mapping)
        old, text = (part if isinstance(part, Mapping) else {} for part in (old, text))
        return {
            key: in_file_convention(item, old.get(key), text.get(key), digits)
            for key, item in value.items()
            if key in text or not has_text or old.get(key) != item
        }
    if isinstance(value, list | tuple):
        old, text = (part if isinstance(part, list | tuple) else () for part in (old, text))
        parts = zip_longest(value, old[: len(value)], text[: len(value)])
        return [in_file_convention(*part, digits) for part in parts]
    if not isinstance(value, float) or value == old:
        return value
    if isinstance(text, str) and isinstance(old, float) and old:
        number, has_unit = split_quantity(text)
        unit = re.sub(r"^[-+\N{MINUS SIGN}0-9.eE]+\s*", "", text.strip())
        if has_unit and unit:
            return f"{value / (old / float(number)):.{digits}g} {unit}"
    return float(f"{value:.{digits}g}")


def mechanisms(
    campaign: Campaign, outcome: Outcome
) -> tuple[Mechanism | LinkageFile, Mechanism | LinkageFile]:
    """The mechanism with re-fitted parameters, without and with the effects of the verdict;
    parameters that the data do not determine keep the stated values.
    """
    stated, chosen = campaign.mechanism, outcome.chosen
    plain = outcome.base if chosen.hypothesis else chosen
    base = augmented_mechanism(stated, (), determined_values(plain))
    return base, augmented_mechanism(stated, chosen.hypothesis, determined_values(chosen))


def augmented_file(
    campaign: Campaign, outcome: Outcome, text: Mapping[str, Any] | None = None
) -> str:
    """The augmented mechanism as YAML with the user's keys and units."""
    _, augmented = mechanisms(campaign, outcome)
    value, old = (part.model_dump(mode="json") for part in (augmented, campaign.mechanism))
    content = in_file_convention(value, old, text)
    try:
        validate(type(augmented), content, "the augmented mechanism")
    except InputError:  # rounding moved a value beyond its bound
        content = in_file_convention(value, old, text, EXACT)
    body = yaml.safe_dump(content, sort_keys=False, width=_WIDTH, allow_unicode=True)
    return "\n".join([*(f"# {line}" for line in _header(campaign, outcome)), body])


def _header(campaign: Campaign, outcome: Outcome) -> list[str]:
    verdict = outcome.verdict.replace("_", " ")
    lines = [f"Augmented mechanism of campaign {campaign.name}. Verdict: {verdict}."]
    for candidate in outcome.chosen.hypothesis:
        note = " (a sensor fault, not part of the mechanism)" if candidate.sensor else ""
        lines.append(f"Identified: {format_label(candidate.label)}{note}.")
    if campaign.own_loads:
        lines.append(
            "Known loads of runs, which the analysis used and which this file does not contain:"
        )
        lines += [f"  {load}" for load in campaign.own_loads]
    lines.append("Intervals and run-specific values: summary.md. Numbers without a unit are in SI.")
    return lines


def missing_force(
    campaign: Campaign, outcome: Outcome, loads_of_runs: Mapping[str, Sequence[Effect]]
) -> pd.DataFrame:
    """Table `MISSING_FORCE` of the fitted runs; empty if no effect was added to the mechanism."""
    if all(candidate.sensor for candidate in outcome.chosen.hypothesis):
        return pd.DataFrame(columns=MISSING_FORCE.names)
    speeds = {run.id: run.speed for run in campaign.runs if run.role != "confirm"}
    base, augmented = mechanisms(campaign, outcome)
    return force_difference(base, augmented, speeds, clockwise(campaign), loads_of_runs)


def force_difference(
    base: Mechanism | LinkageFile,
    augmented: Mechanism | LinkageFile,
    speeds: Mapping[str, float],
    clockwise_runs: Collection[str] = (),
    loads_of_runs: Mapping[str, Sequence[Effect]] | None = None,
) -> pd.DataFrame:
    """Forces on the bodies, and torque on the crank, of the augmented model minus those of the
    base, at the same motion.

    Masses, lengths, clearances and sensor faults exert none.
    """
    parts = [pd.DataFrame(columns=MISSING_FORCE.names)]
    for run, speed in speeds.items():
        is_clockwise, loads = run in clockwise_runs, (loads_of_runs or {}).get(run, ())
        models = [
            with_loads(model.applied().mirrored() if is_clockwise else model, loads)
            for model in (base, augmented)
        ]
        for samples in _forces_over_revolution(*models, speed):
            if is_clockwise:
                samples = samples.iloc[::-1]
                turned = ["angle", "angular_velocity", "torque"]
                angle = math.tau - samples["crank_angle"]
                samples = samples.assign(crank_angle=angle, **-samples[turned].astype(float))
            parts.append(samples.assign(run=run))
    found = pd.concat([part for part in parts if len(part)] or parts, ignore_index=True)
    return found[MISSING_FORCE.names]


def _forces_over_revolution(
    base: Mechanism | LinkageFile, augmented: Mechanism | LinkageFile, speed: float
) -> Iterator[pd.DataFrame]:
    """Samples of each body on which the missing effects exert a force."""
    steps = {"revolutions": _SETTLES + 1, "samples_per_revolution": _SAMPLES}
    options = Simulate(speed=speed, tolerance=tolerance_for(augmented.applied()), **steps)
    samples = simulated_samples(augmented, options)
    samples = samples.tail(_SAMPLES + 1).reset_index(drop=True)
    models, sites = [model_of(each, options) for each in (augmented, base)], base.sites
    turned = samples["crank_angle"] - math.tau * _SETTLES
    crank, time = samples[["crank_speed", "crank_angle"]].to_numpy(), samples["time"]
    slide = next(iter(sites.slides), None)
    for body, joint in {**sites.slides, **sites.pivots, sites.crank: sites.drive}.items():
        is_slide = body in sites.slides
        names = ("position", "velocity") if is_slide else ("angle", "angular_velocity")
        here = crank[:, ::-1]
        if body != sites.crank:
            here = samples[[f"{body}_{name}" for name in names]].to_numpy()
        if is_slide:
            state = [samples[f"{joint}_force"], here]
        elif body == sites.crank and slide:  # the variables of its formulas
            state = [here, samples[[f"{slide}_position", f"{slide}_velocity"]]]
        else:
            state = [here, here]
        rows, law = np.column_stack([*state, crank, time]), _force if is_slide else _torque
        with_effects, without = (
            np.array([law(model, joint, *row) for row in rows]) for model in models
        )
        force = with_effects - without
        columns = {"crank_angle": turned, "body": body, "force" if is_slide else "torque": force}
        columns |= dict(zip(names, here.T, strict=True))
        if force.any():
            yield pd.DataFrame(columns, columns=MISSING_FORCE.names)


def _force(model: Model, slide: str, *state: float) -> float:
    """Force of the effects along a slide."""
    pushed = model.variant.kind.pushed
    return force_along(model.p, pushed.index(slide), *state) if slide in pushed else 0.0


def _torque(model: Model, pivot: str, *state: float) -> float:
    """Torque of the effects at a pivot."""
    pushed = [name for name in model.variant.kind.pushed if name not in model.slides]
    if pivot != model.linkage.drive and pivot not in pushed:
        return 0.0
    place = CRANK if pivot == model.linkage.drive else pushed.index(pivot)
    return torque_at(model.p, place, *state)
