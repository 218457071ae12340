import numpy as np
import pytest

from jointgap.config import Box
from jointgap.core.errors import InputError
from jointgap.lengths.region import Region

REGION = Region.of(Box(crank_length=(0.147, 0.153), rod_length=(0.555, 0.564)), 0.27)


def test_samples_fill_the_region_and_nothing_else():
    points = REGION.sample(5000, np.random.default_rng(1))
    assert points.shape == (5000, 2)
    assert REGION.contains(points).all()
    cranks, rods = np.meshgrid(np.linspace(0.147, 0.153, 2001), np.linspace(0.555, 0.564, 2001))
    by_area = np.mean(cranks[cranks <= 0.27 * rods] > 0.150)
    assert by_area < 0.45  # the inequality cuts off the corner of long cranks and short rods
    assert np.mean(points[:, 0] > 0.150) == pytest.approx(by_area, abs=0.03)


def test_a_step_is_cut_exactly_at_the_edge_it_meets():
    start = np.array([0.149, 0.560])
    assert REGION.reach(start, [0.0, 0.008]) == pytest.approx(0.5)
    assert REGION.reach(start, [-0.004, 0.0]) == pytest.approx(0.5)
    assert REGION.reach(start, [0.0, 0.001]) == 1.0
    to_inequality = 0.27 * 0.560 - 0.149
    assert REGION.reach(start, [2 * to_inequality, 0.0]) == pytest.approx(0.5)
    assert REGION.reach(REGION.upper, [0.0, 0.001]) == 0.0


def test_active_bounds_are_named_in_words():
    assert REGION.active([0.1494, 0.564]) == "rod length at its upper bound 564 mm"
    assert (
        REGION.active([0.147, 0.555]) == "crank length at its lower bound 147 mm; rod length at its lower bound 555 mm"
    )
    assert REGION.active([0.27 * 0.560, 0.560]) == "crank length at 0.27 times the rod length"
    assert REGION.active([0.149, 0.560]) == "none"


def test_clipping_brings_any_lengths_into_the_region():
    for lengths in ([0.2, 0.5], [0.1, 0.6], [0.153, 0.555]):
        assert REGION.contains(REGION.clip(lengths), slack=1e-15)
    tight = Region(REGION.lower, REGION.upper, 0.262)
    assert tight.clip([0.150, 0.555]) == pytest.approx([0.147, 0.147 / 0.262])


def test_a_ratio_that_leaves_nothing_of_the_box_is_refused():
    with pytest.raises(InputError, match=r"ratio_limit 0\.2 leaves nothing of the box"):
        Region.of(Box(crank_length=(0.147, 0.153), rod_length=(0.555, 0.564)), 0.2)
