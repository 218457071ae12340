"""Whether the files of two runs are one measurement: then one of them says nothing about the other."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import pandas as pd

from jointgap.errors import InputError
from jointgap.recordings.limits import RecordingLimits
from jointgap.recordings.rotation import RunFile
from jointgap.tables.sample_file import Columns


def check_copies(files: Mapping[str, tuple[RunFile, Columns]], limits: RecordingLimits) -> None:
    """Whether all runs were measured by themselves, whatever the names, formats and order of their files."""
    rows = {run: _marks(columns) for run, (_, columns) in files.items()}
    for one, other in combinations(files, 2):
        few, many = sorted((rows[one], rows[other]), key=len)
        if np.unique(few).size < limits.copied_share * few.size:
            continue  # rounded so that cycles of one run are alike: another run's may be too
        count = int(np.isin(few, many).sum())
        if count > limits.copied_share * few.size:
            raise InputError(
                f"{files[other][0].path}: the run '{other}' has the samples of the run '{one}' in "
                f"{files[one][0].path} ({count} of {few.size} are the same to the last digit); a copy confirms "
                "nothing: give the file that was measured in this run, or one run with role split"
            )


def _marks(columns: Columns) -> np.ndarray:
    """A number for each sample, the same for the same values in all columns that are read."""
    # zeros and gaps are each of one kind only
    values = {name: np.where(np.isnan(own), np.nan, own + 0.0) for name, own in sorted(columns.values.items())}
    return pd.util.hash_pandas_object(pd.DataFrame(values), index=False).to_numpy()
