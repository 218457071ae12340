"""Re-simulation of new lengths, as an ensemble of slightly perturbed starts, and surfaces through
simulations.

The frozen objective keeps the clearance motion of the original lengths; here it depends on the
lengths. Motion in loose joints can be chaotic, so a reduction from one run is meaningless. Every
pair of lengths, the original one included, is simulated from the same perturbed starts, and each
member of one ensemble is compared with each of the other.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import RectBivariateSpline

from jointgap.config import Ensemble, Mechanism, Optimise, Simulate
from jointgap.core.joints import FROM_FRAME, PINS
from jointgap.dynamics.kinematics import transmission_angle
from jointgap.dynamics.parallel import Ensemble as Motions
from jointgap.dynamics.parallel import Run, simulate_ensemble, simulate_runs
from jointgap.dynamics.simulation import perturbed_start
from jointgap.lengths.objective import MEASURES, Measures, evaluation_samples, measure
from jointgap.lengths.region import Region, Surface

SURFACE_GRID = 21, 41  # grid points of crank and rod length of a surface
LOW, HIGH = 0.05, 0.95  # quantiles of a spread


def spread(key: str, numbers: ArrayLike) -> dict[str, float]:
    """Median and the 5 % and 95 % quantiles of an ensemble's numbers, as columns of a table."""
    low, median, high = np.quantile(numbers, [LOW, 0.5, HIGH])
    return {key: float(median), f"{key}_low": float(low), f"{key}_high": float(high)}


@dataclass(frozen=True)
class Resimulation:
    """An ensemble at one pair of lengths."""

    lengths: tuple[float, float]  # (L2, L3) [m]
    errors: dict[str, Measures]  # By name in `sample_ranges`
    largest_departure: np.ndarray
    outer_dead_centre: np.ndarray
    inner_dead_centre: np.ndarray
    loads: dict[str, dict[str, np.ndarray]]  # Of `_load` by joint, from the frame to the slider
    quantities: dict[str, np.ndarray] = field(
        default_factory=dict
    )  # Other objectives, settled, (members,) each


def perturbations(options: Ensemble, loose: Iterable[str]) -> np.ndarray:
    """Initial clearance vectors r2 x, r2 y, r3 x, r3 y, r1 x, r1 y, shape (members, 6) [m].

    Normally distributed; a joint's values do not depend on which others are loose. Zero in ideal
    joints.
    """
    random, loose = np.random.default_rng(options.seed), tuple(loose)
    drawn = [
        random.normal(0.0, options.perturbation, (options.members, columns)) for columns in (4, 2)
    ]
    return perturbed_start(np.concatenate(drawn, axis=1), loose)


def sample_ranges(
    simulate: Simulate, optimise: Optimise, training_points: int
) -> dict[str, np.ndarray]:
    """Samples of a trajectory used by each error."""
    per_turn = simulate.samples_per_revolution
    angle = simulate.start_angle + np.arange(per_turn * simulate.revolutions + 1) * (
        2.0 * np.pi / per_turn
    )
    first = (optimise.ensemble.settled_revolution - 1) * per_turn
    return {
        "window": evaluation_samples(angle, optimise.window, per_turn, training_points),
        "settled": np.arange(first, first + per_turn),
    }


def resimulate(
    mechanism: Mechanism,
    simulate: Simulate,
    optimise: Optimise,
    training_points: int,
    lengths: tuple[float, float],
) -> Resimulation:
    """Simulate the mechanism with other lengths from each perturbed start."""
    starts = perturbations(optimise.ensemble, mechanism.loose)
    ensemble = simulate_ensemble(mechanism.with_lengths(*lengths), simulate, starts)
    desired = transmission_angle(
        mechanism.crank.length,
        mechanism.rod.length,
        ensemble.crank_angle,
        0.0,
        mechanism.slider.offset,
    )
    error = desired - ensemble.transmission_angle
    samples = sample_ranges(simulate, optimise, training_points)
    angles = ensemble.transmission_angle[:, samples["settled"]]
    slider = ensemble.slider_position[:, samples["settled"]]
    quantities = {}
    if optimise.objective in SIZES:
        observed = {"crank_torque": ensemble.crank_torque, **ensemble.pin_force}
        settled = {name: values[:, samples["settled"]] for name, values in observed.items()}
        quantities[optimise.objective] = SIZES[optimise.objective](settled)
    return Resimulation(
        lengths=lengths,
        errors={name: measure(error[:, chosen]) for name, chosen in samples.items()},
        largest_departure=np.max(np.abs(angles - np.pi / 2), axis=1),
        outer_dead_centre=np.max(slider, axis=1),
        inner_dead_centre=np.min(slider, axis=1),
        loads={
            joint: _load(ensemble, joint, samples["settled"], joint in mechanism.loose)
            for joint in FROM_FRAME
        },
        quantities=quantities,
    )


Settled = Mapping[str, np.ndarray]
"""Torque of the drive [N m] and forces in the pins [N] by name over a settled revolution, shape
(..., n) each."""


def largest_pin_force(settled: Settled) -> np.ndarray:
    """The largest force in either pin [N], shape (...)."""
    return np.max([settled[pin].max(axis=-1) for pin in PINS], axis=0)


def torque_ripple(settled: Settled) -> np.ndarray:
    """The largest minus the smallest torque of the drive [N m], shape (...)."""
    return np.ptp(settled["crank_torque"], axis=-1)


SIZES = {"largest_pin_force": largest_pin_force, "torque_ripple": torque_ripple}
"""Objectives other than the transmission angle, by `optimise.objective`."""


def _load(ensemble: Motions, joint: str, settled: np.ndarray, loose: bool) -> dict[str, np.ndarray]:
    """Loads of a joint over the settled revolution, (members,) each: forces between its bodies [N],
    crank angle of the largest one [rad], and the share of the time in contact (NaN for an ideal
    joint).
    """
    force = ensemble.pin_force[joint][:, settled]
    times = np.diff(
        ensemble.times[:, np.append(settled, settled[-1] + 1)], axis=1
    )  # to the next sample
    weight = times / times.sum(axis=1, keepdims=True)
    touching = ensemble.normal_force[joint][:, settled] > 0.0
    return {
        "peak_force": force.max(axis=1),
        "peak_angle": ensemble.crank_angle[settled][force.argmax(axis=1)] % (2.0 * np.pi),
        "rms_force": np.sqrt(np.sum(weight * force**2, axis=1)),
        "contact_share": (
            np.sum(weight * touching, axis=1) if loose else np.full(len(force), np.nan)
        ),
    }


def reduction_pairs(new: np.ndarray, original: np.ndarray) -> np.ndarray:
    """The reduction of one measure for every pair of single runs, shape (members * members,)."""
    return (1.0 - np.divide.outer(new, original)).ravel()


def compare(new: Resimulation, original: Resimulation) -> list[dict[str, object]]:
    """Errors and reduction with their spreads, per range of samples and measure."""
    compared = [
        (stretch, *each)
        for stretch in new.errors
        for each in zip(MEASURES, new.errors[stretch], original.errors[stretch], strict=True)
    ]
    compared += [
        ("settled", name, own, original.quantities[name]) for name, own in new.quantities.items()
    ]
    rows = []
    for stretch, name, error, before in compared:
        pairs = reduction_pairs(error, before)
        row = {"stretch": stretch, "measure": name}
        row |= (
            spread("original_error", before) | spread("error", error) | spread("reduction", pairs)
        )
        rows.append(row | {"share_better": float(np.mean(pairs > 0.0))})
    return rows


def peak_pin_force(resimulation: Resimulation) -> float:
    """The largest force in either pin over the settled revolution, median of the ensemble [N]."""
    return max(float(np.median(resimulation.loads[joint]["peak_force"])) for joint in PINS)


def pin_force(
    mechanism: Mechanism, simulate: Simulate, optimise: Optimise, region: Region
) -> Surface:
    """The largest pin force over a region."""
    return surface(mechanism, simulate, optimise, region, largest_pin_force)


def surface(
    mechanism: Mechanism,
    simulate: Simulate,
    optimise: Optimise,
    region: Region,
    size: Callable[[Settled], np.ndarray],
) -> Surface:
    """A quantity over a region: a surface through one simulation per grid point."""
    settled = sample_ranges(simulate, optimise, 2)["settled"]
    cranks, rods = (
        np.linspace(low, high, points)
        for low, high, points in zip(region.lower, region.upper, SURFACE_GRID, strict=True)
    )
    runs = (Run(mechanism.with_lengths(crank, rod), simulate) for crank in cranks for rod in rods)
    sizes = []
    for outcome in simulate_runs(runs):
        if outcome.error is not None:
            raise outcome.error
        observed = outcome.result.observed(outcome.parameters)
        forces = {
            pin: np.hypot(observed[f"{pin}_force_x"], observed[f"{pin}_force_y"])[settled]
            for pin in PINS
        }
        sizes.append(float(size({"crank_torque": observed["crank_torque"][settled], **forces})))
    return Surface(RectBivariateSpline(cranks, rods, np.reshape(sizes, SURFACE_GRID)))
