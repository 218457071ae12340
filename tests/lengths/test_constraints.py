"""What a designer asks of the lengths is met exactly: against geometry that is drawn, not computed
by the code."""

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

from jointgap.config import Box, Constraints, Genetic, load_mechanism, resolve
from jointgap.core.errors import InputError
from jointgap.dynamics.kinematics import clearance_lift
from jointgap.lengths.objective import frozen_objective
from jointgap.lengths.region import Region, Surface, check_constraints, geometric
from jointgap.lengths.search import evolve, search_from_all
from tests.catalogue import each

BOX = Box(crank_length=("147 mm", "153 mm"), rod_length=("555 mm", "575 mm"))
OFFSET = 0.02
QUICK = Genetic(population=8, generations=6)


def slide(crank, rod, offset):
    """Crank angles and slider positions over a turn, from the triangle of crank, rod and slide."""
    angles = np.linspace(0.0, 2 * np.pi, 200_001)
    return angles, crank * np.cos(angles) + np.sqrt(rod**2 - (offset - crank * np.sin(angles)) ** 2)


def region(offset=OFFSET, **asked):
    return Region.of(BOX, None).under(geometric(Constraints(**asked), offset), "mine")


@pytest.fixture(scope="module")
def offset_objective(clearance):
    mechanism = load_mechanism("config/mechanisms/erkaya2009.yaml")
    mechanism = mechanism.model_copy(
        update={"slider": mechanism.slider.model_copy(update={"offset": OFFSET})}
    )
    angle, vectors = clearance
    return frozen_objective(mechanism, angle, clearance_lift(vectors))


def found(objective, within):
    """Lengths that both optimisers find."""
    ends = [result.lengths for result in search_from_all(objective, within, 1e-9)]
    return [*ends, evolve(objective, within, QUICK).lengths]


def test_a_fixed_stroke_in_line_fixes_the_crank_and_leaves_the_rod_to_the_search(objective):
    within = region(offset=0.0, stroke="300 mm")
    for crank, rod in found(objective, within):
        assert crank == pytest.approx(0.150, abs=1e-7)
        best = min(objective.value((0.150, length)) for length in np.linspace(*BOX.rod_length, 401))
        assert objective.value((crank, rod)) <= best * 1.01


def test_stroke_dead_centres_and_space_are_as_they_are_asked_for_by_both_optimisers(
    offset_objective,
):
    for crank, rod in found(offset_objective, region(stroke="300.5 mm")):
        assert np.ptp(slide(crank, rod, OFFSET)[1]) == pytest.approx(0.3005, abs=2e-7)
    dead = {
        "outer_dead_centre": ["710 mm", "711 mm"],
        "inner_dead_centre_angle": ["182.78 deg", "182.8 deg"],
    }
    for crank, rod in found(offset_objective, region(**dead)):
        angles, position = slide(crank, rod, OFFSET)
        assert 0.710 - 2e-7 <= position.max() <= 0.711 + 2e-7
        assert 182.779 <= np.degrees(angles[np.argmin(position)]) <= 182.801
    for crank, rod in found(
        offset_objective, region(length_along="860 mm", length_across="298 mm")
    ):
        angles, position = slide(crank, rod, OFFSET)
        assert position.max() - (crank * np.cos(angles)).min() <= 0.860 + 2e-7
        assert np.ptp(crank * np.sin(angles)) <= 0.298 + 2e-7


def test_a_constraint_that_decides_is_named_with_its_value(objective):
    assert (
        region(offset=0.0, stroke="300 mm").active((0.150, 0.57)) == "none"
    )  # what is fixed is no limit
    within = region(offset=0.0, outer_dead_centre=["705 mm", "711 mm"])
    assert "outer dead centre at its upper limit 711 mm" in within.active((0.150, 0.561))


CANNOT = [
    (
        {"stroke": "304 mm", "length_across": "300 mm"},
        "no lengths.*stroke and length_across together.*nearest",
    ),
    ({"inner_dead_centre_angle": "190 deg"}, "inner_dead_centre_angle 190 deg is infeasible"),
]


def test_what_no_lengths_can_meet_is_refused_before_the_search_with_the_scenario_s_name():
    def refused(asked, words):
        with pytest.raises(InputError, match=words):
            region(0.0, **asked)

    each(refused, CANNOT)
    options = {"boxes": {"mine": BOX.model_dump()}, "constraints": {"stroke": "310 mm"}}
    mine = resolve(
        {
            "scenarios": {
                "mine": {"mechanism": "config/mechanisms/erkaya2009.yaml", "optimise": options}
            }
        }
    )
    with pytest.raises(
        InputError, match=r"scenario mine: .*stroke 310 mm is infeasible.*nearest: crank 153 mm"
    ):
        check_constraints(mine)


def test_a_largest_force_bends_the_search_to_lengths_that_carry_no_more(objective):
    cranks, rods = (np.linspace(*ends, 7) for ends in (BOX.crank_length, BOX.rod_length))
    forces = 2000.0 * (cranks[:, None] / 0.150) * (rods[None, :] / 0.564) ** 2
    surface = Surface(RectBivariateSpline(cranks, rods, forces))
    free = found(objective, region(offset=0.0))
    most = float(surface.value(free[0])) - 30.0
    for lengths in found(objective, Region.of(BOX, None).under([surface.limited(most)])):
        assert surface.value(lengths) <= most + 1e-3
    assert (
        np.linalg.norm(surface.gradient((0.150, 0.564)) - [2000 / 0.150, 4000 / 0.564])
        < 1e-3 * 2000 / 0.150
    )
