"""The torque-limited simple pendulum of the DFKI as a model for the naming of effects.

    inertia dv/dt = torque - gravity_torque sin q - viscous v + effects

A motor with a 6:1 gear swings up a rod with a weight. The measured torque drives the simulation
from rest, and the simulated angle is compared with the measured one. Nothing is differentiated.
Each run is compared until the pendulum is first 150 deg away from hanging. Near the top the
controllers change, and later some runs are disturbed by hand.

The loop is closed: friction changes the angle, and the controller answers with torque. This is no
bias, because the torque that acts is measured. The error of the torque reading does count: it
enters the motion, and `drive_errors` states it.

Each reading is the torque of the interval before it. With this shift, commands and readings of the
runs `energy_shaping` and `sac` differ by 0.06 N m (standard deviation), without it by 0.12 and 0.10
N m.

Data: DFKI RIC Underactuated Lab, "torque_limited_simple_pendulum", BSD 3-Clause, at `ADDRESS`.
"""

import os
from pathlib import Path

import numba
import numpy as np
import pandas as pd

from examples.pendulum.effects import CANDIDATES, GEAR_RATIO
from jointgap.core.candidates import Candidate, Effects, Parameter, Series
from jointgap.core.errors import InputError
from jointgap.identification.noise import scatter_between_samples
from jointgap.identification.settings import DEFAULT_SETTINGS

ADDRESS = "https://github.com/dfki-ric-underactuated-lab/torque_limited_simple_pendulum"
RUNS = ("ddp", "direct_collocation", "energy_shaping", "sac")  # by their controllers
HELD_OUT = ("direct_collocation", "sac")
COLUMNS = ("time", "position", "torque")
ANGLE_STEP = 191.0 / 65535  # rad, resolution of the position in the messages of the motor
HIGHEST = np.radians(150.0)
COMPARED = (
    0.02  # s between two angles that are compared; errors of the torque count as one in this time
)
_LONGEST_STEP = 1e-3  # s


class Pendulum:
    """A `jointgap.core.candidates.Model`, and `Driven`.

    Parameters
    ----------
    folder : path, optional
        A clone of the repository at `ADDRESS`; where the environment variable JOINTGAP_PENDULUM
        says by default.
    held_out : tuple of str
        Runs that take no part in fitting.

    Raises
    ------
    InputError
        The files are not there, or not those.
    """

    name = "torque-limited simple pendulum"
    nuisances = (
        Parameter("inertia", 0.15, 0.02, 1.0, step=1e-3, unit="kg*m**2"),
        Parameter("gravity_torque", 3.0, 0.3, 20.0, step=0.02, unit="N*m"),  # when horizontal
        Parameter("viscous", 0.05, 0.0, 1.0, step=2e-3, unit="N*m*s"),
    )
    candidates: tuple[Candidate, ...] = CANDIDATES
    numerics = ("the torque is linear between readings",)

    def __init__(self, folder: str | Path | None = None, held_out: tuple[str, ...] = HELD_OUT):
        folder = folder or os.environ.get("JOINTGAP_PENDULUM")
        if not folder:
            raise InputError(
                f"JOINTGAP_PENDULUM does not say where the pendulum data is; clone {ADDRESS} and"
                " set it to that folder"
            )
        self._data = {run: _read(path_of(folder, run)) for run in RUNS}
        self.series = tuple(self._series(run, run in held_out) for run in RUNS)

    def _series(self, run: str, held_out: bool) -> Series:
        time, angle, _ = self._compared(run, self._data[run])
        unknown, noise = np.full(time.size, np.nan), np.full(time.size, ANGLE_STEP / np.sqrt(12.0))
        return Series(
            run, "position", "rad", angle, time, unknown, np.full(time.size, held_out), noise
        )

    def _compared(self, run: str, samples: np.ndarray) -> np.ndarray:
        """Every so many of the `samples` (..., n) of a run."""
        every = max(round(COMPARED / np.median(np.diff(self._data[run][0]))), 1)
        return samples[..., every::every]

    def simulate(
        self, run, values, effects: Effects = (), numerics: int = 0
    ) -> dict[str, np.ndarray]:
        """The ``position`` [rad] that the encoder would read."""
        return {"position": self._compared(run, self.motion(run, values, effects, numerics)[0])}

    def drive_errors(self, run, values) -> dict[str, np.ndarray]:
        """What one standard deviation of the torque reading changes, for each interval of
        `COMPARED`."""
        time, _, torque = self._data[run]
        sd = scatter_between_samples(torque, DEFAULT_SETTINGS.noise).sd
        block = (time / COMPARED).astype(int)
        changes = [self.motion(run, values)[0]]
        for each in np.unique(block):
            own = block == each
            changes.append(
                self.motion(run, values, error=np.where(own, sd / np.sqrt(own.sum()), 0.0))[0]
            )
        return {"position": self._compared(run, np.array(changes[1:]) - changes[0]).T}

    def motion(
        self, run, values, effects: Effects = (), numerics: int = 0, error=0.0
    ) -> np.ndarray:
        """Position as read [rad] and speed [rad/s] at all samples of a run, (2, n).

        `error` [N m] is added to the torque reading.
        """
        time, angle, torque = self._data[run]
        at = {
            f"{candidate.name}.{key}": value
            for candidate, of in effects
            for key, value in of.items()
        }
        offset, delay = at.get("encoder_offset.angle_rad", 0.0), at.get("torque_delay.delay_s", 0.0)
        impulse = np.append(0.0, np.cumsum(np.diff(time) * (torque + error)[1:]))
        acting = np.diff(np.interp(time - delay, time, impulse)) / np.diff(time)
        if numerics:
            acting = 0.5 * (acting + np.append(acting[0], acting[:-1]))
        effects = np.array([at.get(key, 0.0) for key in _IN_STEP])
        pendulum = np.array([values["inertia"], values["gravity_torque"], values["viscous"]])
        moved = _march(time, acting, angle[0] - offset, pendulum, effects)
        moved[0] += offset
        return moved


def path_of(folder: str | Path, run: str) -> Path:
    """The file of a run in a clone of the repository."""
    return Path(folder) / "results" / f"control_method_{run}" / "data_measured.csv"


_IN_STEP = (
    "coulomb_friction.torque_Nm",
    "load_friction.share",
    "starting_friction.torque_Nm",
    "starting_friction.speed_rad_s",
    "quadratic_drag.drag_Nm_s2",
    "constant_torque.torque_Nm",
    "rotor_torque.cosine_Nm",
    "rotor_torque.sine_Nm",
)


@numba.njit(cache=True, error_model="numpy")
def _march(time, torque, start, pendulum, effects):
    """Angle and speed (2, n) at every sample, from rest; `torque` (n - 1,) acts between samples."""
    inertia, gravity, viscous = pendulum
    coulomb, load, starting, fading, drag, constant, cosine, sine = effects
    found = np.zeros((2, time.size))
    q, v = start, 0.0
    found[0, 0] = q
    for k in range(1, time.size):
        steps = int(np.ceil((time[k] - time[k - 1]) / _LONGEST_STEP))
        h = (time[k] - time[k - 1]) / steps
        drive = torque[k - 1]
        for _ in range(steps):  # drift, kick, drift: of second order
            q += 0.5 * h * v
            force = drive + constant - gravity * np.sin(q) - drag * v * abs(v)
            force += cosine * np.cos(GEAR_RATIO * q) + sine * np.sin(GEAR_RATIO * q)
            dry = coulomb + load * abs(drive)
            if starting > 0.0:
                dry += starting * np.exp(-abs(v) / fading)
            v = (v + h * force / inertia) / (1.0 + h * viscous / inertia)
            # dry friction stops the pendulum or slows it down; there is no speed range with reduced
            # friction
            v = np.sign(v) * max(abs(v) - h * dry / inertia / (1.0 + h * viscous / inertia), 0.0)
            q += 0.5 * h * v
        found[0, k], found[1, k] = q, v
    return found


def _read(path: Path) -> np.ndarray:
    """Time [s], position [rad] and torque [N m], (3, n), from the second sample on to `HIGHEST`.

    The first time stamp can be early, by the time that the controller takes for its first command.
    """
    again = f"clone {ADDRESS} and set JOINTGAP_PENDULUM to that folder"
    if not path.is_file():
        raise InputError(f"'{path}' is not there; {again}")
    try:
        samples = pd.read_csv(path)[list(COLUMNS)].to_numpy(float).T
    except (ValueError, KeyError) as error:
        raise InputError(f"'{path}' is not a run of the pendulum ({error}); {again}") from error
    high = np.abs(samples[1]) > HIGHEST
    samples = samples[:, 1 : np.argmax(high) if high.any() else None]
    if not (
        np.isfinite(samples).all() and samples.shape[1] > 100 and (np.diff(samples[0]) > 0.0).all()
    ):
        raise InputError(
            f"'{path}' needs more than 100 rows of finite numbers in order of time; {again}"
        )
    return samples
