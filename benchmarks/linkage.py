"""Linkages: time of a revolution at a tolerance of 1e-9 m, beside the hand-written slider-crank of
the tag `before-linkage`, compiled LSODA and Exudyn, and the set-up of a further mechanism.

All are timed alternately, those of the tag in a process of their own; values are least processor
times.
"""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks import former
from benchmarks.compiled_lsoda import compiled_lsoda
from benchmarks.project import row
from benchmarks.right_hand_side import right_hand_side
from jointgap.config import Simulate, load_mechanism
from jointgap.config.linkage_file import LinkageFile, Pin
from jointgap.linkage import compiled
from jointgap.linkage.equations import Crank, Pose
from jointgap.motion.linkage import linkage_model
from jointgap.motion.model import Model
from jointgap.motion.simulation import crank_angles, integrate_to_angles
from jointgap.motion.slider_crank import model_of
from tests.independent.test_exudyn_linkage import four_bar
from tests.motion.cases import mechanism
from validation.rig import exudyn_linkage

REVOLUTIONS, ROUNDS = 4, 20
SPEED = 20 * math.pi
BEFORE = {
    ("crank_pin", "piston_pin"): 0.8,
    ("crank_pin",): 0.65,
    ("crank_pivot", "crank_pin"): 0.7,
    ("crank_pivot", "crank_pin", "piston_pin"): 0.9,
}
"""Loose joints of a slider-crank, and the time over that of the tag."""
OTHERS = {"four_bar": 3.0, "six_bar, five loose": 8.0, "six_bar": 1.2}
"""Linkages, and their time over that of the slider-crank with both pins loose."""
SETUP_S = 0.2
EXUDYN, LSODA = 1 / 40, 1 / 3


def measure() -> list[dict]:
    chosen = Simulate(
        speed=SPEED, revolutions=REVOLUTIONS, samples_per_revolution=36, tolerance=1e-9
    )
    angles, tasks = crank_angles(chosen), {}
    with former.Revolutions([*BEFORE]) as before:
        for loose in BEFORE:
            model = model_of(mechanism(loose=loose, friction=0.05), chosen)
            tasks[loose] = _timed(_task(model, angles))
            if before.runs:
                tasks[loose, "before"] = partial(before.seconds, loose)
        for name in OTHERS:
            tasks[name] = _timed(_task(linkage_model(_linkage(name), chosen), angles))
        least = _least(tasks)
    rows = [
        row(
            f"slider-crank, loose: {', '.join(loose)}: over the tag before-linkage",
            reach,
            least[loose] / least[loose, "before"] if (loose, "before") in least else None,
            "",
            ms_per_revolution=1e3 * least[loose] / REVOLUTIONS,
        )
        for loose, reach in BEFORE.items()
    ]
    both = least["crank_pin", "piston_pin"]
    rows += [
        row(
            f"{name}: over the slider-crank with both pins loose",
            reach,
            least[name] / both,
            "",
            ms_per_revolution=1e3 * least[name] / REVOLUTIONS,
        )
        for name, reach in OTHERS.items()
    ]
    return [*rows, *_peers(), _setup(chosen)]


def _linkage(name: str) -> LinkageFile:
    """A shipped linkage; five loose: those of a six-bar but two of the frame."""
    file = load_mechanism(name.partition(",")[0])
    if "five" not in name:
        return file
    contact = next(joint.contact for joint in file.joints.values())
    radii = {"journal_radius": 9.95e-3, "bearing_radius": 10e-3, "contact": contact}
    pins = {
        point: Pin(journal=bodies[0], **radii)
        for point, bodies in file.shared_by_two.items()
        if point not in ("O", "E")
    }
    return file.model_copy(update={"joints": file.joints | pins})


def _task(model: Model, angles: np.ndarray, tolerance: float = 1e-9) -> Callable:
    return lambda: integrate_to_angles(model, model.start(), angles, tolerance)


def _timed(task: Callable) -> Callable[[], float]:
    """The task's processor time [s]."""

    def seconds() -> float:
        begin = time.process_time()
        task()
        return time.process_time() - begin

    return seconds


def _least(tasks: dict[Any, Callable[[], float]], rounds: int = ROUNDS) -> dict[Any, float]:
    found = dict.fromkeys(tasks, math.inf)
    for _ in range(rounds):
        for name, seconds in tasks.items():
            found[name] = min(found[name], seconds())
    return found


def _peers() -> list[dict]:
    """A four-bar for 30 deg, 60 events: least times of all tolerances whose error is at most that
    of ours at 1e-10 m."""
    file, end = four_bar(restitution=0.9), math.radians(30.0) / SPEED
    chosen = Simulate(speed=SPEED, revolutions=1, samples_per_revolution=12, tolerance=1e-14)
    model = linkage_model(file, chosen)
    angles = crank_angles(chosen)[:2]

    def ours(tolerance: float) -> np.ndarray:
        return integrate_to_angles(model, model.start(), angles, tolerance).states[1]

    exact = _directions(model, ours(1e-14), angles[1])
    error = _error(_directions(model, ours(1e-10), angles[1]), exact)
    seconds = _least({"ours": _timed(lambda: ours(1e-10))}, 10 * ROUNDS)["ours"]
    slope, gap = right_hand_side(model, model.workspace())
    peers: dict[str, Callable[[float], np.ndarray]] = {"Exudyn": partial(_exudyn, file, end)}
    try:
        march = compiled_lsoda(slope, gap, len(model.loose))
        peers["compiled LSODA"] = lambda tolerance: _directions(
            model, march(model.start(), end, tolerance), angles[1]
        )
        peers["compiled LSODA"](1e-9)  # compiled
    except ImportError:
        pass
    rows = []
    for name, reach in (("compiled LSODA", LSODA), ("Exudyn", EXUDYN)):
        least = math.inf
        for tolerance in 10.0 ** np.arange(-14, -5) if name in peers else ():
            begin = time.process_time()
            try:
                found = peers[name](tolerance)
            except RuntimeError:
                continue
            if _error(found, exact) <= error:
                least = min(least, time.process_time() - begin)
        what = f"four-bar, 30 deg, error {error:.1g} rad: time over that of {name}"
        measured = seconds / least if least < math.inf else None
        rows.append(row(what, reach, measured, "", ours_s=seconds, theirs_s=least))
    return rows


def _exudyn(file: LinkageFile, end: float, tolerance: float) -> np.ndarray:
    peer = exudyn_linkage(file, SPEED, 0.0)
    peer.advance(end, tolerance)
    return np.array([peer.angle(body) for body in ("coupler", "rocker")])


def _directions(model: Model, state: np.ndarray, crank_angle: float) -> np.ndarray:
    """Angles [rad] of coupler and rocker in a state."""
    vectors = {name: model.vector(state, name) for name in model.loose}
    crank = Crank(math.cos(crank_angle), math.sin(crank_angle), SPEED)
    pose = Pose(model.linkage, model.variant.signs, crank, vectors)
    return np.array([math.atan2(*pose.directions[body][::-1]) for body in ("coupler", "rocker")])


def _error(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.abs((found - exact + math.pi) % (2 * math.pi) - math.pi).max())


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
