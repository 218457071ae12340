"""All that a scenario asks of many designs is one run; publishing it again adds nothing."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Scenario
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.designs.infer_settings import NUMBERS
from jointgap.designs.run import write_dataset
from jointgap.designs.sampling import designs_of
from jointgap.designs.sensitivity import TABLES
from jointgap.designs.stages import sweep_record, track_sweep
from jointgap.scenario.results import ScenarioResults
from tests.dynamics.cases import mechanism, options
from tests.track.synthetic import numbers

SWEPT = {"clearance": {"from": "0.2 mm", "to": "0.4 mm"}, "mechanism.joints.crank_pin.journal": ["crank", "rod"]}
DESIGNS = Path("sweep/designs")
UNCERTAIN = {"friction": {"from": 0, "to": 0.2}}


def scenario(number: int = 8, swept: dict = SWEPT, **more) -> Scenario:
    """Simulated in milliseconds."""
    coarse = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8)
    return Scenario(
        description="made up",
        mechanism=mechanism(friction=0.1),
        simulate=coarse,
        sweep={"parameters": swept, "number": number, "designs_per_job": 4},
        **more,
    )


def simulated(asked: Scenario, folder: Path) -> None:
    """The dataset and the page of a sweep."""
    write_dataset(designs_of(asked), folder / DESIGNS, asked.sweep.designs_per_job, "code", workers=1)
    (folder / "sweep/summary.html").write_text("a page")


def decided(folder: Path) -> None:
    """What decides: indices of one measure, none of another."""
    named = {"measure": ["stroke", "noise_share"], "q2": [0.99, 0.1], "reason": [None, "predicted badly"]}
    surrogates = numbers(schema.SENSITIVITY_SURROGATES, 2, **named)
    indices = {"measure": ["stroke"] * 2, "parameter": ["clearance", "friction"], "total": [0.7, 0.4]}
    frames = {
        schema.SENSITIVITY_SURROGATES: surrogates,
        schema.SENSITIVITY_INDICES: numbers(schema.SENSITIVITY_INDICES, 2, **indices),
        schema.SENSITIVITY_EFFECTS: numbers(schema.SENSITIVITY_EFFECTS, 2),
    }
    _write(frames, folder)
    (folder / "sensitivity/figures").mkdir()
    (folder / "sensitivity/figures/indices.png").write_bytes(b"a picture")


def robust(folder: Path) -> None:
    """Robust lengths beside the original ones."""
    lengths = {"lengths": ["original", "robust"], "crank_length": [0.150, 0.149]}
    gains = {"lengths": ["robust"], "beside": ["original"], "probability": [0.875]}
    candidates = {"search": ["robust"], "step": ["grid"]}
    fresh = schema.OPTIMISE_ROBUST_FRESH.filled(uncertain=())
    _write(
        {
            schema.OPTIMISE_ROBUST_LENGTHS: numbers(schema.OPTIMISE_ROBUST_LENGTHS, 2, **lengths),
            schema.OPTIMISE_ROBUST_GAINS: numbers(schema.OPTIMISE_ROBUST_GAINS, 1, **gains),
            schema.OPTIMISE_ROBUST_CONSTRAINTS: numbers(
                schema.OPTIMISE_ROBUST_CONSTRAINTS, 1, constraint=["stroke"], lengths=["robust"]
            ),
            schema.OPTIMISE_ROBUST_CANDIDATES: numbers(schema.OPTIMISE_ROBUST_CANDIDATES, 1, **candidates),
            fresh: numbers(fresh, 2),
        },
        folder,
    )


def inferred(folder: Path) -> None:
    """Printed numbers that come out in some designs."""
    designs = {"design": [4, 2, 3], "together": [True, False, False], "farthest": [0.04, 0.1, 0.2]}
    designs |= {one.column: [one.printed, 0.0, 0.0] for one in NUMBERS}
    frames = {
        schema.INFER_SETTINGS_SETTINGS: {"setting": ["friction"]},
        schema.INFER_SETTINGS_DESIGNS.filled(swept=()): designs,
    }
    _write({table: numbers(table, len(next(iter(of.values()))), **of) for table, of in frames.items()}, folder)
    (folder / "infer_settings/nearest_scenario.yaml").write_text("run: [nearest]")


def _write(frames: dict, folder: Path) -> None:
    for table, frame in frames.items():
        parquet.write(table, frame, folder / table.path)


@pytest.fixture
def folder(results) -> Path:
    return results / "made_up"


def published(asked: Scenario, folder: Path) -> dict:
    """What the stage says that it did."""
    file = folder / "track_sweep/published.json"
    track_sweep(ScenarioResults(folder, asked))
    return json.loads(file.read_text())


def the_run(client):
    """The only run that there is, deleted ones counted too."""
    from mlflow.entities import ViewType

    experiments = [found.experiment_id for found in client.search_experiments()]
    (run,) = client.search_runs(experiments, run_view_type=ViewType.ALL)
    assert client.get_experiment(run.info.experiment_id).name == "jointgap-sweep"
    return run


def test_a_sweep_is_one_run_with_its_dataset_parameters_and_measures(folder, client):
    asked = scenario()
    simulated(asked, folder)
    assert published(asked, folder)["runs"].keys() == {"sweep"}
    run, frame = the_run(client), pd.read_parquet(folder / DESIGNS)
    (dataset,) = [one.dataset for one in run.inputs.dataset_inputs]
    assert json.loads(dataset.profile) == {"num_rows": 8} and dataset.name == "sweep_designs"
    assert json.loads(dataset.source) == {"uri": str(folder / DESIGNS)}
    assert [column["name"] for column in json.loads(dataset.schema)["mlflow_colspec"]] == list(frame.columns)
    params, metrics = run.data.params, run.data.metrics
    assert params["sweep.parameters.clearance.from"] == "0.2 mm" and params["sweep.design"] == "sobol"
    assert (metrics["designs"], metrics["failed_percent"]) == (8, 0)
    error = 1e3 * np.rad2deg(frame["angle_error_rms"])
    assert metrics["angle_error_rms_mdeg/mean"] == pytest.approx(error.mean())
    assert metrics["angle_error_rms_mdeg/deviation"] == pytest.approx(error.std(ddof=0))
    assert metrics["angle_error_rms_mdeg/quantile_95"] == pytest.approx(np.quantile(error, 0.95))
    assert {file.path for file in client.list_artifacts(run.info.run_id)} == {"options.json", "sweep"}


def test_designs_that_failed_are_counted_and_left_out_of_the_measures(folder):
    asked = scenario()
    simulated(asked, folder)
    place = folder / DESIGNS / "part_000000.parquet"
    table = designs_table(asked)
    frame = parquet.read(table, place)
    frame.loc[0, ["stroke", "reason"]] = [np.nan, "the motor stalls"]
    told = {key.decode(): value.decode() for key, value in parquet.read_footer(place).metadata.items()}
    parquet.write(table, frame, place, {name: told[name] for name in ("jointgap_sweep", "jointgap_code")})
    metrics = sweep_record(asked, folder).metrics
    assert (metrics["failed"], metrics["failed_percent"], metrics["stroke_mm/counted"]) == (1, 12.5, 7)


def designs_table(asked: Scenario):
    from jointgap.designs.run import table_of

    return table_of(designs_of(asked))


def test_publishing_a_sweep_twice_adds_nothing_and_a_grown_one_takes_its_place(folder, client):
    simulated(scenario(), folder)
    first = published(scenario(), folder)["runs"]["sweep"]
    again = published(scenario(), folder)
    assert again["runs"]["sweep"] == first | {"state": "kept"} and again["deleted"] == 0
    assert the_run(client).info.run_id == first["run_id"]
    simulated(scenario(12), folder)
    grown = published(scenario(12), folder)
    assert grown["runs"]["sweep"]["state"] == "written" and grown["deleted"] == 1
    assert client.get_run(grown["runs"]["sweep"]["run_id"]).data.metrics["designs"] == 12
    assert client.get_run(first["run_id"]).info.lifecycle_stage == "deleted"


def test_what_decides_belongs_to_the_run_where_the_scenario_asks_for_it(folder, client):
    asked = scenario(sensitivity={})
    simulated(asked, folder)
    decided(folder)
    published(asked, folder)
    run = the_run(client)
    assert run.data.metrics["total/stroke by clearance"] == 0.7 and run.data.metrics["q2/noise_share"] == 0.1
    assert not [name for name in run.data.metrics if name.startswith(("total/noise_share", "first_order/noise_share"))]
    names = {one.dataset.name for one in run.inputs.dataset_inputs}
    assert names == {"sweep_designs", *(table.name for table in TABLES)}
    figures = client.list_artifacts(run.info.run_id, "sensitivity/figures")
    assert [file.path for file in figures] == ["sensitivity/figures/indices.png"]


def test_a_scenario_that_asks_for_robust_lengths_alone_has_a_run_too(folder, client):
    asked = scenario(swept={}, optimise_robust={"uncertain": UNCERTAIN})
    robust(folder)
    published(asked, folder)
    run = the_run(client)
    assert run.data.params["optimise_robust.uncertain.friction.to"] == "0.2" and "designs" not in run.data.metrics
    assert run.data.metrics["robust/crank_length_mm"] == pytest.approx(149)
    assert run.data.metrics["robust beside original/probability_percent"] == 87.5
    assert "robust keeps stroke/probability_low_percent" in run.data.metrics


def test_settings_that_the_paper_did_not_print_belong_to_the_run_with_the_shares_that_come_out(folder, client):
    asked = scenario(infer_settings={})
    simulated(asked, folder)
    inferred(folder)
    published(asked, folder)
    run, section = the_run(client), "printed"
    metrics = run.data.metrics
    assert metrics[f"{section}/together_percent"] == pytest.approx(100 / 3)
    assert metrics[f"{section}/best_ratio_in_window_percent"] == pytest.approx(100 / 3)
    assert metrics[f"{section}/farthest_off_in_nearest_percent"] == pytest.approx(4)
    files = {file.path for file in client.list_artifacts(run.info.run_id, "infer_settings")}
    assert files == {"infer_settings/nearest_scenario.yaml"}
    names = {one.dataset.name for one in run.inputs.dataset_inputs}
    assert names == {"sweep_designs", "infer_settings_designs", "infer_settings_settings"}


def test_a_dataset_that_lacks_designs_is_not_published(folder):
    simulated(scenario(), folder)
    (folder / DESIGNS / "part_000001.parquet").unlink()
    with pytest.raises(InputError, match="design 4 is missing"):
        published(scenario(), folder)


def test_options_that_ask_for_no_designs_are_refused(folder):
    with pytest.raises(InputError, match="there is nothing to publish"):
        published(scenario(swept={}), folder)
