"""The same mechanisms in Exudyn, an independent multibody code."""

import math

import numpy as np
import pytest

pytest.importorskip("exudyn", reason="needs Exudyn: scripts/set-up peers")

from tests.independent.cases import JOURNALS, SPEED, friction, mechanism, positions
from validation.exudyn import SliderCrank

QUARTERS = (90, 180, 270, 360)
ON_THE_OTHER_BODY = {"crank_pivot": "crank", "crank_pin": "rod", "piston_pin": "rod"}


def differences(made, tolerance, **start) -> dict[int, float]:
    """Largest difference [m, rad] of the two codes' positions at quarters of the first revolution,
    by degrees."""
    ours = positions(made, start.get("start_angle", 0.0), _in_a_row(start.get("perturbation")))
    peer = SliderCrank(made, SPEED, **start)
    found = {}
    for degrees in QUARTERS:
        theirs = peer.advance(math.radians(degrees) / SPEED, tolerance)
        found[degrees] = float(np.abs(theirs - ours[degrees]).max())
    return found


def _in_a_row(perturbation):
    """Perturbation by joint -> as `simulate` takes it."""
    if perturbation is None:
        return None
    return np.ravel(
        [perturbation.get(name, (0.0, 0.0)) for name in ("crank_pin", "piston_pin", "crank_pivot")]
    )


BOTH = ("crank_pin", "piston_pin")
ROWS = [
    (BOTH, {}, 1e-12, 1e-11, 1e-10),
    (("piston_pin",), {"offset": 0.03}, 1e-12, 1e-10, np.inf),
    (("crank_pin",), friction(), 1e-11, 1e-7, 1e-7),
    (tuple(JOURNALS), friction(speed=1.0) | {"journals": ON_THE_OTHER_BODY}, 1e-11, 1e-9, 1e-9),
]
PIVOT = "crank_pivot"
MORE = (*((pin,) for pin in BOTH), *((PIVOT, pin) for pin in BOTH), tuple(JOURNALS))
LATER = [(loose, {}, 1e-12, 1e-11, 1e-10) for loose in MORE]
LATER += [(loose, {"offset": 0.03}, 1e-12, 1e-10, np.inf) for loose in (BOTH, *MORE)]
LATER += [(loose, friction(), 1e-11, 1e-7, 1e-7) for loose in (BOTH, *MORE)]


@pytest.mark.parametrize(
    "rows", [ROWS, pytest.param(LATER, marks=pytest.mark.slow)], ids=["soon", "later"]
)
def test_the_motion_agrees_for_a_revolution(rows):
    far = []
    for loose, keys, tolerance, soon, later in rows:
        found = differences(mechanism(loose, **keys), tolerance)
        if max(found[90], found[180]) > soon or max(found.values()) > later:
            far.append((loose, keys, found))
    assert far == []


def test_the_motion_agrees_from_another_start():
    start = {
        "start_angle": 1.0,
        "perturbation": {"crank_pin": (3e-4, -1e-4), "piston_pin": (-2e-4, 5e-4)},
    }
    found = differences(mechanism(), 1e-12, **start)
    assert max(found[90], found[180]) < 1e-10
