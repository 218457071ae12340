"""Lengths of general linkages: exact gradients, the best transmission angle, and the result."""

import math

import numpy as np
import pytest

import jointgap as jg
from jointgap.config import OptimiseLinkage, Simulate
from jointgap.core.errors import InputError
from jointgap.lengths.linkages import AngleError, Departure, LinkageProblem
from jointgap.lengths.search import evolve, search, search_from_all
from jointgap.linkage.from_file import linkage_of_file
from jointgap.linkage.transmission import variables_of

SIMULATE = Simulate(speed="300 rpm", revolutions=4, samples_per_revolution=720)
BOUNDS = {
    "four_bar": ("coupler.length", "rocker.length", "frame.C.x", "frame.C.y"),
    "six_bar": ("crank.length", "link.length", "output.length", "frame.E.y"),
    "quick_return": ("crank.length", "rocker.length", "rod.length", "frame.C.y"),
}


def problem_of(file, lengths, **keys):
    return LinkageProblem(file, SIMULATE, OptimiseLinkage(lengths=lengths, **keys))


def near(name, **keys):
    """A shipped linkage whose lengths may differ by 5 mm."""
    file = jg.load_mechanism(name)
    known = variables_of(linkage_of_file(file))
    bounds = {each: (known[each] - 5e-3, known[each] + 5e-3) for each in BOUNDS[name]}
    return problem_of(file, bounds, **keys)


def frozen_error(problem, generator):
    """The error of the angle with made clearance vectors."""
    angle = np.linspace(0.0, 2.0 * math.pi, 361)
    vectors = 2e-4 * generator.normal(size=(2 * len(problem.linkage.loose), angle.size))
    geometry, dyad = problem.geometry, problem.dyad
    desired, _ = geometry.angle(dyad, problem.original, angle)
    return AngleError(desired, problem.original, geometry, dyad, angle, vectors)


def by_differences(function, lengths, step=1e-6):
    steps = step * np.eye(len(lengths))
    return np.stack([(function(lengths + s) - function(lengths - s)) / (2 * step) for s in steps])


@pytest.mark.parametrize("name", BOUNDS)
def test_the_gradient_of_the_error_agrees_with_differences(name):
    generator = np.random.default_rng(1)
    problem = near(name)
    objective = frozen_error(problem, generator)
    lengths = problem.original + generator.uniform(-2e-3, 2e-3, 4)
    expected = by_differences(objective.value, lengths)
    assert objective.gradient(lengths) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("name", BOUNDS)
def test_gradients_of_all_constraints_agree_with_differences(name):
    bodies = {"four_bar": "rocker", "six_bar": "output", "quick_return": "rocker"}
    keys = {"swing": {bodies[name]: ("5 deg", "170 deg")}}
    if name == "quick_return":
        keys["stroke"] = {"ram": ("0.1 m", "0.6 m")}
    problem = near(name, **keys)
    lengths = np.add(problem.original, [1e-3, -2e-3, 1.5e-3, 0.7e-3])
    limits = problem.region.constraints
    assert len(limits) >= 3
    for limit in limits:
        expected = by_differences(limit.value, lengths)
        size = np.abs(expected).max()
        assert limit.gradient(lengths) == pytest.approx(expected, rel=1e-5, abs=1e-6 * size)


@pytest.mark.parametrize("name", BOUNDS)
def test_constraints_of_one_design_are_those_of_a_row_of_designs(name):
    problem = near(name)
    for limit in problem.region.constraints:
        one = float(limit.value(np.array(problem.original)))
        row = limit.value(np.array([problem.original]))
        assert row.shape == (1,) and row[0] == pytest.approx(one)


@pytest.mark.parametrize("point, angle", [("B", 90.0), ("F", 90.0)])
def test_transmission_chooses_the_two_bodies_by_their_joint(point, angle):
    problem = near("six_bar", transmission=point)
    assert problem.dyad.inner.name == point
    (low, _), (high, _) = problem.turn.angles(problem.dyad, problem.original)
    assert 0.0 < low < math.radians(angle) < high or high < math.radians(angle)


def test_the_angle_of_a_rod_at_a_slide_is_that_of_the_slider_crank():
    """Between the rod and the normal of the slide: 90 deg plus the rod's angle."""
    problem = near("quick_return")
    angle = np.linspace(0.0, 2.0 * math.pi, 73)
    transmission, _ = problem.geometry.angle(problem.dyad, problem.original, angle)
    found = jg.simulate(problem.file, speed="60 rpm", revolutions=1, samples_per_revolution=72)
    rod = found.samples["rod_angle"].to_numpy()
    assert transmission == pytest.approx(math.pi / 2 + rod, abs=2e-3)  # but for the clearance


def test_a_joint_whose_angle_never_changes_is_an_error():
    with pytest.raises(InputError, match=r"transmission: the angle at track is 90 deg"):
        near("quick_return", transmission="track").check()


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"lengths": {"cuopler.length": (0.3, 0.5)}}, "did you mean 'coupler.length'"),
        ({"lengths": {"coupler.length": (-0.1, 0.5)}}, "a length is above 0"),
        ({"transmission": "A"}, "transmission: 'A' does not join two bodies that are driven"),
        ({"stroke": {"rocker": (0.1, 0.2)}}, "stroke.rocker: no such body"),
        ({"lengths": {"crank.length": (0.3, 0.35)}}, "no lengths satisfy .* give wider bounds"),
        ({"speed": -10.0}, "is clockwise"),
        ({"revolutions": 2}, "ensemble.settled_revolution 4 is more than revolutions, 2"),
        ({"networks": True}, "networks: only of slider-cranks"),
    ],
)
def test_bad_input_is_one_error_that_says_what_to_do(keys, words):
    given = {"lengths": {"coupler.length": (0.35, 0.45)}} | {"speed": 30.0} | keys
    with pytest.raises(InputError, match=words):
        jg.optimise(jg.load_mechanism("four_bar"), **given)


# ---- Norton's crank-rocker: ground 6, crank 2, coupler 7, rocker 9

BOX = {"coupler.length": (0.03, 0.08), "rocker.length": (0.03, 0.10)}


@pytest.fixture(scope="module")
def norton():
    file = jg.load_mechanism("four_bar")
    lengths = {"crank": 0.02, "coupler": 0.07, "rocker": 0.09}
    bodies = {
        name: body.model_copy(
            update={"length": lengths[name], "mass_centre": 0.5 * lengths[name]}
            | ({"angle": math.radians(117.0)} if name == "rocker" else {})
        )
        for name, body in file.bodies.items()
    }
    frame = file.frame.model_copy(update={"points": {"O": (0.0, 0.0), "C": (0.06, 0.0)}})
    return file.model_copy(update={"bodies": bodies, "frame": frame})


def closed_form(coupler, rocker, ground=0.06, crank=0.02):
    """Least transmission angle [rad] by the law of cosines at both extreme positions."""
    ends = [(coupler**2 + rocker**2 - (ground + s * crank) ** 2) for s in (-1, 1)]
    cosines = np.abs(ends) / (2.0 * coupler * rocker)
    return np.arccos(np.minimum(np.max(cosines, axis=0), 1.0))


def test_the_best_crank_rocker_has_the_angle_of_a_dense_grid_of_the_closed_form(norton):
    problem = problem_of(norton, BOX, objective="least_transmission_angle")
    assert math.degrees(closed_form(0.07, 0.09)) == pytest.approx(25.209, abs=1e-3)
    objective = Departure(np.zeros(1), problem.original, problem.turn, problem.dyad)
    assert np.pi / 2 - objective.value(problem.original) == pytest.approx(
        closed_form(0.07, 0.09), abs=1e-12
    )
    genetic = evolve(objective, problem.region, problem.options.genetic)
    ends = search_from_all(objective, problem.region, 1e-10)
    ends += (search(objective, problem.region, genetic.lengths, 1e-10),)
    grids = (np.linspace(*bounds, 2001) for bounds in BOX.values())
    best = closed_form(*np.meshgrid(*grids)).max()
    for end in ends:
        assert np.pi / 2 - end.value == pytest.approx(best, abs=1e-4)
    assert best - 0.02 < np.pi / 2 - genetic.value < best + 1e-4


def test_a_swing_is_kept_and_costs_some_of_the_angle(norton):
    free, held = (
        problem_of(norton, BOX, objective="least_transmission_angle", swing=swing)
        for swing in ({}, {"rocker": ("40 deg", "42 deg")})
    )
    values = []
    for problem in (free, held):
        objective = Departure(np.zeros(1), problem.original, problem.turn, problem.dyad)
        end = min(search_from_all(objective, problem.region, 1e-10), key=lambda one: one.value)
        values.append(end.value)
    assert values[1] > values[0] + 1e-3
    swing = math.degrees(float(held.turn.range("rocker", end.lengths)[0]))
    assert 40.0 - 1e-3 < swing < 42.0 + 1e-3


# ---- the result


@pytest.fixture(scope="module")
def optimum():
    return jg.optimise(
        jg.load_mechanism("six_bar"),
        SIMULATE,
        lengths={"link.length": ("440 mm", "480 mm"), "output.length": ("280 mm", "320 mm")},
        ensemble={"members": 3},
    )


def test_the_gain_is_simulated_again_and_agrees_with_the_frozen_motion(optimum):
    low, high = optimum.interval
    assert 0.0 < low <= optimum.gain <= high < 1.0
    facts = {fact.name: fact for fact in optimum.facts}
    assert facts["estimate_percent"].value == pytest.approx(100 * optimum.gain, abs=1.0)
    assert facts["rms"].value < facts["rms"].before
    assert "The gain is" in optimum.remarks[0]


def test_mass_centres_are_scaled_and_masses_kept(optimum):
    old, new = optimum.original.linkage.bodies["link"], optimum.linkage.bodies["link"]
    assert new.length == optimum.lengths["link.length"] != old.length
    assert new.mass_centre / new.length == pytest.approx(old.mass_centre / old.length, rel=1e-14)
    assert (new.mass, new.inertia) == (old.mass, old.inertia)


@pytest.mark.parametrize("name", ["link.length", "frame.E.x", "frame.C.y"])
def test_a_file_with_other_lengths_has_the_geometry_of_the_search(name):
    problem = problem_of(jg.load_mechanism("six_bar"), {name: (1e-3, 1.0)})
    lengths = [problem.original[0] + 4e-3]
    changed = problem_of(problem.with_lengths(lengths), problem.options.lengths)
    assert changed.original == pytest.approx(lengths, abs=1e-15)
    angles = [p.turn.angle(p.dyad, lengths)[0] for p in (problem, changed)]
    assert angles[0] == pytest.approx(angles[1], abs=1e-12)


def test_a_slide_of_the_frame_is_moved():
    problem = problem_of(jg.load_mechanism("quick_return"), {"frame.guide.y": (0.2, 0.3)})
    changed = problem.with_lengths([0.26])
    assert (
        changed.slides["guide"].at == (0.0, 0.26)
        and changed.slides["track"] == problem.file.slides["track"]
    )


def test_the_page_has_all_figures(optimum, tmp_path):
    page = optimum.write_page(tmp_path / "optimum.html").read_text(encoding="utf-8")
    assert all(title in page for title in optimum.figures.values())
    assert page.count("<img") == len(optimum.figures) == 5
    for name in optimum.figures:
        assert len(optimum.plot(name).data)


def test_a_search_repeats(optimum):
    again = jg.optimise(
        jg.load_mechanism("six_bar"),
        SIMULATE,
        lengths={"link.length": ("440 mm", "480 mm"), "output.length": ("280 mm", "320 mm")},
        ensemble={"members": 3},
    )
    assert again.lengths == optimum.lengths and again.gain == optimum.gain
