"""Disks that are full or read-only: the error names the cause, nothing half-written stays, the next run succeeds."""

import os
import resource
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drills.harness import Complaint, Drill, Failure, Row, Sitting, unclear
from drills.names import crashed_in
from drills.pieces import write_inputs
from drills.project import clean_folder, digests, emptied, run

_SIZE = 64 * 2**20
_CAUSES = ("no space left", "disk is full", "file too large", "read-only", "disk i/o error", "readonly database")

_OPTIONS = "options.json"
COMMANDS = {
    "simulate": ["jointgap", "simulate", "--options", _OPTIONS, "--results", "disk/results"],
    "measure": ["jointgap", "measure", "small/small.json", "--folder", "disk/results"],
    "analyse": ["jointgap", "analyse", "small/small.json", "--folder", "disk/results"],
    "sweep": ["jointgap", "sweep", "--options", "sweep.json", "--folder", "disk/results", "--workers", "1"],
    "schema": ["jointgap", "schema", "--write", "disk/results/schema.json"],
}
"""What is run, by the name of its row."""

_COUNTS = {"simulate": 6, "measure": 4, "schema": 2, "analyse": 2, "sweep": 4}


def can_mount() -> bool:
    """Whether a small disk in memory can be mounted here."""
    with clean_folder(project=False) as folder:
        if os.geteuid() != 0 or not _mount(folder, _SIZE):
            return False
        _unmount(folder)
        return True


def _mount(place: Path, size: int) -> bool:
    command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
    try:
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        return False


def _unmount(place: Path) -> None:
    """Take the disk away at once, even where a process that is about to end still holds a file on it."""
    subprocess.run(["umount", "--lazy", str(place)], capture_output=True, check=True)


@contextmanager
def _disk(folder: Path, mounted: bool) -> Iterator[Path]:
    place = folder / "disk"
    emptied(place)
    if mounted and not _mount(place, _SIZE):
        raise RuntimeError("a disk in memory that could be mounted a moment ago cannot be mounted")
    try:
        yield place
    finally:
        if mounted:
            _unmount(place)


def _cramp(disk: Path, room: int, mounted: bool) -> dict:
    """Leave `room` bytes on the disk; how a command is to be started so that it has no more."""
    if not mounted:
        return {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))}
    free = os.statvfs(disk).f_bavail * os.statvfs(disk).f_frsize
    with open(disk / "filling", "wb") as filling:
        for _ in range(max(0, free - room) // 4096):
            filling.write(bytes(4096))
    return {}


def drill(sitting: Sitting) -> list[Row]:
    """Every command on a disk with little room, and on one that is read-only where such can be mounted."""
    mounted, rows = can_mount(), []
    with clean_folder(project=False) as folder:
        _prepare(folder)
        for name, count in _COUNTS.items():
            began, row = (
                time.monotonic(),
                Row(f"full_disk: {name}", seed=sitting.seed, remark="" if mounted else "by a limit of files' sizes"),
            )
            wanted, size = _undisturbed(folder, name, mounted)
            for n in range(sitting.of(count)):
                room = 0 if n == 0 else int(sitting.random(f"disk {name}", n).uniform(0.0, 0.95) * size)
                read_only = mounted and n % 3 == 2
                row.count += 1
                complaint = _one(folder, name, room, read_only, mounted, wanted)
                if complaint is not None:
                    case = {"command": name, "room": room, "read_only": read_only}
                    row.failures.append(Failure(row.what, complaint, n, case))
            row.seconds = time.monotonic() - began
            rows.append(row)
    return rows


def _prepare(folder: Path) -> None:
    from drills.documents import ROOT
    from drills.pieces import TINY
    from jointgap.config import resolve
    from jointgap.scenario.stages import SCENARIO_STAGES

    write_inputs(folder)
    scenario = resolve({"mechanism": str(ROOT / "config/mechanisms/erkaya2009.yaml"), **TINY})["tiny"]
    (folder / _OPTIONS).write_text(SCENARIO_STAGES["simulate"].options(scenario))


def _left(disk: Path) -> dict[str, str]:
    """What is on the disk, but for the store's own bytes and what fills it."""
    return {name: digest for name, digest in digests(disk).items() if name != "filling" and not name.endswith(".lock")}


def _undisturbed(folder: Path, name: str, mounted: bool) -> tuple[dict[str, str], int]:
    with _disk(folder, mounted) as disk:
        done = run(folder, *COMMANDS[name])
        if done.returncode:
            raise RuntimeError(f"{name} fails undisturbed: {done.stderr[-1000:]}")
        return _left(disk), sum(path.stat().st_size for path in disk.rglob("*") if path.is_file())


def _one(
    folder: Path, name: str, room: int, read_only: bool, mounted: bool, wanted: dict[str, str]
) -> Complaint | None:
    with _disk(folder, mounted) as disk:
        (disk / "results").mkdir()
        how = {} if read_only else _cramp(disk, room, mounted)
        if read_only:
            subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        done = run(folder, *COMMANDS[name], **how)
        if read_only:
            subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)
        if done.returncode == 0:
            return (
                None
                if _left(disk) == wanted
                else Complaint(f"success is told, but results differ: {name}", str(_left(disk)))
            )
        if complaint := told(done.stdout + done.stderr):
            return Complaint(
                f"{complaint.kind}: {name}", f"{room} bytes left, read-only {read_only}: {complaint.details}"
            )
        if half := half_written(disk, wanted):
            return Complaint(f"something half-written stays: {name}", f"{room} bytes left: {half}")
        (disk / "filling").unlink(missing_ok=True)
        again = run(folder, *COMMANDS[name])
        if again.returncode:
            return Complaint(f"the next run fails: {name}", f"{room} bytes were left: {again.stderr[-500:]}")
        return (
            None
            if _left(disk) == wanted
            else Complaint(f"the next run has other results: {name}", f"{room} bytes were left")
        )


def told(said: str) -> Complaint | None:
    """Whether an error names the cause and its place, in one line without a traceback."""
    if complaint := crashed_in(said):
        return complaint
    errors = [line for line in said.splitlines() if "error" in line.lower()]
    if not errors:
        return Complaint("a full disk is not told", said[-500:])
    if not any(cause in line.lower() for line in errors for cause in _CAUSES):
        return Complaint("an error does not name the cause", errors[-1][:500])
    return unclear("\n".join(errors), "disk/results")


def half_written(disk: Path, wanted: dict[str, str]) -> str:
    """A file on the disk that an undisturbed run does not leave, or leaves otherwise; '' without one."""
    for name, digest in _left(disk).items():
        if name.endswith((".parquet", ".json", ".yaml", ".md", ".html")) and wanted.get(name) != digest:
            return name
        if Path(name).name.startswith("."):
            return name
    return ""


DRILL = Drill("full_disk", drill)
