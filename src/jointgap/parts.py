"""Numbered work in parts: which of it each job does, and what its file is called. Imports nothing heavy.

Designs of a sweep, points of a study and blind trials are all cut here.
"""


def parts(number: int, per_job: int) -> dict[str, tuple[int, int]]:
    """The parts of `number` pieces of work, where a job does `per_job` of them and the last job what is left."""
    return {
        part_name(part): (first, min(per_job, number - first)) for part, first in enumerate(range(0, number, per_job))
    }


def part_name(part: int) -> str:
    """Name of a `part`, counted from 0; names sort as numbers do."""
    return f"part_{part:06d}"
