"""The same results on one core, on two, and of a run that was killed and went on."""

import time
from pathlib import Path

from drills.harness import Complaint, Drill, Failure, Row, Sitting
from drills.kills import kill, other, undisturbed
from drills.pieces import CAMPAIGN, SCENARIO, Piece, start_over, write_inputs
from drills.project import clean_folder, run, start


def drill(sitting: Sitting) -> list[Row]:
    """A scenario and a campaign, each three times."""
    pieces = (SCENARIO, CAMPAIGN) if sitting.scale >= 0.5 else (SCENARIO,)
    with clean_folder() as folder:
        write_inputs(folder)
        return [_row(piece, folder, sitting) for piece in pieces]


def _row(piece: Piece, folder: Path, sitting: Sitting) -> Row:
    began, row = (
        time.monotonic(),
        Row(f"determinism: {piece.name} on one core, on two, and killed between", seed=sitting.seed),
    )
    wanted, seconds = undisturbed(piece, folder)
    share = float(sitting.random(piece.name, 0).uniform(0.2, 0.8))
    for n, killed in enumerate((False, True), 1):
        start_over(folder)
        if killed:
            process = start(folder, *piece.command(2))
            time.sleep(share * seconds / 2.0)
            kill(process)
        done = run(folder, *piece.command(2))
        complaint = (
            Complaint("a run fails", done.stderr[-500:]) if done.returncode else other(piece.left(folder), wanted)
        )
        row.count += 1
        if complaint is not None:
            row.failures.append(
                Failure(row.what, complaint, n, {"piece": piece.name, "killed": killed, "share": share})
            )
    row.seconds = time.monotonic() - began
    return row


DRILL = Drill("determinism", drill)
