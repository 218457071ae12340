"""The stage kinematics: the paper's equations with surrogates and with simulated clearances,
against the simulation.

Sources, `NAME` being a surrogate's name such as ``networks``:

- ``simulation``: the simulation's own values; ``ideal``: the mechanism without clearance.
- ``simulation_exact``, ``simulation_paper_form``: simulated clearance vectors, with and without the
  derivatives of r.
- ``NAME_paper_form``: r, gamma, gamma' and gamma'' each from its own fit, r constant (the paper's
  method).
- ``NAME_exact``: the same with r' and r'' as derivatives of the fits of r.
- ``NAME_own_rates``: gamma' and gamma'' as derivatives of the fits of gamma, r constant.
- ``NAME_integrated``: gamma and gamma' as integrals of the fits of gamma' and gamma'', r constant.

The last two show the effect of independent fits that are inconsistent."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_simpson

from jointgap.config import Mechanism, Simulate
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.core.schema import KINEMATICS_CONTRADICTIONS, KINEMATICS_QUANTITIES
from jointgap.motion.kinematics import ClearanceMotion, Fit, LinkageMotion, Motion, linkage_motion

UNITS = {column.name: column.unit for column in KINEMATICS_QUANTITIES.columns}
TRANSIENT = np.radians(60.0)  # end of the paper's transient
STEP = 1e-4  # [rad] step of the difference quotient for second derivatives of fits

Frames = Mapping[str, pd.DataFrame]


def kinematics(
    mechanism: Mechanism,
    options: Simulate,
    training_points: int,
    trajectory: pd.DataFrame,
    surrogates: Mapping[str, Mapping[str, Fit]],
) -> dict[str, pd.DataFrame]:
    """The tables kinematics, kinematics_errors and kinematics_contradictions."""
    samples = trajectory.iloc[: options.samples_per_revolution + 1]
    angle, crank = samples["crank_angle"].to_numpy(), _crank(samples)
    simulated = ClearanceMotion.from_table(samples, mechanism.loose)
    clearances = {"simulation_exact": simulated, "simulation_paper_form": simulated.paper_form()}
    for name, fits in surrogates.items():
        for form, motion in clearance_motions(fits, crank, mechanism.loose).items():
            clearances[f"{name}_{form}"] = motion
    frames = linkage_frames(mechanism, samples)
    for name, motion in clearances.items():
        frames[name] = _frame(linkage_motion(mechanism, crank, motion), angle)

    step = options.samples_per_revolution // (training_points - 1)
    held_out = np.arange(len(samples)) % step != 0
    is_settled = held_out & (angle - angle[0] > TRANSIENT)
    regions = {"first_revolution": held_out, "past_60_deg": is_settled}
    errors, contradictions = [], []
    for region, inside in regions.items():
        errors += [row | {"region": region} for row in _errors(frames, inside)]
        for name in surrogates:
            for way, difference in _contradictions(name, mechanism.loose, clearances, frames):
                sizes = _sizes(difference, samples[way["quantity"]].to_numpy(), inside)
                row = {"surrogate": name, "region": region}
                contradictions.append(row | way | sizes)
    return {
        "kinematics": motion_table(frames, angle),
        "kinematics_errors": pd.DataFrame(errors),
        "kinematics_contradictions": pd.DataFrame(
            contradictions, columns=KINEMATICS_CONTRADICTIONS.names
        ),
    }


def linkage_frames(mechanism: Mechanism, samples: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Quantities of the table kinematics for the sources ``simulation`` and ``ideal``."""
    ideal = linkage_motion(mechanism, _crank(samples))
    return {
        "simulation": samples[list(UNITS)],
        "ideal": _frame(ideal, samples["crank_angle"].to_numpy()),
    }


def motion_table(frames: Frames, angle: np.ndarray) -> pd.DataFrame:
    """The table kinematics from `frames` by source, at the crank angles `angle` (n,) [rad]."""
    motion = pd.concat(
        [frame.assign(source=name, crank_angle=angle) for name, frame in frames.items()]
    )
    return motion[["source", "crank_angle", *UNITS]].reset_index(drop=True)


def _crank(samples: pd.DataFrame) -> Motion:
    columns = (f"crank_{name}" for name in ("angle", "speed", "acceleration"))
    return Motion.of(*(samples[column].to_numpy() for column in columns))


def clearance_motions(
    fits: Mapping[str, Fit], crank: Motion, loose: Iterable[str]
) -> dict[str, ClearanceMotion]:
    """The clearance motion of the fits in the four forms listed above."""
    motions: dict[str, dict[str, Motion]] = {
        form: {} for form in ("paper_form", "exact", "own_rates", "integrated")
    }
    for joint in (JOINT_NUMBERS[name] for name in loose):
        length = _differentiated(fits[f"r{joint}"], crank)
        gamma = _differentiated(fits[f"gamma{joint}"], crank)
        rate, acceleration = (
            fits[f"gamma{joint}_{dots}"](crank.position)[0] for dots in ("dot", "ddot")
        )
        learned = Motion(gamma.position, rate, acceleration)
        integrated = Motion(
            _integral(rate, crank, gamma.position[0]),
            _integral(acceleration, crank, rate[0]),
            acceleration,
        )
        directions = learned, learned, gamma, integrated
        for (form, motion), direction in zip(motions.items(), directions, strict=True):
            motion[f"r{joint}"] = length if form == "exact" else length.standing_still()
            motion[f"gamma{joint}"] = direction
    return {form: ClearanceMotion(**motion) for form, motion in motions.items()}


def _differentiated(fit: Fit, crank: Motion) -> Motion:
    """A fit and its time derivatives; the second is a fourth-order difference quotient of the exact
    first."""
    value, slope = fit(crank.position)
    slopes = [fit(crank.position + step * STEP)[1] for step in (-2, -1, 1, 2)]
    curvature = (slopes[0] - 8.0 * slopes[1] + 8.0 * slopes[2] - slopes[3]) / (12.0 * STEP)
    acceleration = curvature * crank.velocity**2 + slope * crank.acceleration
    return Motion(value, slope * crank.velocity, acceleration)


def _integral(rate: np.ndarray, crank: Motion, start: float) -> np.ndarray:
    return start + cumulative_simpson(rate / crank.velocity, x=crank.position, initial=0.0)


def _frame(motion: LinkageMotion, angle: np.ndarray) -> pd.DataFrame:
    parts = ("position", "velocity", "acceleration")
    rod = [getattr(axis, part) for part in parts for axis in (motion.rod_x, motion.rod_y)]
    turn, slide = (
        [getattr(coordinate, part) for part in parts]
        for coordinate in (motion.rod_angle, motion.slider_x)
    )
    columns = [*rod, *turn, *slide, motion.transmission_angle.position]
    columns = [np.broadcast_to(column, angle.shape) for column in columns]
    return pd.DataFrame(dict(zip(UNITS, columns, strict=True)))


def _sizes(difference: np.ndarray, simulated: np.ndarray, inside: np.ndarray) -> dict[str, float]:
    """Norms of a difference over its defined samples `inside` a region, and the simulation's range
    there."""
    difference = difference[inside & np.isfinite(difference)]
    rms = float(np.sqrt(np.mean(difference**2)))
    extent = float(np.ptp(simulated[inside & np.isfinite(simulated)]))
    return {
        "rms": rms,
        "peak": float(np.max(np.abs(difference))),
        "range": extent,
        "rms_over_range": rms / extent,
        "samples": len(difference),
    }


def _errors(frames: Frames, inside: np.ndarray) -> Iterator[dict[str, object]]:
    """Rows of the table kinematics_errors for a region."""
    for quantity, unit in UNITS.items():
        simulated = frames["simulation"][quantity].to_numpy()
        sizes = {
            source: _sizes(frame[quantity].to_numpy() - simulated, simulated, inside)
            for source, frame in frames.items()
            if source != "simulation"
        }
        for source, size in sizes.items():
            ratio = {"rms_over_ideal": size["rms"] / sizes["ideal"]["rms"]}
            yield {"source": source, "quantity": quantity, "unit": unit} | size | ratio


def _contradictions(
    surrogate: str,
    loose: Iterable[str],
    clearances: Mapping[str, ClearanceMotion],
    frames: Frames,
) -> Iterator[tuple[dict[str, str], np.ndarray]]:
    """Two ways to get a quantity, which contradict each other, and their difference."""
    for gamma in (f"gamma{JOINT_NUMBERS[joint]}" for joint in loose):
        fit, derived, integrated = (
            getattr(clearances[f"{surrogate}_{form}"], gamma)
            for form in ("paper_form", "own_rates", "integrated")
        )
        for ending, unit, text, difference in (
            ("", "rad", f"integral of the fit of {gamma}_dot", integrated.position - fit.position),
            ("_dot", "rad/s", f"derivative of the fit of {gamma}", derived.velocity - fit.velocity),
            (
                "_ddot",
                "rad/s^2",
                f"second derivative of the fit of {gamma}",
                derived.acceleration - fit.acceleration,
            ),
        ):
            quantity = f"{gamma}{ending}"
            way = {"quantity": quantity, "unit": unit, "one_way": f"fit of {quantity}"}
            yield way | {"other_way": text}, difference
    for quantity, form, text in (
        ("slider_position", "integrated", "gamma as integral of the fit of its rate"),
        ("slider_velocity", "own_rates", "gamma' as derivative of the fit of gamma"),
        ("slider_acceleration", "own_rates", "gamma', gamma'' as derivatives of the fit of gamma"),
    ):
        separate, derived = (
            frames[f"{surrogate}_{name}"][quantity].to_numpy() for name in ("paper_form", form)
        )
        way = {"quantity": quantity, "unit": UNITS[quantity], "other_way": text}
        yield way | {"one_way": "each output from its own fit"}, derived - separate
