"""Measures of one motion of a design, and its best lengths."""

import math

import numpy as np
from scipy.optimize import newton

from jointgap.config import Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.core.schema import BEST_LENGTHS
from jointgap.designs.sampling import ErrorDefinition
from jointgap.lengths.objective import Objective, joint_forces, objective_of_motion
from jointgap.linkage.assembly import ON_ARRAYS
from jointgap.linkage.equations import NOTHING, Crank, Pose
from jointgap.linkage.topology import Joint, number
from jointgap.motion.linkage import check_walls
from jointgap.motion.model import Columns, Model, corner_names
from jointgap.motion.parallel import Outcome
from jointgap.motion.sampling import ROUNDING, angle_errors, contact_sums, largest_change
from jointgap.motion.simulation import crank_angles, observed
from jointgap.motion.slider_crank import rod_and_slider
from jointgap.paper.printed import OPTIMA

NOISE_ORDER = 10  # order of the crank above which acceleration counts as noise
_NO_ERROR = 1e-12  # [rad] RMS of rounding errors, without a relative reduction
# [crank length] distance of the first two trial lengths: less than the correction for clearances
_FIRST_STEP = 1e-4
_LENGTH_TOLERANCE = 1e-9  # [crank length] of the best crank length: 0.1 nm
_WHOLE_TURN = (0.0, 2.0 * math.pi)
_ERRORS = tuple(
    f"angle_error_{size}{span}" for span in ("", "_in_window") for size in ("rms", "mean", "peak")
)


def angles_to_measure(options: Simulate) -> np.ndarray:
    """Crank angles [rad] that `measures` reads: the first revolution, and the last two."""
    angles, per_turn = crank_angles(options), options.samples_per_revolution
    second_last = max(per_turn, len(angles) - 2 * per_turn - 1)
    return np.concatenate((angles[:per_turn], angles[second_last:]))


def measures(outcome: Outcome, window: tuple[float, float]) -> dict[str, float]:
    """The numbers `jointgap.config.designs.measured` of a successful run, and some of other
    mechanisms [SI]; NaN where undefined."""
    result, model, mechanism = outcome.result, outcome.model, outcome.run.mechanism
    sites, per_turn = mechanism.sites, outcome.run.options.samples_per_revolution
    last_turn = slice(-per_turn - 1, None)
    seen = observed(model, result.part(last_turn))
    if isinstance(mechanism, LinkageFile):
        check_walls(mechanism, seen)
    slide = model.linkage.joints.get(sites.slides.get(sites.output))
    dyad = next(dyad for dyad in model.linkage.dyads if sites.output in dyad.bodies)

    # the first revolution, and the last one, whose end repeats its beginning
    rows = np.r_[:per_turn, -per_turn - 1 : -1]
    first, last = slice(None, per_turn), slice(per_turn, None)
    angle = outcome.crank_angle[rows]
    pose, ideal = pose_of(model, angle, result.states[rows]), pose_of(model, angle[last])
    cosines, ideal_cosines = (each.cosines[dyad.inner.name] for each in (pose, ideal))
    *errors, least_angle = angle_errors(
        cosines[last], ideal_cosines, angle[last], -math.inf, math.inf
    )
    *errors_in_window, _ = angle_errors(cosines[first], ideal_cosines, angle[first], *window)
    angle, position = angle[last], position_of(pose, sites.output, slide)[last]
    departure = position - position_of(ideal, sites.output, slide)
    departure -= math.tau * np.round(departure / math.tau)  # of angles; never as large in m
    acceleration = _acceleration(seen, sites.output, slide)[:-1]
    turned = position[-1] - position[0]
    (outer, outer_angle), (inner, inner_angle) = (
        # a body that turns fully has no dead centres
        (math.nan, math.nan) if abs(turned) > math.pi else _extreme(sign * position, angle)
        for sign in (1.0, -1.0)
    )
    rms = math.sqrt(np.mean(acceleration**2))
    row = dict(zip(_ERRORS, (*errors, *errors_in_window), strict=True)) | {
        "least_transmission_angle": least_angle,
        "stroke": outer + inner,
        "swing": outer + inner,
        # without offset at 0 and pi: ranges around these have meaningful means over designs
        "outer_dead_centre_angle": (outer_angle + math.pi) % (2.0 * math.pi) - math.pi,
        "inner_dead_centre_angle": inner_angle,
        "acceleration_rms": rms,
        "noise_share": high_order_rms(acceleration) / rms if rms else math.nan,
        "repeat_distance": _repeat_distance(outcome, per_turn),
        "departure_rms": math.sqrt(np.mean(departure**2)),
        "departure_peak": float(np.abs(departure).max()),
        "peak_torque": float(np.abs(seen["crank_torque"]).max()),
    }
    times = result.times[last_turn]
    begin, end = float(times[0]), float(times[-1])
    sums = contact_sums(result.events, len(model.contacts), begin, end)
    for joint, force in joint_forces(seen, model.linkage.joints).items():
        share = count = math.nan
        normal = seen.get(f"{joint}_normal_force", force)
        peak = normal.max()
        if joint in model.loose:
            is_slide = joint not in model.pins
            names = corner_names(joint) if is_slide else (joint,)
            numbers = [model.contacts.index(name) for name in names]
            contact_time, impacts, contact_peaks = (values[numbers] for values in sums)
            if is_slide:  # its corners touch at the same time
                touches = seen[f"{joint}_contacts"][:-1] > 0.0
                contact_time = np.diff(times)[touches]
            share, count = contact_time.sum() / (end - begin), impacts.sum()
            peak = max(peak, *contact_peaks)  # samples may miss that of a short contact
        row |= {
            f"{joint}_contact_share": float(share),
            f"{joint}_impacts": float(count),
            f"{joint}_peak_force": float(peak),
            f"{joint}_rms_force": math.sqrt(np.mean(normal[:-1] ** 2)),
        }
    return row


def pose_of(model: Model, angle: np.ndarray, states: np.ndarray | None = None) -> Pose:
    """Positions at crank angles [rad]; by default those without clearance."""
    vectors = {name: (NOTHING, NOTHING) for name in model.loose}
    if states is not None:
        vectors = {name: (tuple(model.vector(states, name)[0].T), NOTHING) for name in vectors}
    crank = Crank(np.cos(angle), np.sin(angle), 0.0)
    return Pose(model.linkage, model.variant.signs, crank, vectors, ON_ARRAYS)


def position_of(pose: Pose, body: str, slide: Joint | None) -> np.ndarray:
    """Place [m] of a body along its slide, or its continuous angle [rad]."""
    if slide:
        return pose.travel(slide)[0]
    return np.unwrap(ON_ARRAYS.angle(pose.directions[body]))


def _acceleration(seen: Columns, body: str, slide: Joint | None) -> np.ndarray:
    """Acceleration [m/s^2] of a body along its slide, or its angular acceleration [rad/s^2]."""
    if not slide:
        return seen[f"{body}_angular_acceleration"]
    if slide.loose:
        direction = number(slide.direction)
        x, y = (seen[f"{body}_acceleration_{axis}"] for axis in "xy")
        return math.cos(direction) * x + math.sin(direction) * y
    return seen[f"{body}_acceleration"]


def high_order_rms(values: np.ndarray) -> float:
    """RMS of one revolution of `values` above order `NOISE_ORDER`."""
    spectrum = np.fft.rfft(values)
    spectrum[: NOISE_ORDER + 1] = 0.0
    return math.sqrt(np.mean(np.fft.irfft(spectrum, len(values)) ** 2))


def _extreme(values: np.ndarray, angle: np.ndarray) -> tuple[float, float]:
    """Maximum of periodic samples, by parabolic interpolation, and its angle in [0, 2 pi)."""
    top = int(np.argmax(values))
    previous, peak, following = values[top - 1], values[top], values[(top + 1) % len(values)]
    curvature = previous - 2.0 * peak + following
    shift = 0.5 * (previous - following) / curvature if curvature < 0.0 else 0.0
    top_angle = angle[top] + shift * 2.0 * math.pi / len(values)
    return float(peak - 0.25 * (previous - following) * shift), float(top_angle % (2.0 * math.pi))


def _repeat_distance(outcome: Outcome, per_turn: int) -> float:
    """Largest distance of the clearance vectors between the last two revolutions, over the smallest
    clearance; NaN with one revolution, or without clearance."""
    result, mechanism = outcome.result, outcome.run.mechanism
    if len(result.times) < 2 * per_turn + 1 or not mechanism.loose:
        return math.nan
    two_turns = slice(-2 * per_turn - 1, None)
    smallest = min(map(mechanism.clearance, mechanism.loose))
    model, states = outcome.model, result.states[two_turns]
    # of a slide the offset across it
    vectors = [model.vector(states, name)[0][:, : 1 + (name in model.pins)] for name in model.loose]
    return largest_change(np.hstack(vectors), per_turn) / smallest


def best_lengths(outcome: Outcome, definition: ErrorDefinition) -> dict[str, float]:
    """The numbers `BEST_LENGTHS` of a successful run; NaN where undefined."""
    per_turn = outcome.run.options.samples_per_revolution
    last_turn = _objective(outcome, slice(-per_turn - 1, -1), _WHOLE_TURN)
    in_window = _objective_of(outcome, definition)
    return dict(zip(BEST_LENGTHS.names, (*_best(last_turn), *_best(in_window)), strict=True))


def printed_reductions(outcome: Outcome, definition: ErrorDefinition) -> dict[str, float]:
    """The numbers `PRINTED_OPTIMA` of a successful run; NaN where undefined."""
    objective, reductions = _objective_of(outcome, definition), [math.nan] * len(OPTIMA)
    if objective:
        lengths = np.array([(optimum.crank_length, optimum.rod_length) for optimum in OPTIMA])
        reductions = getattr(objective.reductions(lengths), definition.measure)
    keys = (f"reduction_at_{optimum.key}" for optimum in OPTIMA)
    return dict(zip(keys, reductions, strict=True))


def _objective_of(outcome: Outcome, definition: ErrorDefinition) -> Objective | None:
    per_turn, number = outcome.run.options.samples_per_revolution, definition.revolution
    return _objective(outcome, slice((number - 1) * per_turn, number * per_turn), definition.window)


def _objective(outcome: Outcome, turn: slice, window: tuple[float, float]) -> Objective | None:
    """The error of a revolution as a function of the lengths, in a window; None where the window
    has no samples."""
    angle, result = outcome.crank_angle[turn], outcome.result
    # rounding may put the first sample of a later revolution before its beginning
    turned = (angle + ROUNDING) % (2.0 * math.pi)
    inside = (turned >= window[0]) & (turned <= window[1] + 2.0 * ROUNDING)
    if not inside.any():
        return None
    rod, _ = rod_and_slider(outcome.model, angle, result.states[turn])
    return objective_of_motion(outcome.run.mechanism, angle[inside], rod[inside])


def _best(objective: Objective | None) -> tuple[float, float, float]:
    """Best crank length [m] for the original rod, the ratio of the lengths, and the relative
    reduction of the RMS."""
    if objective is None:
        return math.nan, math.nan, math.nan
    rod = objective.original[1]
    crank, original = best_crank_length(objective, rod), objective.value(objective.original)
    has_error = original > len(objective.sine) * _NO_ERROR**2
    relative = objective.value((crank, rod)) / original if has_error else math.nan
    return crank, crank / rod, 1.0 - math.sqrt(relative)


def best_crank_length(objective: Objective, rod_length: float) -> float:
    """Crank length [m] of the smallest sum of squares, equation (12), for a given rod length; NaN
    where none is found.

    The error is almost affine in the crank length, so the secant method converges on the
    derivative's zero.
    """
    crank = objective.original[0]
    with np.errstate(invalid="ignore"):  # undefined where the rod does not reach the slide
        length, state = newton(
            lambda length: objective.gradient((length, rod_length))[0],
            crank,
            x1=(1.0 + _FIRST_STEP) * crank,
            tol=_LENGTH_TOLERANCE * crank,
            full_output=True,
            disp=False,
        )
    return float(length) if state.converged else math.nan
