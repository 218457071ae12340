"""Statistics of chaotic motion agree with Exudyn.  Without friction a change of 1e-11 m grows a
millionfold in a revolution or two. Ensembles of slightly different starts are compared: the means
may differ by their scatter."""

import math

import numpy as np
import pytest

pytest.importorskip("exudyn", reason="needs Exudyn: scripts/set-up peers")

from jointgap.core.joints import PINS
from jointgap.motion.slider_crank import simulate
from tests.independent.cases import SPEED, mechanism, options
from validation.exudyn import SliderCrank

RUNS, REVOLUTIONS = 24, 2  # after a first revolution, in which all runs are still alike
STEP = math.radians(5)
SECTOR = math.radians(30)
# m: small compared with the clearance of 1 mm; the runs diverge within a revolution
SCATTER = 1e-5


def starts(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, SCATTER, (RUNS, 4))


def error(crank_angle, rod_angle) -> float:
    """RMS deviation [rad] of the rod angle, hence of the transmission angle, from the ideal
    mechanism's."""
    made = mechanism()
    ideal = -np.arcsin(made.crank.length / made.rod.length * np.sin(crank_angle))
    return float(np.sqrt(np.mean((rod_angle - ideal) ** 2)))


def force_statistics(angle, force) -> dict[str, float]:
    """Of the largest force [N] in each sector of the crank angle [rad] in one run."""
    sector = ((angle - 2 * math.pi) / SECTOR).astype(int)
    peaks = [force[sector == number].max() for number in np.unique(sector)]
    return {"mean peak": float(np.mean(peaks)), "90 % peak": float(np.percentile(peaks, 90))}


def ours(perturbation) -> dict[str, float]:
    choice = options(revolutions=REVOLUTIONS + 1, samples_per_revolution=36000, tolerance=1e-11)
    run = simulate(mechanism(), choice, perturbation).samples
    late = run[run["crank_angle"] >= 2 * math.pi].iloc[:-1]
    coarse = late.iloc[:: round(36000 * STEP / (2 * math.pi))]
    found = {"error": error(coarse["crank_angle"].to_numpy(), coarse["rod_angle"].to_numpy())}
    for joint in PINS:
        force = late[f"{joint}_normal_force"].to_numpy()
        found[f"{joint} in contact"] = float((late[f"{joint}_mode"] != "flight").mean())
        statistics = force_statistics(late["crank_angle"].to_numpy(), force)
        found |= {f"{joint} {name}": value for name, value in statistics.items()}
    return found


def exudyns(perturbation) -> dict[str, float]:
    start = {"crank_pin": perturbation[:2], "piston_pin": perturbation[2:]}
    peer = SliderCrank(mechanism(), SPEED, perturbation=start, recorded=True)
    peer.advance(2 * math.pi / SPEED, 1e-8)
    angles = 2 * math.pi + STEP * np.arange(round(2 * math.pi * REVOLUTIONS / STEP) + 1)
    rod_angles, records = [peer.positions()[2]], []
    for angle in angles[1:]:
        rod_angles.append(peer.advance(angle / SPEED, 1e-8)[2])
        records.append(peer.record())
    found = {"error": error(angles[:-1], np.array(rod_angles[:-1]))}
    time = np.concatenate([one for one, _, _ in records])
    for joint in PINS:
        inside = np.concatenate([penetration[joint] for _, penetration, _ in records]) > 0
        force = np.concatenate([force[joint] for _, _, force in records])
        lasting = np.diff(time)
        found[f"{joint} in contact"] = float(
            lasting[inside[1:] & inside[:-1]].sum() / lasting.sum()
        )
        statistics = force_statistics(time[:-1] * SPEED, force[:-1])
        found |= {f"{joint} {name}": value for name, value in statistics.items()}
    return found


@pytest.mark.slow
def test_statistics_agree_after_the_motions_diverge():
    rows = {
        "ours": [ours(perturbation) for perturbation in starts(1)],
        "exudyn": [exudyns(perturbation) for perturbation in starts(2)],
    }
    for name in rows["ours"][0]:
        one, other = (np.array([row[name] for row in rows[code]]) for code in rows)
        assert np.ptp(one) > 1e-3 * one.mean()  # the runs have parted
        scatter = math.sqrt((one.var(ddof=1) + other.var(ddof=1)) / RUNS)
        assert abs(one.mean() - other.mean()) < 4 * scatter, (name, one.mean(), other.mean())
