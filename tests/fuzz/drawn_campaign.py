"""Random campaigns: rigs and sensors."""

import math
from math import tau
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from jointgap.config import Mechanism, Simulate
from jointgap.config.campaign import UNITS
from jointgap.config.channels import CHANNELS, channel_kinds
from jointgap.config.scenario import MotorDrive
from jointgap.core.sites import SLIDER_CRANK
from jointgap.core.units import unit_factor
from jointgap.motion.slider_crank import simulate
from tests.motion.cases import BODIES, effect, joint

COMPARED = [name for name in CHANNELS if name not in ("time", "crank_angle")]
DRIVES = ("constant_speed", "measured_angle", "motor")
LOOSE = (*[()] * 6, ("piston_pin",), ("crank_pin",), ("crank_pin", "piston_pin"))
FINE = 720  # simulated samples per revolution
SETTLING = 3  # revolutions before the first sample
FEWEST_ROWS, MOST_ROWS = 40, 1200  # of a run, and of all runs, so that a draw takes seconds


def draw_campaign(rng: np.random.Generator, folder: Path) -> Path:
    """A random campaign file with its data in `folder`."""
    drive, loose = str(rng.choice(DRIVES)), LOOSE[rng.integers(len(LOOSE))]
    if drive == "motor" and rng.random() < 0.7:
        loose = ()  # the motor's settling makes a simulation last
    slowest = 5.0 * 1200.0 ** rng.random()  # rpm
    ratios = np.cumprod([1.0, *rng.uniform(1.0, 1.6, rng.integers(3))])
    speeds = rng.permutation(np.minimum(slowest * ratios, 6000.0)) * tau / 60
    mechanism = _mechanism(rng, loose, float(speeds.max()))
    hidden = _hidden(rng, mechanism, float(speeds.max()), drive)
    true = Mechanism.model_validate(mechanism | {"effects": mechanism["effects"] + hidden})
    channels = list(map(str, rng.permutation(COMPARED)[: rng.integers(1, 7)]))
    clockwise, delay = rng.random() < 0.15, _Delay(rng, channels)
    turns = rng.uniform(1.6, 7.0)
    lowest = max(6.0, FEWEST_ROWS / turns)
    per_turn = lowest * (MOST_ROWS / turns / speeds.size / lowest) ** rng.random()
    # all runs have one rate, or one number of samples per revolution
    rate = per_turn * speeds.mean() / tau
    rate = None if rng.random() < 0.5 else rate
    motor = _motor(true, float(speeds.max())) if drive == "motor" else None
    content: dict[str, Any] = {"name": "drawn", "mechanism": mechanism, "drive": drive, "runs": []}
    if motor:
        content["motor"] = motor
    angle = drive == "measured_angle" or rng.random() < 0.7
    time = not angle or drive != "constant_speed" or rng.random() < 0.9
    columns = [name for name, there in (("time", time), ("crank_angle", angle)) if there] + channels
    units = {name: str(rng.choice(UNITS[CHANNELS[name]])) for name in columns}
    if "time" in units:
        units["time"] = "s"
    sensors = {name: _Sensor(rng, name) for name in columns if name != "time"}
    content["channels"] = {name: {"column": name, "unit": units[name]} for name in columns}
    stated: dict[str, dict[str, float]] = {name: {} for name in sensors}
    for number, speed in enumerate(speeds):
        run = f"run{number}"
        seen = _Record(true, float(speed), turns, motor)
        per_second = rate or per_turn * speed / tau
        times = np.arange(max(int(seen.duration * per_second), 2)) / per_second
        read = {"time": times + rng.uniform(0, 5)}
        for name, sensor in sensors.items():
            values = seen.at(name, times - delay.of(name) / speed) * (
                -1 if clockwise and name in TURNED else 1
            )
            read[name], stated[name][run] = sensor.read(rng, values)
        factors = {name: 1 / unit_factor(units[name], CHANNELS[name]) for name in columns}
        table = pd.DataFrame({name: read[name] * factors[name] for name in columns})
        table.to_csv(folder / f"{run}.csv", index=False, float_format="%.9g")
        own = {"id": run, "file": f"{run}.csv", "speed": f"{speed * 60 / tau:.4g} rpm"}
        own["role"] = (
            "split" if speeds.size == 1 else "confirm" if number == speeds.size - 1 else "identify"
        )
        own["start"] = "unknown" if rng.random() < 0.2 else "settled"
        if not time and drive == "constant_speed" and rng.random() < 0.3:
            own["start"] = {"angle": "40 deg", "turned": "3 turn"}
        content["runs"].append(own | ({"direction": "clockwise"} if clockwise else {}))
    for name, sensor in sensors.items():
        factor = 1 / unit_factor(units[name], CHANNELS[name])
        content["channels"][name] |= sensor.stated(
            {run: factor * sd for run, sd in stated[name].items()}, factor
        )
    content["nuisance"] = _nuisance(rng, mechanism, loose, time and angle)
    if motor:
        content["nuisance"]["no_load_speed"] = "10 %"
    path = folder / "campaign.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


TURNED = {name for name, kind in channel_kinds(SLIDER_CRANK).items() if kind.mirrored}
"""Have the other sign where the crank turns clockwise."""


def _mechanism(rng: np.random.Generator, loose: tuple[str, ...], fastest: float) -> dict:
    """Content of a mechanism file whose contacts bear the loads at its speed [rad/s]."""
    scale = min(1.0, 60.0 / fastest) * rng.uniform(0.5, 1.0)
    bodies = {}
    for name, body in BODIES.items():
        mass = body["mass"] * scale**2 * rng.uniform(0.7, 1.4)
        bodies[name] = {"mass": mass}
        if name == "slider":
            bodies[name]["offset"] = rng.uniform(-0.03, 0.03) * scale * (rng.random() < 0.3)
        else:
            inertia = body["inertia"] / body["mass"] * mass * scale**2
            bodies[name] |= {key: body[key] * scale for key in ("length", "mass_centre")} | {
                "inertia": inertia
            }
    ideal_data = rng.random() < 0.3
    carriers = {"crank_pivot": "crank", "crank_pin": "crank", "piston_pin": "slider"}
    clearance, radius = 1e-4 * 10 ** rng.random() * max(scale, 0.2), 0.01 * max(scale, 0.3)
    joints = dict.fromkeys(carriers, "ideal")
    for name in carriers if ideal_data else loose:
        joints[name] = joint(name in loose, carriers[name], radius, clearance, "steel")
    steel = {"restitution": rng.uniform(0.3, 0.8), "friction": rng.choice([0.0, 0.05, 0.15])}
    effects = [effect("gravity")] if rng.random() < 0.3 else []
    return _plain(bodies | {"joints": joints, "contacts": {"steel": steel}, "effects": effects})


def _plain(node: Any) -> Any:
    """`node` without NumPy numbers, which YAML does not know."""
    if isinstance(node, dict):
        return {key: _plain(value) for key, value in node.items()}
    if isinstance(node, list):
        return [_plain(value) for value in node]
    return node.item() if isinstance(node, np.generic) else node


def _hidden(rng: np.random.Generator, mechanism: dict, speed: float, drive: str) -> list[dict]:
    """Zero to two effects that are not in the mechanism file."""
    crank, mass = mechanism["crank"]["length"], mechanism["slider"]["mass"]
    force = mass * crank * speed**2 * 0.3 * 10 ** -rng.uniform(0, 2)
    found = [
        effect("slider_coulomb_friction", force_N=force),
        effect("slider_viscous_friction", damping_N_s_m=force / (crank * speed)),
        effect("slider_constant_force", force_N=force),
        effect("crank_viscous_friction", damping_N_m_s=force * crank / speed),
    ]
    number = int(rng.choice([0, 1, 1, 2]))
    chosen = [found[place] for place in rng.permutation(len(found))[:number]]
    if drive == "measured_angle":
        ratio, order = rng.uniform(0.001, 0.1), float(rng.choice([0.5, 1.0, 2.0]))
        chosen.append(
            effect("speed_fluctuation", ratio=ratio, order=order, phase_rad=rng.uniform(0, tau))
        )
    return _plain(chosen)


def _motor(mechanism: Mechanism, speed: float) -> dict[str, float]:
    """A motor that is strong enough for the mechanism and its weight at a `speed` [rad/s]."""
    crank = mechanism.crank.length
    mass = mechanism.slider.mass + mechanism.rod.mass + mechanism.crank.mass
    inertia = 4.0 * mass * crank * (crank + 9.81 / speed**2)
    torque = 5.0 * inertia * speed**2
    return {"stall_torque": torque, "no_load_speed": 1.1 * speed, "inertia": inertia}


class _Record:
    """What exact sensors read of a run over `turns` revolutions."""

    def __init__(self, mechanism: Mechanism, speed: float, turns: float, motor: dict | None):
        drive = {"drive": MotorDrive(**motor | {"no_load_speed": 1.05 * speed})} if motor else {}
        revolutions = SETTLING + math.ceil(turns) + 1
        tolerance = min(1e-9, 1e-6 * mechanism.crank.length)
        sampled = {"revolutions": revolutions, "samples_per_revolution": FINE}
        options = Simulate(speed=speed, tolerance=tolerance, **sampled, **drive)
        self.samples = simulate(mechanism, options).samples
        self.first = float(self.samples["time"].iloc[SETTLING * FINE])
        last = min(int((SETTLING + turns) * FINE), len(self.samples) - 1)
        self.duration = float(self.samples["time"].iloc[last]) - self.first

    def at(self, channel: str, elapsed: np.ndarray) -> np.ndarray:
        return np.interp(self.first + elapsed, self.samples["time"], self.samples[channel])


class _Delay:
    """One channel that comes late, or none."""

    def __init__(self, rng: np.random.Generator, channels: list[str]):
        self.channel = str(rng.choice(channels)) if rng.random() < 0.3 else ""
        self.angle = rng.uniform(0.0, 0.2)  # rad

    def of(self, channel: str) -> float:
        return self.angle if channel == self.channel else 0.0


class _Sensor:
    """Noise, steps and gaps of one channel."""

    def __init__(self, rng: np.random.Generator, name: str):
        self.is_angle = name in ("crank_angle", "rod_angle")
        self.share = 10 ** rng.uniform(-3.0, -1.0)
        self.states_noise = rng.random() < 0.5
        self.noiseless = rng.random() < 0.1
        self.step = tau / float(rng.choice([100, 360, 3600, 10000])) if rng.random() < 0.4 else 0.0
        self.states_step = rng.random() < 0.7
        self.every = int(rng.integers(2, 4)) if rng.random() < 0.15 else 1
        kinds = ["none", "gaps", "half", "few"]
        self.empty = str(rng.choice(kinds, p=[0.75, 0.12, 0.1, 0.03]))
        self.wraps = rng.random() < 0.5

    def read(self, rng: np.random.Generator, values: np.ndarray) -> tuple[np.ndarray, float]:
        """Readings of true values, and the standard deviation of their noise."""
        spread = 0.05 if self.is_angle else max(np.std(values), 1e-2 * np.abs(values).max())
        sd = self.share * float(spread) * (not self.noiseless)
        values = values + sd * rng.standard_normal(values.size)
        if self.is_angle and self.step:
            values = self.step * np.round(values / self.step)
        if self.is_angle and self.wraps:
            values = np.mod(values, tau)
        count, places = values.size, np.arange(values.size)
        if self.every > 1:
            values[places % self.every != 0] = np.nan
        if self.empty == "gaps":
            for begin in rng.uniform(0, 0.9, 3):
                values[int(begin * count) : int((begin + 0.08) * count) + 1] = np.nan
        elif self.empty == "half":
            values[(places < count / 2) == (rng.random() < 0.5)] = np.nan
        elif self.empty == "few":
            values[rng.permutation(count)[min(14, count) :]] = np.nan
        return values, sd

    def stated(self, noise: dict[str, float], factor: float) -> dict[str, Any]:
        """Keys of the channel in the campaign file; `factor` is one SI unit in the unit of the
        column."""
        keys: dict[str, Any] = {}
        if self.is_angle and self.step and self.states_step:
            keys["resolution"] = self.step * factor
        if self.states_noise and all(noise.values()):
            keys["noise"] = noise
        return _plain(keys)


def _nuisance(
    rng: np.random.Generator, mechanism: dict, loose: tuple[str, ...], encoded: bool
) -> dict[str, Any]:
    keys: dict[str, Any] = {
        "slider_mass": "5 %",
        "rod_mass": "5 %",
        "rod_inertia": "10 %",
        "crank_length": "0.2 %",
    }
    keys |= {f"{pin}_clearance": "20 %" for pin in loose}
    if loose:
        keys["restitution"] = [0.2, 0.9]
    if not encoded:
        keys["speed"] = "0.5 %"
    else:
        keys |= {"encoder_zero": "5 deg"}
    return {key: value for key, value in keys.items() if rng.random() < 0.5}
