"""A sweep in parts: which designs each job simulates, and what their file is called. Imports nothing heavy."""

from collections.abc import Iterable
from pathlib import Path

from jointgap.errors import InputError


def parts(number: int, designs_per_job: int) -> list[tuple[int, int]]:
    """First design and number of designs of each part of `number` designs, where a job simulates `designs_per_job`."""
    return [(first, min(designs_per_job, number - first)) for first in range(0, number, designs_per_job)]


def part_name(number: int) -> str:
    """Name of part `number`; names sort as numbers do."""
    return f"part_{number:06d}"


def check_no_others(folder: Path, names: Iterable[str]) -> None:
    """Whether the dataset in a `folder` holds nothing but the parts of these `names`, before hours of simulation.

    Raises
    ------
    InputError
        Another Parquet file lies there: of more designs, or of another sweep.
    """
    wanted = {f"{name}.parquet" for name in names}
    if others := sorted(path.name for path in folder.glob("*.parquet") if path.name not in wanted):
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        raise InputError(
            f"{folder / others[0]}{more}: no part of this sweep, whose parts are {min(wanted)} to {max(wanted)}; "
            "remove what is left of an earlier one, or ask for as many designs"
        )
