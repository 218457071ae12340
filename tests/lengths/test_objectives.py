"""Forces and torques as objectives: against a simulation of each pair of lengths."""

import json

import numpy as np
import pytest

import jointgap as jg
from jointgap.config import resolve
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.page import to_markdown
from jointgap.core.schema import TABLES
from jointgap.lengths import surface
from jointgap.scenario.chosen_lengths import document
from jointgap.scenario.mlflow_runs import scenario_records
from jointgap.scenario.stages import SCENARIO_STAGES
from jointgap.scenario.summary_page import page

SIMULATE = {
    "speed": "600 rpm",
    "revolutions": 2,
    "samples_per_revolution": 360,
    "tolerance": "1e-9 m",
}
BOX = {"crank_length": ("0.148 m", "0.152 m"), "rod_length": ("0.555 m", "0.575 m")}
OPTIONS = {
    "boxes": {"near": BOX},
    "genetic": {"generations": 8},
    "ensemble": {"members": 2, "settled_revolution": 2},
}
UNITS = {"largest_pin_force": "N", "torque_ripple": "N m"}


@pytest.fixture(scope="module", autouse=True)
def _coarse():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(surface, "GRID", (4, 5))
        yield


@pytest.fixture(scope="module")
def optima(mechanism):
    return {name: jg.optimise(mechanism, **SIMULATE, **OPTIONS, objective=name) for name in UNITS}


def by_hand(mechanism, name):
    """The objective [N, N m] of one simulated motion."""
    settled = jg.simulate(mechanism, **SIMULATE).samples.iloc[360:720]
    if name == "torque_ripple":
        return np.ptp(settled["crank_torque"])
    return max(
        np.hypot(settled[f"{pin}_force_x"], settled[f"{pin}_force_y"]).max()
        for pin in ("crank_pin", "piston_pin")
    )


@pytest.mark.parametrize("name", UNITS)
def test_the_search_minimises_the_simulated_quantity_with_and_without_clearance(
    optima, mechanism, name
):
    ideal = jg.change(mechanism, {"joints.crank_pin": "ideal", "joints.piston_pin": "ideal"})
    every_grid, local = optima[name].tables["valley"], optima[name].tables["optima"]
    local = local[local["method"] == "local"].set_index("source")
    for source, simulated in (("ideal_joints", ideal), ("with_clearance", mechanism)):
        grid = every_grid[every_grid["source"] == source].sort_values(
            ["crank_length", "rod_length"]
        )
        corner = grid.iloc[0]
        at_corner = simulated.with_lengths(corner["crank_length"], corner["rod_length"])
        assert corner["objective"] == pytest.approx(by_hand(at_corner, name), rel=1e-6)
        assert local.loc[source, "objective"] <= grid["objective"].min() * (1 + 1e-3)
        assert local.loc[source, "objective_reduction"] >= -1e-9


@pytest.mark.parametrize("name, unit", UNITS.items())
def test_the_result_has_the_smallest_quantity_when_simulated_again(optima, mechanism, name, unit):
    best = optima[name]
    rows = best.tables["resimulated"].query(f"measure == '{name}' and stretch == 'settled'")
    error = rows.set_index("point")["error"]
    reduction = 1 - error.drop("original").min() / error["original"]
    assert best.gain == pytest.approx(reduction, rel=0.02, abs=0.01)
    assert error["original"] == pytest.approx(by_hand(mechanism, name), rel=0.05)
    label = f"{name.replace('_', ' ')} over a settled revolution"
    assert best.summary().set_index("quantity").loc[label, "unit"] == unit
    for table, frame in best.tables.items():
        parquet.to_arrow(TABLES[f"optimise_{table}"], frame)


def test_page_and_json_name_the_objective_and_keep_the_names_of_the_angle(optima):
    chosen = optima["largest_pin_force"]._chosen
    text = to_markdown(page(chosen, "mine"))
    assert "largest pin force" in text.splitlines()[0] and "| largest pin force, a settled" in text
    assert "Motion used by the search: simulations with" in text
    assert "root mean square (RMS), a settled revolution" in text
    content = json.loads(json.dumps(document(chosen, "mine"), allow_nan=False))
    force, angle = content["largest_pin_force"], chosen.gains.loc[("settled", "rms")]
    assert content["objective"] == "largest_pin_force" and force["unit"] == "N"
    for reductions, gain in ((force, chosen.gain), (content, angle)):
        median = reductions["reduction_percent"]["median"]
        assert median == pytest.approx(100 * float(gain["reduction"]))


@pytest.mark.parametrize("name", UNITS)
def test_the_figures_show_the_objective(optima, name):
    label = name.replace("_", " ")
    grid, resimulation = (
        set(optima[name].plot(figure).data["series"]) for figure in ("valley", "resimulation")
    )
    assert {"objective", "local paths", label} <= grid
    assert {f"{label}, simulated again", f"{label}, search", "RMS, simulated again"} <= resimulation


def test_mlflow_has_metrics_of_the_objective_and_of_the_angle(optima, tmp_path):
    best, files = optima["torque_ripple"], {}
    for name, frame in best.tables.items():
        files[f"optimise_{name}"] = tmp_path / f"{name}.parquet"
        parquet.write(TABLES[f"optimise_{name}"], frame, files[f"optimise_{name}"])
    sections = {name: stage.sections for name, stage in SCENARIO_STAGES.items()}
    records = {
        record.output: record
        for record in scenario_records(best._chosen.scenario, sections, files, tmp_path)
    }
    record = records[best._chosen.row["point"]]
    metrics = record.metrics
    assert records[""].metrics == metrics
    assert metrics["gain_torque_ripple_percent"] == pytest.approx(100 * best.gain, abs=1e-3)
    assert metrics["search/torque_ripple_N_m"] > 0 and "torque_ripple_N_m" in record.curves
    assert {
        "gain_revolution_percent",
        "frozen/rms_reduction_percent",
        "resimulated_settled/torque_ripple_error_N_m",
    } <= set(metrics)


FORCE = {"objective": "largest_pin_force"}


@pytest.mark.parametrize(
    "sections, message",
    [
        ({"networks": True, "optimise": FORCE}, "cannot be combined with networks: true"),
        (
            {"sweep": {"best_lengths": True}, "optimise": FORCE},
            "cannot be combined with sweep.best_lengths",
        ),
        (
            {
                "optimise_robust": {"uncertain": {"friction": {"from": 0, "to": 0.1}}},
                "optimise": FORCE,
            },
            "cannot be combined with optimise_robust.uncertain",
        ),
        (
            {"optimise": FORCE | {"window": ["60 deg", "360 deg"]}},
            "window belongs to the transmission angle",
        ),
        ({"optimise": {"objective": "pin_force"}}, "objective"),
    ],
)
def test_sections_of_the_angle_are_rejected_with_another_objective(sections, message):
    mine = {"mechanism": "config/mechanisms/erkaya2009.yaml", **sections}
    with pytest.raises(InputError, match=message):
        resolve({"scenarios": {"mine": mine}})


def test_boxes_that_cannot_be_one_grid_are_rejected(mechanism):
    far = {"crank_length": ("0.56 m", "0.57 m"), "rod_length": ("0.9 m", "1 m")}
    options = OPTIONS | {"boxes": {"near": BOX, "far": far}}
    with pytest.raises(InputError, match="optimise in one box at a time"):
        jg.optimise(mechanism, **SIMULATE, **options, objective="torque_ripple")
