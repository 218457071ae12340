"""One trial: effects injected into the data of a virtual rig, and the truth for the sealed record.

The data come from the package's equations by independent numerics; those of the kind ``exudyn`` from independent code.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from jointgap.core.errors import SimulationError
from jointgap.dynamics.equations import evaluate
from jointgap.effects import EFFECTS
from jointgap.formula import Program, compile_formula
from jointgap.trials import exudyn_contact, exudyn_model
from jointgap.trials.campaign_writer import write_campaign
from jointgap.trials.idle_effects import idle_effects
from jointgap.trials.injected_effects import LISTED, OFF_LIST, InjectedEffect
from jointgap.trials.sensor_readings import (
    SETTLING_REVOLUTIONS,
    CrankRun,
    noise_free_readings,
    simulate_signals,
    with_injected_effects,
)
from jointgap.trials.size_calibration import (
    GAP_TOLERANCE,
    Readings,
    SizeCalibrator,
    StatisticsSizeCalibrator,
    calibrate_size,
)
from jointgap.trials.trial_plan import CLEARANCES, TrialPlan
from jointgap.trials.virtual_rig import (
    VirtualRig,
    draw_rig,
    with_drawn_contact,
    with_drawn_damping,
    with_drawn_starts,
    with_measured_angle,
)
from jointgap.trials.wiring import NEED_ENCODER, damage_campaign

_MOST_RIGS = 4
"""Rigs drawn for one effect; where none can show it, the last is kept, and the trial counts as undetectable."""

_WHIRLS = 50.0
"""Gap from which on a joint whirls that becomes loose by the first size of its clearance, or with another effect beside
it. Friction of 0.25 and more drives the journal around in a clearance of some ten micrometres, with forces of hundreds
of times the noise. Nobody runs such a rig."""

_MOST_CONTACTS = 20  # drawn for one joint until it does not whirl; the last is kept

ANGLE_PIECES = 72
"""Pieces of the crank angle for which the truth says how far the base is off: of 5 deg each."""


@dataclass(frozen=True)
class TrialDraw:
    """A rig with the effects to inject."""

    rig: VirtualRig
    calibrator: SizeCalibrator | StatisticsSizeCalibrator
    effects: list[tuple[InjectedEffect, float]]
    gaps: list[float]  # That each effect causes alone [1]


def make_trial(plan: TrialPlan, seed: int, folder: Path) -> dict:
    """Write a campaign, and return the truth that is to be sealed."""
    rng = np.random.default_rng([seed, 1, plan.number])
    draw = draw_trial(plan, rng, *(np.random.default_rng([seed, stream, plan.number]) for stream in (2, 4, 5)))
    read = _exudyn_readings if plan.kind == "exudyn" else _own_readings
    truth = {"id": plan.id, **_write_trial(plan, draw, rng, folder, *read(draw))}
    if plan.damage:
        truth["damage"] = damage_campaign(np.random.default_rng([seed, 3, plan.number]), plan.damage, folder)
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
        rig = with_drawn_starts(draw_rig(rng, plan.base, film[0] if film else plan.loose, encoder), unmeasured)
        rig = with_drawn_damping(rig, unmeasured)
        if plan.measured_angle:
            rig = with_measured_angle(rig, encoders)
        calibrator = (StatisticsSizeCalibrator if plan.base == "chaotic" else SizeCalibrator)(rig, rig.identify_runs)
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
    rig: VirtualRig,
    calibrator: SizeCalibrator | StatisticsSizeCalibrator,
    effect: InjectedEffect,
    rng: np.random.Generator,
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


def _own_readings(draw: TrialDraw) -> tuple[VirtualRig, Readings, dict]:
    """The rig as it was sampled, its noise-free readings, and by which numerics."""
    rig = draw.rig
    clean = {
        run: noise_free_readings(rig.true, crank, rig.numerics, tuple(rig.sensors), draw.effects)
        for run, crank in rig.runs.items()
    }
    return rig, clean, vars(rig.numerics)


def _exudyn_readings(draw: TrialDraw) -> tuple[VirtualRig, Readings, dict]:
    """Likewise by Exudyn; the sizes of effects are set by the package's own numerics."""
    rig, content = draw.rig, with_injected_effects(draw.rig.true, draw.effects)
    if rig.loose or any(effect.name in CLEARANCES for effect, _ in draw.effects):
        clean = {run: exudyn_contact.simulate(content, crank) for run, crank in rig.runs.items()}
        numerics = {"tolerance": exudyn_contact.TOLERANCE, "friction_speed": exudyn_contact.FRICTION_SPEED}
        return rig, clean, {"code": "exudyn"} | numerics
    # Its implicit integrator takes samples in equal steps.
    runs = {
        run: replace(crank, times=np.linspace(0.0, crank.times[-1], crank.times.size))
        for run, crank in rig.runs.items()
    }
    clean = {
        run: exudyn_model.simulate(content, crank.speed, crank.phase, crank.times, SETTLING_REVOLUTIONS)
        for run, crank in runs.items()
    }
    numerics = {"steps_per_revolution": exudyn_model.STEPS, "friction_zone": exudyn_model.FRICTION_ZONE}
    return replace(rig, runs=runs), clean, {"code": "exudyn"} | numerics


def _write_trial(
    plan: TrialPlan, draw: TrialDraw, rng: np.random.Generator, folder: Path, rig: VirtualRig, clean: Readings,
    numerics: dict,
) -> dict:  # fmt: skip
    """Write the campaign of a `rig` with noise on its `clean` readings; the sealed truth."""
    write_campaign(rng, rig, _noisy_readings(rng, rig, clean), folder, plan.id)
    calibrator, effects = draw.calibrator, draw.effects
    repeats = isinstance(calibrator, SizeCalibrator)
    comparable = repeats and rig is draw.rig  # sampled at the same times
    records = [_effect_record(draw.rig, effect, size) for effect, size in effects]
    idle = idle_effects(folder / "campaign.yaml", records)
    return {
        **_truth_record(plan, draw),
        **({"drive": rig.drive} if plan.measured_angle else {}),
        "numerics": numerics,
        "numerics_gap": round(calibrator.numerics_gap(effects, clean), 3) if comparable else None,
        "difference": _base_difference(draw.rig, calibrator, effects) if repeats else None,
        "effects": [record | {"idle": none} for record, none in zip(records, idle, strict=True)],
    }


def _truth_record(plan: TrialPlan, draw: TrialDraw) -> dict:
    """What the sealed truth of every trial holds."""
    rig = draw.rig
    return {
        "kind": plan.kind,
        "base": plan.base,
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
    }


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


def _noisy_readings(
    rng: np.random.Generator, rig: VirtualRig, clean: Mapping[str, Mapping[str, np.ndarray]]
) -> Readings:
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
    """First-order autoregressive noise of variance 1, (count,); `rng` draws, neighbours have the `correlation`."""
    steps = rng.normal(size=count)
    if not correlation:
        return steps
    noise = np.empty(count)
    noise[0] = steps[0]
    for sample in range(1, count):
        noise[sample] = correlation * noise[sample - 1] + math.sqrt(1 - correlation**2) * steps[sample]
    return noise


def _base_difference(
    rig: VirtualRig, calibrator: SizeCalibrator, effects: Sequence[tuple[InjectedEffect, float]]
) -> dict[str, dict[str, list[float | None]]]:
    """RMS noise-free difference of the recalibrated base over the noise, by run, channel and piece of crank angle."""
    _, residual = calibrator.residual(effects)
    differences: dict[str, dict[str, list[float | None]]] = {}
    for part in calibrator.channel_noises:
        crank = rig.runs[part.run]
        turns = (crank.phase + crank.speed * crank.times) / (2 * math.pi)
        piece = (turns % 1 * ANGLE_PIECES).astype(int) % ANGLE_PIECES
        square = np.bincount(piece, residual[part.place] ** 2, ANGLE_PIECES)
        count = np.bincount(piece, minlength=ANGLE_PIECES)
        values = [round(math.sqrt(s / n), 4) if n else None for s, n in zip(square, count, strict=True)]
        differences.setdefault(part.run, {})[part.channel] = values
    return differences


def _effect_record(rig: VirtualRig, effect: InjectedEffect, size: float) -> dict:
    record = {
        "name": effect.name,
        "site": effect.site,
        "listed": effect.listed,
        "parameters": parameters_beyond_nominal(rig, effect, size),
    }
    return record | {"force": _force_over_states(rig, effect, size)} if effect.formula else record


def _force_over_states(rig: VirtualRig, effect: InjectedEffect, size: float) -> dict:
    """A law that is not on the list over the states that the motion visits, for a formula to be compared with."""
    kind, text = effect.formula
    program = compile_formula(text, {"s": size})
    visited = {key: [] for key in ("x", "v", "w", "theta", "t", "value")}
    for crank in rig.runs.values():
        times = np.arange(100) / 100 * 2 * math.pi / crank.speed
        content = with_injected_effects(rig.true, [(effect, size)])
        signals = simulate_signals(content, CrankRun(crank.speed, 0.0, times), rig.numerics)
        states = (
            *(signals[name] for name in ("slider_velocity", "slider_position", "crank_speed", "crank_angle")),
            times,
        )
        visited["value"] += formula_values(program, *states)
        for key, values in zip(("v", "x", "w", "theta", "t"), states, strict=True):
            visited[key] += np.round(values, 9).tolist()
    return {"kind": kind, "formula": text, "coefficients": {"s": size}, **visited}


def formula_values(program: Program, *states: np.ndarray) -> list[float]:
    """Values [N or N m] of a formula's `program` over `states`.

    Five (n,) arrays: the slider's velocity and position, the crank's speed and angle, time, SI.
    """
    return [float(evaluate(program.codes, program.numbers, *map(float, state))) for state in zip(*states, strict=True)]
