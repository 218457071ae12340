"""The stage: brings the store in line with one scenario's finished tables.

Each run is known by scenario, stage and output, and by a digest of all it holds. What is there unchanged is kept,
what changed is written anew and its old run deleted, what was cut short is deleted. Going twice logs nothing twice, and
neither do two processes at once: where no lock keeps the others out, each looks afterwards what the others wrote, and
all keep the same run.
"""

import getpass
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jointgap import __version__
from jointgap.config import Scenario
from jointgap.core.page import markdown_text
from jointgap.track.experiment_views import NOTE, TAG, VIEWS
from jointgap.track.mlflow_store import Store, StoredRun, address_for, opened
from jointgap.track.run_record import Record
from jointgap.track.scenario_runs import records
from jointgap.track.store_trouble import without_password

SCENARIO, STAGE, OUTPUT, DIGEST = (f"jointgap.{key}" for key in ("scenario", "stage", "output", "digest"))
PARENT, COLOUR = "mlflow.parentRunId", "mlflow.runColor"

_COLOURS = (
    *("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf"),
    *("#08306b", "#7f2704", "#00441b", "#67000d", "#3f007d", "#aec7e8", "#ffbb78", "#98df8a", "#ff9896", "#c5b0d5"),
)
"""Of scenarios: MLflow's own follow from the runs' numbers, and with ten of them some are alike."""

_LONGEST_PUBLISHING = 3_600_000
"""Milliseconds after which a run that is not complete was cut short, on a server that others write to: publishing takes
seconds, minutes over a slow line.
"""


@dataclass(frozen=True)
class _Scenario:
    """What all runs of one going share."""

    name: str
    description: str
    commit: str
    user: str


def publish(
    scenario_name: str,
    options: Scenario,
    sections: Mapping[str, Sequence[str]],
    tables: Mapping[str, Path],
    figures: Sequence[Path],
    benchmarks: Sequence[Path],
    tracking_uri: str | None,
    results_folder: Path,
) -> dict:
    """Publish what one scenario's stages wrote."""
    content = records(options, sections, tables, figures, benchmarks)
    return publish_records(scenario_name, options.description, content, tracking_uri, results_folder)


def publish_records(
    name: str, description: str, content: list[Record], tracking_uri: str | None, results_folder: Path
) -> dict:
    """Publish records of any kind."""
    shared = _Scenario(name, description, commit(), _user())
    address = address_for(results_folder, tracking_uri)
    runs, deleted = {}, 0
    with opened(address, results_folder) as store:
        for stage in dict.fromkeys(record.stage for record in content):
            mine = [record for record in content if record.stage == stage]
            done, gone = _publish_stage(store, shared, stage, mine)
            runs |= done
            deleted += gone
    return {"store": without_password(address), "scenario": name, "runs": runs, "deleted": deleted}


def _publish_stage(store: Store, shared: _Scenario, stage: str, content: list[Record]) -> tuple[dict, int]:
    """Bring one experiment in line; what became of each run, and how many old ones were deleted."""
    experiment = store.experiment(stage)
    if stage in VIEWS:
        store.describe(experiment, {TAG: VIEWS[stage].state()}, {NOTE: VIEWS[stage].note})
    present = store.runs(experiment, {SCENARIO: shared.name})
    valid, colour = _valid(present), _colour(store, experiment, present)
    newest = max((run.begun for run in present), default=0)
    written, parent = set(), None
    for record in content:  # the stage's own run comes first, the nested ones name it
        run = valid.get(record.output)
        if run is not None and run.tags.get(DIGEST) == record.digest:
            run_id = run.run_id
            if COLOUR not in run.tags:  # an earlier version wrote it
                store.tag(run_id, COLOUR, colour)
        else:
            tags = _tags(shared, record, parent) | {COLOUR: colour}
            run_id = store.write(experiment, _name(shared, record), record, tags, newest)
            written.add(run_id)
        if not record.nested:
            parent = run_id
    valid, deleted = _settle(store, experiment, shared, {record.output for record in content})
    done = {}
    for record in content:
        run = valid.get(record.output)
        if run is not None:  # none where another machine has published something else meanwhile
            key = f"{stage}/{record.output}" if record.nested else stage
            state = "written" if run.run_id in written else "kept"
            done[key] = {"run_id": run.run_id, "digest": run.tags[DIGEST], "state": state}
    return done, deleted


def _settle(store: Store, experiment: str, shared: _Scenario, outputs: set[str]) -> tuple[dict[str, StoredRun], int]:
    """Leave one run of each output, the nested ones under that of the stage: which, and how many were deleted.

    Where others write meanwhile, all of them come to the same choice, since it depends on the runs alone: it is looked
    at again until nothing is left to do, and whoever is done last has seen every run.
    """
    deleted = 0
    while True:
        present = store.runs(experiment, {SCENARIO: shared.name})
        valid = {output: run for output, run in _valid(present).items() if output in outputs}
        kept = {run.run_id for run in valid.values()}
        superseded = [run for run in present if run.run_id not in kept and (run.complete or _given_up(store, run))]
        parent = valid[""].run_id if "" in valid else None
        elsewhere = [run for output, run in valid.items() if output and run.tags.get(PARENT) != parent]
        for run in elsewhere if parent else ():
            store.tag(run.run_id, PARENT, parent)
        for run in superseded:
            store.delete(run.run_id)
        deleted += len(superseded)
        if not superseded and not (parent and elsewhere):
            return valid, deleted


def _valid(present: list[StoredRun]) -> dict[str, StoredRun]:
    """By output the run that counts: of those that hold what the newest complete one holds, the oldest."""
    valid = {}
    complete = [run for run in present if run.complete and OUTPUT in run.tags]
    for run in sorted(complete, key=lambda run: (run.begun, run.run_id)):
        before = valid.get(run.tags[OUTPUT])
        if before is None or before.tags.get(DIGEST) != run.tags.get(DIGEST):
            valid[run.tags[OUTPUT]] = run
    return valid


def _given_up(store: Store, run: StoredRun) -> bool:
    """Whether nobody goes on with a run that is not complete."""
    return store.exclusive or time.time_ns() // 10**6 - run.begun > _LONGEST_PUBLISHING


def _colour(store: Store, experiment: str, present: list[StoredRun]) -> str:
    """The colour of a scenario: that of its runs, else the first one that no other scenario of the experiment has."""
    own = next((run.tags[COLOUR] for run in present if COLOUR in run.tags), None)
    if own is not None:
        return own
    taken = [run.tags.get(COLOUR) for run in store.runs(experiment, {OUTPUT: ""})]
    return next((colour for colour in _COLOURS if colour not in taken), _COLOURS[len(taken) % len(_COLOURS)])


def _name(shared: _Scenario, record: Record) -> str:
    return f"{shared.name} {record.output}".strip()


def _tags(shared: _Scenario, record: Record, parent: str | None) -> dict[str, str]:
    tags = {
        SCENARIO: shared.name,
        STAGE: record.stage,
        OUTPUT: record.output,
        DIGEST: record.digest,
        "jointgap.version": __version__,
        "mlflow.source.name": "jointgap track",
        "mlflow.source.type": "LOCAL",
        "mlflow.source.git.commit": shared.commit,
        "mlflow.user": shared.user,
        "mlflow.note.content": markdown_text(shared.description),
    }
    tags |= {f"jointgap.{name}": text for name, text in record.notes.items()}
    return tags | ({PARENT: parent} if record.nested else {})


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container may run under a number that has no name
        return "unknown"


def commit(folder: Path = Path(__file__).parent) -> str:
    """The commit that `folder` is checked out at, with ``-changed`` where tracked files differ; ``unknown`` outside
    git.
    """
    head = _git(folder, "rev-parse", "HEAD")
    tracked = _git(folder, "ls-files", "--error-unmatch", ".")  # a package in .venv of another project is not tracked
    if head is None or tracked is None:
        return "unknown"
    return head.strip() + ("-changed" if _git(folder, "diff-index", "--name-only", "HEAD") else "")


def _git(folder: Path, *words: str) -> str | None:
    # a checkout that belongs to another user is only read, so it may be trusted
    command = ["git", "-C", str(folder), "-c", "safe.directory=*", *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout if done.returncode == 0 else None
