"""The whole chain with the smoke configuration, run as a user runs it."""

import json
import os
import re
import signal
import subprocess
import time

import pytest

from benchmarks.project import ROOT, SMOKE_REPORT, copy_project, environment, in_venv, run, smoke_command

pytestmark = pytest.mark.integration

STAGES = ("simulate", "surrogate", "kinematics", "optimise")


def tables(folder):
    """Content of every Parquet file of the smoke scenario, by path; not the hidden files that a killed write leaves."""
    files = [path for path in (folder / "results/smoke").rglob("*.parquet") if not path.name.startswith(".")]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def test_smoke_runs_end_to_end_in_a_path_with_a_space_and_without_a_home(smoke):
    results = smoke.folder / "results"
    assert (results / "smoke/comparison.md").stat().st_size > 0
    told = json.loads((results / "smoke/summary.json").read_text(encoding="utf-8"))
    said = smoke.first.stdout + smoke.first.stderr
    assert "page of smoke: results/smoke/summary.html" in said and all(remark in said for remark in told["remarks"])
    assert (smoke.folder / SMOKE_REPORT).stat().st_size > 0
    for stage in STAGES:
        assert list((results / "smoke" / stage).rglob("*.parquet")), stage


def test_the_runs_in_mlflow_are_those_of_the_golden_list(smoke):
    """Names, parents, metrics, lengths of curves and artifacts, as they were before the package was halved."""
    wanted = {
        name: {key: value for key, value in group.items() if key != "runs"}
        for group in json.loads((ROOT / "tests/golden/smoke_runs.json").read_text())
        for name in group["runs"]
    }
    found = published(f"sqlite:///{smoke.folder / 'results/mlflow.db'}")
    assert set(found) == set(wanted)
    for name, held in found.items():
        assert held == wanted[name], name


def published(store: str) -> dict[str, dict]:
    """What the runs of a store hold, by the names of their experiment and their own."""
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=store)
    experiments = {found.experiment_id: found.name for found in client.search_experiments()}
    runs = client.search_runs(list(experiments), max_results=1000)
    names = {one.info.run_id: one.info.run_name for one in runs}

    def artifacts(run_id: str, folder: str | None = None) -> list[str]:
        listed = client.list_artifacts(run_id, folder)
        return [path for file in listed for path in (artifacts(run_id, file.path) if file.is_dir else [file.path])]

    held = {}
    for one in runs:
        lengths = {name: len(client.get_metric_history(one.info.run_id, name)) for name in one.data.metrics}
        held[f"{experiments[one.info.experiment_id]}/{one.info.run_name}"] = {
            "parent": names.get(one.data.tags.get("mlflow.parentRunId")),
            "metrics": sorted(name for name, length in lengths.items() if length == 1),
            "curves": {name: length for name, length in lengths.items() if length > 1},
            "artifacts": sorted(artifacts(one.info.run_id)),
        }
    return held


def test_a_dry_run_says_what_would_be_done_and_writes_no_report(fresh_project):
    done = run(fresh_project, *smoke_command("--cores", "1", "--dry-run"))
    assert done.returncode == 0, done.stderr
    assert "This was a dry-run" in done.stdout + done.stderr
    assert not tables(fresh_project)
    assert not (fresh_project / SMOKE_REPORT).exists()


def test_a_project_in_a_folder_that_snakemake_cannot_take_says_so(tmp_path):
    done = run(copy_project(tmp_path / "a {b}"), "snakemake", "--cores", "1", "--dry-run")
    said = done.stdout + done.stderr
    assert done.returncode == 1 and "a {b} has a brace in its path" in said and "rename it" in said
    assert "Traceback" not in said


def test_a_second_run_has_nothing_to_do(smoke):
    (smoke.folder / "results/bench.json").write_text("{}")  # what `make bench` and the dashboard write
    os.utime(smoke.folder / "results/mlflow.db")
    before = {path: path.stat().st_mtime_ns for path in (smoke.folder / "results").rglob("*") if path.is_file()}
    again = run(smoke.folder, *smoke_command("--cores", "2"))
    assert again.returncode == 0, again.stderr
    assert "Nothing to be done" in again.stdout + again.stderr
    assert "writing" not in again.stdout
    after = {path: path.stat().st_mtime_ns for path in (smoke.folder / "results").rglob("*") if path.is_file()}
    assert after == before


@pytest.mark.parametrize(
    ("lost", "rules"),
    [
        ("simulate/trajectory.parquet", {"simulate", "surrogate", "compare", "figures", "track"}),
        ("surrogate/r2/history.parquet", {"surrogate", "figures", "track"}),
        ("kinematics/contradictions.parquet", {"kinematics", "figures", "track"}),
        ("figures/contact_forces.png", {"figures", "summarise", "track"}),
        ("comparison.html", {"compare", "track"}),
    ],
)
def test_a_lost_file_is_made_again_though_all_that_was_made_of_it_is_there(smoke, tmp_path, lost, rules):
    place = smoke.folder / "results/smoke" / lost
    place.rename(tmp_path / "kept")
    try:
        done = run(smoke.folder, *smoke_command("--cores", "1", "--dry-run", "--quiet", "rules"))
    finally:
        (tmp_path / "kept").rename(place)
    assert done.returncode == 0, done.stderr
    assert rules <= set(re.findall(r"^(\w+) +\d+$", done.stdout + done.stderr, re.MULTILINE))


def test_a_changed_option_reruns_its_stage_and_nothing_before_it(smoke):
    changed = smoke.folder.parent / "changed.yaml"
    text = (smoke.folder / "config/smoke.yaml").read_text()
    changed.write_text(text.replace("population: 8", "population: 10"))
    assert changed.read_text() != text
    done = run(smoke.folder, "snakemake", "--configfile", str(changed), "--dry-run", "--quiet", "rules", "--cores", "1")
    assert done.returncode == 0, done.stderr
    printed = done.stdout + done.stderr
    assert "optimise" in printed
    assert "simulate" not in printed.split("optimise")[0]
    assert "surrogate" not in printed


def test_a_killed_run_goes_on_and_ends_with_the_same_bytes_on_one_core(smoke, fresh_project):
    wanted = [name for name in tables(smoke.folder) if "/surrogate/" in name or "/optimise/" in name]
    command = smoke_command("--cores", "1")
    killed = subprocess.Popen(
        in_venv(*command),
        cwd=fresh_project,
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while not tables(fresh_project) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait()
    assert 0 < len(tables(fresh_project)) < len(wanted)

    done = run(fresh_project, *command)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    assert tables(fresh_project) == tables(smoke.folder)
