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

from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_simpson

from jointgap.config import Mechanism, Simulate
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.core.schema import KINEMATICS_CONTRADICTIONS, KINEMATICS_QUANTITIES
from jointgap.dynamics.kinematics import ClearanceMotion, Fit, LinkageMotion, Motion, linkage_motion

UNITS = {column.name: column.unit for column in KINEMATICS_QUANTITIES.columns}
PAST = np.radians(60.0)  # end of the paper's transient
STEP = 1e-4  # [rad] step of the difference quotient for second derivatives of fits

Frames = Mapping[str, pd.DataFrame]
Regions = Mapping[str, np.ndarray]


def kinematics(
    mechanism: Mechanism,
    options: Simulate,
    training_points: int,
    trajectory: pd.DataFrame,
    surrogates: Mapping[str, Mapping[str, Fit]],
) -> dict[str, pd.DataFrame]:
    """The tables kinematics, kinematics_errors and kinematics_contradictions."""
    first = trajectory.iloc[: options.samples_per_revolution + 1]
    angle, crank = first["crank_angle"].to_numpy(), _crank(first)
    simulated = ClearanceMotion.from_table(first, mechanism.loose)
    clearances = {"simulation_exact": simulated, "simulation_paper_form": simulated.paper_form()}
    for name, fits in surrogates.items():
        forms = clearance_motions(fits, crank, mechanism.loose)
        clearances |= {f"{name}_{form}": motion for form, motion in forms.items()}
    frames = linkage_frames(mechanism, first)
    frames |= {
        name: _frame(linkage_motion(mechanism, crank, motion), angle)
        for name, motion in clearances.items()
    }

    held_out = (
        np.arange(len(first)) % (options.samples_per_revolution // (training_points - 1)) != 0
    )
    regions = {"first_revolution": held_out, "past_60_deg": held_out & (angle - angle[0] > PAST)}
    rows = [
        row
        for name in surrogates
        for row in _contradictions(name, mechanism.loose, clearances, frames, regions, first)
    ]
    return {
        "kinematics": motion_table(frames, angle),
        "kinematics_errors": _errors(frames, regions),
        "kinematics_contradictions": pd.DataFrame(rows, columns=KINEMATICS_CONTRADICTIONS.names),
    }


def linkage_frames(mechanism: Mechanism, samples: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Quantities of the table kinematics for the sources ``simulation`` and ``ideal``."""
    ideal = linkage_motion(mechanism, _crank(samples))
    return {
        "simulation": samples[list(UNITS)],
        "ideal": _frame(ideal, samples["crank_angle"].to_numpy()),
    }


def motion_table(frames: Mapping[str, pd.DataFrame], angle: np.ndarray) -> pd.DataFrame:
    """The table kinematics from `frames` by source, at the crank angles `angle` (n,) [rad]."""
    motion = pd.concat(
        [frame.assign(source=name, crank_angle=angle) for name, frame in frames.items()]
    )
    return motion[["source", "crank_angle", *UNITS]].reset_index(drop=True)


def _crank(samples: pd.DataFrame) -> Motion:
    return Motion.of(
        *(samples[f"crank_{name}"].to_numpy() for name in ("angle", "speed", "acceleration"))
    )


def clearance_motions(
    fits: Mapping[str, Fit], crank: Motion, loose: Iterable[str]
) -> dict[str, ClearanceMotion]:
    """The clearance motion of the fits in the four forms listed above."""
    forms: dict[str, dict[str, Motion]] = {
        "paper_form": {},
        "exact": {},
        "own_rates": {},
        "integrated": {},
    }
    for joint in (JOINT_NUMBERS[name] for name in loose):
        length = _differentiated(fits[f"r{joint}"], crank)
        own = _differentiated(fits[f"gamma{joint}"], crank)
        rate, second = (fits[f"gamma{joint}_{dots}"](crank.position)[0] for dots in ("dot", "ddot"))
        learned = Motion(own.position, rate, second)
        integrated = Motion(
            _integrated(rate, crank, own.position[0]), _integrated(second, crank, rate[0]), second
        )
        for form, gamma in zip(forms, (learned, learned, own, integrated), strict=True):
            forms[form][f"r{joint}"] = length if form == "exact" else length.standing_still()
            forms[form][f"gamma{joint}"] = gamma
    return {form: ClearanceMotion(**motions) for form, motions in forms.items()}


def _differentiated(fit: Fit, crank: Motion) -> Motion:
    """A fit and its time derivatives; the second is a fourth-order difference quotient of the exact
    first."""
    angle = crank.position
    value, slope = fit(angle)
    slopes = [fit(angle + step * STEP)[1] for step in (-2, -1, 1, 2)]
    second = (slopes[0] - 8.0 * slopes[1] + 8.0 * slopes[2] - slopes[3]) / (12.0 * STEP)
    return Motion(
        value, slope * crank.velocity, second * crank.velocity**2 + slope * crank.acceleration
    )


def _integrated(rate: np.ndarray, crank: Motion, start: float) -> np.ndarray:
    return start + cumulative_simpson(rate / crank.velocity, x=crank.position, initial=0.0)


def _frame(motion: LinkageMotion, angle: np.ndarray) -> pd.DataFrame:
    parts = ("position", "velocity", "acceleration")
    rod = [getattr(motion_of, part) for part in parts for motion_of in (motion.rod_x, motion.rod_y)]
    turn, slide = (
        [getattr(motion_of, part) for part in parts]
        for motion_of in (motion.rod_angle, motion.slider_x)
    )
    columns = [*rod, *turn, *slide, motion.transmission_angle.position]
    return pd.DataFrame(
        {name: np.broadcast_to(one, angle.shape) for name, one in zip(UNITS, columns, strict=True)}
    )


def _difference(
    one: np.ndarray, other: np.ndarray, region: np.ndarray, true: np.ndarray
) -> dict[str, float]:
    """Norms of other - one over the defined samples of the region, and the simulation's range
    there."""
    difference, reference = (other - one)[region], true[region]
    difference, reference = difference[np.isfinite(difference)], reference[np.isfinite(reference)]
    rms, extent = float(np.sqrt(np.mean(difference**2))), float(np.ptp(reference))
    peak, share = float(np.max(np.abs(difference))), rms / extent
    return {
        "rms": rms,
        "peak": peak,
        "range": extent,
        "rms_over_range": share,
        "samples": len(difference),
    }


def _errors(frames: Frames, regions: Regions) -> pd.DataFrame:
    rows = []
    for quantity, unit in UNITS.items():
        true = frames["simulation"][quantity].to_numpy()
        for region, inside in regions.items():
            keys = {"quantity": quantity, "unit": unit, "region": region}
            sizes = {
                source: _difference(true, frame[quantity].to_numpy(), inside, true)
                for source, frame in frames.items()
                if source != "simulation"
            }
            rows += [
                {
                    "source": source,
                    **keys,
                    **own,
                    "rms_over_ideal": own["rms"] / sizes["ideal"]["rms"],
                }
                for source, own in sizes.items()
            ]
    return pd.DataFrame(rows)


def _contradictions(
    name: str,
    loose: Iterable[str],
    clearances: Mapping[str, ClearanceMotion],
    frames: Frames,
    regions: Regions,
    simulated: pd.DataFrame,
) -> list[dict[str, object]]:
    """Rows of the table kinematics_contradictions for one surrogate; ranges from `simulated`."""
    pairs = []
    for gamma in (f"gamma{JOINT_NUMBERS[joint]}" for joint in loose):
        fit, own, integrated = (
            getattr(clearances[f"{name}_{form}"], gamma)
            for form in ("paper_form", "own_rates", "integrated")
        )
        of = f"of the fit of {gamma}"
        for quantity, unit, way, one, other in (
            (gamma, "rad", f"integral {of}_dot", fit.position, integrated.position),
            (f"{gamma}_dot", "rad/s", f"derivative {of}", fit.velocity, own.velocity),
            (
                f"{gamma}_ddot",
                "rad/s^2",
                f"second derivative {of}",
                fit.acceleration,
                own.acceleration,
            ),
        ):
            pairs.append((quantity, unit, f"fit of {quantity}", way, one, other))
    for quantity, form, way in (
        ("slider_position", "integrated", "gamma as integral of the fit of its rate"),
        ("slider_velocity", "own_rates", "gamma' as derivative of the fit of gamma"),
        ("slider_acceleration", "own_rates", "gamma', gamma'' as derivatives of the fit of gamma"),
    ):
        one, other = (
            frames[f"{name}_{which}"][quantity].to_numpy() for which in ("paper_form", form)
        )
        pairs.append((quantity, UNITS[quantity], "each output from its own fit", way, one, other))
    return [
        {
            "surrogate": name,
            "quantity": quantity,
            "unit": unit,
            "one_way": one_way,
            "other_way": other_way,
        }
        | {"region": region, **_difference(one, other, inside, simulated[quantity].to_numpy())}
        for quantity, unit, one_way, other_way, one, other in pairs
        for region, inside in regions.items()
    ]
