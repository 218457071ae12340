"""Linearised changes of the readings of a run in periodic steady state, for many changes of its
parameters at once."""

from collections.abc import Callable, Sequence
from math import tau

import numpy as np

from jointgap.config.campaign import Campaign
from jointgap.core.candidates import Effects, Variation
from jointgap.core.costs import count_revolutions
from jointgap.core.errors import InputError, SimulationError
from jointgap.motion.model import Model
from jointgap.motion.periodic import Evaluation, LinearMotion, Orbit, periodic_orbit
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

NEIGHBOURS = 6  # Points of an interpolation
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


class _ReadingsNearby:
    """The readings of a run near a periodic motion."""

    def __init__(self, campaign: Campaign, plan: RunPlan, base: Prepared, orbit: Orbit):
        self._campaign, self._plan, self._base = campaign, plan, base
        channels = [name for name in plan.channels if name != "crank_angle"]
        self._columns = list(dict.fromkeys([*channels, "crank_torque"]))
        self._motion = LinearMotion(orbit, self._columns)
        self._between = _Interpolation(orbit.angles)

    def _motion_of(
        self, model: Model, change: np.ndarray | float = 0.0
    ) -> Callable[[np.ndarray], Columns]:
        """The motion with a model and a `change` (n, c) of the orbit's channels."""
        at_points = self._motion.channels + change

        def motion(angles: np.ndarray) -> Columns:
            columns = self._between(angles, at_points).T
            here = {"time": times_at(model, angles), "crank_angle": angles}
            return dict(zip(self._columns, columns, strict=True)) | here

        return motion

    def _read(self, run: Prepared, motion: Callable[[np.ndarray], Columns]) -> Readings:
        return read(self._campaign, self._plan, run, motion)

    def changes(self, variations: Sequence[Variation]) -> list[Readings | None] | None:
        """Changes of the readings by each of the variations; None if the motion is not stable."""
        content = self._base.driven.model.content
        unchanged = self._motion_of(self._base.driven.model)
        readings = self._read(self._base, unchanged)

        def torque(model: Model, angles: np.ndarray) -> np.ndarray:
            return unchanged(angles)["crank_torque"]

        runs: dict[int, Prepared] = {}
        forcing: dict[int, Evaluation] = {}
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
            elif (forced := self._motion.forcing(run.driven.model)) is not None:
                runs[place], forcing[place] = run, forced
        count_revolutions(REVOLUTIONS + REVOLUTIONS_OF_CHANGE * len(forcing))
        channels = self._motion.changes(list(forcing.values()))
        if channels is None:
            return None
        change_of = dict(zip(forcing, channels, strict=True))
        found: list[Readings | None] = [None] * len(variations)
        for place, run in runs.items():
            motion = self._motion_of(run.driven.model, change_of.get(place, 0.0))
            changed = self._read(run, motion)
            found[place] = {name: changed[name] - readings[name] for name in readings}
        return found


class _Interpolation:
    """Local polynomials through columns at `angles` (n,) [rad] of a revolution, of fifth degree."""

    def __init__(self, angles: np.ndarray):
        self._size = angles.size
        reach = NEIGHBOURS // 2
        self._places = np.arange(-reach, angles.size + reach) % angles.size
        turns = np.arange(-reach, angles.size + reach) // angles.size
        self._knots = angles[self._places] + tau * turns
        self._begin = angles[-1] - tau
        self._known: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def __call__(self, angles: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Values (m, c) of `columns` (n, c) at `angles` (m,) [rad] of any revolution."""
        if self._known is None or not np.array_equal(self._known[0], angles):
            self._known = (angles, *self._weights(angles))
        _, places, weights = self._known
        return np.einsum("mk,mkc->mc", weights, columns[places])

    def _weights(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (m, k) of the neighbours, and their weights."""
        reach = NEIGHBOURS // 2
        within = self._begin + np.mod(angles - self._begin, tau)
        first = np.searchsorted(self._knots, within, side="right") - reach
        first = np.clip(first, 0, self._knots.size - NEIGHBOURS)
        neighbours = first[:, None] + np.arange(NEIGHBOURS)
        knots = self._knots[neighbours]
        weights = np.ones(knots.shape)
        for i in range(NEIGHBOURS):
            for j in range(NEIGHBOURS):
                if i != j:
                    weights[:, i] *= (within - knots[:, j]) / (knots[:, i] - knots[:, j])
        return self._places[neighbours], weights
