"""Known loads of single runs: effects that a run lists, and pressures in its record, averaged over
its cycles."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import radians, tau
from typing import Any, ClassVar, Literal

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array

from jointgap.config import Effect, Mechanism
from jointgap.config.campaign import Campaign, CampaignRun
from jointgap.config.channels import PRESSURES
from jointgap.core.section import ConfigModel
from jointgap.effects.base import Records
from jointgap.effects.force_table import (
    Table,
    add_table,
    corrected,
    piston_area,
    with_pressure_sensor,
)

_FINEST = radians(1.0)  # [rad] Distance of the knots of an averaged pressure
_LEAST_KNOTS = 16
_LEVELS = np.linspace(-18.0, 18.0, 73)  # [1] Logarithms of the smoothing that are tried
# [1] Residual of one turn over that of two, and over the deviation of the pressure
_FOUR_STROKE = (1.5, 0.02)
# [1] Share of the variance in independent errors of the average
_KEPT_ERRORS, _MOST_ERRORS = (0.999, 100)


class PressureParameters(ConfigModel):
    """An averaged pressure on the slider; keys as of ``slider_force_table``."""

    pieces: Any  # Force by the pressure as read: see `jointgap.effects.force_table.Table`
    deviations: Any  # (m, k, 4) Changes of their polynomials by independent errors
    period: float  # [rad]
    begin: float = 0.0  # [rad]
    bore: float
    ambient_pressure: float
    side: Literal["head", "crank"]
    pressure_zero: float = 0.0
    pressure_gain: float = 1.0


class RecordedPressure(Effect):
    """A pressure on the slider over the crank angle, from the record of a run."""

    GROUP, SITE, BODY, DESCRIBED = "slider", "slider", "slider", {}
    NAME: ClassVar[str] = "cylinder_pressure"
    SEVERAL = True
    name: str = NAME
    parameters: PressureParameters

    def compile_into(self, records: Records) -> None:
        parameters = self.parameters
        pieces = corrected(
            parameters.pieces, parameters, parameters.pressure_zero, parameters.pressure_gain
        )
        add_table(records, self.BODY, Table(1, 1.0, parameters.begin, parameters.period, pieces))

    def largest_force(self, stroke: float) -> float:
        return float(np.abs(self.parameters.pieces[:, -1]).max())


@dataclass(frozen=True)
class Averaged:
    """A periodic average over the crank angle."""

    period: float  # [rad]
    pieces: np.ndarray  # (k, 5) as in `jointgap.effects.force_table.Table`
    # (m, k, 4) Changes of the polynomials by independent errors, of one standard deviation each
    errors: np.ndarray
    residual: float  # Standard deviation from the average


def averaged(angle: np.ndarray, values: np.ndarray, period: float) -> Averaged:
    """The smooth average of `values` (n,) at crank angles (n,) [rad] over cycles of a `period`
    [rad].

    A periodic cubic spline whose second differences are penalised, by generalised cross-validation
    (P. H. C. Eilers and B. D. Marx, Statistical Science 11 (1996) 89-121); the errors have its
    posterior covariance.
    """
    step = np.ptp(angle) / (angle.size - 1)
    count = max(round(period / max(step, _FINEST)), _LEAST_KNOTS)
    place = np.mod(angle, period) / period * count
    knot = np.minimum(place.astype(int), count - 1)
    t = place - knot
    weights = (
        np.column_stack(
            [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
        )
        / 6.0
    )
    columns = (knot[:, None] + np.arange(-1, 3)) % count
    basis = csr_array(
        (weights.ravel(), columns.ravel(), np.arange(angle.size + 1) * 4), (angle.size, count)
    )
    bends = (
        np.eye(count) - 2.0 * np.roll(np.eye(count), 1, axis=1) + np.roll(np.eye(count), 2, axis=1)
    )
    roughness = bends.T @ bends
    mean = np.mean(values)
    least = 1e-9 * angle.size / count  # so that the matrix is regular where there is no sample
    rough, modes = eigh(roughness, (basis.T @ basis).toarray() + least * roughness)
    information = 1.0 - least * rough
    sizes = modes.T @ (basis.T @ (values - mean))
    best = math.inf, 0.0, np.ones(count)
    for level in np.exp(_LEVELS) * angle.size / count:
        shrinkage = 1.0 / (1.0 + level * rough)
        reduction = np.sum((2.0 - shrinkage * information) * shrinkage * sizes**2)
        squares = np.sum((values - mean) ** 2) - reduction
        free = angle.size - np.sum(shrinkage * information)
        if free > 0.5 and squares > 0.0 and squares / free**2 < best[0]:
            best = squares / free**2, math.sqrt(squares / free), shrinkage
    _, residual, shrinkage = best

    def polynomials(c: np.ndarray) -> np.ndarray:
        """Of the pieces (k, 4) of splines with the coefficients `c` (k,)."""
        left_knot = np.roll(c, 1)
        right = np.roll(c, -1)
        far_right = np.roll(c, -2)
        cubic = -left_knot + 3 * c - 3 * right + far_right
        square = 3 * left_knot - 6 * c + 3 * right
        parts = cubic, square, 3 * (right - left_knot), left_knot + 4 * c + right
        return np.column_stack(
            [part / 6.0 * (count / period) ** (3 - i) for i, part in enumerate(parts)]
        )

    begins = np.arange(count) * (period / count)
    pieces = np.column_stack([begins, polynomials(mean + modes @ (shrinkage * sizes))])
    scaled = residual * np.sqrt(shrinkage) * modes
    order = np.argsort(-np.sum(scaled**2, axis=0))
    share = np.cumsum(np.sum(scaled**2, axis=0)[order])
    modes_used = order[: min(np.searchsorted(share, _KEPT_ERRORS * share[-1]) + 1, _MOST_ERRORS)]
    errors = np.array([polynomials(scaled[:, i]) for i in modes_used])
    return Averaged(period, pieces, errors, residual)


def average_cycle(angle: np.ndarray, values: np.ndarray) -> Averaged:
    """The average over one turn, or over two (four-stroke engines) if consecutive turns differ."""
    turned = np.ptp(angle)
    one_turn = averaged(angle, values, tau)
    if turned * angle.size / (angle.size - 1) < 1.9 * tau:
        return one_turn
    two_turns, (ratio, share) = averaged(angle, values, 2.0 * tau), _FOUR_STROKE
    least = max(ratio * two_turns.residual, share * np.std(values))
    return two_turns if one_turn.residual > least else one_turn


def loads_of_run(
    campaign: Campaign,
    run: CampaignRun,
    angle: np.ndarray | None = None,
    channels: dict[str, np.ndarray] | None = None,
) -> tuple[Effect, ...]:
    """The known loads of a `run`, as seen from `CampaignRun.mirrored`.

    Pressures from the `channels` of its record with the crank `angle` (n,) [rad]; without them
    (planned runs) none.
    """
    loads = [*run.effects]
    for name in PRESSURES.keys() & (channels or {}).keys():
        channel = campaign.channels[name]
        finite = np.isfinite(angle) & np.isfinite(channels[name])
        cycle = average_cycle(angle[finite], channels[name][finite])
        keys = {
            "bore": channel.bore,
            "ambient_pressure": channel.pressure_behind,
            "side": PRESSURES[name],
        }
        parameters = PressureParameters(pieces=None, deviations=None, period=cycle.period, **keys)
        area = piston_area(parameters)
        pieces = cycle.pieces * [1.0, -area, -area, -area, -area]
        pieces[:, 4] += channel.pressure_behind * area
        forces = {"pieces": pieces, "deviations": -area * cycle.errors}
        loads.append(RecordedPressure(parameters=parameters.model_copy(update=forces)))
    return tuple(loads)


def perturbed(loads: Sequence[Effect]) -> Iterator[tuple[Effect, ...]]:
    """The `loads` with each independent error of a recorded pressure, of one standard deviation."""
    for i, load in enumerate(loads):
        for error in load.parameters.deviations if isinstance(load, RecordedPressure) else ():
            pieces = load.parameters.pieces.copy()
            pieces[:, 1:] += error
            yield (*loads[:i], load.with_parameters(pieces=pieces), *loads[i + 1 :])


def with_loads(
    mechanism: Mechanism,
    loads: Iterable[Effect],
    values: dict[str, float] | None = None,
    angle: float = 0.0,
) -> Mechanism:
    """`mechanism` with the `loads` of a run and the `values` of its nuisances.

    Crank angles of the simulation exceed those of the record by `angle` [rad].
    """
    loads = with_pressure_sensor(loads, values or {})
    if not loads:
        return mechanism
    turned = (
        (
            load.with_parameters(begin=load.parameters.begin + angle)
            if isinstance(load, RecordedPressure)
            else load
        )
        for load in loads
    )
    mechanism = mechanism.applied()
    return mechanism.model_copy(update={"effects": (*mechanism.effects, *turned)})
