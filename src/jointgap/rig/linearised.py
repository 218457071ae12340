"""Linearised changes of the readings of a run in periodic steady state, for many changes of its
parameters at once."""

from collections.abc import Callable, Sequence
from math import pi, tau
from typing import NamedTuple

import numpy as np

from jointgap.config.campaign import Campaign
from jointgap.core.candidates import Effects, Variation
from jointgap.core.costs import count_revolutions
from jointgap.core.errors import InputError, SimulationError
from jointgap.motion.integrate import Samples
from jointgap.motion.model import Model
from jointgap.motion.periodic import LinearMotion, Orbit, periodic_orbit
from jointgap.motion.simulation import integrate_on, observed
from jointgap.motion.variation import Solution, along, at_angles, rates_over_angle, weights_of
from jointgap.rig.drives import RunPlan, Values
from jointgap.rig.simulate_run import (
    Columns,
    Prepared,
    prepared,
    read,
    settled_revolution,
    simulated_effects,
    times_at,
)

Readings = dict[str, np.ndarray]

NEAR = 1e-3  # [rad] Crank angles this close to known ones are reached by the derivatives
# Simulated revolutions that take as long as the linear equations, and as one change of the
# parameters
REVOLUTIONS, REVOLUTIONS_OF_CHANGE = 9.0, 1.3


def linearised_changes(
    campaign: Campaign,
    plan: RunPlan,
    values: Values,
    effects: Effects,
    variations: Sequence[Variation],
) -> list[Readings | None] | None:
    """Arguments and result as of `jointgap.core.candidates.Linearised.changes`, for the samples of
    a plan."""
    limited, _, share = simulated_effects(effects)
    if share < 1.0:
        return None
    base = prepared(campaign, plan, values, limited)
    settled = settled_revolution(campaign, plan, base)
    if settled is None:
        return None
    count_revolutions(1.0)
    orbit = periodic_orbit(base.driven.model, *settled, base.tolerance)
    if orbit is None:
        return None
    return _ReadingsNearby(campaign, plan, base, orbit).changes(variations)


class _Known(NamedTuple):
    """A periodic motion at sorted crank angles of its revolution."""

    angles: np.ndarray  # (n,) [rad]
    motion: Samples
    columns: Columns
    states: np.ndarray  # (n, states, m) Its m periodic changes

    def nearest(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (m,) of the nearest known angles, and how far `angles` (m,) [rad] of any
        revolution are ahead of them."""
        if not self.angles.size:
            return np.zeros(angles.size, int), np.full(angles.size, pi)
        after = np.searchsorted(self.angles, self.angles[0] + np.mod(angles - self.angles[0], tau))
        places = np.stack([after - 1, after % self.angles.size])
        ahead = np.remainder(angles - self.angles[places] + pi, tau) - pi
        nearer = np.abs(ahead).argmin(axis=0)[None]
        return np.take_along_axis(places, nearer, 0)[0], np.take_along_axis(ahead, nearer, 0)[0]


class _ReadingsNearby:
    """The readings of a run near a periodic motion."""

    def __init__(self, campaign: Campaign, plan: RunPlan, base: Prepared, orbit: Orbit):
        self._campaign, self._plan, self._base, self._orbit = campaign, plan, base, orbit
        channels = [name for name in plan.channels if name != "crank_angle"]
        self._columns = list(dict.fromkeys([*channels, "crank_torque", "crank_speed"]))
        self._known, self._change = self._integrated(np.empty(0), None), None

    def _seen(self, model: Model, motion: Samples) -> Columns:
        columns = observed(model, motion)
        return {name: columns[name] for name in self._columns}

    def _integrated(self, angles: np.ndarray, change: Solution | None) -> _Known:
        """The motion at sorted crank angles of the orbit's revolution."""
        orbit = self._orbit
        motion = orbit.model.room_for(np.empty(0))
        if angles.size:
            motion, _ = integrate_on(orbit.model, orbit.begin, angles, orbit.tolerance)
        begins = orbit.motion.begins[:1].repeat(angles.size, axis=0)
        motion = motion._replace(begins=begins, events=orbit.motion.events)
        states = np.empty((angles.size, orbit.model.states, 0))
        if change is not None:
            states = change(angles)
        return _Known(angles, motion, self._seen(orbit.model, motion), states)

    def _near(self, angles: np.ndarray) -> tuple[_Known, np.ndarray]:
        """The motion at the nearest known angles, and how far `angles` (m,) [rad] are ahead."""
        places, ahead = self._known.nearest(angles)
        if (far := np.abs(ahead) > NEAR).any():
            begin = self._orbit.intervals.angles[0]
            new = np.unique(begin + np.mod(angles[far] - begin, tau))
            self._known = _joined(self._known, self._integrated(new, self._change))
            places, ahead = self._known.nearest(angles)
        known = self._known
        columns = {name: values[places] for name, values in known.columns.items()}
        motion = known.motion.part(places)
        return _Known(known.angles[places], motion, columns, known.states[places]), ahead

    def _motion_of(
        self, model: Model, number: int | None = None
    ) -> Callable[[np.ndarray], Columns]:
        """The motion with a model, by the solution of a `number` of the linear equations."""
        base = self._orbit.model

        def motion(angles: np.ndarray) -> Columns:
            near, ahead = self._near(angles)
            columns = dict(near.columns)
            added = np.zeros((angles.size, weights_of(base).size))
            if ahead.any():
                added[:, : base.states] = rates_over_angle(base, near.motion) * ahead[:, None]
                added[:, -1] = ahead / columns["crank_speed"]
            if number is not None:
                added[:, : base.states] += near.states[:, :, number]
                columns = self._seen(model, at_angles(model, near.motion, near.angles))
            if added.any():
                nearby = along(base, near.motion, added, self._seen)
                columns = {name: columns[name] + nearby[name] for name in columns}
            return columns | {"time": times_at(model, angles), "crank_angle": angles}

        return motion

    def _read(self, run: Prepared, motion: Callable[[np.ndarray], Columns]) -> Readings:
        return read(self._campaign, self._plan, run, motion)

    def changes(self, variations: Sequence[Variation]) -> list[Readings | None] | None:
        """Changes of the readings by each of the variations; None if the motion is not stable."""
        content = self._base.driven.model.content
        unchanged = self._motion_of(self._base.driven.model)
        readings, linear = self._read(self._base, unchanged), LinearMotion(self._orbit)

        def torque(model: Model, angles: np.ndarray) -> np.ndarray:
            return unchanged(angles)["crank_torque"]

        runs: dict[int, Prepared] = {}
        forcing: dict[int, np.ndarray] = {}
        for place, (values, effects) in enumerate(variations):
            limited, _, share = simulated_effects(effects)
            if share < 1.0:
                continue
            try:
                run = prepared(self._campaign, self._plan, values, limited, torque=torque)
            except (InputError, SimulationError):
                continue
            if run.driven.model.content == content:
                runs[place] = run
            elif (forced := linear.forcing(run.driven.model)) is not None:
                runs[place], forcing[place] = run, forced
        count_revolutions(REVOLUTIONS + REVOLUTIONS_OF_CHANGE * len(forcing))
        if forcing:
            self._change = linear.solution(list(forcing.values()))
            if self._change is None:
                return None
            self._known = self._known._replace(states=self._change(self._known.angles))
        found: list[Readings | None] = [None] * len(variations)
        for place, run in runs.items():
            motion = unchanged
            if place in forcing:
                motion = self._motion_of(run.driven.model, list(forcing).index(place))
            changed = self._read(run, motion)
            found[place] = {name: changed[name] - readings[name] for name in readings}
        return found


def _joined(one: _Known, other: _Known) -> _Known:
    """Both, sorted by angle."""
    angles = np.concatenate([one.angles, other.angles])
    order = np.argsort(angles, kind="stable")

    def both(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.concatenate([a, b])[order]

    of_samples = (both(a, b) for a, b in zip(one.motion[:-2], other.motion[:-2], strict=True))
    motion = Samples(*of_samples, *one.motion[-2:])
    columns = {name: both(values, other.columns[name]) for name, values in one.columns.items()}
    return _Known(angles[order], motion, columns, both(one.states, other.states))
