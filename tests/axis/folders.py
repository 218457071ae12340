"""Folders of models of the user, with simulated data."""

from pathlib import Path

import numpy as np
import pandas as pd

PENDULUM = '''
import numpy as np

from jointgap.axis import Axis, parameter


class Pendulum(Axis):
    """A rod with a weight, driven by a motor."""

    inertia = parameter(0.14, "kg*m**2", low=0.02, high=1.0)
    gravity_torque = parameter(3.2, "N*m", low=0.3, high=20.0)
    viscous = parameter(0.04, "N*m*s", low=0.0, high=1.0)

    def mass(self):
        return self.inertia

    def force(self, position, velocity):
        return -self.gravity_torque * np.sin(position) - self.viscous * velocity
'''

PENDULUM_FILE = """
name: pendulum
given: drive
mean_of: 10
channels:
  time: {column: time, unit: s}
  drive: {column: torque, unit: N*m}
  position: {column: position, unit: deg, noise: 0.1}
runs:
  - {id: slow, file: slow.csv, role: identify, start: at_rest}
  - {id: fast, file: fast.csv, role: identify, start: at_rest}
  - {id: check, file: check.csv, role: confirm, start: at_rest}
candidates: [coulomb_friction, quadratic_drag, constant_force, "sensor_delay:position",
  "sensor_gain:position"]
"""

PISTON = '''
from jointgap.axis import Axis, effect, parameter


class Piston(Axis):
    """A piston that is moved by hand, at a pressure."""

    area = parameter(2.0e-4, "m**2", low=1.0e-4, high=4.0e-4)
    zero = parameter(0.0, "N", low=-2.0, high=2.0, each_run=True)
    squeeze = effect("1", step=1e-3)

    def force(self, pressure):
        return -self.zero - self.area * pressure * (1.0 - self.squeeze)

    def load(self, pressure):
        return self.area * pressure
'''

PISTON_FILE = """
name: piston
given: position
channels:
  time: {column: t, unit: s}
  drive: {column: F, unit: N}
  position: {column: x, unit: mm, bandwidth: 10 Hz}
  pressure: {column: p, unit: bar}
runs:
  - {id: low, file: low.csv, role: identify, period: 2 s}
  - {id: high, file: high.csv, role: identify, period: 2 s}
  - {id: check, file: check.csv, role: confirm, period: 2 s}
"""

GEAR = '''
from jointgap.axis import Axis, parameter


class Gear(Axis):
    """A gear whose angles are measured at both ends."""

    ratio = parameter(11.0, "1", low=10.0, high=12.0)
    zero = parameter(0.0, "rad", low=-0.5, high=0.5)

    def output(self, position):
        return position / self.ratio + self.zero
'''

GEAR_FILE = """
name: gear
given: position
channels:
  time: {column: t, unit: s}
  position: {column: input, unit: deg}
  output: {column: output, unit: deg}
runs:
  - {id: one, file: one.csv, role: identify, period: 4 s}
  - {id: two, file: two.csv, role: confirm, period: 4 s}
"""


def write(folder: Path, file: str, code: str, runs: dict[str, pd.DataFrame]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "model.yaml").write_text(file, encoding="utf-8")
    (folder / "model.py").write_text(code, encoding="utf-8")
    for name, samples in runs.items():
        samples.to_csv(folder / f"{name}.csv", index=False)
    return folder


def pendulum(folder: Path, friction: float = 0.15, delay: float = 0.0, gain: float = 0.0) -> Path:
    """A pendulum with dry friction [N m], and a delay [s] and an error of the gain [1] of its
    encoder; by a method of its own with steps of 0.1 ms."""
    random, runs = np.random.default_rng(3), {}
    interval, each = 2e-3, 20
    for name, (most, frequency) in {
        "slow": (1.0, 0.5),
        "fast": (1.6, 0.8),
        "check": (1.3, 0.6),
    }.items():
        fine = np.arange(3000 * each + 1) * interval / each
        torque = most * np.sin(2 * np.pi * frequency * fine)
        torque += 0.5 * most * np.sin(3.4 * np.pi * frequency * fine)
        torque = np.interp(fine, fine[::each], torque[::each])
        angle = _swings(fine, torque, friction)
        read = (1.0 + gain) * np.interp(fine - delay, fine, angle)[::each]
        read = np.degrees(read) + random.normal(0.0, 0.1, read.size)
        columns = {"time": fine[::each], "torque": torque[::each], "position": read}
        runs[name] = pd.DataFrame(columns)
    return write(folder, PENDULUM_FILE, PENDULUM, runs)


def _swings(time: np.ndarray, torque: np.ndarray, friction: float) -> np.ndarray:
    angle, speed, step = np.zeros(time.size), 0.0, time[1]
    for k in range(time.size - 1):
        middle = angle[k] + 0.5 * step * speed
        drive = 0.5 * (torque[k] + torque[k + 1]) - 3.0 * np.sin(middle)
        change = step * (drive - 0.05 * speed) / 0.15
        rest = step * friction / 0.15
        speed = np.sign(speed + change) * max(abs(speed + change) - rest, 0.0)
        angle[k + 1] = middle + 0.5 * step * speed
    return angle


def piston(folder: Path, friction: float = 3.1, share: float = 0.04) -> Path:
    """A piston with dry friction [N], and a `share` [1] of the pressure force."""
    random, runs = np.random.default_rng(4), {}
    time = np.arange(2000) * 0.01
    for name, pressure in {"low": 1.0, "high": 4.0, "check": 2.5}.items():
        position = 20.0 * np.sin(np.pi * time)
        sign = np.tanh(np.cos(np.pi * time) / 0.007)
        push = 1.9e-4 * 1e5 * pressure
        force = push + 0.3 + (friction + share * push) * sign
        runs[name] = pd.DataFrame(
            {
                "t": time,
                "F": force + random.normal(0.0, 0.1, time.size),
                "x": position + random.normal(0.0, 0.002, time.size),
                "p": pressure + random.normal(0.0, 0.001, time.size),
            }
        )
    return write(folder, PISTON_FILE, PISTON, runs)


def gear(folder: Path, play: float = 2.0) -> Path:
    """A gear of the ratio 11.2 with a play [deg] at its output."""
    random, runs = np.random.default_rng(5), {}
    time = np.arange(1600) * 0.01
    for name, most in {"one": 120.0, "two": 90.0}.items():
        given = most * np.sin(0.5 * np.pi * time)
        behind, half = np.empty(time.size), 0.5 * play * 11.2
        behind[0] = -half
        for k in range(1, time.size):
            behind[k] = min(max(behind[k - 1], given[k] - half), given[k] + half)
        read = behind / 11.2 + 0.5 + random.normal(0.0, 0.02, time.size)
        runs[name] = pd.DataFrame({"t": time, "input": given, "output": read})
    return write(folder, GEAR_FILE, GEAR, runs)
