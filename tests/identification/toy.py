"""A mechanism in closed form for tests: a slide driven by a crank that turns evenly, with effects
that act on the slide.

x = r (cos(angle) + L/4 cos(2 angle)) with L = 0.25; the drive holds the slide against inertia and
the sum F of the effects: force = m a - F, of which the sensors read ``torque`` = force dx/dangle,
``guide_force`` = force L sin(angle), and ``acceleration`` = a. A simulation takes 0.1 ms.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from jointgap.core.candidates import Candidate, Effects, LawFamily, Parameter, Series
from jointgap.core.errors import SimulationError
from jointgap.identification.baseline import Baseline, other_numerics, recalibrate
from jointgap.identification.problem import Noise
from jointgap.identification.screening import Sensitivities, simulate_sensitivities
from jointgap.identification.search import STEPS, Search
from jointgap.identification.thresholds import thresholds
from jointgap.identification.verdict import Thresholds

ROD_RATIO = 0.25
FALLING_SPEED = 0.5  # m/s, over which a share of dry friction falls
SPEEDS = {"slow": 10.0, "mid": 16.0, "fast": 24.0}  # rad/s
UNITS = {"torque": "N*m", "guide_force": "N", "acceleration": "m/s**2"}
Law = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""A force [N] on the slide from x [m], v [m/s], crank angle [rad] and time [s]."""


def _effect(
    name: str, coordinate: str, step: float, unit: str, low: float = -np.inf, **more
) -> Candidate:
    size = Parameter(coordinate, 0.0, low, step=step, unit=unit)
    return Candidate(name, "slider", (size,), (coordinate,), **more)


def _drag(name: str, coordinate: str, unit: str, exponent: float, *more: LawFamily) -> Candidate:
    """A force over a power of the speed, which is one of a family, and of `more`."""
    force = Parameter("force_N", 0.0, 0.0, step=0.3, unit="N")
    shape = Parameter("exponent", exponent, 0.0, 6.0, 0.1)
    law = Candidate("power_drag", "slider", (force, shape), ("force_N",))
    in_use = (0.0, 1.0, 2.0, 3.0, 5.0)
    family = LawFamily(
        law, "exponent", exponent, in_use, lambda values: {"force_N": values[coordinate]}
    )
    return _effect(name, coordinate, 0.3, unit, low=0.0, families=(family, *more))


def _falling() -> LawFamily:
    """Dry friction of which a share falls with speed."""
    force = Parameter("force_N", 0.0, 0.0, step=0.3, unit="N")
    share = Parameter("falling_share", 0.0, 0.0, 1.0, 0.1)
    law = Candidate("falling_friction", "slider", (force, share), ("force_N",))
    return LawFamily(law, "falling_share", 0.0, (0.0, 0.5, 1.0), dict)


def _harmonic() -> Candidate:
    amplitudes = tuple(Parameter(part, 0.0, step=0.3, unit="N") for part in ("cosine_N", "sine_N"))
    frequency = Parameter("frequency_Hz", 7.0, 1.0, 20.0, step=0.05, unit="Hz")
    starts = tuple({"frequency_Hz": float(value)} for value in (3.0, 7.0, 11.0))
    given = ((*amplitudes, frequency), ("cosine_N", "sine_N"), starts)
    return Candidate("harmonic_force", "slider", *given, carrier="constant_force")


def _sensor(name: str, channel: str, coordinate: str, step: float, unit: str) -> Candidate:
    size = Parameter(coordinate, 0.0, step=step, unit=unit)
    return Candidate(name, channel, (size,), (coordinate,), sensor=True, has_site=True)


CANDIDATES = (
    _drag("coulomb", "force_N", "N", 0.0, _falling()),
    _drag("viscous", "damping_N_s_m", "N*s/m", 1.0),
    _drag("quadratic", "drag_N_s2_m2", "N*s**2/m**2", 2.0),
    _effect("constant_force", "force_N", 0.3, "N"),
    _effect("spring", "stiffness_N_m", 3.0, "N/m", low=0.0),
    # -mass w^2 x: at one speed the same force as the spring's
    _effect("centrifugal", "mass_kg", 0.01, "kg"),
    _effect("added_mass", "mass_kg", 0.01, "kg", replaces={"slider_mass": "mass_kg"}),
    _harmonic(),
    _sensor("sensor_bias", "torque", "bias", 0.02, "N*m"),
    _sensor("sensor_gain", "acceleration", "gain_error", 0.01, "1"),
    _sensor("sensor_lag", "torque", "lag_s", 0.001, "s"),
)


SEARCH = {"initial_guesses": ({"size": 0.1},), "search_range": (0.02, 0.73)}
RINGING = _effect("ringing", "size", 0.01, "1", low=0.0, **SEARCH)
"""Not in CANDIDATES: a ringing impact whose phase determines the size within some percent."""


def ringing(size: float, angle: np.ndarray) -> np.ndarray:
    """Its force [N]."""
    since = np.mod(angle, 2 * np.pi)
    return 3.0 * np.sqrt(size) * np.exp(-since) * np.cos(17.0 * since + 40.0 * size * since**2)


KNOCKING = _effect("knocking", "size", 0.01, "1", low=0.0)
"""Not in CANDIDATES: impacts that get stronger and later with the size, as of a loose joint."""


def knocking(size: float, angle: np.ndarray) -> np.ndarray:
    """Its force [N]."""
    return 3.0 * size * np.exp(-np.mod(angle - 1.0 - 0.3 * size, 2 * np.pi) / 0.2)


@dataclass(frozen=True)
class Toy:
    """A `jointgap.core.candidates.Model`."""

    series: Sequence[Series]
    nuisances: Sequence[Parameter]
    candidates: Sequence[Candidate]
    speeds: Mapping[str, float]
    hidden: Law | None = None
    name: str = "toy"
    numerics: Sequence[str] = ("friction of another width at rest",)

    def simulate(
        self, run: str, values: Mapping[str, float], effects: Effects = (), numerics: int = 0
    ) -> Mapping[str, np.ndarray]:
        """Readings of the sensors."""
        here = next(series for series in self.series if series.run == run)
        angle, r, w = here.angle, values["crank_length"], values["speed"]
        if r <= 0.0:
            raise SimulationError(f"run {run}: a crank of {r:g} m does not turn")
        time = here.time
        x = r * (np.cos(angle) + ROD_RATIO / 4 * np.cos(2 * angle))
        slope = -r * (np.sin(angle) + ROD_RATIO / 2 * np.sin(2 * angle))
        v, a = slope * w, -r * w**2 * (np.cos(angle) + ROD_RATIO * np.cos(2 * angle))
        sign = np.tanh(v / (0.02 if numerics > 0 else 0.01))
        state = SimpleNamespace(x=x, v=v, w=w, time=time, angle=angle, sign=sign)
        mass, force = values["slider_mass"], np.zeros(angle.size)
        for candidate, at in effects:
            if candidate.name == "added_mass":
                mass = mass + at["mass_kg"]
            elif not candidate.sensor:
                force = force + FORCES[candidate.name](at, state)
        if self.hidden is not None:
            force = force + self.hidden(x, v, angle, time)
        drive = mass * a - force
        read = {
            "torque": drive * slope,
            "guide_force": drive * ROD_RATIO * np.sin(angle),
            "acceleration": a,
        }
        for candidate, at in effects:
            if candidate.sensor and candidate.site in read:
                read[candidate.site] = READINGS[candidate.name](at, read[candidate.site], state)
        return {series.channel: read[series.channel] for series in self.series if series.run == run}


FORCES = {
    "ringing": lambda at, s: ringing(at["size"], s.angle),
    "knocking": lambda at, s: knocking(at["size"], s.angle),
    "coulomb": lambda at, s: -at["force_N"] * s.sign,
    "viscous": lambda at, s: -at["damping_N_s_m"] * s.v,
    "quadratic": lambda at, s: -at["drag_N_s2_m2"] * s.v * np.abs(s.v),
    "power_drag": lambda at, s: -at["force_N"] * np.abs(s.v) ** at["exponent"] * s.sign,
    "falling_friction": lambda at, s: -at["force_N"] * falling(at["falling_share"], s.v) * s.sign,
    "constant_force": lambda at, s: np.full(s.x.shape, at["force_N"]),
    "spring": lambda at, s: -at["stiffness_N_m"] * s.x,
    "centrifugal": lambda at, s: -at["mass_kg"] * s.w**2 * s.x,
    "harmonic_force": lambda at, s: (
        at["cosine_N"] * np.cos(2 * np.pi * at["frequency_Hz"] * s.time)
        + at["sine_N"] * np.sin(2 * np.pi * at["frequency_Hz"] * s.time)
    ),
}
"""Force [N] on the slide by the coordinates of an effect and the state."""
READINGS = {
    "sensor_bias": lambda at, value, s: value + at["bias"],
    "sensor_gain": lambda at, value, s: value * (1.0 + at["gain_error"]),
    "sensor_lag": lambda at, value, s: value - at["lag_s"] * s.w * np.gradient(value, s.angle),
}


def falling(share: float, v: np.ndarray) -> np.ndarray:
    return 1.0 - share + share * np.exp(-np.abs(v) / FALLING_SPEED)


def toy(
    effects: Mapping[str, Mapping[str, float]] | None = None,
    nuisances: Mapping[str, float] | None = None,
    noise: float = 0.02,
    seed: int = 0,
    *,
    speeds: Mapping[str, float] = SPEEDS,
    held_out: Sequence[str] = ("fast",),
    channels: Sequence[str] = tuple(UNITS),
    candidates: Sequence[str] | None = None,
    autocorrelation: float = 0.0,
    samples: int = 72,
    cycles: float = 5.0,
    stated: bool = True,
    planned: bool = False,
    hidden: Law | None = None,
) -> Toy:
    """A toy and data measured on it, with `effects` by label and coordinate.

    `nuisances` (such as slider_mass or speed@slow) are off nominal; the force `hidden` is not a
    candidate. `noise` is a share of the standard deviation of a channel, with `autocorrelation`
    from sample to sample; it may be `stated`. A run has `cycles` of `samples` each. `candidates`
    are labels, all by default. A `planned` campaign is not measured: all values are NaN.
    """
    mass, length = 0.5, 0.15
    uncertain = [
        Parameter("slider_mass", mass, 0.95 * mass, 1.05 * mass, 0.01 * mass, "kg"),
        Parameter("crank_length", length, 0.98 * length, 1.02 * length, 0.002 * length, "m"),
    ]
    for run, w in speeds.items():
        uncertain.append(Parameter("speed", w, 0.995 * w, 1.005 * w, 0.001 * w, "rad/s", run))
    angle = 0.1 + 2 * np.pi * np.arange(round(samples * cycles)) / samples
    empty = np.full(angle.size, np.nan)
    series = []
    for run, w in speeds.items():
        is_held_out = np.full(angle.size, run in held_out)
        for channel in channels:
            unit = UNITS[channel]
            series.append(Series(run, channel, unit, empty, angle / w, angle, is_held_out))
    known = tuple(c for c in CANDIDATES if candidates is None or c.label in candidates)
    model = Toy(series, tuple(uncertain), known, dict(speeds))
    truth, rng, measured = replace(model, hidden=hidden), np.random.default_rng(seed), []
    acting = [(candidate_of(label), at) for label, at in (effects or {}).items()]
    for run in speeds:
        of_run = [p for p in uncertain if p.run in (None, run)]
        values = {p.name: (nuisances or {}).get(p.key, p.nominal) for p in of_run}
        clean = truth.simulate(run, values, acting)
        for one in (s for s in series if s.run == run):
            sd = noise * float(np.std(clean[one.channel]))
            value = clean[one.channel] + sd * coloured(angle.size, autocorrelation, rng)
            spread = np.full(angle.size, sd) if stated else None
            value = empty if planned else value
            measured.append(replace(one, value=value, stated_noise=spread))
    return replace(model, series=tuple(measured))


def candidate_of(label: str) -> Candidate:
    """The candidate of that label."""
    return next(c for c in CANDIDATES if c.label == label)


def coloured(count: int, autocorrelation: float, rng: np.random.Generator) -> np.ndarray:
    """Noise of variance 1 that remembers `autocorrelation` of its last sample, shape (count,)."""
    found = rng.standard_normal(count)
    for i in range(1, count):
        found[i] = autocorrelation * found[i - 1] + np.sqrt(1.0 - autocorrelation**2) * found[i]
    return found


def stated_noise(
    model: Toy, autocorrelation: float = 0.0, order: int = 0
) -> dict[tuple[str, str], Noise]:
    """The noise as stated, with the given memory over `order` samples."""
    memory = tuple(autocorrelation**lag for lag in range(1, order + 1))
    return {series.key: Noise(series.stated_noise, memory) for series in model.series}


def screened(model: Toy) -> tuple[Baseline, Sensitivities]:
    """The fitted base and sensitivities of its candidates."""
    base = recalibrate(model, stated_noise(model))
    return base, simulate_sensitivities(base.problem, base.base, base.differences)


def analysed(model: Toy) -> tuple[Baseline, Sensitivities, Thresholds]:
    """That, and the limits: all that is known before an effect is fitted."""
    base, sensitivities = screened(model)
    numerics = other_numerics(base.problem, base.base)
    return base, sensitivities, thresholds(base.problem, sensitivities, numerics)


def searched(base: Baseline, sensitivities: Sensitivities, limits: Thresholds) -> Search:
    """The fits of all steps."""
    return Search(base, sensitivities, limits, STEPS).run()
