"""The table of trials: truth and verdict side by side."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.errors import InputError
from jointgap.tables.columns import Column, Table
from jointgap.trials.batches import records
from jointgap.trials.score import scored

_TEXT = {
    "id": "the campaign's name",
    "kind": "nothing, single, pair, off_list, or exudyn (single, by independent code)",
    "base": "ideal joints, loose joints with friction, or a chaotic motion",
    "hidden": "effects hidden",
    "verdict": "verdict, or failed",
    "named": "effects named, or the verdict",
    "outcome": "right, wrong, partly, ambiguous, unexplained, missed or failed",
    "greedy": "outcome of the least BIC, one effect at a time, without a gate",
    "greedy_named": "what that names",
    "sparse": "outcome of sparse regression of the residual",
    "sparse_named": "what that names",
    "reason": "why the verdict is what it is, what it leaves open if it is ambiguous, or why the analysis failed",
}
_NUMBERS = {
    "size": ("1", "whitened gap asked for"),
    "gap_caused": ("1", "whitened gap that the smallest of the effects causes after recalibration, without noise"),
    "numerics_gap": (
        "1",
        "gap that the truth leaves, simulated by usual numerics; not known of chaotic motion and from Exudyn",
    ),
    "seconds": ("s", "time that the analysis took"),
    "error": ("1", "relative error of the effect's size, where it is named right"),
    "covered": ("1", "share of sizes within their 90 % interval"),
    "gap_before": ("1", "gap of the held-out run before"),
    "gap_after": ("1", "gap of the held-out run after"),
    "closed": ("1", "share of the held-out excess closed, where the gap before is over 1.5"),
    "windows": (
        "1",
        "windows in the map whose noise-free difference is known; not those in the crank angle, unless nothing is hidden",
    ),
    "false_windows": ("1", "of these, with a noise-free difference below 0.1 of the noise"),
    "bins_off": ("1", "bins of 10 deg with a noise-free difference above half of the noise"),
    "missed_bins": ("1", "of these, in no window"),
}

TRIALS = Table(
    "blind_trials",
    "Blind trials: what was hidden, and what was found",
    (
        *(Column(name, "", meaning, "text") for name, meaning in _TEXT.items()),
        Column("detectable", "", "an effect is hidden that preflight calls detectable, as large as asked for", "bool"),
        Column("foreseen", "", "an effect is hidden that preflight calls undetectable", "bool"),
        *(Column(name, unit, meaning, nullable=True) for name, (unit, meaning) in _NUMBERS.items()),
    ),
)


def trials(truths: Iterable[Path], founds: Iterable[Path]) -> pd.DataFrame:
    """The table of all trials of several batches.

    Raises
    ------
    InputError
        A file that is not there or no list of trials, a trial without its truth, or a truth without its trial.
    """
    truth, found = (
        {one["id"]: one for path in paths for one in records(path, option, command)}
        for paths, option, command in ((truths, "--truth", "blind-conceal"), (founds, "--found", "blind-analyse"))
    )
    if odd := truth.keys() ^ found.keys():
        raise InputError(f"trial {min(odd)} has a truth or a verdict alone; give the files of the same batches")
    rows = pd.DataFrame([scored(truth[trial], found[trial]) for trial in sorted(truth)])
    columns = [column.name for column in TRIALS.columns]
    return rows.reindex(columns=columns).assign(
        **{name: lambda frame, name=name: frame[name].astype(bool) for name in ("detectable", "foreseen")},
        **{name: lambda frame, name=name: frame[name].astype(np.float64) for name in _NUMBERS},
    )
