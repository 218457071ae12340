"""What one run in MLflow is to hold, before MLflow is asked: plain data with a digest."""

import hashlib
import json
import math
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

CURVE_POINTS = 300
"""Points kept of a curve. MLflow draws at most 320; the full curve stays in its table."""


def file_digest(path: Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class Dataset:
    """A table that a run was made from, or that it made."""

    name: str  # Name of the table
    path: Path  # Its Parquet file, or a folder of Parquet files that are one table
    context: str  # ``'input'`` or ``'result'``

    @property
    def files(self) -> list[Path]:
        """Its Parquet files, by name."""
        return sorted(self.path.glob("[!.]*.parquet")) if self.path.is_dir() else [self.path]

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the file; of a folder that of its files' names and digests."""
        if not self.path.is_dir():
            return file_digest(self.path)
        listed = "".join(f"{file_digest(path)}  {path.name}\n" for path in self.files)
        return hashlib.sha256(listed.encode()).hexdigest()


@dataclass(frozen=True)
class Curve:
    """One metric over the iterations of a training or a search."""

    steps: np.ndarray  # Iterations, increasing, shape (n,)
    values: np.ndarray  # Shape (n,)

    def thinned(self, points: int = CURVE_POINTS) -> "Curve":
        """At most `points` of the curve, spaced evenly on a logarithmic axis of steps, first and last included.

        Where the early steps are fewer than the spacing asks for, all of them are kept.
        """
        count = len(self.steps)
        if count <= points:
            return self

        def spaced(number: int) -> np.ndarray:
            return np.unique(np.geomspace(1, count, number).round().astype(int)) - 1

        # early indices coincide after rounding, so more spacings are asked for than points wanted
        most = int(points * np.log(count)) + 2
        numbers = range(points, most)
        number = numbers[bisect_right(numbers, points, key=lambda number: len(spaced(number))) - 1]
        kept = spaced(number)
        return Curve(self.steps[kept], self.values[kept])


@dataclass(frozen=True)
class Record:
    """One run: what it is, and what it holds."""

    stage: str  # Stage whose experiment the run belongs to
    output: str = ""  # Which of the stage's runs it is; empty for the run that stands for the whole stage
    params: Mapping[str, str] = field(default_factory=dict)  # What sets the run apart, by short names
    metrics: Mapping[str, float] = field(default_factory=dict)  # Numbers; those that are not finite are left out
    curves: Mapping[str, Curve] = field(default_factory=dict)  # Metrics over iterations
    datasets: tuple[Dataset, ...] = ()  # Tables read and written
    files: Mapping[str, Path | bytes] = field(default_factory=dict)  # Artifacts by their path in the run
    costs: Mapping[str, float] = field(default_factory=dict)  # Metrics that say what the run cost
    notes: Mapping[str, str] = field(default_factory=dict)  # Words about the result, kept as tags

    @property
    def nested(self) -> bool:
        """Whether the run is shown under the run of its stage."""
        return self.output != ""

    @cached_property
    def digest(self) -> str:
        """SHA-256 over everything the run holds except its costs: equal digests, equal results."""
        content = {
            "params": dict(self.params),
            "notes": dict(self.notes),
            "metrics": {name: repr(float(value)) for name, value in self.metrics.items()},
            "curves": {
                name: hashlib.sha256(
                    np.ascontiguousarray(curve.steps, dtype=np.int64).tobytes()
                    + np.ascontiguousarray(curve.values, dtype=np.float64).tobytes()
                ).hexdigest()
                for name, curve in self.curves.items()
            },
            "datasets": sorted([dataset.name, dataset.context, dataset.sha256] for dataset in self.datasets),
            "files": {
                name: hashlib.sha256(source).hexdigest() if isinstance(source, bytes) else file_digest(source)
                for name, source in self.files.items()
            },
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def points(self) -> list[tuple[str, float, int]]:
        """Every metric as (name, value, step); costs and single numbers at step 0."""
        single = [(name, float(value), 0) for name, value in {**self.metrics, **self.costs}.items()]
        along = [
            (name, float(value), int(step))
            for name, curve in self.curves.items()
            for thin in [curve.thinned()]
            for step, value in zip(thin.steps, thin.values, strict=True)
        ]
        return [point for point in single + along if math.isfinite(point[1])]
