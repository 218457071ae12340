"""All that a scenario asks of many designs is one run; publishing it again adds nothing."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Scenario
from jointgap.config.scenario_results import ScenarioResults
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.designs.dataset import table_of, write_dataset
from jointgap.designs.infer_settings import NUMBERS
from jointgap.designs.sampling import designs_of
from jointgap.designs.sensitivity import TABLES
from jointgap.designs.stages import sweep_record, track_sweep
from tests.dynamics.cases import mechanism, options
from tests.scenario.published_tables import numbers

SWEPT = {
    "clearance": {"from": "0.2 mm", "to": "0.4 mm"},
    "mechanism.joints.crank_pin.journal": ["crank", "rod"],
}
DESIGNS = Path("sweep/designs")


def scenario(number: int = 8, swept: dict = SWEPT, **more) -> Scenario:
    """Simulated in milliseconds."""
    coarse = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8)
    sweep = {"parameters": swept, "number": number, "designs_per_job": 4}
    return Scenario(
        description="made up",
        mechanism=mechanism(friction=0.1),
        simulate=coarse,
        sweep=sweep,
        **more,
    )


def simulated(asked: Scenario, folder: Path) -> None:
    """The dataset and the page of a sweep."""
    write_dataset(
        designs_of(asked), folder / DESIGNS, asked.sweep.designs_per_job, "code", workers=1
    )
    (folder / "sweep/summary.html").write_text("a page")


def made_up(folder: Path, *files: str, **tables: dict) -> None:
    """Tables, by name, with these columns and made-up numbers in the others; and files that hold
    nothing."""
    for name, columns in tables.items():
        groups = {one.name[1:-1]: () for one in schema.TABLES[name].columns if one.name[0] == "{"}
        table = schema.TABLES[name].filled(**groups)
        rows = len(next(iter(columns.values()), (1, 2)))
        parquet.write(table, numbers(table, rows, **columns), folder / table.path)
    for name in files:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()


@pytest.fixture
def folder(results) -> Path:
    return results / "made_up"


def published(asked: Scenario, folder: Path) -> dict:
    """What the stage says that it did."""
    track_sweep(ScenarioResults(folder, asked))
    return json.loads((folder / "track_sweep/published.json").read_text())


def the_run(client, kind="ACTIVE_ONLY"):
    """The only run that there is."""
    from mlflow.entities import ViewType

    experiments = [found.experiment_id for found in client.search_experiments()]
    (run,) = client.search_runs(experiments, run_view_type=ViewType.from_string(kind.lower()))
    assert client.get_experiment(run.info.experiment_id).name == "jointgap-sweep"
    return run


def inputs(run) -> set[str]:
    return {one.dataset.name for one in run.inputs.dataset_inputs}


def test_a_sweep_is_one_run_and_publishing_it_twice_adds_nothing_and_a_grown_one_takes_its_place(
    folder, client
):
    asked = scenario()
    simulated(asked, folder)
    first = published(asked, folder)["runs"]
    run, frame = the_run(client), pd.read_parquet(folder / DESIGNS)
    assert first.keys() == {"sweep"}
    (dataset,) = [one.dataset for one in run.inputs.dataset_inputs]
    assert json.loads(dataset.profile) == {"num_rows": 8} and dataset.name == "sweep_designs"
    assert json.loads(dataset.source) == {"uri": str(folder / DESIGNS)}
    assert [column["name"] for column in json.loads(dataset.schema)["mlflow_colspec"]] == list(
        frame.columns
    )
    params, metrics = run.data.params, run.data.metrics
    assert (
        params["sweep.parameters.clearance.from"] == "0.2 mm" and params["sweep.design"] == "sobol"
    )
    assert (metrics["designs"], metrics["failed_percent"]) == (8, 0)
    error = 1e3 * np.rad2deg(frame["angle_error_rms"])
    wanted = {
        "mean": error.mean(),
        "deviation": error.std(ddof=0),
        "quantile_95": np.quantile(error, 0.95),
    }
    assert {key: metrics[f"angle_error_rms_mdeg/{key}"] for key in wanted} == pytest.approx(wanted)
    assert {file.path for file in client.list_artifacts(run.info.run_id)} == {
        "options.json",
        "sweep",
    }
    again = published(asked, folder)
    assert again["runs"]["sweep"] == first["sweep"] | {"state": "kept"} and again["deleted"] == 0
    assert the_run(client, "ALL").info.run_id == first["sweep"]["run_id"]
    simulated(scenario(12), folder)
    grown = published(scenario(12), folder)
    assert grown["runs"]["sweep"]["state"] == "written" and grown["deleted"] == 1
    assert the_run(client).data.metrics["designs"] == 12
    assert client.get_run(first["sweep"]["run_id"]).info.lifecycle_stage == "deleted"


def test_designs_that_failed_are_counted_and_a_dataset_that_lacks_some_is_not_published(folder):
    asked, place = scenario(), folder / DESIGNS / "part_000000.parquet"
    simulated(asked, folder)
    table = table_of(designs_of(asked))
    frame = parquet.read(table, place)
    frame.loc[0, ["stroke", "reason"]] = [np.nan, "the motor stalls"]
    told = {
        key.decode(): value.decode() for key, value in parquet.read_footer(place).metadata.items()
    }
    parquet.write(
        table, frame, place, {name: told[name] for name in ("jointgap_sweep", "jointgap_code")}
    )
    metrics = sweep_record(asked, folder).metrics
    assert (metrics["failed"], metrics["failed_percent"], metrics["stroke_mm/counted"]) == (
        1,
        12.5,
        7,
    )
    (folder / DESIGNS / "part_000001.parquet").unlink()
    with pytest.raises(InputError, match="design 4 is missing"):
        published(asked, folder)
    with pytest.raises(InputError, match="there is nothing to publish"):
        published(scenario(swept={}), folder)


def test_what_else_a_scenario_asks_for_belongs_to_its_run(folder, client):
    """Indices of what decides, inferred settings, robust lengths."""
    uncertain = {"uncertain": {"friction": {"from": 0, "to": 0.2}}}
    asked = scenario(sensitivity={}, infer_settings={}, optimise_robust=uncertain)
    simulated(asked, folder)
    designs = {"design": [4, 2, 3], "together": [True, False, False], "farthest": [0.04, 0.1, 0.2]}
    designs |= {one.column: [one.printed, 0.0, 0.0] for one in NUMBERS}
    robust = {
        "lengths": {"lengths": ["original", "robust"], "crank_length": [0.150, 0.149]},
        "gains": {"lengths": ["robust"], "beside": ["original"], "probability": [0.875]},
        "constraints": {"constraint": ["stroke"], "lengths": ["robust"]},
        "candidates": {"search": ["robust"], "step": ["grid"]},
        "fresh": {},
    }
    tables = {f"optimise_robust_{name}": columns for name, columns in robust.items()} | {
        "sensitivity_surrogates": {
            "measure": ["stroke", "noise_share"],
            "q2": [0.99, 0.1],
            "reason": [None, "poor"],
        },
        "sensitivity_indices": {
            "measure": ["stroke"] * 2,
            "parameter": ["clearance", "friction"],
            "total": [0.7, 0.4],
        },
        "sensitivity_effects": {},
        "infer_settings_settings": {"setting": ["friction"]},
        "infer_settings_designs": designs,
    }
    (folder / "sensitivity/figures").mkdir(parents=True)
    made_up(
        folder, "sensitivity/figures/indices.png", "infer_settings/nearest_scenario.yaml", **tables
    )
    published(asked, folder)
    run = the_run(client)
    params, metrics = run.data.params, run.data.metrics
    assert params["optimise_robust.uncertain.friction.to"] == "0.2"
    wanted = {
        "robust/crank_length_mm": 149,
        "robust beside original/probability_percent": 87.5,
        "q2/noise_share": 0.1,
    }
    wanted |= {"total/stroke by clearance": 0.7, "printed/together_percent": 100 / 3}
    assert {name: metrics[name] for name in wanted} == pytest.approx(wanted)
    assert not [name for name in metrics if name.startswith("total/noise_share")]  # it has no index
    assert inputs(run) >= {
        "sweep_designs",
        "infer_settings_designs",
        *(table.name for table in TABLES),
    }
    for stage, file in (
        ("sensitivity/figures", "indices.png"),
        ("infer_settings", "nearest_scenario.yaml"),
    ):
        assert [one.path for one in client.list_artifacts(run.info.run_id, stage)] == [
            f"{stage}/{file}"
        ]
