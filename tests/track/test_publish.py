"""Publishing: nothing twice, what changed supersedes, what was cut short goes, several at once, no server."""

import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from jointgap import tables
from jointgap.errors import InputError
from jointgap.track.publish import publish
from jointgap.track.store import create_store, default_address
from tests.track.synthetic import benchmark, numbers, scenario


@pytest.fixture
def simulated(results):
    """A scenario of which the simulation is done: what `publish` takes, less the store."""
    folder = results / "made_up"
    trajectory, events = folder / "simulate/trajectory.parquet", folder / "simulate/events.parquet"
    tables.write(tables.TRAJECTORY, numbers(tables.TRAJECTORY, 50, seed=1), trajectory)
    joint, event = ["crank_pin"] * 3 + ["piston_pin"], ["impact", "separation", "impact", "impact"]
    tables.write(tables.EVENTS, numbers(tables.EVENTS, 4, seed=2, joint=joint, event=event), events)
    figure = folder / "figures/figure 5.png"
    figure.parent.mkdir()
    figure.write_bytes(b"a picture")
    return {
        "scenario_name": "made_up",
        "options": scenario(),
        "tables": {"trajectory": trajectory, "events": events},
        "figures": [figure],
        "benchmarks": [benchmark(folder / "benchmarks/simulate.tsv", 3.5)],
        "tracking_uri": None,
        "results_folder": results,
    }


@pytest.fixture
def client(results):
    from mlflow.tracking import MlflowClient

    return MlflowClient(tracking_uri=default_address(results))


def all_runs(client, view="ACTIVE_ONLY"):
    from mlflow.entities import ViewType

    experiments = [found.experiment_id for found in client.search_experiments()]
    return client.search_runs(experiments, run_view_type=ViewType.from_string(view.lower()))


def test_each_stage_has_its_experiment_and_the_run_says_what_it_is(simulated, client):
    done = publish(**simulated)
    assert set(done["runs"]) == {"simulate", "figures"}
    run = client.get_run(done["runs"]["simulate"]["run_id"])
    assert client.get_experiment(run.info.experiment_id).name == "jointgap-simulate"
    assert run.info.status == "FINISHED" and run.info.run_name == "made_up"
    tags = run.data.tags
    assert tags["jointgap.scenario"] == "made_up" and tags["jointgap.stage"] == "simulate"
    assert tags["mlflow.source.git.commit"] and tags["mlflow.note.content"] == "made up"


def test_results_costs_and_configuration_are_logged(simulated, client):
    run = client.get_run(publish(**simulated)["runs"]["simulate"]["run_id"])
    metrics, params = run.data.metrics, run.data.params
    assert metrics["seconds"] == 3.5 and metrics["peak_memory_mb"] == 123.4
    assert metrics["crank_pin_impacts"] == 2 and metrics["piston_pin_impacts"] == 1
    assert params["mechanism.crank.length"] == "0.15" and params["simulate.revolutions"] == "4"
    assert params["mechanism.joints.crank_pin.contact.friction"] == "0.05"
    names = {file.path for file in client.list_artifacts(run.info.run_id)}
    assert names == {"options.json"}


def test_figures_are_kept_with_the_scenario(simulated, client):
    run = publish(**simulated)["runs"]["figures"]["run_id"]
    assert client.download_artifacts(run, "figures/figure 5.png")
    with open(client.download_artifacts(run, "figures/figure 5.png"), "rb") as file:
        assert file.read() == b"a picture"


def test_publishing_twice_logs_nothing_twice(simulated, client):
    first = publish(**simulated)
    second = publish(**simulated)
    assert {run["state"] for run in second["runs"].values()} == {"kept"} and second["deleted"] == 0
    assert [run["run_id"] for run in first["runs"].values()] == [run["run_id"] for run in second["runs"].values()]
    assert len(all_runs(client, "ALL")) == 2


def test_new_timings_of_unchanged_results_change_nothing(simulated):
    publish(**simulated)
    benchmark(simulated["benchmarks"][0], 99.0)
    assert {run["state"] for run in publish(**simulated)["runs"].values()} == {"kept"}


def test_a_changed_option_supersedes_the_runs_that_read_it(simulated, client):
    old = publish(**simulated)["runs"]
    changed = simulated | {"options": scenario(optimise={"ratio_limit": 0.28})}
    new = publish(**changed)
    assert new["runs"]["simulate"]["state"] == "kept"
    assert new["runs"]["figures"]["state"] == "written" and new["deleted"] == 1
    assert client.get_run(old["figures"]["run_id"]).info.lifecycle_stage == "deleted"
    assert len(all_runs(client)) == 2


def test_a_changed_table_supersedes_its_run(simulated, client):
    old = publish(**simulated)["runs"]
    tables.write(tables.TRAJECTORY, numbers(tables.TRAJECTORY, 50, seed=3), simulated["tables"]["trajectory"])
    new = publish(**simulated)["runs"]
    assert new["simulate"]["state"] == "written" and new["figures"]["state"] == "kept"
    assert old["simulate"]["run_id"] not in {run.info.run_id for run in all_runs(client)}


def test_scenarios_do_not_touch_each_others_runs(simulated, client):
    publish(**simulated)
    other = publish(**simulated | {"scenario_name": "other"})
    assert {run["state"] for run in other["runs"].values()} == {"written"} and other["deleted"] == 0
    assert len(all_runs(client)) == 4


def test_a_run_that_was_cut_short_is_replaced(simulated, client):
    experiment = client.create_experiment("jointgap-simulate", (simulated["results_folder"] / "elsewhere").as_uri())
    tags = {"jointgap.scenario": "made_up", "jointgap.stage": "simulate", "jointgap.output": ""}
    client.delete_experiment(experiment)
    client.restore_experiment(experiment)
    cut = client.create_run(experiment, tags=tags).info.run_id
    with pytest.raises(InputError, match="was made elsewhere"):
        publish(**simulated)
    assert client.get_run(cut).info.status == "RUNNING"


def test_an_experiment_that_was_deleted_comes_back(simulated, client):
    run = publish(**simulated)["runs"]["simulate"]["run_id"]
    client.delete_experiment(client.get_run(run).info.experiment_id)
    publish(**simulated)
    assert client.get_experiment_by_name("jointgap-simulate").lifecycle_stage == "active"
    assert len(all_runs(client)) == 2
