"""Trials drawn and analysed in processes of their own, with a limit of processor time.

Each result is a file, written beside its place and renamed, so interrupted runs resume and several
runs may share a folder.
"""

import json
import math
import multiprocessing
import os
import resource
import signal
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

from jointgap.core.files import write_text
from validation.analyse import analyse_trial
from validation.kinds import Trial
from validation.score import UNFINISHED
from validation.trial import make_trial


def in_process(function: Callable[[], Any], seconds: float = 0.0) -> tuple[Any, str]:
    """The result of `function` in a process of its own, and why there is none ("" if there is).

    The process ends after `seconds` of processor time; 0: no limit.
    """
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_send_result, args=(function, seconds, sender))
    process.start()
    sender.close()
    try:
        result, error = receiver.recv(), ""
    except EOFError:
        result, error = None, "the process ended early"
    process.join()
    if error and process.exitcode == -signal.SIGPROF:
        error = UNFINISHED
    return result, error


def _send_result(function: Callable[[], Any], seconds: float, sender: Any) -> None:
    signal.setitimer(signal.ITIMER_PROF, seconds)
    sender.send(function())


def write_record(path: Path, record: Mapping[str, Any]) -> None:
    """Write a record as JSON."""
    write_text(path, json.dumps(record, indent=1, allow_nan=False) + "\n")


def draw_trial(plan: Trial, seed: int, campaign: Path, truth: Path) -> None:
    """Write the campaign and the ground truth of a trial of the set with `seed`, unless both exist.

    RuntimeError if the trial cannot be drawn.
    """
    if truth.is_file() and campaign.is_dir():
        return
    campaign.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=campaign.parent, prefix=".") as temporary:
        drawn = Path(temporary) / campaign.name
        record, error = in_process(partial(make_trial, plan, seed, drawn))
        if error:
            raise RuntimeError(f"trial {plan.id} cannot be drawn: {error}")
        if not campaign.is_dir():
            drawn.rename(campaign)
    write_record(truth, record)


def analyse_within(
    path: Path, trial: str, analyse: Callable[[], dict[str, Any]], seconds: float = 0.0
) -> dict[str, Any]:
    """Write the record of `analyse`, an analysis of a trial, to `path`; the record.

    After `seconds` of processor time (0: no limit) the analysis is unfinished. The record has the
    version of the code.
    """
    begin = _seconds_of_children()
    record, error = in_process(analyse, seconds)
    if error:
        record = {"id": trial, "error": error, "seconds": round(_seconds_of_children() - begin, 3)}
    record = {**record, "code": code_version()}
    write_record(path, record)
    return record


def _seconds_of_children() -> float:
    """Processor time [s] of ended child processes."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


@cache
def code_version() -> str:
    """The first digits of the hash of the commit at the first call, and whether files differ from
    it; empty without Git."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    root = Path(__file__).parents[1]
    try:
        described = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return described.stdout.strip()


def identify(campaign: Path) -> dict[str, Any]:
    """The record of `analyse_trial` without other packages, which take longer to load than some
    analyses take."""
    return analyse_trial(campaign, others=False)


def run_trials(
    plans: Sequence[Trial],
    seed: int,
    folder: Path,
    seconds: float = 120.0,
    budget: float = math.inf,
    cores: int = 1,
    analyse: Callable[[Path], dict[str, Any]] = identify,
) -> None:
    """Draw and analyse trials of the set with `seed`: ``campaigns/``, ``truth/`` and ``verdicts/``
    in `folder`. Files that exist are kept.

    An analysis ends unfinished after `seconds` of processor time. No trial begins after `budget`
    seconds of processor time.
    """
    code_version()  # of the code that is loaded, whatever is committed during the run
    context = multiprocessing.get_context("fork")
    position, parent = context.Value("i", 0), os.getpid()

    def work() -> None:
        # ends with its parent, so a killed run does not continue
        while os.getppid() == parent and _seconds_of_children() < budget / cores:
            with position.get_lock():
                number, position.value = position.value, position.value + 1
            if number >= len(plans):
                return
            _run_trial(plans[number], seed, folder, seconds, analyse)

    workers = [context.Process(target=work) for _ in range(cores)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()


def _run_trial(plan: Trial, seed: int, folder: Path, seconds: float, analyse: Callable) -> None:
    campaign, name = folder / "campaigns" / plan.id, f"{plan.id}.json"
    verdict = folder / "verdicts" / name
    if verdict.is_file():
        return
    try:
        draw_trial(plan, seed, campaign, folder / "truth" / name)
    except RuntimeError as error:
        print(error, flush=True)
        return
    record = analyse_within(verdict, plan.id, partial(analyse, campaign), seconds)
    print(f"{plan.number}: {summary(record)}", flush=True)


def summary(record: Mapping[str, Any]) -> str:
    """A line on the record of an analysis."""
    outcome = record["verdict"]["verdict"] if "verdict" in record else record["error"]
    return f"{record['id']}: {outcome}, {record['seconds']:.1f} CPU-s"
