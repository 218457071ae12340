"""What all drills share: rows of the table, failures kept with their input, and cases judged in processes with limits.

A drill of many cases makes each from a seed and judges it in a worker process. A case that hangs, needs too much memory
or kills its worker is a failure of that case; the others go on.
"""

import json
import multiprocessing
import os
import re
import resource
import shutil
import signal
import tempfile
import time
import traceback
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

Case = dict[str, Any]
"""Input of one case: what JSON can hold, so that a failure can be kept and judged again."""

KEPT_OF_A_KIND = 3
"""Failures alike of which the input is kept; more say nothing new."""

_WORKERS = 2
_MEBIBYTE = 2**20
_OBEYED = ("Cc", "Cf", "Zl", "Zp", "Cs")  # control, direction, line breaks, halves of pairs


class Complaint(NamedTuple):
    """What is wrong with a case: of which kind, the same words for all alike, and the details."""

    kind: str
    details: str


Answers = dict[str, Complaint | None]
"""By the question that a case was judged by: what is wrong, None where nothing is."""


@dataclass(frozen=True)
class Failure:
    """A case with what was wrong with it."""

    question: str
    complaint: Complaint
    index: int
    case: Case


@dataclass
class Row:
    """A line of the table: how many cases a question was asked of, and the failures among them."""

    what: str
    count: int = 0
    failures: list[Failure] = field(default_factory=list)
    seconds: float = 0.0
    seed: int = 0
    remark: str = ""

    @property
    def kinds(self) -> Counter[str]:
        """How many failures there are of each kind."""
        return Counter(failure.complaint.kind for failure in self.failures)


@dataclass(frozen=True)
class Sitting:
    """One go through the drills: its seed, and the share of the full counts that is drilled."""

    seed: int = 0
    scale: float = 1.0

    def of(self, count: int) -> int:
        """`count` cases at full scale; one at least."""
        return max(1, round(count * self.scale))

    def random(self, drill: str, index: int) -> np.random.Generator:
        """The random numbers of one case of a drill; those of another case are independent of them."""
        return np.random.default_rng([self.seed, index, *drill.encode()])


@dataclass(frozen=True)
class Drill:
    """Something to go through.

    Attributes
    ----------
    name : str
    run : callable
        From a `Sitting` to rows of the table.
    judge : callable, optional
        Judges the kept input of a failure again; None where a failure is no matter of an input.
    """

    name: str
    run: Callable[[Sitting], list[Row]]
    judge: Callable[[Case], Answers] | None = None


@dataclass(frozen=True)
class Sweep:
    """Many independent cases, judged in worker processes.

    Attributes
    ----------
    name : str
    count : int
        Cases at full scale.
    make : callable
        From random numbers to a case.
    judge : callable
        From a case and an empty folder to answers.
    prepare : callable
        Loads what all cases need, once, before the workers are forked.
    limit_s, memory_mb : float, int
        What one case may take: seconds on the clock, and memory beyond that of the prepared process.
    """

    name: str
    count: int
    make: Callable[[np.random.Generator], Case]
    judge: Callable[[Case, Path], Answers]
    prepare: Callable[[], None] = lambda: None
    limit_s: float = 20.0
    memory_mb: int = 1500

    def drill(self) -> Drill:
        """The sweep as a drill."""
        return Drill(self.name, self.run, self.judge_again)

    def run(self, sitting: Sitting) -> list[Row]:
        """Judge all cases; a row for each question, in the order in which they first came up."""
        began, rows = time.monotonic(), {}
        self.prepare()
        for index, answers in _judged(self, sitting, sitting.of(self.count)):
            for question, complaint in answers.items():
                row = rows.setdefault(question, Row(f"{self.name}: {question}", seed=sitting.seed))
                row.count += 1
                if complaint is not None:
                    case = self.make(sitting.random(self.name, index))
                    row.failures.append(Failure(question, Complaint(*complaint), index, case))
        for row in rows.values():
            row.seconds = time.monotonic() - began
        return list(rows.values())

    def judge_again(self, case: Case) -> Answers:
        """Judge one case, in a worker like all others."""
        self.prepare()
        once = Sweep(self.name, 1, lambda _: case, self.judge, limit_s=self.limit_s, memory_mb=self.memory_mb)
        return next(answers for _, answers in _judged(once, Sitting(), 1))


ENDS = "ends within its limits"
"""The question that the watchdog asks."""


@dataclass
class _Worker:
    """A process that judges the cases `todo`, the next one first."""

    process: multiprocessing.Process
    messages: Connection
    todo: list[int]
    deadline: float


def _judged(sweep: Sweep, sitting: Sitting, count: int) -> Iterator[tuple[int, Answers]]:
    """Number and answers of each case, as they come."""
    shares = [list(range(first, count, _WORKERS)) for first in range(min(_WORKERS, count))]
    workers = [_start(sweep, sitting, share) for share in shares]
    try:
        while workers:
            ready = wait([worker.messages for worker in workers], timeout=0.2)
            for worker in list(workers):
                ended = _advance(worker, sweep, worker.messages in ready)
                yield from ended
                if not worker.todo:
                    workers.remove(worker)
                    worker.process.join()
                elif ended and ENDS in ended[-1][1]:  # its process is gone
                    workers.remove(worker)
                    workers.append(_start(sweep, sitting, worker.todo))
    finally:
        for worker in workers:
            worker.process.kill()


def _advance(worker: _Worker, sweep: Sweep, ready: bool) -> list[tuple[int, Answers]]:
    """What a worker has told; of a case that hung or killed its process, which then is over, that this was so."""
    complaint = None
    if ready:
        try:
            answers = worker.messages.recv()
            worker.deadline = time.monotonic() + sweep.limit_s
            return [(worker.todo.pop(0), answers)]
        except EOFError:
            worker.process.join()
            complaint = Complaint("kills its process", f"exit code {worker.process.exitcode}")
    elif time.monotonic() > worker.deadline:
        worker.process.kill()
        worker.process.join()
        complaint = Complaint("hangs", f"no answer within {sweep.limit_s:g} s")
    return [] if complaint is None else [(worker.todo.pop(0), {ENDS: complaint})]


def _start(sweep: Sweep, sitting: Sitting, todo: list[int]) -> _Worker:
    here, there = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=_work, args=(sweep, sitting, list(todo), there))
    process.start()
    there.close()
    return _Worker(process, here, todo, time.monotonic() + sweep.limit_s)


def _work(sweep: Sweep, sitting: Sitting, todo: list[int], messages: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends the workers
    held = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    most = held + sweep.memory_mb * _MEBIBYTE
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for index in todo:
        with tempfile.TemporaryDirectory(prefix="drill-") as folder:
            try:
                answers = sweep.judge(sweep.make(sitting.random(sweep.name, index)), Path(folder))
            except Exception as error:  # the judge itself lets errors pass that it does not expect
                answers = {"ends in a clear error or a result": crashed(error)}
        messages.send(answers)


def crashed(error: BaseException) -> Complaint:
    """What a traceback in place of a clear error comes to: type and place of the error, and its words."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "/jointgap/" in frame.filename] or frames
    place = re.sub(r".*/(?=jointgap/)", "", own[-1].filename) if own else "?"
    name = own[-1].name if own else "?"
    return Complaint(f"{type(error).__name__} in {place}, {name}", str(error)[:500])


def unclear(message: str, names: str) -> Complaint | None:
    """What is wrong with the `message` of an error: it has to name the file or key `names` in each of its lines."""
    if not message.strip():
        return Complaint("an error says nothing", repr(message))
    if odd := sorted({sign for sign in message if sign != "\n" and unicodedata.category(sign) in _OBEYED}):
        return Complaint("an error has signs that a terminal obeys", f"{odd[:5]!r} in {message[:300]!r}")
    lines = message.splitlines()
    if "Traceback" in message:
        return Complaint("an error has a traceback in it", message[:500])
    if astray := [line for line in lines if names not in line]:
        return Complaint("a line of an error does not name its file", repr(astray[0][:500]))
    if (longest := max(map(len, lines))) > 2000:
        return Complaint("an error has more than 2000 characters in a line", f"{longest} {message[:300]!r}")
    if len(lines) > 40:
        return Complaint("an error has more than 40 lines", message[:300])
    return None


def keep(drill: str, rows: list[Row], seed: int, folder: Path) -> dict[tuple[str, str], list[Path]]:
    """Write the input of failures into `folder`, some of each kind; the files by drill and kind."""
    own = folder / drill
    shutil.rmtree(own, ignore_errors=True)
    kept: dict[tuple[str, str], list[Path]] = {}
    for failure in (failure for row in rows for failure in row.failures):
        files = kept.setdefault((drill, failure.complaint.kind), [])
        if len(files) == KEPT_OF_A_KIND:
            continue
        own.mkdir(parents=True, exist_ok=True)
        content = {
            "drill": drill,
            "question": failure.question,
            "kind": failure.complaint.kind,
            "details": failure.complaint.details,
            "seed": seed,
            "index": failure.index,
            "case": failure.case,
        }
        files.append(own / f"{_slug(failure.complaint.kind)}-{failure.index}.json")
        files[-1].write_text(json.dumps(content, indent=2, ensure_ascii=True) + "\n")
    return kept


def _slug(kind: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", kind.lower()).strip("-")[:60]
