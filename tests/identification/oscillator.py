"""An oscillator in windows with an exact solution, linear in state and forces."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from jointgap.core.candidates import Candidate, Parameter, Series, StateEstimate
from jointgap.identification.problem import Noise, Problem
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from tests.identification.toy import coloured

FREQUENCY, DAMPING = 1.4, 0.05  # rad/s, 1
SPEEDS, TURNS, PER_TURN, SD, MEMORY = {"slow": 1.0, "fast": 1.7}, 4, 24, 0.02, 0.5
CHANNELS = ("angle", "rate")
START = {"slow": (0.4, -0.3), "fast": (-0.5, 0.2)}


def force(name: str, low: float = -math.inf) -> Candidate:
    return Candidate(name, "mass", (Parameter("size", 0.0, low, step=0.01),), ("size",))


SWING, WOBBLE, PULL = force("swing"), force("wobble"), force("pull", low=0.0)
PUSH = replace(force("push"), replaces={"drive": "size"})
SPRING = Candidate(
    "spring",
    "mass",
    (Parameter("size", 0.0, -1.0, 3.0, 0.01), Parameter("damping", 0.0, 0.0, 1.0, 0.01)),
    ("size",),
    ({"size": 0.2, "damping": 0.0}, {"size": 0.2, "damping": 0.3}),
    is_perturbation=True,
    search_range=(-0.9, 0.6),
)
"""Relative change of stiffness (-1: no spring), and damping."""
HIDDEN_SPRING = replace(
    SPRING,
    coordinates=(Parameter("size", 0.0, 0.0, 3.0, 0.01), SPRING.coordinates[1]),
    is_perturbation=False,
    search_range=(0.1, 1.6),
)
"""The same without a slope at size 0, like a clearance."""


class Handed(NamedTuple):
    windows: np.ndarray  # how many came before


@dataclass(frozen=True)
class States:
    edges: np.ndarray
    slow: np.ndarray
    carried: Handed


FORCES = "swing", "pull", "wobble", "push"
BY_NAME = {candidate.name: candidate for candidate in (SWING, WOBBLE, PULL, PUSH, SPRING)}


@dataclass
class Oscillator:
    """A `jointgap.core.candidates.Model` of runs that turn at a speed W: x'' + 2 z w x' + w^2 x =
    drive cos(W t) + (swing - pull) cos(2 W t) + wobble cos(3 W t), of which x, from a zero of each
    run, and x' are read. One trajectory of a run begins at its `START`."""

    nuisances: Sequence[Parameter]
    series: Sequence[Series] = ()
    broken: int = -1  # a window that cannot be simulated
    # whether there are windows, by the effects' values
    windowed: Callable[[dict], bool] = lambda effects: True
    # for each reading, that a filter is to find with effects
    deviance: Callable[[dict], float] = lambda effects: 0.0
    name: str = "oscillator"
    candidates: Sequence[Candidate] = (SWING, WOBBLE, PULL)
    numerics: Sequence[str] = ()
    per_turn: int = 0  # windows that were asked for at last
    # values, effects, jump and turns of all searches for states
    filtered: list = field(default_factory=list)

    def windows(self, run, values, effects=()):
        own = {candidate.name: at for candidate, at in effects}
        return Windows(self, run, values, own) if self.windowed(own) else None

    def simulate(self, run, values, effects=(), numerics=0):
        one = Windows(self, run, values, {candidate.name: at for candidate, at in effects})
        motion = one.motion(one.times, np.zeros(1), np.array([START[run]]))
        return {"angle": motion[:, 0] + values.get("zero", 0.0), "rate": motion[:, 1]}


@dataclass
class Windows:
    """A `jointgap.core.candidates.WindowedRun` of it."""

    model: Oscillator
    run: str
    values: dict
    effects: dict  # values of their coordinates by name
    size: int = 2
    turns: float = TURNS
    channels: Sequence[str] = CHANNELS

    @property
    def times(self):
        return np.arange(TURNS * PER_TURN) * math.tau / PER_TURN / SPEEDS[self.run]

    @property
    def frequency(self):
        stiffer = self.effects.get("spring", {"size": 0.0})["size"]
        return self.values.get("frequency", FREQUENCY) * math.sqrt(1.0 + stiffer)

    @property
    def damping(self):
        more = self.effects.get("spring", {"damping": 0.0})["damping"]
        return self.values.get("damping", DAMPING) + more

    def window_of(self, time, states):
        return np.clip(
            np.searchsorted(states.edges, time, side="right") - 1, 0, len(states.slow) - 1
        )

    def steady_states(self, states):
        return None

    def states_from(self, slow, per_turn):
        if len(slow) != round(TURNS * per_turn):
            return None
        edges = np.linspace(0.0, TURNS * math.tau / SPEEDS[self.run], len(slow) + 1)
        return States(edges, slow, Handed(np.zeros((len(slow), 1))))

    def deviance_of(self, predicted, measured, noise):
        return self.model.deviance({})

    def filter_states(self, measured, noise, per_turn, jump, turns, most=math.inf):
        """States at rest."""
        self.model.per_turn = per_turn
        self.model.filtered.append((self.values, self.effects, jump, turns))
        states = self.states_from(np.zeros((round(TURNS * per_turn), 2)), per_turn)
        return StateEstimate(states, self.model.deviance(self.effects), 1.0)

    def _lasting(self, t):
        w, damping, speed = self.frequency, self.damping, SPEEDS[self.run]
        x, v = np.full((2, *t.shape), 0.0)
        swing, pull, wobble, push = (
            self.effects.get(name, {"size": 0.0})["size"] for name in FORCES
        )
        for order, size in enumerate((self.values["drive"] + push, swing - pull, wobble), 1):
            at = 1j * order * speed
            turning = size * np.exp(at * t) / (w**2 + at**2 + 2 * damping * w * at)
            x, v = x + turning.real, v + (at * turning).real
        return np.stack([x, v], axis=-1)

    def _decaying(self, t, state):
        w, damping = self.frequency, self.damping
        at, (x, v) = w * math.sqrt(1 - damping**2), np.moveaxis(state, -1, 0)
        c, s, falls = np.cos(at * t), np.sin(at * t) / at, np.exp(-damping * w * t)
        there = c * x + s * (v + damping * w * x), c * v - s * (w**2 * x + damping * w * v)
        return np.stack([falls * there[0], falls * there[1]], axis=-1)

    def motion(self, t, begin, state):
        return self._lasting(t) + self._decaying(t - begin, state - self._lasting(begin))

    def simulate(self, states):
        window = self.window_of(self.times, states)
        done = np.arange(len(states.slow)) != self.model.broken
        motion = self.motion(self.times, states.edges[window], states.slow[window])
        motion[~done[window]] = np.nan
        ends = np.where(
            done[:, None], self.motion(states.edges[1:], states.edges[:-1], states.slow), np.nan
        )
        readings = {"angle": motion[:, 0] + self.values.get("zero", 0.0), "rate": motion[:, 1]}
        return readings, ends, Handed(np.arange(1.0, 1.0 + len(done))[:, None]), done


def linear(
    drive=0.3,
    zero=0.1,
    bounds=(0.0, 0.6),
    settings=DEFAULT_SETTINGS,
    hidden=(),
    runs=tuple(SPEEDS),
    **more,
) -> Problem:
    """A problem with `hidden` effects and correlated noise; `more`: arguments of the oscillator."""
    own = [Parameter("zero", 0.0, -0.5, 0.5, 0.01, run=run) for run in runs]
    model = Oscillator([Parameter("drive", 0.2, *bounds, 0.01), *own], **more)
    return measured(model, {"drive": drive, "zero": zero}, dict(hidden), MEMORY, settings)


def measured(
    model: Oscillator,
    values: dict,
    hidden: dict,
    memory: float = 0.0,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> Problem:
    rng, series = np.random.default_rng(5), []
    for run in dict.fromkeys(p.run for p in model.nuisances if p.run) or ("slow",):
        t = Windows(model, run, values, {}).times
        clean = model.simulate(run, values, [(BY_NAME[name], at) for name, at in hidden.items()])
        for name in CHANNELS:
            noisy = clean[name] + SD * coloured(t.size, memory, rng)
            series.append(Series(run, name, "1", noisy, t, t * SPEEDS[run], np.zeros(t.size, bool)))
    model.series = series
    noise = {
        one.key: Noise(np.full(one.value.size, SD), (memory,) if memory else ()) for one in series
    }
    return Problem(model, noise, settings=settings)


def windows(**changed) -> IdentificationSettings:
    """Default settings with changed window settings."""
    return replace(DEFAULT_SETTINGS, windows=replace(DEFAULT_SETTINGS.windows, **changed))


def noise_of(problem: Problem) -> dict[tuple[str, str], Noise]:
    return {part.series.key: part.noise for part in problem.parts}
