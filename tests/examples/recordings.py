"""Synthetic recordings in the formats of the authors' downloads, with known effects.

The laws are restated here from their definitions; nothing is imported from the models.
"""

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.io import savemat

from examples.band_brake import convert as band_brake
from examples.cycloidal_gear import convert as cycloidal_gear
from examples.emps import convert as emps
from examples.pendulum import convert as pendulum
from examples.pneumatic_piston import convert as pneumatic_piston
from examples.servo import convert as servo

SEED = 7
STEP = 2e-4  # s, of the simulations


def swing(
    time: np.ndarray,
    start: float,
    inertia: float,
    command: Callable,
    torque: Callable,
    friction: Callable = lambda command: 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Angles and commands (n,) of a body that starts from rest.

    `command(time, angle)` is what the motor gets, `torque(command, angle, speed)` acts on the body,
    and dry friction of the size `friction(command)` stops it.
    """
    angles, commands = np.empty(time.size), np.empty(time.size)
    angle, speed = start, 0.0
    for k, now in enumerate(time):
        angles[k], commands[k] = angle, command(now, angle)
        steps = int(np.ceil((time[min(k + 1, time.size - 1)] - now) / STEP))
        for i in range(steps):
            h = (time[k + 1] - now) / steps
            given = command(now + (i + 0.5) * h, angle)
            speed += h * torque(given, angle, speed) / inertia
            speed = np.sign(speed) * max(abs(speed) - h * friction(given) / inertia, 0.0)
            angle += h * speed
    return angles, commands


def write_band_brake(folder: Path, play: float = 4e-3) -> None:
    """A band that slips at 10 kN, with a stiffness of 5 kN/mm behind a play [m]."""
    random = np.random.default_rng(SEED)
    path = folder / band_brake.TESTS
    path.mkdir(parents=True)
    half, stiffness, friction = 0.5 * play, 5e6, 1e4
    for file in band_brake.RUNS.values():
        frequency, rest = file.split("Hz30lbtension")
        amplitude = band_brake.INCH * float(rest.removesuffix("amplitude"))
        time = np.arange(12 * 1024) / 1024.0
        position = amplitude * np.sin(2 * np.pi * float(frequency) * time)
        band, force = 0.0, np.zeros(time.size)
        for k, x in enumerate(position):
            reach = half + friction / stiffness
            band = min(max(band, x - reach), x + reach)
            force[k] = stiffness * np.sign(x - band) * max(abs(x - band) - half, 0.0)
        force += random.normal(0.0, 100.0, time.size)
        position = position / band_brake.INCH
        rows = np.column_stack([time, position, force / band_brake.KIP, 0 * time, 0 * time])
        text = json.dumps({"data": rows.round(7).tolist()})
        (path / f"{file}.json").write_text(text, encoding="utf-8")


def write_pneumatic_piston(folder: Path, dry: float = 3.2, per_bar: float = 0.77) -> None:
    """Friction of `dry` [N] and of `per_bar` [N/bar], in a cylinder of 25 mm."""
    random = np.random.default_rng(SEED)
    path = folder / pneumatic_piston.TESTS
    path.mkdir(parents=True)
    time = 0.01 * np.arange(4000)
    phase = time / 8.0 % 1.0
    position = 40.0 * np.where(phase < 0.6, phase / 0.6, (1.0 - phase) / 0.4)  # mm
    speed = np.sign(np.gradient(position))
    for bar in pneumatic_piston.PRESSURES:
        pressure = bar + 0.03 * speed
        force = 1e5 * pressure * np.pi * 0.0125**2 + (dry + per_bar * bar) * speed
        force += random.normal(0.0, 0.1, time.size)
        read = position + random.normal(0.0, 0.004, time.size)
        columns = [1000.0 * time, *3 * [0 * time], read, pressure, force]
        np.savetxt(path / f"Circle_{bar}bar.csv", np.column_stack(columns), "%.3f")


def write_cycloidal_gear(folder: Path, play: float = 1.5) -> None:
    """A play [deg] and 2 N m of friction."""
    random = np.random.default_rng(SEED)
    cycles = []
    half, stiffness = np.radians(0.5 * play), 1500.0
    start = -half - 0.5 / stiffness  # where friction holds the rotor after the cycle before

    def ramps(time, angle):
        return 4.0 * (1.0 - abs(time % 2.0 - 1.0)) * (1.0 if time < 2.0 else -1.0)

    def torque(command, angle, speed):
        twist = math.copysign(max(abs(angle) - half, 0.0), angle)
        return command - stiffness * twist - 2.0 * speed

    for cycle in range(max(cycloidal_gear.CYCLES) + 1):
        time = np.arange(1800) / 450.0
        angle, command = swing(time, start, 0.05, ramps, torque, lambda command: 2.0)
        start = angle[-1]
        read = (angle - 0.03) / (2.0 * np.pi) + random.normal(0.0, 5e-6, time.size)
        stamps = 4.0 * cycle + np.floor(time / 0.016) * 0.016
        table = {"TIME": stamps, "POSITION": read, "CONTROL_TORQUE": command, "test_nr": cycle}
        cycles.append(pd.DataFrame(table))
    path = folder / cycloidal_gear.FILE
    path.parent.mkdir(parents=True)
    pd.concat(cycles).to_csv(path, index=False)


def write_servo(folder: Path, share: float = 0.28) -> None:
    """Friction of a `share` of the motor torque; an arm of 0.1 m with 0.49 kg."""
    random = np.random.default_rng(SEED)
    path = folder / servo.RECORDINGS
    path.mkdir(parents=True)

    def torque(voltage, angle, speed):
        return 0.1 * voltage - 0.04 * speed - 0.49 * 9.81 * 0.1 * math.sin(angle)

    for run, file in servo.RUNS.items():
        gain = 2.5 / servo.FULL_DUTY * float(run.removeprefix("gain_"))

        def controller(time, angle, gain=gain):
            duty = gain * (math.sin(time**2) - angle)
            return 7.0 * min(max(duty, -1.0), 1.0)

        time = np.cumsum(random.uniform(0.0051, 0.0056, 1100))
        angle, voltage = swing(
            time, 0.0, 0.0069, controller, torque, lambda voltage: share * abs(0.1 * voltage)
        )
        step = 2.0 * np.pi / 4096
        counts = np.round(servo.FULL_DUTY * voltage / 7.0).astype(int)
        entries = pd.DataFrame(
            {
                "timestamp": time,
                "position": step * np.round(angle / step),
                "load": counts % servo.COUNTS,
                "input_volts": 7.0,
            }
        )
        text = json.dumps({"entries": entries.to_dict("records")})
        (path / f"2026-01-15_{file}.json").write_text(text, encoding="utf-8")


def write_pendulum(folder: Path, dry: float = 0.15) -> None:
    """Dry friction [N m] on a pendulum of 0.19 kg m^2."""
    random = np.random.default_rng(SEED)
    torques = {
        "ddp": lambda time: (0.3 + 0.3 * time) * np.sin(4.1 * time),
        "direct_collocation": lambda time: 1.2 * np.sin(5.5 * time) + 0.6 * np.sin(2.0 * time),
        "energy_shaping": lambda time: 0.9 * np.tanh(3.0 * np.sin(4.0 * time)),
        "sac": lambda time: 0.8 * np.tanh(3.0 * np.sin(4.4 * time + 1.0)),
    }

    def total(command, angle, speed):
        return command - 3.6 * math.sin(angle) - 0.012 * speed

    time = 0.004 * np.arange(1201)
    for run, torque in torques.items():

        def motor(time, angle, torque=torque):
            return torque(time)

        angle, _ = swing(time, 0.0, 0.19, motor, total, lambda command: dry)
        step = 191.0 / 65535
        table = {
            "time": time,
            "position": step * np.round(angle / step),
            # a reading is the torque of the interval before it
            "torque": torque(time - 0.002) + random.normal(0.0, 0.04, time.size),
        }
        path = pendulum.path_of(folder, run)
        path.parent.mkdir(parents=True)
        pd.DataFrame(table).to_csv(path, index=False)


def write_emps(folder: Path, dry: float = 20.0) -> None:
    """Dry friction [N] on a slide of 95 kg."""
    random = np.random.default_rng(SEED)
    time = emps.SAMPLE_TIME * np.arange(20000)
    for run, file in emps.RUNS.items():
        position = velocity = acceleration = 0.0
        for amplitude, order in ((0.1, 1.0), (0.02, 5.0 if run == "reference" else 7.0)):
            rate = 2.0 * np.pi * order / 6.24
            position = position + amplitude * (1.0 - np.cos(rate * time))
            velocity = velocity + amplitude * rate * np.sin(rate * time)
            acceleration = acceleration + amplitude * rate**2 * np.cos(rate * time)
        force = 95.0 * acceleration + 200.0 * velocity + dry * np.sign(velocity)
        force += random.normal(0.0, 3.0, time.size)
        position = position + random.normal(0.0, 1e-6, time.size)
        savemat(folder / file, {"qm": position, "vir": force / 35.0, "gtau": 35.0})


WRITERS = {
    "band_brake": write_band_brake,
    "cycloidal_gear": write_cycloidal_gear,
    "emps": write_emps,
    "pendulum": write_pendulum,
    "pneumatic_piston": write_pneumatic_piston,
    "servo": write_servo,
}
