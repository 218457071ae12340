"""Drawing of rigs: a mechanism and what is not known of it, runs, sensors and how their data are written."""

import math
from dataclasses import dataclass

import numpy as np

from jointgap.joints import PINS
from jointgap.trials.injected_effects import Rig
from jointgap.trials.sensor_readings import SETTLING, Numerics, Turn, moved

KINEMATIC = ("slider_position", "slider_velocity", "rod_angle", "rod_angular_velocity")
FORCES = ("crank_torque", "guide_force", "frame_force_x", "frame_force_y")
ACCELERATIONS = ("slider_acceleration", "rod_acceleration_x", "rod_acceleration_y")

BASES = ("ideal", "loose", "chaotic")
_JOURNALS = {"crank_pivot": "crank", "crank_pin": "crank", "piston_pin": "slider"}
_LOOSE = (PINS, PINS, PINS, ("piston_pin",), ("piston_pin",), ("crank_pin",))

_ALIKE, _APART = 3e-3, 0.05
"""Share of a channel's standard deviation by which settled revolutions may differ where samples are compared, and by which
they do differ where they cannot be."""


@dataclass(frozen=True)
class Sensor:
    """How one channel is measured: noise as a share of the signal's standard deviation, its memory from sample to sample."""

    share: float
    memory: float
    gaps: bool


@dataclass(frozen=True)
class Design:
    """One rig with its true, hidden values; angles in rad, speeds in rad/s.

    Attributes
    ----------
    base : str
        One of `BASES`.
    nominal, true : dict
        Content of mechanism files: as the analyst is told, and with the true values of the nuisances.
    nuisance : dict
        Key to bounds in SI; those of ``speed`` are a share.
    values : dict
        True values of the nuisances, ``speed@run`` for a run's.
    runs : dict of str to Turn
        By id, in the order of the campaign file.
    speeds : dict of str to float
        Nominal speed by run.
    confirm : str
        The run that takes no part.
    sensors : dict of str to Sensor
    angle_noise : float
        Standard deviation of the crank angle's reading; 0 where there is no encoder.
    stated : bool
        Whether the noise is.
    """

    base: str
    nominal: dict
    true: dict
    nuisance: dict[str, tuple[float, float]]
    values: dict[str, float]
    runs: dict[str, Turn]
    speeds: dict[str, float]
    confirm: str
    sensors: dict[str, Sensor]
    angle_noise: float
    stated: bool
    numerics: Numerics

    @property
    def loose(self) -> tuple[str, ...]:
        """Names of the loose joints."""
        return tuple(name for name, joint in self.nominal["joints"].items() if joint["loose"])

    def rig(self, spread: dict[str, float]) -> Rig:
        """What the sizes of effects go by."""
        return Rig(self.true, max(self.speeds.values()), self.loose, tuple(self.sensors), spread)


def mechanism(rng: np.random.Generator, base: str, needed: str = "") -> dict:
    """Content of a mechanism file, around the paper's slider-crank; the joint `needed` is loose."""
    scale, heavier = rng.uniform(0.7, 1.2), rng.uniform(0.8, 1.3, 3)
    crank, rod = 0.15 * scale * rng.uniform(0.85, 1.1), 0.564 * scale
    choices = [joints for joints in _LOOSE if not needed or needed in joints]
    loose = () if base == "ideal" else choices[rng.integers(len(choices))]
    radius = float(rng.uniform(0.006, 0.010))
    friction = {"ideal": rng.uniform(0.03, 0.1), "loose": rng.uniform(0.05, 0.2), "chaotic": 0.0}[base]
    joints = {
        name: {
            "loose": name in loose,
            "journal": journal,
            "journal_radius": round(radius, 5),
            "bearing_radius": round(round(radius, 5) + 10 ** rng.uniform(-4, -3), 6),
            "contact": "steel",
        }
        for name, journal in _JOURNALS.items()
    }
    steel = {
        "law": "lankarani_nikravesh",
        "youngs_modulus": 207e9,
        "poisson_ratio": 0.3,
        "restitution": round(float(rng.uniform(0.4, 0.75)), 3),
        "friction": round(float(friction), 3),
    }
    number = lambda value: float(f"{value:.5g}")  # noqa: E731
    masses = [0.3704, 0.773, 0.4482] * heavier * scale
    return {
        "crank": {
            "length": number(crank),
            "mass": number(masses[0]),
            "inertia": number(masses[0] * crank**2 * 0.175),
            "mass_centre": number(crank * rng.uniform(0.3, 0.5)),
        },
        "rod": {
            "length": number(rod),
            "mass": number(masses[1]),
            "inertia": number(masses[1] * rod**2 * 0.101),
            "mass_centre": number(rod * rng.uniform(0.42, 0.5)),
        },
        "slider": {"mass": number(masses[2]), "offset": number(rng.choice([0.0, 0.0, rng.uniform(-0.03, 0.03)]))},
        "joints": joints,
        "contacts": {"steel": steel},
        "gravity_direction": -math.pi / 2,
        "effects": [],
    }


def settles(content: dict, speed: float) -> float:
    """By what share of their standard deviation settled revolutions differ that began alike, or are some apart."""
    times = np.arange(90) / 90 * 2 * math.pi / speed
    aside = [1e-7 if content["joints"][joint]["loose"] else 0.0 for joint in PINS]
    starts = (None, SETTLING), ([aside[0], 0.0, 0.0, aside[1]], SETTLING), (None, 2), (None, SETTLING + 3)
    first, *others = (
        moved(content, Turn(speed, 0.3, times), Numerics(1e-10), start, settling) for start, settling in starts
    )
    seen = ("slider_acceleration", "crank_torque")
    apart = (
        np.sqrt(np.mean((first[name] - other[name]) ** 2)) / first[name].std() for other in others for name in seen
    )
    return float(max(apart))


def _nuisances(rng, nominal: dict, encoder: bool) -> dict[str, tuple[float, float]]:
    def within(value: float, share: float) -> tuple[float, float]:
        return value * (1 - share), value * (1 + share)

    crank, rod, slider = nominal["crank"], nominal["rod"], nominal["slider"]
    found = {
        "slider_mass": within(slider["mass"], round(rng.uniform(0.02, 0.06), 2)),
        "rod_mass": within(rod["mass"], round(rng.uniform(0.02, 0.06), 2)),
        "rod_inertia": within(rod["inertia"], round(rng.uniform(0.03, 0.08), 2)),
    }
    for key, link in (("crank_length", crank), ("rod_length", rod)):
        if rng.random() < 0.3:
            found[key] = within(link["length"], 0.001)
    loose = [name for name, joint in nominal["joints"].items() if joint["loose"]]
    steel = nominal["contacts"]["steel"]
    if loose:
        found["restitution"] = (0.3, 0.9)
        if steel["friction"]:
            found["joint_friction"] = (round(0.5 * steel["friction"], 3), round(min(1.6 * steel["friction"], 0.5), 3))
        for name in loose:
            clearance = nominal["joints"][name]["bearing_radius"] - nominal["joints"][name]["journal_radius"]
            found[f"{name}_clearance"] = within(clearance, 0.1)
    if rng.random() < 0.5 or not encoder:
        found["speed"] = (-0.003, 0.003)
    keep = {"slider_mass", "restitution", "joint_friction", "speed"}
    return {key: bounds for key, bounds in found.items() if key in keep or rng.random() < 0.8}


def with_values(content: dict, values: dict[str, float]) -> dict:
    """`content` with true values of nuisances, by their keys."""
    made = {key: dict(value) if isinstance(value, dict) else value for key, value in content.items()}
    made["joints"] = {name: dict(joint) for name, joint in content["joints"].items()}
    made["contacts"] = {"steel": dict(content["contacts"]["steel"])}
    for key, value in values.items():
        if key == "restitution":
            made["contacts"]["steel"]["restitution"] = value
        elif key == "joint_friction":
            made["contacts"]["steel"]["friction"] = value
        elif key.endswith("_clearance"):
            joint = made["joints"][key.removesuffix("_clearance")]
            joint["bearing_radius"] = joint["journal_radius"] + value
        elif not key.startswith(("speed", "first_angle")):
            body, what = key.split("_")
            if what == "length" and "mass_centre" in made[body]:  # keeps its share
                made[body]["mass_centre"] *= value / made[body]["length"]
            made[body][what] = value
    return made


def design(rng: np.random.Generator, base: str, needed: str = "", encoder: bool = False) -> Design:
    """Draw a rig whose settled motion is as `base` says: the same in each revolution, or not.

    Parameters
    ----------
    rng : numpy.random.Generator
    base : str
        One of `BASES`.
    needed : str
        A joint that has to be loose.
    encoder : bool
        Whether the crank angle has to be measured.
    """
    for _ in range(200):
        nominal = mechanism(rng, base, needed)
        slowest = rng.uniform(150, 330)
        steps = np.cumprod([1.0, *rng.uniform(1.25, 1.5, 2)])
        speeds = np.round(rng.permutation(np.minimum(slowest * steps, 600))) * math.pi / 30
        if base == "ideal":
            break
        apart = (settles(nominal, speed) for speed in speeds)
        if all(share < _ALIKE if base == "loose" else share > _APART for share in apart):
            break
    else:
        raise RuntimeError(f"no rig with a {base} motion in 200 draws")
    encoder = bool(rng.random() < 0.85) or encoder
    nuisance = _nuisances(rng, nominal, encoder)
    values = {
        key: float(rng.uniform(*(0.5 * (low + high) + np.array([-0.45, 0.45]) * (high - low))))
        for key, (low, high) in nuisance.items()
        if key != "speed"
    }
    names = [f"run{number}" for number in range(1, 4)]
    runs = {}
    for name, speed in zip(names, speeds, strict=True):
        share = rng.uniform(-0.003, 0.003) if encoder or "speed" in nuisance else 0.0
        values[f"speed@{name}"] = float(speed * (1 + 0.9 * share))
        runs[name] = _turn(rng, values[f"speed@{name}"], 30 if base == "chaotic" else rng.uniform(3, 6))
    sensors = {
        channel: Sensor(
            share=float(rng.uniform(0.01, 0.05)),
            memory=float(rng.uniform(0.3, 0.8)) if rng.random() < 0.25 else 0.0,
            gaps=bool(rng.random() < 0.15),
        )
        for channel in _channels(rng, base)
    }
    law = str(rng.choice(["coulomb", "coulomb", "threlfall"]))
    width = float(rng.choice([0.5, 1.5])) if law == "coulomb" else 1.5
    return Design(
        base,
        nominal,
        with_values(nominal, values),
        nuisance,
        values,
        runs,
        dict(zip(names, map(float, speeds), strict=True)),
        names[int(rng.integers(3))],
        sensors,
        float(np.radians(rng.uniform(0.05, 0.3))) if encoder else 0.0,
        bool(rng.random() < 0.8),
        Numerics(float(10 ** rng.uniform(-12, -11)), law, 1e-3 * width, float(rng.choice([0.5, 1.0, 1.5]))),
    )


def _turn(rng, speed: float, revolutions: float) -> Turn:
    samples = int(rng.integers(60, 201))
    if revolutions >= 30:
        samples = min(samples, 100)
    count = int(revolutions * samples)
    step = 2 * math.pi / speed / samples
    times = np.arange(count) * step
    if rng.random() < 0.25:
        times[1:] += rng.uniform(-0.3, 0.3, count - 1) * step
    return Turn(speed, float(rng.uniform(0, 2 * math.pi)), times)


def _channels(rng, base: str) -> list[str]:
    """Two to four channels, one of which at least tells of forces."""
    telling = FORCES if base == "ideal" else FORCES + ACCELERATIONS
    first = "crank_torque" if rng.random() < 0.5 else str(rng.choice(telling))
    others = [name for name in (*KINEMATIC, *FORCES, *ACCELERATIONS) if name != first]
    return [first, *(others[place] for place in rng.permutation(len(others))[: int(rng.integers(1, 4))])]
