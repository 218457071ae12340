"""Random rigs of linkages: the shipped ones with other lengths, masses and loose joints."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from math import tau
from typing import Any

import numpy as np

from jointgap.config.linkage_file import LinkageFile
from jointgap.core.errors import InputError, SimulationError
from jointgap.linkage.assembly import ideal_pose, signs_of
from jointgap.linkage.from_file import linkage_of_file
from jointgap.rig.sensors import FAULTS
from validation.rig import (
    LINKAGES,
    LISTED,
    RECIPE,
    Numerics,
    Rig,
    candidates,
    draw_run,
    draw_sensors,
    has_base_motion,
    mechanism_of,
)

_LINKAGES = RECIPE["linkages"]

_MOST_DRAWS = 200  # of linkages until one turns fully and its motion is as required
_ANGLES = np.arange(360) * (tau / 360)  # of the crank, at which a linkage has to be far from dead

# Effects of Exudyn's model, but not on a slide between moving bodies
_MODELLED = r"gravity|added_\w+|link_length_error|\w+_(coulomb|viscous)_friction|\w+_clearance"
_MODELLED += r"|\w+_(quadratic_drag|constant_force|spring|offset)"


@cache
def names_to_hide(mechanism: str, group: str) -> tuple[str, ...]:
    """Labels of a group of effects of a shipped linkage, whose joints are all ideal."""
    file, joints = LINKAGES[mechanism], _LINKAGES["joints"][mechanism]
    clearances = tuple(f"{joint}_clearance" for joint in joints)
    if group == "nothing":
        return ("",)
    if group == "clearances":
        return clearances
    if group == "off_list":
        return *_LINKAGES["laws"], *RECIPE["faults"]
    known = candidates(_with_bearings(file, joints), 30.0, {})
    faults = (name for name in LISTED if name in FAULTS)
    return tuple(name for name in (*known, *faults) if name not in clearances)


def _with_bearings(file: LinkageFile, joints: Sequence[str]) -> LinkageFile:
    """A linkage with ideal joints that have the data of a bearing."""
    data = file.model_dump()
    steel = next(iter(data["contacts"].values()))
    for name in joints:
        bearing = {"journal_radius": 0.008, "bearing_radius": 0.0081, "contact": steel}
        data["joints"][name] = {"loose": False, "journal": file.shared[name][0]} | bearing
    return LinkageFile.model_validate(data)


def exudyn_models(mechanism: str, base: str, effects: Sequence[str]) -> bool:
    """Whether Exudyn's model has the motion of a linkage with these effects."""
    loose = base == "loose" or any(name.endswith("_clearance") for name in effects)
    if loose and mechanism != "four_bar":  # ideal joints close a loop
        return False
    known = {*FAULTS, *RECIPE["faults"], *_LINKAGES["laws"]}
    tracks = tuple(LINKAGES[mechanism].sites.tracks)
    return all(
        name in known or (re.fullmatch(_MODELLED, name) and not name.startswith(tracks))
        for name in effects
    )


def draw_linkage(rng: np.random.Generator, trial: Any) -> Rig:
    """Draw a rig that turns fully, with a motion as the base of the trial requires."""

    def drawn(key: str, size: int | None = None) -> Any:
        return rng.uniform(*(_LINKAGES if key in _LINKAGES else RECIPE["rig"])[key], size)

    for _ in range(_MOST_DRAWS):
        content = _draw_content(rng, drawn, trial)
        count = 3 if rng.random() < _LINKAGES["three_runs"] else 2
        speeds = drawn("slowest") * np.cumprod([1.0, *drawn("faster", count - 1)])
        speeds = np.round(rng.permutation(np.minimum(speeds, _LINKAGES["fastest"]))) * tau / 60
        try:
            file = mechanism_of(content)
            if turns_fully(file) and has_base_motion(file, speeds, trial.base):
                break
        except (InputError, SimulationError):
            continue
    else:
        raise RuntimeError(
            f"no {trial.mechanism} with a {trial.base} motion in {_MOST_DRAWS} draws"
        )
    bounds = {} if rng.random() < 0.5 else {"speed": (-0.003, 0.003)}
    bounds |= _draw_bounds(rng, drawn, content, file)
    values = {
        key: low + (0.5 + 0.9 * (float(rng.random()) - 0.5)) * (high - low)
        for key, (low, high) in bounds.items()
        if key != "speed"
    }
    if not trial.peer:
        values |= {f"lasting_damping_{name}": float(drawn("log_damping")) for name in file.loose}
    runs = {
        f"run{number}": draw_run(rng, drawn, float(nominal), False)
        for number, nominal in enumerate(speeds, 1)
    }
    if trial.peer:
        settling = _LINKAGES["exudyn_settling"]
        runs = {name: replace(run, settling=settling) for name, run in runs.items()}
    law, width = (("coulomb", 0.5), ("coulomb", 1.5), ("threlfall", 1.5))[rng.integers(3)]
    tolerance, sign_factor = 10 ** float(drawn("log_tolerance")), float(rng.choice([0.5, 1.0, 1.5]))
    return Rig(
        base=trial.base,
        content=content,
        bounds=bounds,
        values=values,
        runs=runs,
        confirm=str(rng.choice(list(runs))),
        sensors=draw_sensors(rng, drawn, lambda: _draw_channels(rng, file)),
        numerics=Numerics(tolerance, law, width, sign_factor),
        noise_is_stated=bool(rng.random() < 0.8),
        angle_noise=math.radians(drawn("encoder_deg")),
    )


def turns_fully(file: LinkageFile) -> bool:
    """Whether every pair of bodies stays far from its dead points at all crank angles."""
    linkage = linkage_of_file(file)
    with np.errstate(invalid="ignore"):
        pose = ideal_pose(linkage, signs_of(linkage, 0.0), _ANGLES)
    most = math.cos(math.radians(_LINKAGES["least_transmission_deg"]))
    return all(np.all(np.abs(cosine) < most) for cosine in pose.cosines.values())


def _draw_content(rng: np.random.Generator, drawn: Any, trial: Any) -> dict[str, Any]:
    """Content of a mechanism file similar to a shipped linkage."""
    file, joints = LINKAGES[trial.mechanism], _LINKAGES["joints"][trial.mechanism]

    def scaled(points: dict[str, tuple[float, float]], factor: float) -> dict[str, list[float]]:
        return {name: [_rounded(factor * x) for x in at] for name, at in points.items()}

    bodies = {}
    for name, body in file.bodies.items():
        data = body.model_dump(exclude_none=True)
        size, heavier = float(drawn("varied")), float(drawn("varied"))
        data["mass"] = _rounded(heavier * body.mass)
        if body.inertia is not None:
            data["inertia"] = _rounded(heavier * size**2 * body.inertia)
        centre = body.mass_centre
        is_point = isinstance(centre, tuple)
        data["mass_centre"] = (
            [_rounded(size * x) for x in centre] if is_point else _rounded(size * centre)
        )
        if body.length is not None:
            data |= {"length": _rounded(size * body.length), "ends": list(body.ends)}
        else:
            data["points"] = scaled(body.points, size)
        bodies[name] = data
    entries: dict[str, Any] = {}
    for name, slide in file.slides.items():
        entries[name] = {"slide": list(slide.slide)}
        if slide.at is not None:
            entries[name]["at"] = scaled({"at": slide.at}, float(drawn("varied")))["at"]
    loose = draw_loose(rng, joints, trial)
    journal = round(float(drawn("journal_radius")), 5)
    for name in joints:
        bearing = round(journal + math.exp(rng.uniform(*np.log(_LINKAGES["clearance"]))), 6)
        radii = {"journal_radius": journal, "bearing_radius": bearing}
        carrier = str(rng.choice(file.shared[name]))
        entries[name] = {"loose": name in loose, "journal": carrier, **radii, "contact": "steel"}
    steel: dict[str, Any] = {"law": "lankarani_nikravesh"}
    steel["restitution"] = round(float(drawn("restitution")), 3)
    steel["friction"] = round(float(drawn(f"friction_{trial.base}")), 3)
    if trial.peer:
        steel["memory"] = "published"  # the only contact law of Exudyn
    frame = {"points": scaled(file.frame.points, float(drawn("varied")))}
    parts = {"frame": frame, "bodies": bodies, "joints": entries, "contacts": {"steel": steel}}
    return parts | {"drive": file.drive, "effects": []}


def draw_loose(rng: np.random.Generator, joints: Sequence[str], trial: Any) -> list[str]:
    """The joints that are loose in the model: none, or one or two without a hidden effect."""
    if trial.base == "ideal":
        return []
    pivots = LINKAGES[trial.mechanism].sites.pivots
    used = {
        pivot
        for body, pivot in pivots.items()
        for name in trial.effects
        if trial.peer and (name.startswith(f"{body}_") or name in _LINKAGES["laws"])
    }  # Exudyn's chains turn about them
    used |= {name.removesuffix("_clearance").rpartition(":")[2] for name in trial.effects}
    free = [name for name in joints if name not in used]
    count = min(int(rng.integers(1, 3)), len(free))
    return list(map(str, rng.choice(free, count, replace=False)))


def _draw_bounds(
    rng: np.random.Generator, drawn: Any, content: dict[str, Any], file: LinkageFile
) -> dict[str, tuple[float, float]]:
    """Bounds of uncertain parameters about their nominal values: masses, and data of loose
    joints."""
    bounds = {}
    for name, body in file.bodies.items():
        if name != file.sites.crank:
            share = float(drawn("mass_share"))
            bounds[f"{name}_mass"] = (1 - share) * body.mass, (1 + share) * body.mass
    for name, joint in file.loose_pins.items():
        bounds[f"{name}_clearance"] = 0.9 * joint.clearance, 1.1 * joint.clearance
    if file.loose:
        friction = content["contacts"]["steel"]["friction"]
        bounds["restitution"] = 0.3, 0.9
        bounds["joint_friction"] = round(0.5 * friction, 3), round(1.6 * friction, 3)
    return bounds


def _draw_channels(rng: np.random.Generator, file: LinkageFile) -> list[str]:
    """The torque of the crank, and accelerations and angles of other bodies."""
    rig = [
        f"{body}_{end}"
        for body in file.bodies
        if body != file.sites.crank
        for end in (
            ("acceleration", "position")
            if body in file.sites.slides
            else ("acceleration_x", "acceleration_y", "angle")
        )
    ]
    count = int(rng.integers(*_LINKAGES["channels"], endpoint=True))
    return ["crank_torque", *map(str, rng.choice(rig, count, replace=False))]


def _rounded(value: float) -> float:
    return float(f"{value:.5g}")
