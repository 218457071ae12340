"""What a stage cost, from Snakemake's benchmark files."""

import csv
from collections.abc import Sequence
from pathlib import Path

from jointgap.errors import InputError


def read_costs(benchmarks: Sequence[Path]) -> dict[str, dict[str, float]]:
    """Seconds and peak memory by what was measured.

    Parameters
    ----------
    benchmarks : sequence of Path
        Snakemake's benchmark files, e.g. ``results/paper/benchmarks/surrogate/r2.tsv``.

    Returns
    -------
    dict of str to dict of str to float
        ``seconds`` and ``peak_memory_mb`` by the file's place under ``benchmarks``, without suffix, e.g.
        ``surrogate/r2``; a measurement that failed is left out. Repeats are averaged.

    Raises
    ------
    InputError
        A file that is not a benchmark file.
    """
    return {_key(path): _read(path) for path in benchmarks}


def _key(path: Path) -> str:
    parts = path.with_suffix("").parts
    start = max((place + 1 for place, part in enumerate(parts) if part == "benchmarks"), default=len(parts) - 1)
    return "/".join(parts[start:])


def _read(path: Path) -> dict[str, float]:
    try:
        with open(path, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file, delimiter="\t"))
        columns = {"seconds": "s", "peak_memory_mb": "max_rss"}
        found = {name: [_number(row[column]) for row in rows] for name, column in columns.items()}
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path}: is not a benchmark file of Snakemake ({error!r}); run its stage again") from error
    known = {name: [value for value in values if value is not None] for name, values in found.items()}
    return {name: sum(values) / len(values) for name, values in known.items() if values}


def _number(text: str) -> float | None:
    return None if text in ("NA", "-") else float(text)  # memory is not measured for jobs shorter than its interval
