"""Constraints of the lengths hold at the lengths found: checked against drawn geometry."""

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

from jointgap.config import Box, Constraints, Genetic, load_mechanism, resolve
from jointgap.core.errors import InputError
from jointgap.lengths.objective import frozen_objective
from jointgap.lengths.region import Region, check_constraints, geometric
from jointgap.lengths.search import evolve, search_from_all
from jointgap.lengths.surface import Surface
from jointgap.motion.kinematics import clearance_lift

BOX = Box(crank_length=("147 mm", "153 mm"), rod_length=("555 mm", "575 mm"))
OFFSET = 0.02
QUICK = Genetic(population=8, generations=6)


def slide(crank, rod):
    """Crank angles and slider positions over a turn, from the triangle of crank, rod and slide."""
    angles = np.linspace(0.0, 2 * np.pi, 200_001)
    height = OFFSET - crank * np.sin(angles)
    return angles, crank * np.cos(angles) + np.sqrt(rod**2 - height**2)


def region(offset=OFFSET, **constraints):
    return Region.of(BOX, None).under(geometric(Constraints(**constraints), offset), "mine")


@pytest.fixture(scope="module")
def offset_objective(clearance):
    mechanism = load_mechanism("config/mechanisms/erkaya2009.yaml")
    slider = mechanism.slider.model_copy(update={"offset": OFFSET})
    angle, vectors = clearance
    offset_mechanism = mechanism.model_copy(update={"slider": slider})
    return frozen_objective(offset_mechanism, angle, clearance_lift(vectors))


def searched(objective, within):
    """Lengths that both optimisers find."""
    ends = [result.lengths for result in search_from_all(objective, within, 1e-9)]
    return [*ends, evolve(objective, within, QUICK).lengths]


def test_a_fixed_stroke_in_line_fixes_the_crank_and_the_rod_is_optimised(objective):
    best = min(objective.value((0.150, length)) for length in np.linspace(*BOX.rod_length, 401))
    for lengths in searched(objective, region(offset=0.0, stroke="300 mm")):
        assert lengths[0] == pytest.approx(0.150, abs=1e-7)
        assert objective.value(lengths) <= best * 1.01


def test_both_optimisers_keep_stroke_dead_centres_and_space(offset_objective):
    for crank, rod in searched(offset_objective, region(stroke="300.5 mm")):
        assert np.ptp(slide(crank, rod)[1]) == pytest.approx(0.3005, abs=2e-7)
    dead_centres = {
        "outer_dead_centre": ["710 mm", "711 mm"],
        "inner_dead_centre_angle": ["182.78 deg", "182.8 deg"],
    }
    for crank, rod in searched(offset_objective, region(**dead_centres)):
        angles, position = slide(crank, rod)
        assert 0.710 - 2e-7 <= position.max() <= 0.711 + 2e-7
        assert 182.779 <= np.degrees(angles[np.argmin(position)]) <= 182.801
    space = region(length_along="860 mm", length_across="298 mm")
    for crank, rod in searched(offset_objective, space):
        angles, position = slide(crank, rod)
        assert position.max() - (crank * np.cos(angles)).min() <= 0.860 + 2e-7
        assert np.ptp(crank * np.sin(angles)) <= 0.298 + 2e-7


def test_an_active_limit_is_reported_with_its_value_and_a_fixed_property_is_no_limit():
    fixed, limited = (
        region(offset=0.0, **constraints)
        for constraints in ({"stroke": "300 mm"}, {"outer_dead_centre": ["705 mm", "711 mm"]})
    )
    assert fixed.active((0.150, 0.57)) == "none"
    assert "outer dead centre at its upper limit 711 mm" in limited.active((0.150, 0.561))


@pytest.mark.parametrize(
    "constraints, message",
    [
        (
            {"stroke": "304 mm", "length_across": "300 mm"},
            "satisfy stroke 304 mm .* and length_across 300 mm at most .*; nearest: crank",
        ),
        (
            {"inner_dead_centre_angle": "190 deg"},
            r"inner_dead_centre_angle 190 deg \(within the bounds 180 deg to 180 deg\)",
        ),
    ],
)
def test_infeasible_constraints_are_errors_before_the_search(constraints, message):
    with pytest.raises(InputError, match=message):
        region(0.0, **constraints)


def test_infeasible_constraints_are_reported_with_the_scenario():
    options = {"boxes": {"mine": BOX.model_dump()}, "constraints": {"stroke": "310 mm"}}
    mine = {"mechanism": "config/mechanisms/erkaya2009.yaml", "optimise": options}
    with pytest.raises(
        InputError,
        match=r"scenario mine: .*no lengths satisfy stroke 310 mm .*nearest: crank 153 mm",
    ):
        check_constraints(resolve({"scenarios": {"mine": mine}}))


def test_both_optimisers_keep_a_limit_of_a_surface_of_forces(objective):
    cranks, rods = (np.linspace(*bounds, 7) for bounds in (BOX.crank_length, BOX.rod_length))
    forces = 2000.0 * (cranks[:, None] / 0.150) * (rods[None, :] / 0.564) ** 2
    surface = Surface(RectBivariateSpline(cranks, rods, forces))
    limit = float(surface.value(searched(objective, region(offset=0.0))[0])) - 30.0
    for lengths in searched(objective, Region.of(BOX, None).under([surface.limited(limit)])):
        assert surface.value(lengths) <= limit + 1e-3
    slope = surface.gradient((0.150, 0.564))
    assert slope == pytest.approx([2000 / 0.150, 4000 / 0.564], rel=1e-3)
