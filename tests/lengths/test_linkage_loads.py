"""Forces and torques of general linkages as objectives and limits: exact values and gradients, the
optimum, and the result."""

import numpy as np
import pytest

import jointgap as jg
from jointgap.config import OptimiseLinkage, Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.core.errors import InputError
from jointgap.lengths.linkages import LinkageProblem, goals_of, joint_forces
from jointgap.lengths.search import evolve, search_from_all
from jointgap.linkage.from_file import linkage_of_file
from jointgap.linkage.transmission import variables_of

SIMULATE = Simulate(speed="300 rpm", revolutions=4, samples_per_revolution=720)
BOUNDS = {
    "four_bar": ("coupler.length", "rocker.length", "frame.C.x", "frame.C.y"),
    "six_bar": ("crank.length", "link.length", "output.length", "frame.E.y"),
    "quick_return": ("crank.length", "rocker.length", "rod.length", "frame.C.y"),
}
OBJECTIVES = {
    "four_bar": ("B_peak_force", "peak_torque", "rms_torque"),
    "six_bar": ("largest_pin_force", "F_rms_force", "torque_ripple"),
    "quick_return": ("guide_peak_force", "track_rms_force", "torque_ripple"),
}
CASES = [(name, objective) for name, each in OBJECTIVES.items() for objective in each]


def problem_of(file, lengths, simulate=SIMULATE, **keys):
    return LinkageProblem(file, simulate, OptimiseLinkage(lengths=lengths, **keys))


def near(name, **keys):
    """A shipped linkage whose lengths may differ by 5 mm."""
    file = jg.load_mechanism(name)
    known = variables_of(linkage_of_file(file))
    return problem_of(file, {n: (known[n] - 5e-3, known[n] + 5e-3) for n in BOUNDS[name]}, **keys)


def objective_of(problem):
    """The objective, which needs no motion with clearance."""
    samples = {"crank_angle": np.linspace(0.0, 8.0 * np.pi, 4 * 720 + 1)}
    return problem.objective(samples)


def with_effects(*effects):
    """The four-bar without clearance, but with friction in its pins, and with effects."""
    content = jg.load_mechanism("four_bar").with_ideal_joints().model_dump(mode="json")
    return LinkageFile.model_validate(content | {"effects": [*effects]})


def simulated(file, simulate, rows):
    """Torque and forces of a simulation without clearance."""
    samples = jg.simulate(file, simulate).samples.iloc[rows]
    columns = {name: samples[name].to_numpy() for name in samples}
    forces = joint_forces(columns, linkage_of_file(file).joints)
    return {"crank_torque": columns["crank_torque"], **forces}


@pytest.mark.parametrize("name", BOUNDS)
def test_forces_at_other_lengths_are_those_of_a_simulation_without_clearance(name):
    problem = near(name)
    lengths = np.add(problem.original, [1e-3, -2e-3, 1.5e-3, 0.7e-3])
    file = problem.with_lengths(lengths).with_ideal_joints()
    expected = simulated(file, SIMULATE, problem.settled[::2])
    found, _ = problem.forces([*expected], lengths)
    for values, each in zip(found, expected.values(), strict=True):
        assert values == pytest.approx(each, abs=1e-10 * np.abs(each).max())


@pytest.mark.parametrize(
    "drive",
    [
        {},
        {"speed": "200 rpm", "drive": {"kind": "free", "inertia": "2 kg*m^2"}},
        {
            "drive": {
                "kind": "motor",
                "stall_torque": "400 N*m",
                "no_load_speed": "320 rpm",
                "inertia": "0.3 kg*m^2",
            }
        },
    ],
)
def test_effects_and_drives_keep_their_forces_and_motion_of_the_original_lengths(drive):
    file = with_effects(
        {"name": "gravity"},
        {"name": "rocker_viscous_friction", "parameters": {"damping_N_m_s": 0.4}},
        {"name": "crank_viscous_friction", "parameters": {"damping_N_m_s": 0.2}},
        {"name": "added_coupler_mass", "parameters": {"mass_kg": 0.3}},
    )
    simulate = Simulate(**({"speed": "300 rpm", "revolutions": 4} | drive))
    problem = problem_of(file, {"coupler.length": (0.39, 0.41)}, simulate)
    rows = problem.settled[np.arange(360) * len(problem.settled) // 360]
    expected = simulated(file, simulate, rows)
    found, slopes = problem.forces([*expected], problem.original)
    for values, each in zip(found, expected.values(), strict=True):
        assert values == pytest.approx(each, abs=1e-8 * np.abs(each).max())
    assert np.isfinite(slopes).all()


@pytest.mark.parametrize("name, objective", CASES)
def test_gradients_agree_with_differences(name, objective):
    function = objective_of(near(name, objective=objective))
    lengths = np.add(function.original, [1e-3, -2e-3, 1.5e-3, 0.7e-3])
    steps = 1e-6 * np.eye(4)
    of = function.several
    expected = np.stack([(of(lengths + s) - of(lengths - s)) / 2e-6 for s in steps], axis=-1)
    size = np.abs(expected).max()
    assert function.slopes(lengths) == pytest.approx(expected, rel=1e-5, abs=1e-6 * size)


@pytest.mark.parametrize("name, objective", CASES)
def test_an_objective_is_the_number_of_the_simulated_forces(name, objective):
    problem = near(name, objective=objective)
    function = objective_of(problem)
    settled = simulated(problem.file.with_ideal_joints(), SIMULATE, problem.settled[::2])
    expected = problem.goal.load(settled)
    assert function.value(problem.original) == pytest.approx(expected, rel=1e-9)
    assert function.several(np.array(problem.original)).max() == pytest.approx(expected)


@pytest.mark.parametrize("objective", ["B_peak_force", "torque_ripple", "rms_torque"])
def test_the_optimum_is_that_of_a_dense_grid(objective):
    bounds = {"coupler.length": (0.28, 0.45), "rocker.length": (0.23, 0.38)}
    problem = problem_of(jg.load_mechanism("four_bar"), bounds, objective=objective)
    function, region = objective_of(problem), problem.region
    grid = np.stack(np.meshgrid(*(np.linspace(*ends, 61) for ends in bounds.values())), axis=-1)
    grid = grid.reshape(-1, 2)
    grid = grid[region.violation(grid) <= 1e-4]
    best = function.value(grid).min()
    ends = search_from_all(function, region, 1e-8)
    least = min(end.value for end in ends)
    assert 0.97 * best < least <= best * (1 + 1e-6)
    genetic = evolve(function, region, problem.options.genetic).value
    assert least * (1 - 1e-6) <= genetic < 1.05 * least


def test_the_pins_of_the_largest_pin_force_join_two_moving_bodies():
    goals = goals_of(linkage_of_file(jg.load_mechanism("six_bar")))
    assert goals["largest_pin_force"].load.names == ("A", "B", "D", "F")
    assert {"E_peak_force", "O_rms_force", "peak_torque"} <= goals.keys()


# ---- the result

KEYS = {
    "speed": "300 rpm",
    "samples_per_revolution": 720,
    "lengths": {"coupler.length": ("350 mm", "450 mm"), "rocker.length": ("230 mm", "280 mm")},
    "ensemble": {"members": 3},
}


@pytest.fixture(scope="module")
def optimum():
    return jg.optimise(jg.load_mechanism("four_bar"), objective="rms_torque", **KEYS)


def test_the_gain_is_that_of_simulations_with_clearance(optimum):
    def rms(file):
        settled = jg.simulate(file, speed="300 rpm", revolutions=4, samples_per_revolution=720)
        return np.sqrt(np.mean(settled.samples["crank_torque"].iloc[3 * 720 : 4 * 720] ** 2))

    original = jg.load_mechanism("four_bar")
    assert optimum.gain == pytest.approx(1 - rms(optimum.linkage) / rms(original), abs=0.05)
    assert optimum.gain > 0.1
    fact = {fact.name: fact for fact in optimum.facts}["rms_torque"]
    assert fact.unit == "N m" and fact.value < fact.before
    assert "in the search (ideal joints)" in str(optimum)


def test_the_page_shows_the_quantity_first(optimum, tmp_path):
    assert next(iter(optimum.figures)) == "torque"
    assert len(optimum.plot("torque").data)
    page = optimum.write_page(tmp_path / "optimum.html").read_text(encoding="utf-8")
    assert "smallest RMS torque of the drive" in page and page.count("<img") == 5


def test_without_clearance_the_search_is_exact_and_has_no_interval():
    ideal = jg.load_mechanism("four_bar").with_ideal_joints()
    best = jg.optimise(ideal, objective="torque_ripple", **KEYS)
    assert best.interval == (best.gain, best.gain)
    assert best.gain == pytest.approx(best._found.estimate, abs=1e-3)
    assert "perturbed starts" not in str(best)


def test_a_limit_of_a_force_is_kept_with_clearance_and_costs_some_of_the_objective():
    file, objective = jg.load_mechanism("four_bar"), "transmission_angle"
    bounds = {"lengths": {"coupler.length": ("300 mm", "420 mm")}}
    free = jg.optimise(file, objective=objective, **(KEYS | bounds))
    force = float(free.tables["loads"].loc["B", "peak_force"])
    limit = 0.9 * force
    held = jg.optimise(file, objective=objective, largest_force={"B": limit}, **(KEYS | bounds))
    assert held.tables["loads"].loc["B", "peak_force"] <= 1.005 * limit
    assert held.gain < free.gain


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"objective": "B_peak_frce"}, "objective: 'B_peak_frce' .*did you mean 'B_peak_force'"),
        ({"largest_force": {"Z": "1 N"}}, "largest_force.Z: no such joint; known here: A, B, C, O"),
        ({"largest_force": {"B": "0 N"}}, "largest_force.B"),
        (
            {"largest_force": {"B": "10 N"}},
            "keep the largest force in B below 10 N; the least is .* N in B at coupler.length .*"
            " mm, rocker.length .* mm; allow larger forces, give wider bounds",
        ),
    ],
)
def test_bad_input_is_one_error_that_says_what_to_do(keys, words):
    with pytest.raises(InputError, match=words):
        jg.optimise(jg.load_mechanism("four_bar"), **KEYS, **keys)
