"""The MLflow run of a scenario's studies."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Scenario
from jointgap.config.scenario_results import ScenarioResults
from jointgap.core.errors import InputError
from jointgap.designs.stages import sweep_record, track_sweep, write_sweep
from tests.motion.cases import mechanism, options

SWEPT = {
    "clearance": {"from": "0.2 mm", "to": "0.4 mm"},
    "mechanism.joints.crank_pin.journal": ["crank", "rod"],
}


def scenario(number: int = 8, swept: dict = SWEPT, **sections) -> Scenario:
    """Simulated in milliseconds."""
    return Scenario(
        description="made up",
        mechanism=mechanism(friction=0.1),
        simulate=options(revolutions=2, samples_per_revolution=360, tolerance=1e-8),
        sweep={"parameters": swept, "number": number, "designs_per_job": 4},
        **sections,
    )


@pytest.fixture
def folder(results) -> Path:
    return results / "made_up"


def publish(made: Scenario, folder: Path) -> dict:
    """The summary that the stage writes."""
    track_sweep(ScenarioResults(folder, made))
    return json.loads((folder / "track_sweep/published.json").read_text())


def only_run(client, kind="active_only"):
    from mlflow.entities import ViewType

    experiments = [experiment.experiment_id for experiment in client.search_experiments()]
    (run,) = client.search_runs(experiments, run_view_type=ViewType.from_string(kind))
    assert client.get_experiment(run.info.experiment_id).name == "jointgap-sweep"
    return run


def test_publishing_is_idempotent_and_a_larger_sweep_replaces_the_run(folder, client):
    made = scenario()
    write_sweep(made, folder / "sweep", 1)
    written = publish(made, folder)["runs"]["sweep"]
    run, frame = only_run(client), pd.read_parquet(folder / "sweep/designs")
    (dataset,) = [dataset_input.dataset for dataset_input in run.inputs.dataset_inputs]
    assert dataset.name == "sweep_designs" and json.loads(dataset.profile) == {"num_rows": 8}
    params, metrics = run.data.params, run.data.metrics
    assert params["sweep.parameters.clearance.from"] == "0.2 mm"
    assert (metrics["designs"], metrics["failed_percent"]) == (8, 0)
    error = 1e3 * np.rad2deg(frame["angle_error_rms"])
    expected = {
        "angle_error_rms_mdeg/mean": error.mean(),
        "angle_error_rms_mdeg/deviation": error.std(ddof=0),
        "angle_error_rms_mdeg/quantile_95": np.quantile(error, 0.95),
    }
    assert {name: metrics[name] for name in expected} == pytest.approx(expected)
    artifacts = {file.path for file in client.list_artifacts(run.info.run_id)}
    assert artifacts == {"options.json", "sweep"}
    again = publish(made, folder)
    assert again["runs"]["sweep"] == written | {"state": "kept"} and again["deleted"] == 0
    assert only_run(client, "all").info.run_id == written["run_id"]
    write_sweep(scenario(12), folder / "sweep", 1)
    larger = publish(scenario(12), folder)
    assert larger["runs"]["sweep"]["state"] == "written" and larger["deleted"] == 1
    assert only_run(client).data.metrics["designs"] == 12
    assert client.get_run(written["run_id"]).info.lifecycle_stage == "deleted"


def test_failed_designs_are_counted(folder):
    swept = {"mechanism.crank.mass_centre": ["100 mm", "200 mm"]}
    made = scenario(swept=swept)
    write_sweep(made, folder / "sweep", 1)
    metrics = sweep_record(made, folder).metrics
    assert (metrics["failed"], metrics["failed_percent"]) == (4, 50)
    assert metrics["stroke_mm/counted"] == 4


def test_an_incomplete_dataset_or_study_is_not_published(folder):
    made = scenario(sensitivity={})
    write_sweep(made, folder / "sweep", 1)
    with pytest.raises(InputError, match=r"sensitivity/summary\.json: is missing; run `jointgap"):
        publish(made, folder)
    (folder / "sweep/designs/part_000001.parquet").unlink()
    with pytest.raises(InputError, match="design 4 is missing"):
        publish(made, folder)
    with pytest.raises(InputError, match="there is nothing to publish"):
        publish(scenario(swept={}), folder)


def test_the_run_contains_all_studies_of_the_scenario(folder):
    """Numbers, tables and figures of sensitivity, inferred settings and robust lengths."""
    uncertain = {"uncertain": {"friction": {"from": 0, "to": 0.2}}}
    made = scenario(sensitivity={}, infer_settings={}, optimise_robust=uncertain)
    write_sweep(made, folder / "sweep", 1)
    written = {
        "sensitivity": ({"q2/noise_share": 0.1}, "figures/indices.png"),
        "infer_settings": ({"printed/together_percent": 33.0}, "nearest_scenario.yaml"),
        "optimise_robust": ({"robust/crank_length_mm": 149.0}, "robust_errors.png"),
    }
    for study, (numbers, file) in written.items():
        (folder / study / file).parent.mkdir(parents=True)
        (folder / study / file).touch()
        (folder / study / "summary.json").write_text(json.dumps(numbers))
        pd.DataFrame().to_parquet(folder / study / "indices.parquet")
    record = sweep_record(made, folder)
    assert record.params["optimise_robust.uncertain.friction.to"] == "0.2"
    for study, (numbers, file) in written.items():
        assert numbers.items() <= record.metrics.items()
        assert f"{study}/{file}" in record.files
    names = {dataset.name for dataset in record.datasets}
    assert names >= {"sweep_designs", "sensitivity_indices"}
