"""Simulation of a measured run in windows, each with its own initial state."""

from collections.abc import Mapping
from itertools import product
from math import inf, tau

import numpy as np

from jointgap.config.campaign import Campaign
from jointgap.core.candidates import Effects, StateEstimate
from jointgap.core.costs import count_run
from jointgap.motion import windows
from jointgap.motion.model import Model
from jointgap.rig import sensors
from jointgap.rig.drives import RunPlan, Values
from jointgap.rig.simulate_run import Columns, Prepared, prepared, read, simulated_effects

TOLERANCE = 1e-11  # [m] Local error of a step: at 1e-10 some finite differences are half noise
# Tried initial directions of each loose joint, by number of loose joints; of more joints this many
# of each one, while the others have their settled direction
DIRECTIONS = {1: 12, 2: 8, 3: 6}
DIRECTIONS_OF_MANY = 4
MOTIONS_KEPT = 8  # Cached simulations
LEAD = 1e-3  # [revolutions] Begin of the first window before the record


def run_in_windows(
    campaign: Campaign,
    plan: RunPlan,
    values: Values,
    effects: Effects,
    rows: Mapping[str, np.ndarray],
) -> "RunInWindows | None":
    """A run in windows; None without channels besides the crank angle, with ideal joints, a loose
    slide, a free crank or a film.

    `rows` (n,) are the samples of each channel.
    """
    if not {*plan.channels} - {"crank_angle"}:
        return None
    run = prepared(campaign, plan, values, simulated_effects(effects)[0], tolerance=TOLERANCE)
    model = run.driven.model
    films = any(model.bearings[name].film_viscosity > 0.0 for name in model.pins)
    others = films or model.is_free or model.pins != model.loose
    size = 0 if others else 2 * len(model.loose)
    return RunInWindows(campaign, plan, run, rows, size) if size else None


_KEPT: dict[bytes, tuple] = {}


def _simulated(
    model: Model, rows: windows.Rows, states: windows.WindowStates, tolerance: float
) -> tuple:
    """`windows.simulate_windows` with a cache, as sensor faults do not change the motion."""
    numbers = (rows.angles, rows.found.times, states.slow, *states.carried)
    arrays = b"".join(np.ascontiguousarray(array).tobytes() for array in numbers)
    key = arrays + model.content + bytes(repr(tolerance), "ascii")
    # for read-only arrays all would be compiled again
    slow = np.require(states.slow, requirements="W")
    motion = _KEPT.pop(key, None)
    if motion is None:
        count_run(np.ptp(rows.angles) / tau)
        motion = windows.simulate_windows(model, rows, slow, states.carried, tolerance)
    _KEPT[key] = motion
    if len(_KEPT) > MOTIONS_KEPT:
        del _KEPT[next(iter(_KEPT))]
    return motion


class RunInWindows:
    """A `jointgap.core.candidates.WindowedRun` of a mechanism. State of each loose joint: angle
    of the pin on the clearance circle, and its rate over the crank speed."""

    def __init__(
        self,
        campaign: Campaign,
        plan: RunPlan,
        run: Prepared,
        rows: Mapping[str, np.ndarray],
        size: int,
    ):
        self._campaign, self._plan, self._run = campaign, plan, run
        self._rows_of, self.size = rows, size
        self.turns = plan.samples.turned / tau
        self.channels = tuple(name for name in plan.channels if name != "crank_angle")

    def _edges(self, per_turn: int, turns: float) -> np.ndarray:
        """Edges (k + 1,) of windows since the first sample [s]; they begin earlier for sensors with
        memory."""
        samples = self._plan.samples
        faults = self._run.faults
        end = samples.elapsed[-1]
        turn = tau / samples.speed
        count = max(round(end / turn * per_turn), 1)
        edges = np.linspace(0.0, end, count + 1)
        edges[0], edges[-1] = -LEAD * turn, end + LEAD * turn
        channels = {name: self._campaign.channels[name] for name in self._plan.channels}
        remember = any(
            channel.bandwidth or channel.remembers or faults.need_grid(name)
            for name, channel in channels.items()
        )
        if remember or any(map(faults.delay, channels)):
            edges[-1] = max(edges[-1], end - min(map(faults.delay, channels)) + LEAD * turn)
            lead = sensors.remembered_time(channels.values(), turn) / turn
            earlier = max(round(lead * per_turn), 1)
            edges = np.concatenate(
                [np.linspace(-lead * turn, -LEAD * turn, earlier + 1)[:-1], edges]
            )
        return edges[: max(np.searchsorted(edges, min(turns, 1e9) * turn), 1) + 1]

    def _rows(self, edges: np.ndarray, angles: np.ndarray) -> windows.Rows:
        at = self._run.driven.at(np.maximum(edges, -self._run.driven.begin))
        return windows.rows_of(self._run.driven.model, at, angles)

    def window_of(self, time: np.ndarray, states: windows.WindowStates) -> np.ndarray:
        """As of `WindowedRun.window_of`."""
        place = np.searchsorted(states.edges, time - self._plan.samples.time[0], side="right") - 1
        return np.clip(place, 0, len(states.slow) - 1)

    def states_from(self, slow: np.ndarray, per_turn: int) -> windows.WindowStates | None:
        """As of `WindowedRun.states_from`."""
        edges = self._edges(per_turn, inf)
        if slow.shape != (edges.size - 1, self.size):
            return None
        return windows.WindowStates(edges, slow, windows.resting(self._run.driven.model, len(slow)))

    def steady_states(self, states: windows.WindowStates) -> windows.WindowStates:
        """As of `WindowedRun.steady_states`: by the filter without readings."""
        edges = states.edges
        model = self._run.driven.model
        length = np.median(np.diff(edges))
        earlier = np.arange(edges[0] - length, -self._run.driven.begin - length, -length)[::-1]
        rows = self._rows(np.concatenate([earlier, edges]), np.empty(0))
        n = earlier.size
        nothing = windows.Readings(
            np.empty(0, np.int64), *np.zeros((2, 0)), *np.zeros((2, rows.angles.size, 0))
        )
        start = np.zeros((1, self.size))
        free_states = np.full((n + edges.size - 1, self.size), np.nan)
        filtered, _ = windows.filtered(
            model,
            rows,
            len(free_states),
            nothing,
            windows.FilterSettings(0.0),
            start,
            True,
            free_states,
            self._run.tolerance,
        )
        return windows.WindowStates(
            edges, filtered.slow[n:], windows.Carried(*(state[n:] for state in filtered.carried))
        )

    def simulate(
        self, states: windows.WindowStates
    ) -> tuple[dict[str, np.ndarray], np.ndarray, windows.Carried, np.ndarray]:
        """As of `WindowedRun.simulate`."""
        ends = None

        def motion(angles: np.ndarray) -> Columns:
            nonlocal ends
            sorted_angles, places = np.unique(angles, return_inverse=True)
            rows = self._rows(states.edges, sorted_angles)
            columns, *ends = _simulated(self._run.driven.model, rows, states, self._run.tolerance)
            return {name: values[places] for name, values in columns.items()}

        readings = read(self._campaign, self._plan, self._run, motion)
        return {name: value[self._rows_of[name]] for name, value in readings.items()}, *ends

    def filter_states(
        self,
        measured: Mapping[str, np.ndarray],
        noise: Mapping[str, np.ndarray],
        per_turn: int,
        jump: float,
        turns: float,
        most: float = inf,
    ) -> StateEstimate:
        """As of `WindowedRun.filter_states`: start values, as the filter ignores filters, lags and
        delays of sensors.

        A first pass covers two turns from all directions; the second covers all windows from the
        state one turn later.
        """
        edges = self._edges(per_turn, turns)
        count = edges.size - 1
        model = self._run.driven.model
        tolerance = self._run.tolerance
        angles, places = np.unique(
            self._run.driven.at(self._plan.samples.elapsed), return_inverse=True
        )
        rows = self._rows(edges, angles)
        readings = self._readings(rows, places, edges[-1], measured, noise)
        guesses = self._guesses(edges)
        prior = np.full((count, self.size), np.nan)
        settings = windows.FilterSettings(jump, float(most))
        starts = guesses
        if count > 2 * per_turn:
            two_turns, _ = windows.filtered(
                model, rows, 2 * per_turn, readings, settings, guesses, False, prior, tolerance
            )
            starts = np.vstack([two_turns.slow[[per_turn, 0]], guesses])
            prior = two_turns.slow[per_turn + np.arange(count) % per_turn]
        is_known = starts is not guesses
        filtered, sums = windows.filtered(
            model, rows, count, readings, settings, starts, is_known, prior, tolerance
        )
        return StateEstimate(
            windows.WindowStates(edges, filtered.slow, filtered.carried),
            sums.deviance,
            sums.readings,
        )

    def _guesses(self, edges: np.ndarray) -> np.ndarray:
        """Initial states (n, states) to try."""
        joints = self.size // 2
        if joints in DIRECTIONS:
            directions = np.linspace(0.0, tau, DIRECTIONS[joints], endpoint=False)
            guesses = np.zeros((directions.size**joints, self.size))
            guesses[:, 0::2] = list(product(directions, repeat=joints))
            return guesses
        still = np.zeros((edges.size - 1, self.size))
        model = self._run.driven.model
        start = windows.WindowStates(edges, still, windows.resting(model, len(still)))
        settled = self.steady_states(start).slow[0]
        turned = np.arange(DIRECTIONS_OF_MANY) * (tau / DIRECTIONS_OF_MANY)
        guesses = np.tile(settled, (joints * turned.size, 1))
        for joint in range(joints):
            guesses[joint * turned.size : (joint + 1) * turned.size, 2 * joint] += turned
        return guesses

    def deviance_of(
        self,
        predicted: Mapping[str, np.ndarray],
        measured: Mapping[str, np.ndarray],
        noise: Mapping[str, np.ndarray],
    ) -> float:
        """As of `WindowedRun.deviance_of`."""
        away = ((predicted[name] - measured[name]) / noise[name] for name in measured)
        return sum(float(np.nansum(windows.heavy_squares(residual))) for residual in away)

    def _readings(
        self,
        rows: windows.Rows,
        places: np.ndarray,
        end: float,
        measured: Mapping[str, np.ndarray],
        noise: Mapping[str, np.ndarray],
    ) -> windows.Readings:
        """Readings for the filter at the `rows` until the time `last` [s]; `places` (n,): order of
        the samples."""
        n = rows.angles.size
        names = self.channels
        data, weight = np.zeros((2, n, len(names)))
        factor = np.ones(len(names))
        shift = np.zeros(len(names))
        row_of_sample = np.argsort(rows.sample, kind="stable")[n - places.max() - 1 :]
        elapsed = self._plan.samples.elapsed
        for c, name in enumerate(names):
            if name not in measured:  # no sample is used
                continue
            shift[c] = self._reading(name, 0.0)
            factor[c] = self._reading(name, 1.0) - shift[c]
            rows_of_channel = np.flatnonzero(self._rows_of[name])
            is_used = np.isfinite(measured[name]) & (elapsed[rows_of_channel] < end)
            at = row_of_sample[places[rows_of_channel[is_used]]]
            data[at, c] = measured[name][is_used]
            weight[at, c] = 1.0 / np.broadcast_to(noise[name], is_used.shape)[is_used]
        columns = np.array([self._run.driven.model.columns.index(name) for name in names])
        return windows.Readings(columns, factor, shift, data, weight)

    def _reading(self, name: str, true: float) -> float:
        """Sensor reading of a constant value."""
        faults = self._run.faults
        value = sensors.at_sensor(self._campaign, self._plan.run.side, name, np.array([true]))
        value = faults.act("before_filter", name, value)
        return float(faults.act("after_filter", name, value)[0])
