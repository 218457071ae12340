"""The same mechanisms in Exudyn, a multibody code that shares nothing with this package but the laws."""

import math

import numpy as np
import pytest

pytest.importorskip("exudyn", reason="needs Exudyn: scripts/set-up peers")

from tests.independent.cases import JOURNALS, SPEED, friction, mechanism, positions
from validation.exudyn import SliderCrank

QUARTERS = (90, 180, 270, 360)
SUBSETS = [
    ("crank_pin", "piston_pin"),
    ("crank_pin",),
    ("piston_pin",),
    ("crank_pivot", "crank_pin"),
    ("crank_pivot", "piston_pin"),
    ("crank_pivot", "crank_pin", "piston_pin"),
]
ON_THE_OTHER_BODY = {"crank_pivot": "crank", "crank_pin": "rod", "piston_pin": "rod"}


def differences(made, tolerance, **start) -> dict[int, float]:
    """Largest difference [m, rad] of the two codes' positions at quarters of the first revolution, by degrees."""
    ours = positions(made, start.get("start_angle", 0.0), _in_a_row(start.get("perturbation")))
    peer = SliderCrank(made, SPEED, **start)
    return {
        degrees: float(np.abs(peer.advance(math.radians(degrees) / SPEED, tolerance) - ours[degrees]).max())
        for degrees in QUARTERS
    }


def _in_a_row(perturbation):
    """Perturbation by joint -> as `simulate` takes it."""
    if perturbation is None:
        return None
    return np.ravel([perturbation.get(name, (0.0, 0.0)) for name in ("crank_pin", "piston_pin", "crank_pivot")])


@pytest.mark.parametrize("loose", SUBSETS, ids=" ".join)
def test_without_friction_the_motion_agrees_for_a_revolution(loose):
    found = differences(mechanism(loose), 1e-12)
    assert max(found[90], found[180]) < 1e-11
    assert max(found.values()) < 1e-10


@pytest.mark.parametrize("loose", SUBSETS, ids=" ".join)
def test_on_an_offset_slide_too(loose):
    found = differences(mechanism(loose, offset=0.03), 1e-12)
    assert max(found[90], found[180]) < 1e-10


@pytest.mark.parametrize("loose", SUBSETS, ids=" ".join)
def test_with_friction_the_motion_agrees_to_what_exudyn_can_do(loose):
    assert max(differences(mechanism(loose, **friction()), 1e-11).values()) < 1e-7


def test_with_the_journals_on_the_other_bodies_too():
    swapped = {**friction(speed=1.0), "journals": ON_THE_OTHER_BODY}
    made = mechanism(tuple(JOURNALS), **swapped)
    assert made.joint("piston_pin").journal == "rod"
    assert max(differences(made, 1e-11).values()) < 1e-9


def test_from_another_start_too():
    start = {"start_angle": 1.0, "perturbation": {"crank_pin": (3e-4, -1e-4), "piston_pin": (-2e-4, 5e-4)}}
    found = differences(mechanism(), 1e-12, **start)
    assert max(found[90], found[180]) < 1e-10
