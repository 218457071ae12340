"""Linearised changes of the readings of a run in periodic steady state, for many changes of its
parameters at once."""

from collections.abc import Callable, Sequence
from math import tau
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


class _At(NamedTuple):
    """A periodic motion at crank angles of any revolution."""

    angles: np.ndarray  # (n,) [rad]
    motion: Samples  # at these, in the revolution of the orbit
    rates: np.ndarray  # (n, states) over the crank angle
    columns: Columns


class _ReadingsNearby:
    """The readings of a run near a periodic motion."""

    def __init__(self, campaign: Campaign, plan: RunPlan, base: Prepared, orbit: Orbit):
        self._campaign, self._plan, self._base = campaign, plan, base
        channels = [name for name in plan.channels if name != "crank_angle"]
        self._columns = list(dict.fromkeys([*channels, "crank_torque", "crank_speed"]))
        self._orbit, self._known = orbit, []
        self._states: dict[int, np.ndarray] = {}  # changes (n, states, m) at known angles

    def _seen(self, model: Model, motion: Samples) -> Columns:
        columns = observed(model, motion)
        return {name: columns[name] for name in self._columns}

    def _at(self, angles: np.ndarray) -> _At:
        """The orbit at crank angles (n,) [rad], or near them if it is known there."""
        for known in self._known:
            if known.angles.shape == angles.shape:
                if np.abs(known.angles - angles).max() <= NEAR:
                    return known
        begin = self._orbit.intervals.angles[0]
        within, places = np.unique(begin + np.mod(angles - begin, tau), return_inverse=True)
        orbit = self._orbit
        motion, _ = integrate_on(orbit.model, orbit.begin, within, orbit.tolerance)
        motion = motion._replace(begins=orbit.motion.begins[:1].repeat(within.size, axis=0))
        motion = motion.part(places)
        columns = self._seen(orbit.model, motion)
        rates = rates_over_angle(orbit.model, motion)
        self._known.append(_At(angles, motion, rates, columns))
        return self._known[-1]

    def _motion_of(
        self, model: Model, change: Solution | None = None, number: int = 0
    ) -> Callable[[np.ndarray], Columns]:
        """The motion with a model, by the solution of a `number` of the linear equations."""
        orbit, begin = self._orbit, self._orbit.intervals.angles[0]

        def motion(angles: np.ndarray) -> Columns:
            at = self._at(angles)
            columns, times = dict(at.columns), at.motion.times
            added = np.zeros((angles.size, weights_of(orbit.model).size))
            states = slice(orbit.model.states)
            if (ahead := angles - at.angles).any():
                added[:, states] = at.rates * ahead[:, None]
                added[:, -1] = ahead / columns["crank_speed"]
            if change is not None:
                within = begin + np.mod(at.angles - begin, tau)
                if id(at) not in self._states:
                    self._states[id(at)] = change(within)
                added[:, states] += self._states[id(at)][:, :, number]
                there = at_angles(model, at.motion, within)
                direct = self._seen(model, there)
                columns = {name: direct[name] for name in columns}
            if added.any():
                nearby = along(orbit.model, at.motion, added, self._seen)
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
        change = linear.solution(list(forcing.values())) if forcing else None
        if forcing and change is None:
            return None
        found: list[Readings | None] = [None] * len(variations)
        for place, run in runs.items():
            motion = unchanged
            if place in forcing:
                motion = self._motion_of(run.driven.model, change, list(forcing).index(place))
            changed = self._read(run, motion)
            found[place] = {name: changed[name] - readings[name] for name in readings}
        return found
