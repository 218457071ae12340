"""How far a crank's speed varies, and at which order of the crank: half orders are those of
four-stroke engines."""

import math

import numpy as np
import pytest

from jointgap.rig.checks import speed_variation, unsteady

SPEED = 310.0  # rad/s


def crank(
    turns: float, half: float = 0.0, first: float = 0.0, noise: float = 0.0, phase: float = 0.0
):
    """Times [s] and angles [rad] of a crank whose speed varies at order 0.5 and at the first."""
    angle = phase + np.arange(0.0, turns * math.tau, math.radians(6.0))
    slowness = 1.0 - half * np.cos(angle / 2 + 0.4) - first * np.cos(angle)
    time = (
        np.concatenate([[0.0], np.cumsum(0.5 * (slowness[1:] + slowness[:-1]) * np.diff(angle))])
        / SPEED
    )
    return time, angle + noise * np.random.default_rng(3).standard_normal(angle.size)


def test_a_speed_that_repeats_after_one_or_two_turns_is_reported_with_its_size_and_order():
    for turns, phase in ((6.0, 0.0), (6.0, 2.0), (24.3, 0.0), (24.3, 2.0)):
        time, angle = crank(turns, half=0.025, first=0.005, noise=1e-3, phase=phase)
        within, over, error, order = speed_variation(time, angle)
        assert within == pytest.approx(0.0275, abs=0.003)
        assert over < 0.005 and error < 1e-3 and order == 0.5
        assert "within two turns (strongest order 0.5" in unsteady(time, angle)
    reason = unsteady(*crank(12.0, first=0.03, noise=1e-3))
    assert "by ±3 % within a turn" in reason and "order" not in reason
    for turns in (1.5, 5.0, 40.0):  # of a steady crank
        assert not unsteady(*crank(turns, noise=math.radians(0.2)))
