"""The chain with the smoke configuration, as a user runs it."""

import json
import os
import re
import shutil

import pytest

from benchmarks.project import ROOT, SMOKE_REPORT, copy_project, run, smoke_command
from jointgap.scenario.figures import FIGURES
from tests.scenario.mlflow_store import client_of, runs_of
from tests.workflow.conftest import tables

pytestmark = pytest.mark.integration

STILL = [FIGURES[name] for name in FIGURES.still]


def text_of(page: str) -> str:
    """Visible text of a page."""
    return " ".join(
        re.sub("<[^>]*>", "", page.partition("</style>")[2]).replace("&#39;", "'").split()
    )


def jobs(done) -> set[str]:
    """Rules that a dry run would run."""
    assert done.returncode == 0, done.stderr
    return set(re.findall(r"^(\w+) +\d+$", done.stdout + done.stderr, re.MULTILINE))


def dry_run(folder, config="config/smoke.yaml", *options: str):
    command = ("snakemake", "--configfile", config, "--dry-run", "--quiet", "rules", "--cores", "1")
    return jobs(run(folder, *command, *options))


def test_a_killed_run_resumes_to_the_end(smoke):
    results = smoke.folder / "results"
    assert 0 < smoke.left < len(tables(smoke.folder))
    assert (results / "smoke/comparison.md").stat().st_size > 0
    assert (smoke.folder / SMOKE_REPORT).stat().st_size > 0
    summary = json.loads((results / "smoke/summary.json").read_text(encoding="utf-8"))
    said = smoke.last.stdout + smoke.last.stderr
    assert "page of smoke: results/smoke/summary.html" in said
    assert all(remark in said for remark in summary["remarks"])
    for stage in ("simulate", "surrogate", "kinematics", "optimise"):
        assert list((results / "smoke" / stage).rglob("*.parquet")), stage


def test_a_resumed_run_has_the_bytes_of_an_undisturbed_one(smoke, fresh_project):
    targets = [f"results/smoke/surrogate/{output}/history.parquet" for output in ("r2", "gamma3")]
    done = run(
        fresh_project, "snakemake", *targets, "--configfile", "config/smoke.yaml", "--cores", "1"
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    wanted, found = tables(smoke.folder), tables(fresh_project)
    assert len(found) > 4 and {name: wanted[name] for name in found} == found


def test_the_report_is_one_small_file_with_all_figures(smoke):
    report = (smoke.folder / SMOKE_REPORT).read_text(encoding="utf-8")
    assert len(report) < 10e6 and "name='viewport'" in report  # fits a phone
    assert not re.search(r"<(script|link|iframe)\b", report)
    assert set(re.findall(r"<img [^>]*src='([^:]*:)", report)) == {"data:"}
    headline = report.partition("<h1>")[2].partition("</h1>")[0]
    assert re.match(
        r"Crank [\d.]+\smm, rod [\d.]+\smm: error of the transmission angle [\d.]+\s% smaller$",
        headline,
    )
    assert report.index("<h1>") < report.index("<img") < report.index("<h2")
    text = text_of(report)
    places = [text.index(f". {spec.title}. {spec.caption}") for spec in STILL]
    order = list(dict.fromkeys(spec.category for spec in STILL))
    by_category = sorted(zip([order.index(spec.category) for spec in STILL], places, strict=True))
    assert [place for _, place in by_category] == sorted(places)


def test_mlflow_runs_match_the_golden_list(smoke):
    """Names, parents, metrics, lengths of curves and artifacts."""
    wanted = {
        name: {key: value for key, value in group.items() if key != "runs"}
        for group in json.loads((ROOT / "tests/golden/smoke_runs.json").read_text())
        for name in group["runs"]
    }
    client = client_of(smoke.folder / "results")
    runs = runs_of(client)
    names = {one.info.run_id: one.info.run_name for one in runs.values()}

    def artifacts(run_id: str, folder: str | None = None) -> list[str]:
        listed = client.list_artifacts(run_id, folder)
        return [
            path
            for file in listed
            for path in (artifacts(run_id, file.path) if file.is_dir else [file.path])
        ]

    assert runs.keys() == wanted.keys()
    for name, one in runs.items():
        own = wanted[name]
        lengths = {
            metric: len(client.get_metric_history(one.info.run_id, metric))
            for metric in one.data.metrics
        }
        if "optimise" in name:  # which of several starts is the best may hang on the last bits
            lengths |= {
                metric: length
                for metric, length in own["curves"].items()
                if lengths.get(metric, 0) > 1
            }
        assert own == {
            "parent": names.get(one.data.tags.get("mlflow.parentRunId")),
            "metrics": sorted(metric for metric, length in lengths.items() if length == 1),
            "curves": {metric: length for metric, length in lengths.items() if length > 1},
            "artifacts": sorted(artifacts(one.info.run_id)),
        }, name


def test_a_dry_run_writes_no_report_and_braces_in_a_path_are_refused(fresh_project):
    done = run(fresh_project, *smoke_command("--cores", "1", "--dry-run"))
    assert done.returncode == 0, done.stderr
    assert "This was a dry-run" in done.stdout + done.stderr
    assert not tables(fresh_project) and not (fresh_project / SMOKE_REPORT).exists()
    done = run(
        copy_project(fresh_project.parent / "a {b}"), "snakemake", "--cores", "1", "--dry-run"
    )
    said = done.stdout + done.stderr
    assert done.returncode == 1 and "a {b} has a brace in its path" in said and "rename it" in said
    assert "Traceback" not in said


def test_a_second_run_has_nothing_to_do(smoke):
    def written():
        return {
            path: path.stat().st_mtime_ns
            for path in (smoke.folder / "results").rglob("*")
            if path.is_file()
        }

    # what `make bench` and the dashboard write
    (smoke.folder / "results/bench.json").write_text("{}")
    os.utime(smoke.folder / "results/mlflow.db")
    before = written()
    again = run(smoke.folder, *smoke_command("--cores", "2"))
    assert again.returncode == 0, again.stderr
    assert "Nothing to be done" in again.stdout + again.stderr and "writing" not in again.stdout
    assert written() == before


def test_lost_files_are_made_again(smoke, tmp_path):

    pages = ["kinematics/contradictions.parquet", "figures/contact_forces.png", "comparison.html"]
    cases = [
        (
            ["simulate/trajectory.parquet"],
            {"simulate", "surrogate", "compare", "figures", "track"},
            set(),
        ),
        (
            pages,
            {"kinematics", "figures", "summarise", "compare", "track"},
            {"simulate", "surrogate", "optimise"},
        ),
    ]
    for lost, rules, others in cases:
        places = [smoke.folder / "results/smoke" / one for one in lost]
        for number, place in enumerate(places):
            shutil.move(place, tmp_path / str(number))
        try:
            planned = jobs(
                run(smoke.folder, *smoke_command("--cores", "1", "--dry-run", "--quiet", "rules"))
            )
        finally:
            for number, place in enumerate(places):
                shutil.move(tmp_path / str(number), place)
        assert rules <= planned and not others & planned


def test_a_changed_option_reruns_its_stage_only(smoke):
    changed = smoke.folder.parent / "changed.yaml"
    text = (smoke.folder / "config/smoke.yaml").read_text()
    changed.write_text(text.replace("population: 8", "population: 10"))
    assert changed.read_text() != text
    planned = dry_run(smoke.folder, str(changed))
    assert "optimise" in planned and not {"simulate", "surrogate"} & planned
