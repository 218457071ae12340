"""Re-simulation of lengths, as an ensemble of slightly perturbed starts.

The frozen objective keeps the clearance motion of the original lengths; here it depends on the
lengths. Motion in loose joints can be chaotic, so a reduction from one run is meaningless. Every
pair of lengths, the original one included, is simulated from the same perturbed starts, and each
member of one ensemble is compared with each of the other.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from jointgap.config import Ensemble, Mechanism, Optimise, Simulate
from jointgap.core.joints import FROM_FRAME, PINS
from jointgap.lengths.objective import GOALS, evaluation_samples, measure
from jointgap.motion.kinematics import transmission_angle
from jointgap.motion.parallel import Ensemble as Motions
from jointgap.motion.parallel import simulate_ensemble
from jointgap.motion.slider_crank import perturbed_start


@dataclass(frozen=True)
class Resimulation:
    """An ensemble at one pair of lengths; arrays have the shape (members,)."""

    lengths: tuple[float, float]  # (L2, L3) [m]
    sizes: dict[tuple[str, str], np.ndarray]  # Objectives, by stretch and measure
    extremes: dict[str, np.ndarray]  # Of a settled cycle, named as in `IdealCycle`
    loads: dict[str, dict[str, np.ndarray]]  # Of `_load`, by joint from the frame to the slider

    @property
    def peak_pin_force(self) -> float:
        """The largest force in either pin over the settled revolution, median [N]."""
        return max(float(np.median(self.loads[pin]["peak_force"])) for pin in PINS)


def perturbations(options: Ensemble, loose: Iterable[str]) -> np.ndarray:
    """Initial clearance vectors r2 x, r2 y, r3 x, r3 y, r1 x, r1 y, shape (members, 6) [m].

    Normally distributed; a joint's values do not depend on which others are loose. Zero in ideal
    joints.
    """
    random = np.random.default_rng(options.seed)
    pins, pivot = (
        random.normal(0.0, options.perturbation, (options.members, columns)) for columns in (4, 2)
    )
    return perturbed_start(np.hstack([pins, pivot]), tuple(loose))


def resimulate(
    mechanism: Mechanism,
    simulate: Simulate,
    options: Optimise,
    training_points: int,
    lengths: tuple[float, float],
) -> Resimulation:
    """Simulate the mechanism with other lengths from each perturbed start."""
    starts = perturbations(options.ensemble, mechanism.loose)
    motions = simulate_ensemble(mechanism.with_lengths(*lengths), simulate, starts)
    samples = evaluation_samples(simulate, options, training_points)
    settled = samples["settled"]
    original = mechanism.crank.length, mechanism.rod.length
    desired = transmission_angle(*original, motions.crank_angle, 0.0, mechanism.slider.offset)
    error = desired - motions.transmission_angle
    sizes = {
        (stretch, name): size
        for stretch, chosen_samples in samples.items()
        for name, size in measure(error[:, chosen_samples])._asdict().items()
    }
    if (load := GOALS[options.objective].load) is not None:
        quantities = {"crank_torque": motions.crank_torque, **motions.pin_force}
        sizes["settled", options.objective] = load(
            {name: values[:, settled] for name, values in quantities.items()}
        )
    departure = np.abs(motions.transmission_angle[:, settled] - np.pi / 2)
    slider = motions.slider_position[:, settled]
    return Resimulation(
        lengths,
        sizes,
        extremes={
            "largest_departure": departure.max(axis=1),
            "outer_dead_centre": slider.max(axis=1),
            "inner_dead_centre": slider.min(axis=1),
        },
        loads={
            joint: _load(motions, joint, settled, joint in mechanism.loose) for joint in FROM_FRAME
        },
    )


def _load(
    motions: Motions, joint: str, settled: np.ndarray, is_loose: bool
) -> dict[str, np.ndarray]:
    """Loads of a joint over the settled revolution, (members,) each: forces between its bodies [N],
    crank angle of the largest one [rad], and the share of the time in contact (NaN for an ideal
    joint).
    """
    force = motions.pin_force[joint][:, settled]
    ends = np.append(settled, settled[-1] + 1)
    steps = np.diff(motions.times[:, ends], axis=1)
    weights = steps / steps.sum(axis=1, keepdims=True)
    in_contact = motions.normal_force[joint][:, settled] > 0.0
    return {
        "peak_force": force.max(axis=1),
        "peak_angle": motions.crank_angle[settled][force.argmax(axis=1)] % (2.0 * np.pi),
        "rms_force": np.sqrt(np.sum(weights * force**2, axis=1)),
        "contact_share": np.sum(weights * in_contact, axis=1)
        if is_loose
        else np.full(len(force), np.nan),
    }
