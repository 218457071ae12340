"""Runs killed at random moments with all their processes: the next run ends by itself, with the same bytes."""

import os
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

from drills.harness import Answers, Case, Complaint, Drill, Failure, Row, Sitting
from drills.pieces import (
    NETWORK,
    SCREENED,
    SWEEP,
    SWEEP_OF_WORKFLOW,
    Piece,
    hidden_files,
    start_over,
    write_inputs,
)
from drills.project import clean_folder, run, start

_COUNTS = {NETWORK: 12, SCREENED: 12, SWEEP: 20, SWEEP_OF_WORKFLOW: 20}
_SIDES = 2  # runs side by side


def kill(process: subprocess.Popen) -> bool:
    """SIGKILL for a process and all of its group; whether it was still running."""
    running = process.poll() is None
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.communicate()
    for _ in range(200):  # the group is gone when nobody is left in it
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            break
        time.sleep(0.05)
    return running


def undisturbed(piece: Piece, folder: Path) -> tuple[dict[str, str], float]:
    """What a piece leaves when nobody kills it, and the seconds that it took.

    Raises
    ------
    RuntimeError
        It does not even end so.
    """
    start_over(folder)
    began = time.monotonic()
    done = run(folder, *piece.command(1))
    if done.returncode:
        raise RuntimeError(f"{piece.name} fails undisturbed:\n{done.stdout[-1500:]}\n{done.stderr[-1500:]}")
    return piece.left(folder), time.monotonic() - began


def other(left: dict[str, str], wanted: dict[str, str]) -> Complaint | None:
    """How what is left differs from what is wanted."""
    if lost := sorted(set(wanted) - set(left)):
        return Complaint("results are missing", ", ".join(lost[:5]))
    if more := sorted(set(left) - set(wanted)):
        return Complaint("there are more results than of an undisturbed run", ", ".join(more[:5]))
    if changed := sorted(name for name in wanted if left[name] != wanted[name]):
        return Complaint("results differ from those of an undisturbed run", ", ".join(changed[:5]))
    return None


def one(piece: Piece, folder: Path, moment: float, wanted: dict[str, str]) -> tuple[Complaint | None, bool, int]:
    """Kill a run of a piece after a `moment` [s] and run it again; what is wrong, whether it was running, and how many
    hidden files stay.
    """
    start_over(folder)
    process = start(folder, *piece.command(1))
    time.sleep(moment)
    running = kill(process)
    done = run(folder, *piece.command(1))
    if done.returncode:
        said = (done.stderr.strip() or done.stdout.strip())[-700:]
        return (
            Complaint(f"after a kill, the next run fails: {piece.name}", f"killed after {moment:.2f} s: {said}"),
            running,
            0,
        )
    try:
        left = piece.left(folder)
    except Exception as error:
        return (
            Complaint(f"after a kill, results cannot be read: {piece.name}", f"killed after {moment:.2f} s: {error}"),
            running,
            0,
        )
    return other(left, wanted), running, len(hidden_files(folder))


def drill(sitting: Sitting) -> list[Row]:
    """All pieces, each killed as often as it says; two at a time, in two folders."""
    rows = []
    with ExitStack() as stack:
        folders = [stack.enter_context(clean_folder()) for _ in range(_SIDES)]
        for folder in folders:
            write_inputs(folder)
        for piece, count in _COUNTS.items():
            rows.append(_row(piece, sitting.of(count), folders, sitting))
    return rows


def _row(piece: Piece, count: int, folders: list[Path], sitting: Sitting) -> Row:
    began, row = time.monotonic(), Row(f"kills: {piece.name}", seed=sitting.seed)
    wanted, _ = undisturbed(piece, folders[0])
    _, seconds = undisturbed(piece, folders[0])  # the first may have had code to compile
    moments = [float(sitting.random(piece.name, n).uniform(0.02, 1.02)) * seconds for n in range(count)]

    def share(side: int) -> list:
        return [(n, one(piece, folders[side], moments[n], wanted)) for n in range(side, count, len(folders))]

    with ThreadPoolExecutor(len(folders)) as pool:
        found = sorted(
            (each for part in pool.map(share, range(len(folders))) for each in part), key=lambda each: each[0]
        )
    row.count = count
    for n, (complaint, _, _) in found:
        if complaint is not None:
            row.failures.append(Failure(piece.name, complaint, n, {"piece": piece.name, "share": moments[n] / seconds}))
    killed, hidden = sum(each[1][1] for each in found), sum(each[1][2] for each in found)
    row.remark = f"{killed} killed before their end, {hidden} hidden files left"
    row.seconds = time.monotonic() - began
    return row


def judge_again(case: Case) -> Answers:
    """Kill the piece again at the same share of its time; what happens then need not be the same."""
    piece = next(each for each in _COUNTS if each.name == case["piece"])
    with clean_folder() as folder:
        write_inputs(folder)
        wanted, seconds = undisturbed(piece, folder)
        return {piece.name: one(piece, folder, case["share"] * seconds, wanted)[0]}


DRILL = Drill("kills", drill, judge_again)
