"""The positioning axis of the EMPS benchmark as a model for the naming of effects: a slide in
closed loop.

A DC motor drives a slide through a ball screw; a position and a speed loop in cascade, sampled at 1
kHz, follow a reference:

    voltage = kv (kp (reference - q) - speed) + pulses,    speed = (q now - q two samples ago) / 2
    ms M dv/dt = gtau voltage - Fv v + effects

That the speed is taken over two samples is no guess about the slide: with it the recorded voltage
follows from the recorded position to 4 mV, with the difference of two neighbours to 50 mV. Compared
is the force gtau voltage, averaged over 52 ms: one period of the closed loop's own oscillation,
sqrt(gtau kv kp / M) = 120 rad/s, which is the controller's and not the friction's. Position is not
compared too, since the controller makes the one from the other; so nothing can be said of the
encoder here, and a bias of the drive is a constant force.

Data and loop: A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Nonlinear
System Identification Benchmarks, 2019, nonlinearbenchmark.org.
"""

import os
from pathlib import Path

import numba
import numpy as np
from scipy.io import loadmat
from scipy.signal import lfilter

from examples.emps.effects import CANDIDATES
from jointgap.core.candidates import Candidate, Effects, Parameter, Series
from jointgap.core.errors import InputError

ADDRESS = "nonlinearbenchmark.org"
FILES = {"reference": "DATA_EMPS.mat", "pulses": "DATA_EMPS_PULSES.mat"}
HELD_OUT = "pulses"
SAMPLE_TIME = 1e-3  # s
AVERAGED = 52  # samples that become one
CYCLE = 6240 // AVERAGED  # of those, after which the reference repeats itself (6.24 s)
_SUB_STEPS = 4


class Emps:
    """A `jointgap.core.candidates.Model`.

    Parameters
    ----------
    folder : path, optional
        Holds the two files of `FILES`; where the environment variable JOINTGAP_EMPS says by
        default.

    Attributes
    ----------
    force : dict of str to (n,) array
        Measured force of each run [N], every millisecond.

    Raises
    ------
    InputError
        The files are not there.
    """

    name = "EMPS positioning axis"
    nuisances = (
        Parameter("mass", 100.0, 20.0, 500.0, step=1.0, unit="kg"),
        Parameter("viscous", 200.0, 0.0, 2000.0, step=5.0, unit="N*s/m"),
    )
    candidates: tuple[Candidate, ...] = CANDIDATES
    numerics = ("the drive acts half a sample later", "dry friction as tanh(v / 0.5 mm/s)")

    def __init__(self, folder: str | Path | None = None):
        folder = folder or os.environ.get("JOINTGAP_EMPS")
        if not folder:
            raise InputError(
                f"JOINTGAP_EMPS does not say where the EMPS data is; get it from {ADDRESS} and set"
                " it to its folder"
            )
        self._data = {run: _read(Path(folder) / file) for run, file in FILES.items()}
        self.force = {run: data["gtau"] * data["vir"] for run, data in self._data.items()}
        repeated = averages(self.force["reference"])
        # of one of two alike cycles
        scatter = float(np.std(repeated[CYCLE:] - repeated[:-CYCLE]) / np.sqrt(2.0))
        self.series = tuple(self._series(run, scatter) for run in FILES)

    def _series(self, run: str, scatter: float) -> Series:
        value = averages(self.force[run])
        time = AVERAGED * SAMPLE_TIME * (np.arange(value.size) + 0.5)
        angle = 2 * np.pi * time / (CYCLE * AVERAGED * SAMPLE_TIME)
        held_out, noise = np.full(value.size, run == HELD_OUT), np.full(value.size, scatter)
        return Series(run, "force", "N", value, time, angle, held_out, noise)

    def simulate(
        self, run, values, effects: Effects = (), numerics: int = 0
    ) -> dict[str, np.ndarray]:
        """What the drive's force would be on average, ``force`` [N]."""
        return {"force": averages(self.simulated_force(run, values, effects, numerics))}

    def simulated_force(self, run, values, effects: Effects = (), numerics: int = 0) -> np.ndarray:
        """The drive's force [N], every millisecond."""
        data = self._data[run]
        at = {
            f"{candidate.name}.{key}": value
            for candidate, of in effects
            for key, value in of.items()
        }
        force = _march(
            data["qg"],
            data["pulses"],
            np.array([data["gtau"], data["kp"], data["kv"]]),
            np.array([data["qm"][0], (data["qm"][1] - data["qm"][0]) / SAMPLE_TIME]),
            np.array([values["mass"], values["viscous"]]),
            np.array([at.get(key, 0.0) for key in _FORCES]),
            numerics,
        )
        if lag := at.get("sensor_lag.lag_s", 0.0):
            keep = np.exp(-SAMPLE_TIME / lag)
            force = lfilter([1.0 - keep], [1.0, -keep], force, zi=[keep * force[0]])[0]
        return force


_FORCES = (
    "slider_coulomb_friction.force_N",
    "slider_constant_force.force_N",
    "slider_quadratic_drag.drag_N_s2_m2",
    "slider_spring.stiffness_N_m",
    "slider_spring.rest_position_m",
    "harmonic_force.cosine_N",
    "harmonic_force.sine_N",
    "harmonic_force.frequency_Hz",
)


@numba.njit(cache=True, error_model="numpy")
def _march(reference, pulses, loop, start, slide, forces, numerics):
    """The drive's force at every sample; the controller sees the position at the samples, the drive
    holds the voltage between.
    """
    gain, kp, kv = loop
    mass, viscous = slide
    coulomb, constant, drag, stiffness, rest, cosine, sine, frequency = forces
    q, v = start
    before = q - v * SAMPLE_TIME
    before_that = before - v * SAMPLE_TIME
    h = SAMPLE_TIME / _SUB_STEPS
    held = 0.0
    found = np.empty(reference.size)
    for k in range(reference.size):
        speed = (q - before_that) / (2 * SAMPLE_TIME)
        drive = gain * (kv * (kp * (reference[k] - q) - speed) + pulses[k])
        found[k] = drive
        before_that, before = before, q
        for i in range(_SUB_STEPS):
            late = numerics == 1 and k > 0 and i < _SUB_STEPS // 2
            force = (
                (held if late else drive) + constant - drag * v * abs(v) - stiffness * (q - rest)
            )
            if frequency > 0.0:
                phase = 2 * np.pi * frequency * (k * SAMPLE_TIME + i * h)
                force += cosine * np.cos(phase) + sine * np.sin(phase)
            if numerics == 2:
                force -= coulomb * np.tanh(v / 5e-4)
                v = (v + h * force / mass) / (1.0 + h * viscous / mass)
            # dry friction stops the slide within a step or takes its share: no width about zero
            # speed
            else:
                v = (v + h * force / mass) / (1.0 + h * viscous / mass)
                most = h * coulomb / mass / (1.0 + h * viscous / mass)
                v = np.sign(v) * max(abs(v) - most, 0.0)
            q += h * v
        held = drive
    return found


def averages(samples: np.ndarray) -> np.ndarray:
    """Means of every `AVERAGED` samples; the rest at the end is left out."""
    return samples[: samples.size // AVERAGED * AVERAGED].reshape(-1, AVERAGED).mean(axis=1)


def _read(path: Path) -> dict:
    if not path.is_file():
        raise InputError(
            f"'{path}' is not there; get the EMPS data from {ADDRESS} and set JOINTGAP_EMPS to its"
            " folder"
        )
    try:
        table = loadmat(path)
        numbers = {key: float(table[key].item()) for key in ("gtau", "kp", "kv")}
        samples = {key: table[key].ravel().astype(float) for key in ("qm", "qg", "vir")}
    except (ValueError, KeyError) as error:
        raise InputError(
            f"'{path}' is not the EMPS data ({error}); get it anew from {ADDRESS}"
        ) from error
    pulses = np.ravel(table.get("pulses_N", np.zeros(samples["vir"].size))).astype(float)
    # in volts, whatever the file's name for them says
    return {**numbers, **samples, "pulses": pulses}
