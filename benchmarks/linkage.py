"""General linkages: time of a revolution at a tolerance of 1e-9 m, beside the short form of a
slider-crank and Exudyn, and the set-up of a further mechanism.

All are timed alternately in one process; values are least processor times.
"""

import math
import time
from collections.abc import Callable

import numpy as np

from benchmarks.project import row
from jointgap.config import Simulate, load_mechanism
from jointgap.core.joints import JOINTS
from jointgap.dynamics.model import Model, linkage_model
from jointgap.dynamics.simulation import crank_angles, integrate_to_angles, simulate_linkage
from jointgap.dynamics.slider_crank import model_of
from jointgap.linkage import compiled
from tests.dynamics.cases import mechanism
from tests.dynamics.test_linkage_motion import as_linkage
from tests.independent.test_exudyn_linkage import four_bar, start_of
from validation.exudyn import LooseLinkage

REVOLUTIONS, ROUNDS = 4, 20
SPEED = 20 * math.pi
MIXES = (
    ("crank_pin", "piston_pin"),
    ("crank_pin",),
    ("piston_pin",),
    ("crank_pivot", "crank_pin"),
    JOINTS,
)
"""Loose joints of a slider-crank."""
GENERAL = 1.1
"""Time of a slider-crank in the general form over that in the short form."""
OTHERS = {"four_bar": 3.0, "six_bar": 1.2}
"""Linkages, and their time over that of the slider-crank with both pins loose."""
SETUP_S = 0.2
EXUDYN = 1 / 40


def measure() -> list[dict]:
    chosen = Simulate(
        speed=SPEED, revolutions=REVOLUTIONS, samples_per_revolution=36, tolerance=1e-9
    )
    angles, tasks = crank_angles(chosen), {}
    for loose in MIXES:
        made = mechanism(loose=loose, friction=0.05).applied()
        tasks[loose, "general"] = _task(linkage_model(as_linkage(made), chosen), angles)
        tasks[loose, "short"] = _task(model_of(made, chosen), angles)
    for name in OTHERS:
        tasks[name, "general"] = _task(linkage_model(load_mechanism(name), chosen), angles)
    least = _least(tasks)
    rows = [
        row(
            f"slider-crank, loose: {', '.join(loose)}: general form over short form",
            GENERAL,
            least[loose, "general"] / least[loose, "short"],
            "",
        )
        for loose in MIXES
    ]
    both = least[("crank_pin", "piston_pin"), "general"]
    rows += [
        row(
            f"{name}: over the slider-crank with both pins loose",
            reach,
            least[name, "general"] / both,
            "",
        )
        for name, reach in OTHERS.items()
    ]
    return [*rows, _exudyn(), _setup(chosen)]


def _task(model: Model, angles: np.ndarray, tolerance: float = 1e-9) -> Callable:
    return lambda: integrate_to_angles(model, model.start(), angles, tolerance)


def _least(tasks: dict[tuple, Callable]) -> dict[tuple, float]:
    found = dict.fromkeys(tasks, math.inf)
    for _ in range(ROUNDS):
        for name, task in tasks.items():
            begin = time.process_time()
            task()
            found[name] = min(found[name], time.process_time() - begin)
    return found


def _exudyn() -> dict:
    """A four-bar for 30 deg, 60 events: least time of all tolerances whose error is at most that of
    ours at 1e-10 m."""
    file = four_bar(restitution=0.9)
    chosen = Simulate(speed=SPEED, revolutions=1, samples_per_revolution=12, tolerance=1e-14)
    model, columns = linkage_model(file, chosen), ["coupler_angle", "rocker_angle"]
    exact = simulate_linkage(file, chosen).samples[columns].to_numpy()[1]
    coarse = chosen.model_copy(update={"tolerance": 1e-10})
    ours = np.abs(simulate_linkage(file, coarse).samples[columns].to_numpy()[1] - exact).max()
    angles = crank_angles(chosen)[:2]
    seconds = _least({("ours",): _task(model, angles, 1e-10)})["ours",]
    theirs = math.inf
    for tolerance in 10.0 ** np.arange(-12, -5):
        peer = LooseLinkage(file, SPEED, start_of(model))
        begin = time.process_time()
        peer.advance(math.radians(30.0) / SPEED, tolerance)
        spent = time.process_time() - begin
        found = np.array([peer.coordinates(body)[2] for body in ("coupler", "rocker")])
        error = np.abs((found - exact + math.pi) % (2 * math.pi) - math.pi).max()
        if error <= ours:
            theirs = min(theirs, spent)
    name = f"four-bar, 30 deg, error {ours:.1g} rad: time over Exudyn's"
    return row(name, EXUDYN, seconds / theirs, "", Exudyn_s=theirs)


def _setup(chosen: Simulate) -> dict:
    """Equations and machine code of a six-bar, the compiled engine at hand."""
    file = load_mechanism("six_bar")
    seconds = math.inf
    for _ in range(5):
        compiled.forget()
        begin = time.process_time()
        linkage_model(file, chosen).workspace()
        seconds = min(seconds, time.process_time() - begin)
    return row("set-up of a further linkage (six-bar)", SETUP_S, seconds, "s")
