"""Publishing: nothing twice, what changed supersedes, what was cut short goes."""

import pytest

from jointgap import tables
from jointgap.core.errors import InputError
from jointgap.track.publish import publish
from tests.track.synthetic import benchmark, numbers, scenario


def all_runs(client, deleted: bool = False):
    from mlflow.entities import ViewType

    experiments = [found.experiment_id for found in client.search_experiments()]
    return client.search_runs(experiments, run_view_type=ViewType.ALL if deleted else ViewType.ACTIVE_ONLY)


def states(summary) -> dict[str, str]:
    return {name: run["state"] for name, run in summary["runs"].items()}


def test_each_stage_has_its_experiment_and_the_run_says_what_it_is(simulated, client):
    done = publish(**simulated)
    assert states(done) == {"simulate": "written", "figures": "written"}
    run = client.get_run(done["runs"]["simulate"]["run_id"])
    assert client.get_experiment(run.info.experiment_id).name == "jointgap-simulate"
    assert run.info.status == "FINISHED" and run.info.run_name == "made_up"
    tags = run.data.tags
    assert tags["jointgap.scenario"] == "made_up" and tags["jointgap.stage"] == "simulate"
    assert tags["mlflow.source.git.commit"] and tags["mlflow.note.content"] == "made up"


def test_publishing_twice_logs_nothing_twice(simulated, client):
    first = publish(**simulated)
    second = publish(**simulated)
    assert set(states(second).values()) == {"kept"} and second["deleted"] == 0
    assert [run["run_id"] for run in first["runs"].values()] == [run["run_id"] for run in second["runs"].values()]
    assert len(all_runs(client, deleted=True)) == 2


def test_new_timings_of_unchanged_results_change_nothing(simulated):
    publish(**simulated)
    benchmark(simulated["benchmarks"][0], 99.0)
    assert set(states(publish(**simulated)).values()) == {"kept"}


def test_a_changed_option_supersedes_the_runs_that_read_it(simulated, client):
    old = publish(**simulated)["runs"]
    new = publish(**simulated | {"options": scenario(optimise={"ratio_limit": 0.28})})
    assert states(new) == {"simulate": "kept", "figures": "written"} and new["deleted"] == 1
    assert client.get_run(old["figures"]["run_id"]).info.lifecycle_stage == "deleted"
    assert len(all_runs(client)) == 2


def test_a_changed_table_supersedes_its_run(simulated, client):
    old = publish(**simulated)["runs"]
    tables.write(tables.TRAJECTORY, numbers(tables.TRAJECTORY, 50, salt=3), simulated["tables"]["trajectory"])
    assert states(publish(**simulated)) == {"simulate": "written", "figures": "kept"}
    assert old["simulate"]["run_id"] not in {run.info.run_id for run in all_runs(client)}


def test_scenarios_do_not_touch_each_others_runs(simulated, client):
    publish(**simulated)
    other = publish(**simulated | {"scenario_name": "other"})
    assert set(states(other).values()) == {"written"} and other["deleted"] == 0
    assert len(all_runs(client)) == 4


def test_a_run_that_was_cut_short_is_replaced(simulated, client):
    whole = publish(**simulated)["runs"]["simulate"]["run_id"]
    run = client.get_run(whole)
    cut = client.create_run(run.info.experiment_id, tags={**run.data.tags, "jointgap.complete": "false"})
    client.delete_run(whole)
    done = publish(**simulated)
    assert states(done) == {"simulate": "written", "figures": "kept"}
    assert client.get_run(cut.info.run_id).info.lifecycle_stage == "deleted"
    assert [run.info.status for run in all_runs(client)] == ["FINISHED"] * 2


def test_a_run_killed_after_it_was_marked_complete_but_before_it_ended_is_replaced(simulated, client):
    run = client.get_run(publish(**simulated)["runs"]["simulate"]["run_id"])
    client.set_terminated(run.info.run_id, "KILLED")
    assert states(publish(**simulated))["simulate"] == "written"


def test_nested_runs_follow_a_new_parent(learned, client):
    old = publish(**learned)["runs"]
    parent = client.get_run(old["surrogate"]["run_id"])
    client.delete_run(parent.info.run_id)
    new = publish(**learned)
    assert states(new)["surrogate"] == "written" and states(new)["surrogate/r2"] == "kept"
    nested = client.get_run(new["runs"]["surrogate/r2"]["run_id"])
    assert nested.data.tags["mlflow.parentRunId"] == new["runs"]["surrogate"]["run_id"] != parent.info.run_id


def test_an_output_that_is_no_longer_there_leaves_the_experiment(learned, client):
    publish(**learned)
    for table in ("fit", "fit_history", "fit_errors"):
        del learned["tables"][f"{table}/r3"]
    done = publish(**learned)
    assert "surrogate/r3" not in done["runs"]
    assert "made_up r3" not in {run.info.run_name for run in all_runs(client)}


def test_an_experiment_that_was_deleted_comes_back(simulated, client):
    run = publish(**simulated)["runs"]["simulate"]["run_id"]
    client.delete_experiment(client.get_run(run).info.experiment_id)
    publish(**simulated)
    assert client.get_experiment_by_name("jointgap-simulate").lifecycle_stage == "active"
    assert len(all_runs(client)) == 2


def test_a_store_that_was_moved_with_its_folder_is_refused(simulated, tmp_path):
    publish(**simulated)
    moved = simulated["results_folder"].rename(tmp_path / "moved")
    files = {name: moved / "made_up" / f"{name}.parquet" for name in simulated["tables"]}
    elsewhere = simulated | {"tables": files, "figures": [], "benchmarks": [], "results_folder": moved}
    with pytest.raises(InputError, match=r"mlflow\.db was made elsewhere.*put it back there, or move the file away"):
        publish(**elsewhere)
