"""One trial: effects injected into the data of a virtual rig, and the ground truth for the sealed record.

The data come from the package's equations by an independent integrator; those of the kind ``exudyn`` from Exudyn.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from jointgap.config import Mechanism
from jointgap.config.load import load_campaign, validate
from jointgap.core.errors import SimulationError
from jointgap.core.formula import Program, compile_formula
from jointgap.dynamics.equations import evaluate
from jointgap.effects import EFFECTS
from jointgap.rig.model import build_model
from validation import exudyn
from validation.calibrate import GAP_TOLERANCE, Calibrator, Readings, StatisticsCalibrator, calibrate_size
from validation.campaign import NEED_ENCODER, damage_campaign, write_campaign
from validation.effects import LISTED, OFF_LIST, InjectedEffect
from validation.plan import CLEARANCES, TrialPlan
from validation.rig import (
    CrankRun,
    VirtualRig,
    draw_rig,
    noise_free_readings,
    simulate_signals,
    with_drawn_contact,
    with_injected_effects,
    with_measured_angle,
    with_unmeasured,
)

_MOST_RIGS = 4
"""Rigs drawn for one effect; where none can show it, the last is kept, and the trial counts as undetectable."""

_WHIRLS = 50.0
"""Gap from which on a joint that becomes loose whirls: friction of 0.25 and more drives the journal around in some ten
micrometres, with forces of hundreds of times the noise. Nobody runs such a rig."""

_MOST_CONTACTS = 20  # drawn for one joint until it does not whirl; the last is kept


@dataclass(frozen=True)
class TrialDraw:
    """A rig with the effects to inject."""

    rig: VirtualRig
    calibrator: Calibrator
    effects: list[tuple[InjectedEffect, float]]
    gaps: list[float]  # That each effect causes alone [1]


def make_trial(plan: TrialPlan, seed: int, folder: Path) -> dict[str, Any]:
    """Write a campaign, and return the ground truth that is to be sealed."""

    def stream(number: int) -> np.random.Generator:
        return np.random.default_rng([seed, number, plan.number])

    rng = stream(1)
    draw = draw_trial(plan, rng, stream(2), stream(4), stream(5))
    rig = draw.rig
    if plan.kind == "exudyn":
        if not rig.loose and not any(effect.name in CLEARANCES for effect, _ in draw.effects):
            # Exudyn's implicit integrator takes samples in equal steps.
            runs = {
                run: replace(crank, times=np.linspace(0.0, crank.times[-1], crank.times.size))
                for run, crank in rig.runs.items()
            }
            rig = replace(rig, runs=runs)
        content = with_injected_effects(rig.true, draw.effects)
        found = {run: exudyn.readings(content, crank) for run, crank in rig.runs.items()}
        clean, numerics = {run: own for run, (own, _) in found.items()}, next(iter(found.values()))[1]
    else:
        clean = {
            run: noise_free_readings(rig.true, crank, rig.numerics, tuple(rig.sensors), draw.effects)
            for run, crank in rig.runs.items()
        }
        numerics = vars(rig.numerics)
    write_campaign(rng, rig, _noisy_readings(rng, rig, clean), folder, plan.id)
    effects = [_effect_record(draw.rig, effect, size) for effect, size in draw.effects]
    idle = idle_effects(folder / "campaign.yaml", effects)
    comparable = plan.base != "chaotic" and rig is draw.rig  # sampled at the same times
    truth = {
        "id": plan.id,
        "kind": plan.kind,
        "base": plan.base,
        "drive": rig.drive,
        "size": plan.size,
        "gaps": [round(gap, 4) for gap in draw.gaps],
        "confirm": rig.confirm_run,
        "channels": list(rig.sensors),
        "encoder": rig.angle_noise > 0,
        "stated": rig.noise_is_stated,
        "nuisances": rig.nuisance_values,
        "starts": {
            run: {"angle_rad": round(crank.start_angle, 6), "revolutions": crank.settling}
            for run, crank in rig.runs.items()
        },
        "numerics": numerics,
        "numerics_gap": round(draw.calibrator.numerics_gap(draw.effects, clean), 3) if comparable else None,
        "effects": [record | {"idle": none} for record, none in zip(effects, idle, strict=True)],
    }
    if plan.damage:
        truth["damage"] = damage_campaign(stream(3), plan.damage, folder)
    return truth


def draw_trial(
    plan: TrialPlan,
    rng: np.random.Generator,
    unmeasured: np.random.Generator,
    contacts: np.random.Generator,
    encoders: np.random.Generator | None = None,
) -> TrialDraw:
    """Draw rigs until one shows the effects of a plan as large as asked for."""
    catalogue = OFF_LIST if plan.kind == "off_list" else LISTED
    film = [name.partition(":")[2] for name in plan.effects if name.startswith("lubricated_joint")]
    encoder = "encoder_offset" in plan.effects or plan.damage in NEED_ENCODER or plan.measured_angle
    for number in range(_MOST_RIGS):
        rig = with_unmeasured(draw_rig(rng, plan.base, film[0] if film else plan.loose, encoder), unmeasured)
        if plan.measured_angle:
            rig = with_measured_angle(rig, encoders)
        calibrator = (StatisticsCalibrator if plan.base == "chaotic" else Calibrator)(rig)
        scales = rig.scales(calibrator.spread())
        effects = [_with_contact(rig, calibrator, catalogue[name](scales, rng), contacts) for name in plan.effects]
        calibrated = [calibrate_size(calibrator, effect, plan.size) for effect in effects]
        sized = [(effect, size) for effect, (size, _) in zip(effects, calibrated, strict=True)]
        draw = TrialDraw(rig, calibrator, sized, [gap for _, gap in calibrated])
        if number == _MOST_RIGS - 1 or (_as_large_as_planned(plan, draw) and not _whirls_together(draw)):
            return draw
    raise AssertionError("the last draw returns")


def _whirls_together(draw: TrialDraw) -> bool:
    """Whether a joint whirls with its clearance and the other effect of a pair, though not with that alone."""
    has_clearance = any(effect.name in CLEARANCES for effect, _ in draw.effects)
    return has_clearance and len(draw.effects) > 1 and draw.calibrator.gap(draw.effects) >= _WHIRLS


def _with_contact(
    rig: VirtualRig, calibrator: Calibrator, effect: InjectedEffect, rng: np.random.Generator
) -> InjectedEffect:
    """The effect; a joint whose clearance it is does not whirl with the contact of `with_drawn_contact`."""
    drawn = effect
    for _ in range(_MOST_CONTACTS):
        drawn = with_drawn_contact(rig, effect, rng)
        if drawn is effect:
            break
        try:
            if calibrator.gap([(drawn, drawn.first)]) < _WHIRLS:
                break
        except SimulationError:
            continue  # so does what cannot be simulated
    return drawn


def _as_large_as_planned(plan: TrialPlan, draw: TrialDraw) -> bool:
    """Whether each gap is what was asked for, or more where the effect cannot be smaller."""
    return all(
        abs(gap / plan.size - 1) < 2 * GAP_TOLERANCE or (size <= effect.least and gap > plan.size)
        for (effect, size), gap in zip(draw.effects, draw.gaps, strict=True)
    )


def parameters_beyond_nominal(rig: VirtualRig, effect: InjectedEffect, size: float) -> dict[str, float]:
    """An effect's parameters as an analyst can know them, the drawn one first.

    A mass that is added to one that is not exactly known, and likewise a length, is known by their sum alone: it counts
    from what the mechanism file says.
    """
    values = dict(effect.parameters(size))
    added = EFFECTS[effect.name].ADDS_TO if effect.name in EFFECTS else {}
    for key, (body, attribute) in added.items():
        values[key] = values.get(key, 0.0) + rig.true[body][attribute] - rig.nominal[body][attribute]
    return values


def _noisy_readings(rng: np.random.Generator, rig: VirtualRig, clean: Readings) -> Readings:
    """Readings with noise and gaps, with the noise's standard deviation as ``{channel} sd``."""
    noisy = {}
    for run, crank in rig.runs.items():
        readings = {"time": crank.times - crank.times[0]}
        for channel, sensor in rig.sensors.items():
            series = clean[run][channel]
            sd = sensor.noise_share * float(series.std())
            values = series + sd * ar1_noise(rng, series.size, sensor.correlation)
            if sensor.gaps:
                for _ in range(int(rng.integers(1, 4))):
                    length = int(rng.uniform(0.01, 0.05) * values.size)
                    begin = int(rng.integers(0, values.size - length))
                    values[begin : begin + length] = np.nan
            readings |= {channel: values, f"{channel} sd": sd}
        if rig.angle_noise:
            angle = clean[run]["crank_angle"] + rng.normal(0.0, rig.angle_noise, crank.times.size)
            readings["crank_angle"] = np.round(angle / rig.angle_step) * rig.angle_step if rig.angle_step else angle
        noisy[run] = readings
    return noisy


def ar1_noise(rng: np.random.Generator, count: int, correlation: float) -> np.ndarray:
    """First-order autoregressive noise of variance 1, (count,); neighbours have the `correlation`."""
    steps = rng.normal(size=count)
    if not correlation:
        return steps
    noise = np.empty(count)
    noise[0] = steps[0]
    for sample in range(1, count):
        noise[sample] = correlation * noise[sample - 1] + math.sqrt(1 - correlation**2) * steps[sample]
    return noise


def _effect_record(rig: VirtualRig, effect: InjectedEffect, size: float) -> dict[str, Any]:
    parameters = parameters_beyond_nominal(rig, effect, size)
    record = {"name": effect.name, "site": effect.site, "listed": effect.listed, "parameters": parameters}
    if effect.formula:  # a law that is not on the list, over the states that the motion visits
        kind, text = effect.formula
        content, states = with_injected_effects(rig.true, [(effect, size)]), {}
        for crank in rig.runs.values():
            times = np.arange(100) / 100 * 2 * math.pi / crank.speed
            signals = simulate_signals(content, CrankRun(crank.speed, 0.0, times), rig.numerics) | {"time": times}
            for key in ("slider_velocity", "slider_position", "crank_speed", "crank_angle", "time"):
                states.setdefault(key, []).extend(signals[key].tolist())
        program = compile_formula(text, {"s": size})
        record["force"] = {"kind": kind, "value": formula_values(program, states.values()), "states": states}
    return record


def formula_values(program: Program, states: Sequence[Sequence[float]]) -> list[float]:
    """Values [N or N m] over the slider's velocity and position, the crank's speed and angle, and the time, SI."""
    return [float(evaluate(program.codes, program.numbers, *state)) for state in zip(*states, strict=True)]


def idle_effects(campaign_file: Path, effects: Sequence[Mapping[str, Any]]) -> list[bool]:
    """Whether each effect is none: within the range that the campaign states for what it changes, or overwritten.

    A slider of 0.487 kg is no added mass where the file says 0.454 to 0.492 kg. Friction of a pin is none beside a
    clearance that states its contact's friction.
    """
    if not effects:
        return []
    campaign = load_campaign(campaign_file)
    model = build_model(campaign)
    stated = {nuisance.name: nuisance for nuisance in model.nuisances}
    candidates = {(candidate.name, candidate.site): candidate for candidate in model.candidates}

    def is_within(effect: Mapping[str, Any]) -> bool:
        candidate = candidates.get((effect["name"], effect["site"]))
        # Where it leaves the rest of a shared nuisance as it is, the effect is that the two differ.
        if (
            candidate is None
            or not candidate.replaces
            or candidate.replaces.keys() & {coordinate.name for coordinate in candidate.coordinates}
        ):
            return False
        ranges = {amplitude: stated[name] for name, amplitude in reversed(candidate.replaces.items())}
        zero = dict.fromkeys(candidate.amplitudes, 0.0)
        low, high = (
            candidate.parameters(zero | {key: getattr(p, end) - p.nominal for key, p in ranges.items()})
            for end in ("low", "high")
        )
        return all(low[key] <= effect["parameters"].get(key, 0.0) <= high[key] for key in low)

    moving = [effect for effect in effects if effect["name"] in EFFECTS]

    def modified(chosen: Sequence[Mapping[str, Any]]) -> Mechanism:
        entries = [
            {"name": one["name"], "parameters": one["parameters"]}
            | ({"site": one["site"]} if EFFECTS[one["name"]].sites() else {})
            for one in chosen
        ]
        content = campaign.mechanism.model_dump() | {"effects": entries}
        return validate(Mechanism, content, "the mechanism with what is hidden").applied()

    def is_overwritten(effect: Mapping[str, Any]) -> bool:
        others = [one for one in moving if one is not effect]
        return len(others) < len(moving) and modified(moving) == modified(others)

    return [is_within(effect) or is_overwritten(effect) for effect in effects]
