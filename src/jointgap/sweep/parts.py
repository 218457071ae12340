"""A sweep in parts: which designs each job simulates, and what their file is called. Imports nothing heavy."""


def parts(number: int, designs_per_job: int) -> list[tuple[int, int]]:
    """First design and number of designs of each part of `number` designs, where a job simulates `designs_per_job`."""
    return [(first, min(designs_per_job, number - first)) for first in range(0, number, designs_per_job)]


def part_name(number: int) -> str:
    """Name of part `number`; names sort as numbers do."""
    return f"part_{number:06d}"
