"""Simulating a measured run."""

import math
from collections.abc import Callable, Mapping, Sequence
from math import tau
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from jointgap.config import EFFECTS, Effect, Mechanism
from jointgap.config.campaign import Campaign
from jointgap.config.channels import joints_of
from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.config.linkage_file import LinkageFile, Slide
from jointgap.config.load import validate
from jointgap.config.mechanism import Joint
from jointgap.config.scenario import TOLERANCE_SHARE
from jointgap.core.candidates import Candidate, Effects
from jointgap.core.costs import count_revolutions, count_run
from jointgap.core.errors import InputError
from jointgap.effects import effects_of
from jointgap.effects.force_table import with_pressure_sensor
from jointgap.effects.own_law import formula_effect
from jointgap.linkage.drive import crank_times
from jointgap.linkage.parameters import CONSTANT, FLUCTUATING
from jointgap.motion.integrate import Samples
from jointgap.motion.model import Model, Workspace, beginning
from jointgap.motion.of_file import start_state
from jointgap.motion.periodic import COMPARED_ANGLES, compared_angles
from jointgap.motion.simulation import integrate_on, observed
from jointgap.rig import drives, sensors
from jointgap.rig.cylinder_pressure import with_loads
from jointgap.rig.drives import TOLERANCE, RunPlan, Values
from jointgap.rig.recording import noise_of
from jointgap.rig.sensors import Faults

Columns = Mapping[str, np.ndarray]  # Channels of a motion (n,), by column
# Torque [N m] on the crank at angles (n,) [rad]
Torque = Callable[[Model, np.ndarray], np.ndarray]

# [m] Local error with a lubricated joint: films are stiff, steps are short anyway
FILM_TOLERANCE = 1e-11
# [1] Periodic steady state: norm of the change of all readings between revolutions, over the noise
SETTLED_LENGTH = 1.0
SETTLED_AFTER = (3, 12)  # Least and largest number of revolutions dropped as transient
LINEARISED_BEFORE = 7  # Motion that settles in a later revolution is not linearised
TRANSIENT_REVOLUTIONS = 1.5  # A record that begins earlier after the start is simulated in full
# Earlier begin of the motion for another start: not at a symmetry of the slider-crank (golden
# section)
OTHER_START_REVOLUTIONS = 1.382
UNSTATED_NOISE_SHARE = 0.02  # [1, of a channel's standard deviation] Noise if it is not stated


def friction_speed(mechanism: Mechanism | LinkageFile) -> float | None:
    """Regularisation speed [m/s] of friction in the first loose pin with friction; None if there is
    none.

    It is not measured but has a large influence near reversals, so it is fitted as a nuisance; the
    speeds of other pins scale with it.
    """
    contacts = [mechanism.joint(pin).contact for pin in mechanism.loose]
    return next((contact.friction_speed for contact in contacts if contact.friction > 0), None)


def steady_contact_damping(mechanism: Mechanism | LinkageFile) -> dict[str, str]:
    """Name of the damping nuisance of each loose joint with fading contact memory.

    The nuisance is the natural logarithm of the damping of steady contact over that of the
    mechanism file, on which readings depend about linearly. It is not measured but determines the
    ringing after load reversals.
    """
    return {
        pin: f"lasting_damping_{pin}"
        for pin in mechanism.loose
        if mechanism.joint(pin).contact.reference_speed is not None
    }


def with_nuisances(mechanism: Mechanism | LinkageFile, values: Values) -> Mechanism | LinkageFile:
    """`mechanism` with the `values` of its nuisances."""
    sites = mechanism.sites
    bodies = {}
    for name in sites.bodies:
        body = mechanism.body(name)
        if name in sites.links:
            body = body.with_length(values.get(f"{name}_length", body.length))
        own = {key: values.get(f"{name}_{key}") for key in ("mass", "inertia", "offset")}
        change = {key: value for key, value in own.items() if value is not None}
        bodies[name] = body.model_copy(update=change)
    joints = {name: _joint_with_nuisances(mechanism, name, values) for name in mechanism.loose}
    if isinstance(mechanism, LinkageFile):
        update = {"bodies": bodies, "joints": {**mechanism.joints, **joints}}
    else:
        update = {**bodies, "joints": mechanism.joints.model_copy(update=joints)}
    effects = with_pressure_sensor(mechanism.effects, values)
    return mechanism.model_copy(update=update | {"effects": effects})


def _joint_with_nuisances(
    mechanism: Mechanism | LinkageFile, name: str, values: Values
) -> Joint | Slide:
    joint = mechanism.joint(name)
    contact_data, contact = joint.contact, {}
    for key in ("joint_friction", "restitution") if name in joints_of(mechanism.sites) else ():
        of_contact = key.removeprefix("joint_")
        if (nominal := getattr(contact_data, of_contact)) is not None:
            contact[of_contact] = values.get(f"{key}_{name}", values.get(key, nominal))
    if "friction_speed" in values:
        contact["friction_speed"] = (
            contact_data.friction_speed * values["friction_speed"] / friction_speed(mechanism)
        )
    if (damping := f"lasting_damping_{name}") in values:
        contact["reference_approach_speed"] = contact_data.reference_speed * math.exp(
            -values[damping]
        )
    change: dict[str, Any] = {"contact": contact_data.model_copy(update=contact)}
    if f"{name}_clearance" in values:
        change["bearing_radius"] = joint.journal_radius + values[f"{name}_clearance"]
    return joint.model_copy(update=change)


def with_effects(mechanism: Mechanism | LinkageFile, effects: Effects) -> Mechanism | LinkageFile:
    """`mechanism` with additional effects."""
    known, added, formulas = effects_of(mechanism.sites), [], {}
    for candidate, values in effects:
        if candidate.name.startswith("discovered_"):
            formulas.setdefault(candidate.name.partition("[")[0], []).append((candidate, values))
        elif not candidate.sensor:
            # keys of amplitudes with and without run
            sizes = {name for key in candidate.amplitudes for name in (key, key.partition("@")[0])}
            is_there = any(values[key] for key in sizes & values.keys())
            if candidate.formula and is_there:
                parameters = {"formula": candidate.formula, "coefficients": dict(values)}
                effect = known[formula_effect(mechanism.sites, candidate.site)]
                added.append(_effect(effect, "", parameters, label=candidate.name))
            elif is_there or (not candidate.formula and known[candidate.name].ACTS_AT_ZERO):
                effect, parameters = known[candidate.name], candidate.parameters(values)
                added.append(_effect(effect, candidate.site, parameters))
    for name, terms in formulas.items():
        is_listed = mechanism.effect(name, known[name].SITE) is not None
        added.append(_formula(known[name], terms, label="found" if is_listed else ""))
    return mechanism.model_copy(update={"effects": (*mechanism.effects, *added)})


def _effect(effect: type[Effect], site: str, parameters: Mapping[str, Any], **keys: str) -> Effect:
    data = {"name": effect.NAME, "parameters": dict(parameters)} | keys
    data |= {"site": site} if "site" in effect.model_fields else {}
    return validate(effect, data, effect.NAME)


def _formula(effect: type[Effect], terms: Effects, label: str) -> Effect:
    """One law of several terms, each with a coefficient: ``discovered_slider_force[v^3]``."""
    parts, coefficients = [], {}
    for place, (candidate, values) in enumerate(terms, 1):
        term = candidate.name.partition("[")[2].removesuffix("]")
        if not term:
            raise InputError(
                f"{candidate.name}: has no term; use a name such as {effect.NAME}[v^3]"
            )
        parts.append(f"c{place}*({term})")
        coefficients[f"c{place}"] = values[candidate.amplitudes[0]]
    return _effect(
        effect, "", {"formula": " + ".join(parts), "coefficients": coefficients}, label=label
    )


def simulated_effects(effects: Effects) -> tuple[list, list, float]:
    """Effects within simulation limits, those that need no limit, and the share of the limited
    effects."""
    limited, exact, share = [], [], 1.0
    for candidate, values in effects:
        effect = EFFECTS.get(candidate.name)
        nearest, part = effect.simulated(values) if effect else (values, 1.0)
        limited.append((candidate, nearest))
        exact += [(candidate, values)] if part == 1.0 else []
        share *= part
    return limited, exact, share


def augmented_mechanism(
    mechanism: Mechanism | LinkageFile,
    hypothesis: Sequence[Candidate] = (),
    values: Mapping[str, float] | None = None,
) -> Mechanism | LinkageFile:
    """The mechanism with re-fitted nuisances and effects."""
    values = values or {}
    modified = with_nuisances(mechanism, {key: v for key, v in values.items() if "@" not in key})
    effects = []
    for candidate in hypothesis:
        # a fit has no values of held-out runs
        keys = {p.key: f"{candidate.label}.{p.key}" for p in candidate.coordinates}
        effect_values = {key: values[name] for key, name in keys.items() if name in values}
        effects.append((candidate, effect_values))
        # a partly replaced nuisance, such as the other pin's friction
        modified = with_nuisances(modified, effect_values)
    augmented = with_effects(modified, effects).model_dump()
    return validate(type(mechanism), augmented, "the augmented mechanism")


# Equivalent solver variants; their differences count as solver error. The last one requires loose
# joints and an unknown start
NUMERICS = ("friction regularised by Threlfall's law", "a tenth of the tolerance", "another start")


def numerics_for(campaign: Campaign) -> tuple[str, ...]:
    """The solver variants that matter in a campaign."""
    free = campaign.drive != "measured_angle" and any(map(drives.has_unknown_start, campaign.runs))
    return NUMERICS if free and campaign.mechanism.applied().loose else NUMERICS[:-1]


def channels_read(
    campaign: Campaign,
    plan: RunPlan,
    values: Values,
    effects: Effects = (),
    numerics: int = 0,
    perturbation=None,
) -> dict[str, np.ndarray]:
    """Sensor readings of a run at its samples, by channel."""
    count_run()
    effects, without, share = simulated_effects(effects)
    read = _read_at_limit(campaign, plan, values, effects, numerics, perturbation)
    if share < 1.0:
        baseline = _read_at_limit(campaign, plan, values, without, numerics, perturbation)
        read = {
            channel: baseline[channel] + share * (read[channel] - baseline[channel])
            for channel in read
        }
    return read


class Prepared(NamedTuple):
    """A run ready for simulation."""

    driven: drives.DrivenRun
    faults: Faults
    tolerance: float  # [m]


def prepared(
    campaign: Campaign,
    plan: RunPlan,
    values: Values,
    effects: Effects,
    numerics: int = 0,
    tolerance: float | None = None,
    torque: Torque | None = None,
) -> Prepared:
    """A run ready for simulation with the local error `tolerance` [m] (default: that of its
    plan); `torque` as of `_driven_run`."""
    side = plan.run.side
    nuisances = dict(values)
    faults = Faults(effects, side, values, plan.second_clock)
    for (
        candidate,
        effect_values,
    ) in effects:  # a partly replaced nuisance, such as the other pin's friction
        nuisances |= {
            name: effect_values[name]
            for name in effect_values
            if name in values and name not in candidate.amplitudes
        }
    mechanism = with_effects(with_nuisances(campaign.mechanism, nuisances), effects).applied()
    if side < 0.0:
        mechanism = mechanism.mirrored()
    finer, change = other_numerics(numerics)
    tolerance = finer * tolerance_for(mechanism, tolerance or plan.tolerance)
    other_start = numerics == len(NUMERICS) and drives.has_unknown_start(plan.run)
    earlier = OTHER_START_REVOLUTIONS * tau if other_start else 0.0
    driven = _driven_run(campaign, plan, mechanism, nuisances, faults, tolerance, earlier, torque)
    change(driven.model)
    # phases refer to time 0 of the record, not of the simulation
    for law in driven.model.p.slides.laws:
        law.harmonic_phase += law.harmonic_angular_frequency * (plan.samples.time[0] - driven.begin)
    return Prepared(driven, faults, tolerance)


def _read_at_limit(
    campaign: Campaign, plan: RunPlan, values: Values, effects: Effects, numerics: int, perturbation
) -> dict[str, np.ndarray]:
    """`channels_read` with effects within simulation limits."""
    run = prepared(campaign, plan, values, effects, numerics)
    count = run.driven.angles.size
    change = (
        _change_over_noise(campaign, plan, count) if drives.has_unknown_start(plan.run) else None
    )

    def motion(angles: np.ndarray) -> Columns:
        return channels_at(run.driven.model, angles, run.tolerance, perturbation, change, count)

    return read(campaign, plan, run, motion)


def other_numerics(numerics: int) -> tuple[float, Callable[[Model], None]]:
    """Factor on the tolerance and change of the model, for `numerics` of `channels_read`."""
    if numerics == 1:
        return 1.0, _threlfall
    return (0.1 if numerics == 2 else 1.0), lambda model: None


def _threlfall(model: Model) -> None:
    coulomb = FRICTION_LAWS["coulomb"]
    threlfall = FRICTION_LAWS["threlfall"]
    for joint in model.bearings.values():
        if joint.friction_law == coulomb.code:
            joint.friction_law = threlfall.code
            # the same slope at zero speed
            joint.friction_speed *= threlfall.slope_at_zero / coulomb.slope_at_zero


def _driven_run(
    campaign: Campaign,
    plan: RunPlan,
    mechanism: Mechanism,
    values: Values,
    faults: Faults,
    tolerance: float,
    earlier: float,
    torque: Torque | None,
) -> drives.DrivenRun:
    """The simulation of a run; the `torque` on the crank [N m], which an encoder's coupling
    follows, is simulated by default."""
    samples = plan.samples
    late = faults.lag * values.get("speed", samples.speed)  # a lagging encoder reads less
    later = values.get("first_angle", samples.first_angle) - samples.first_angle

    def driven(error: np.ndarray | float) -> drives.DrivenRun:
        """With the `error` of the encoder [rad] at the samples."""
        error = error - late
        loaded = with_loads(mechanism, plan.loads, values, later - float(np.nanmean(error)))
        if plan.measured is not None:
            run = drives.measured_angle_run(loaded, plan, faults.of_reading, faults.lag, tolerance)
        elif campaign.drive == "motor":
            run = drives.motor_run(loaded, campaign.motor, plan, values, error, tolerance, earlier)
        elif campaign.drive == "free":
            run = drives.free_run(loaded, plan, values, error, tolerance, earlier)
        else:
            run = drives.constant_speed_run(loaded, plan, values, error, tolerance, earlier)
        for law in run.model.p.slides.laws:
            if law.table_over == 2:  # over time of the record, not of the simulation
                if not samples.timed:
                    raise InputError(
                        "effects: a force table over time requires the channel time; add it, or use"
                        " angle"
                    )
                law.table_begin += run.begin - samples.time[0]
        return run

    run = driven(faults.of_reading(samples.angle))
    if faults.follow_torque:  # which is known once the crank is in its place
        torque = torque or _simulated_torque(tolerance)
        run = driven(faults.of_encoder(run.angles, torque(run.model, run.angles)))
    return run


def _simulated_torque(tolerance: float) -> Torque:
    return lambda model, angles: channels_at(model, angles, tolerance)["crank_torque"]


def read(
    campaign: Campaign, plan: RunPlan, run: Prepared, motion: Callable[[np.ndarray], Columns]
) -> dict[str, np.ndarray]:
    """Sensor readings at the samples of a `motion`, which returns its channels at crank angles (m,)
    [rad]."""
    driven, faults = run.driven, run.faults
    channels = {name: campaign.channels[name] for name in plan.channels}
    samples = plan.samples
    delay = faults.lag if plan.measured is None else 0.0
    late = driven.at(samples.elapsed - delay) if delay else driven.angles
    if channels.keys() == {"crank_angle"} and not faults.follow_torque:
        return {"crank_angle": late + faults.of_encoder(late)}
    corners = [channel.bandwidth for channel in channels.values() if channel.bandwidth]
    grid = np.empty(0)
    count = driven.angles.size
    interval = cycle = 0.0
    if corners or any(
        channel.remembers or faults.need_grid(name) for name, channel in channels.items()
    ):
        revolution = tau / samples.speed
        padding = sensors.remembered_time(channels.values(), revolution)
        # a measured angle ends with the record
        end = samples.elapsed[-1] + (0.0 if plan.measured else padding)
        grid = sensors.filter_times(-min(padding, driven.begin), end, revolution, corners)
        interval = grid[1] - grid[0]
        if not drives.starts_with_record(plan.run):
            turned = driven.at(grid)
            turns = math.floor((turned[-1] - turned[0]) / tau)
            turns -= turns % 2 if turns > 1 else 0  # half orders repeat every two turns
            cycle = np.interp(turned[0] + turns * tau, turned, grid - grid[0])
    # a delay is simulated, not interpolated: impacts stay sharp
    delays = list(dict.fromkeys([0.0, *map(faults.delay, channels)]))
    earlier = [
        driven.at(np.maximum(samples.elapsed - delay, -driven.begin)) for delay in delays[1:]
    ]
    angles = np.concatenate([driven.angles, *earlier, driven.at(grid)])
    true = motion(angles)
    elapsed = true["time"][:count] - driven.begin
    readings = {}
    for name, channel in channels.items():
        if name == "crank_angle":
            torque = true["crank_torque"][:count]
            torque = np.interp(elapsed - delay, elapsed, torque) if delay else torque
            readings[name] = late + faults.of_encoder(late, torque)
            continue
        values = sensors.at_sensor(campaign, plan.run.side, name, true[name])
        values = faults.act("before_filter", name, values)
        behind = faults.delay(name)
        begin = count * delays.index(behind)
        times = elapsed - behind
        read = values[begin : begin + count]
        fine = _bridged(values[count * len(delays) :])
        if channel.bandwidth:
            fine = sensors.low_pass(fine, interval, channel.bandwidth, channel.filter == "causal")
            read = np.where(np.isfinite(read), CubicSpline(grid, fine)(times), np.nan)
        if channel.remembers or faults.need_grid(name):
            later = fine
            if channel.average:
                later = sensors.averaged(later, interval, cycle, channel.average)
            if channel.high_pass:
                later = sensors.high_passed(later, interval, cycle, channel.high_pass)
            later = faults.act("over_time", name, later, interval, cycle)
            # only the change is interpolated: impacts stay sharp
            read = read + CubicSpline(grid, later - fine)(times)
        readings[name] = faults.act("after_filter", name, read)
    return readings


def _bridged(values: np.ndarray) -> np.ndarray:
    """`values` (n,) with lines over gaps, where windows could not be simulated; filters would
    spread these."""
    known = np.isfinite(values)
    if known.all():
        return values
    places = np.arange(values.size)
    return np.interp(places, places[known], values[known]) if known.any() else np.zeros(values.size)


def _change_over_noise(campaign: Campaign, plan: RunPlan, count: int) -> Callable:
    """A function: norm of the change of readings over noise, extrapolated from compared samples to
    `count`.

    Noise that is not stated is a share of the channel's standard deviation. Filters and faults are
    ignored, as they do not increase the change.
    """
    noise = noise_of(campaign, plan.run.id)
    channels = [name for name in plan.channels if name != "crank_angle"]

    def change(channels_before: Columns, channels_after: Columns) -> float:
        squares = 0.0
        for name in channels:
            sd = noise.get(name) or UNSTATED_NOISE_SHARE * np.std(channels_after[name]) or 1e-300
            squares += np.mean(((channels_before[name] - channels_after[name]) / sd) ** 2)
        return math.sqrt(count * squares)

    return change


def tolerance_for(mechanism: Mechanism | LinkageFile, usual: float = TOLERANCE) -> float:
    """Local error of a step [m] for a fit: smaller for films and small clearances."""
    film = any(mechanism.effect("lubricated_joint", joint) for joint in mechanism.loose)
    shares = [TOLERANCE_SHARE * mechanism.clearance(joint) for joint in mechanism.loose]
    return min([FILM_TOLERANCE if film else usual, *shares])


def has_settled(
    earlier: Columns,
    previous: Columns,
    current: Columns,
    change: Callable[[Columns, Columns], float],
) -> bool:
    """Whether three revolutions have converged to a periodic steady state.

    For changes in a geometric sequence with the (complex) ratio z, the distance to the limit is |z
    / (1 - z)| times the last change: the last change squared over the change of the changes
    (Aitken's extrapolation).
    """
    changed = change(previous, current)
    if changed >= SETTLED_LENGTH:
        return False
    continued = {name: 2.0 * previous[name] - earlier[name] for name in current}
    return changed**2 <= SETTLED_LENGTH * change(continued, current)


def channels_at(
    model: Model,
    angles: np.ndarray,
    tolerance: float,
    perturbation: np.ndarray | None = None,
    change: Callable[[Columns, Columns], float] | None = None,
    read: int | None = None,
) -> dict[str, np.ndarray]:
    """Channels at crank angles by name, with the ``time`` [s]."""
    if model.states == 0:
        count_revolutions(np.ptp(angles) / tau)
        return _sampled(model, angles, lambda at: _kinematic_motion(model, at))
    workspace = beginning(model, start_state(model, perturbation), 0.0)

    def integrate(sorted_angles: np.ndarray) -> Samples:
        nonlocal workspace
        before = workspace.crank_angle
        motion, workspace = integrate_on(model, workspace, sorted_angles, tolerance)
        count_revolutions((workspace.crank_angle - before) / tau)
        return motion

    start = model.drive.start_angle
    back = (angles.min() - start) / tau
    is_settled = perturbation is None and back > TRANSIENT_REVOLUTIONS and _may_repeat(model)
    if change is None or not is_settled:
        return _sampled(model, angles, integrate)
    # in a periodic steady state one revolution is simulated
    within = start + np.mod(angles - start, tau)
    whole_record = {"crank_angle": angles, "time": times_at(model, angles)}
    fewest, most = (max(dropped, round(back)) for dropped in SETTLED_AFTER)
    compared = _spread(within[:read], COMPARED_ANGLES)
    earlier = _sampled(model, within[compared] + (fewest - 2) * tau, integrate)
    previous = _sampled(model, within[compared] + (fewest - 1) * tau, integrate)
    for dropped in range(fewest, most + 1):
        motion = _sampled(model, within + dropped * tau, integrate)
        current = {name: values[compared] for name, values in motion.items()}
        if has_settled(earlier, previous, current, change):
            return motion | whole_record
        earlier, previous = previous, current
    later = (
        most + 1 - math.floor(back)
    ) * tau  # not settled: simulate the record after the dropped revolutions
    return _sampled(model, angles + later, integrate) | whole_record


def settled_revolution(
    campaign: Campaign, plan: RunPlan, run: Prepared
) -> tuple[Workspace, Samples, float] | None:
    """A revolution in periodic steady state: the integration's state at its end, the motion at
    `compared_angles`, and the crank angle [rad] of its end; None if the motion does not settle."""
    model, start = run.driven.model, run.driven.model.drive.start_angle
    if not drives.has_unknown_start(plan.run) or model.states == 0 or not _may_repeat(model):
        return None
    change = _change_over_noise(campaign, plan, run.driven.angles.size)
    workspace, history = beginning(model, start_state(model), 0.0), []
    fewest, _ = SETTLED_AFTER
    for revolution in range(fewest - 2, LINEARISED_BEFORE):
        begin, before = start + revolution * tau, workspace.crank_angle
        motion, workspace = integrate_on(
            model, workspace, compared_angles(begin), run.tolerance, records=True
        )
        count_revolutions((workspace.crank_angle - before) / tau)
        history = [*history[-2:], observed(model, motion)]
        if len(history) == 3 and has_settled(*history, change):
            return workspace, motion, begin + tau
    return None


def _spread(angles: np.ndarray, count: int) -> np.ndarray:
    """Indices of at most `count` of the `angles`, evenly distributed."""
    order = np.argsort(angles, kind="stable")
    return order[np.linspace(0, order.size - 1, min(count, order.size)).round().astype(int)]


def _sampled(
    model: Model, angles: np.ndarray, integrate: Callable[[np.ndarray], Samples]
) -> dict[str, np.ndarray]:
    """Channels at unsorted `angles`; angles of bodies go on beyond half a turn."""
    sorted_angles, places = np.unique(angles, return_inverse=True)
    motion = integrate(sorted_angles)
    columns = observed(model, motion) | {"time": motion.times}
    for body in model.linkage.moving:
        name = f"{body}_angle"
        if name in columns and np.ptp(columns[name]) > math.pi and body != model.linkage.crank:
            columns[name] = continued = np.unwrap(columns[name])
            continued -= tau * np.round(np.mean(continued) / tau)
    return {name: values[places] for name, values in columns.items()}


def times_at(model: Model, angles: np.ndarray) -> np.ndarray:
    """Times (n,) [s] of a prescribed crank at unsorted `angles` (n,) [rad]."""
    with_start = np.append(model.drive.start_angle, angles)
    sorted_angles, places = np.unique(with_start, return_inverse=True)
    return crank_times(model.p, sorted_angles)[places[1:]]


def _may_repeat(model: Model) -> bool:
    """Whether the equations of motion have the period of one revolution."""
    drive, slides, pivots = model.drive, model.p.slides.laws, model.p.pivots.laws
    steady = drive.kind == CONSTANT or (
        drive.kind == FLUCTUATING and drive.order == round(drive.order)
    )
    over_turns = any(
        law.table_over == 2 or (law.table_over == 1 and law.table_period > 1.5 * tau)
        for law in slides
    ) or any(law.periodic and law.periodic_order % 1 for law in pivots)  # a half order
    others = any(law.harmonic or law.formula for law in slides)
    return bool(steady and not over_turns and not others and not any(pivots["formula"]))


def _kinematic_motion(model: Model, angles: np.ndarray) -> Samples:
    start_state(model)  # raises for a rod that does not reach the slide
    return model.room_for(crank_times(model.p, angles))
