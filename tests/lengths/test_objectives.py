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
from jointgap.lengths import resimulate as again
from jointgap.scenario.mlflow_runs import scenario_records
from jointgap.scenario.outcome import document, page, remarks
from jointgap.scenario.stages import SCENARIO_STAGES
from tests.catalogue import refused

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
GRID = 4, 5
NAMES = ("largest_pin_force", "torque_ripple")


@pytest.fixture(scope="module", autouse=True)
def _coarse():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(again, "SURFACE_GRID", GRID)
        yield


@pytest.fixture(scope="module")
def optima(mechanism):
    return {name: jg.optimise(mechanism, **SIMULATE, **OPTIONS, objective=name) for name in NAMES}


def by_hand(mechanism, name):
    """The objective [N, N m] of one simulated motion."""
    last = jg.simulate(mechanism, **SIMULATE).samples.iloc[360:720]
    pins = [
        np.hypot(last[f"{pin}_force_x"], last[f"{pin}_force_y"]).max()
        for pin in ("crank_pin", "piston_pin")
    ]
    return max(pins) if name == "largest_pin_force" else np.ptp(last["crank_torque"])


@pytest.mark.parametrize("name", NAMES)
def test_the_search_minimises_the_force_or_torque_of_simulations_with_and_without_clearance(
    optima, mechanism, name
):
    ideal = jg.change(mechanism, {"joints.crank_pin": "ideal", "joints.piston_pin": "ideal"})
    valley = optima[name].tables["valley"]
    for source, made in (("ideal_joints", ideal), ("with_clearance", mechanism)):
        corner = (
            valley[valley["source"] == source].sort_values(["crank_length", "rod_length"]).iloc[0]
        )
        own = made.with_lengths(corner["crank_length"], corner["rod_length"])
        assert corner["objective"] == pytest.approx(by_hand(own, name), rel=1e-6)
        found = (
            optima[name]
            .tables["optima"]
            .query(f"source == '{source}' and method == 'local'")
            .iloc[0]
        )
        least = valley.loc[valley["source"] == source, "objective"].min()
        assert found["objective"] <= least * (1 + 1e-3) and found["objective_reduction"] >= -1e-9


@pytest.mark.parametrize("name", NAMES)
def test_the_result_is_the_smallest_force_or_torque_when_simulated_again(optima, mechanism, name):
    best = optima[name]
    rows = (
        best.tables["resimulated"]
        .query(f"measure == '{name}' and stretch == 'settled'")
        .set_index("point")
    )
    own = rows["error"].drop("original").min()
    assert best.gain == pytest.approx(1 - own / rows.loc["original", "error"], rel=0.02, abs=0.01)
    assert rows.loc["original", "error"] == pytest.approx(by_hand(mechanism, name), rel=0.05)
    unit = {"largest_pin_force": "N", "torque_ripple": "N m"}[name]
    shown = best.summary().set_index("quantity")
    words = name.replace("_", " ")
    assert shown.loc[f"{words} over a settled revolution, after", "unit"] == unit
    for table, frame in best.tables.items():
        parquet.to_arrow(TABLES[f"optimise_{table}"], frame)


def test_page_and_json_have_the_objective_under_its_name_and_the_angle_under_the_old_names(optima):
    found = optima["largest_pin_force"]._outcome
    text = to_markdown(page(found, "mine", remarks(found)))
    assert "largest pin force" in text.splitlines()[0] and "| largest pin force |" in text
    assert (
        "simulations with ideal joints" in text
        and "root mean square (RMS), a settled revolution" in text
    )
    known = json.loads(json.dumps(document(found, "mine", ()), allow_nan=False))
    assert known["objective"] == "largest_pin_force" and known["largest_pin_force"]["unit"] == "N"
    assert known["largest_pin_force"]["reduction_percent"]["median"] == pytest.approx(
        100 * float(found.gain["reduction"])
    )
    angle = found.gains.loc[("settled", "rms")]
    assert known["reduction_percent"]["median"] == pytest.approx(100 * float(angle["reduction"]))


@pytest.mark.parametrize("name", NAMES)
def test_the_figures_show_the_objective(optima, name):
    words = name.replace("_", " ")
    valley, resimulation = (optima[name].plot(figure).data for figure in ("valley", "resimulation"))
    assert {"objective", "local paths", words} <= set(valley["series"])
    assert {f"{words}, simulated again", f"{words}, search", "RMS, simulated again"} <= set(
        resimulation["series"]
    )


def test_mlflow_has_metrics_of_the_objective_beside_those_of_the_angle(optima, tmp_path):
    best, files = optima["torque_ripple"], {}
    for name, frame in best.tables.items():
        files[f"optimise_{name}"] = tmp_path / f"{name}.parquet"
        parquet.write(TABLES[f"optimise_{name}"], frame, files[f"optimise_{name}"])
    sections = {name: stage.sections for name, stage in SCENARIO_STAGES.items()}
    records = {
        record.output: record
        for record in scenario_records(best._outcome.scenario, sections, files, tmp_path)
    }
    own = records[best._outcome.chosen["point"]]
    assert records[""].metrics == own.metrics
    assert own.metrics["gain_torque_ripple_percent"] == pytest.approx(100 * best.gain, abs=1e-3)
    assert own.metrics["search/torque_ripple_N_m"] > 0 and "torque_ripple_N_m" in own.curves
    assert {"gain_revolution_percent", "frozen/rms_reduction_percent"} <= set(own.metrics)
    assert "resimulated_settled/torque_ripple_error_N_m" in own.metrics


FORCE = {"objective": "largest_pin_force"}
TOGETHER = [
    ({"networks": True, "optimise": FORCE}, "cannot be combined with networks: true"),
    (
        {"sweep": {"best_lengths": True}, "optimise": FORCE},
        "cannot be combined with sweep.best_lengths",
    ),
    (
        {"optimise_robust": {"uncertain": {"friction": {"from": 0, "to": 0.1}}}, "optimise": FORCE},
        "cannot be combined with optimise_robust.uncertain",
    ),
    (
        {"optimise": FORCE | {"window": ["60 deg", "360 deg"]}},
        "window belongs to the transmission angle",
    ),
    ({"optimise": {"objective": "pin_force"}}, "objective"),
]


def test_sections_that_concern_the_angle_only_are_refused_with_another_objective():
    def read(sections):
        resolve(
            {"scenarios": {"mine": {"mechanism": "config/mechanisms/erkaya2009.yaml", **sections}}}
        )

    refused(read, TOGETHER)


def test_networks_and_boxes_that_cannot_be_one_grid_are_refused_in_python(mechanism):
    with pytest.raises(InputError, match="cannot be combined with networks: true"):
        jg.optimise(mechanism, **OPTIONS, objective="torque_ripple", networks=True)
    far = {"crank_length": ("0.56 m", "0.57 m"), "rod_length": ("0.9 m", "1 m")}
    options = OPTIONS | {"boxes": {"near": BOX, "far": far}}
    with pytest.raises(InputError, match="optimise in one box at a time"):
        jg.optimise(mechanism, **SIMULATE, **options, objective="torque_ripple")
