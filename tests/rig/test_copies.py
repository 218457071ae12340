"""A run that repeats the samples of another one confirms nothing, and is refused."""

import os
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.config.load import load_campaign
from jointgap.core.csv_files import Columns
from jointgap.core.errors import InputError
from jointgap.rig.read_files import check_copies, read_measurements
from tests.rig.recorded_files import CAMPAIGN, read_rig, table, write_rig

SAME_SPEED = {"runs": [run | {"speed": "200 rpm"} for run in CAMPAIGN["runs"]]}


def by_a_link(slow, fast):
    fast.unlink()
    os.symlink(slow, fast)


def with_a_comment_and_another_separator(slow, fast):
    fast.write_text("# measured on Tuesday\n" + slow.read_text().replace(",", ";"))


def with_rows_left_out(slow, fast):
    lines = slow.read_text().splitlines()
    fast.write_text("\n".join([lines[0], *lines[20:-20]]))


def in_another_format(slow, fast):
    table(200.0).to_parquet(fast)


@pytest.mark.parametrize(
    "copy", [by_a_link, with_a_comment_and_another_separator, with_rows_left_out, in_another_format]
)
def test_a_confirm_run_that_is_a_copy_of_an_identify_run_is_refused(tmp_path, copy):
    file = write_rig(tmp_path, SAME_SPEED)
    copy(tmp_path / "slow.csv", tmp_path / "fast.csv")
    with pytest.raises(InputError, match=r"fast\.csv: run 'fast' has the samples of run 'slow' in"):
        read_measurements(load_campaign(file))


def test_runs_that_are_alike_but_no_copies_are_read(tmp_path):
    fast = table(200.0, first=0.4)
    assert set(read_rig(tmp_path, SAME_SPEED, fast=fast).runs) == {"slow", "fast"}
    angle = np.tile(
        np.arange(0.0, 360.0), 4
    )  # of an encoder that asks for the samples, and no time
    values = {
        "theta": angle,
        "x": np.round(np.cos(np.radians(angle)), 2),
    }  # rounded until cycles are alike
    columns = Columns(values, np.arange(angle.size), {})
    runs = [SimpleNamespace(id=run) for run in ("slow", "fast")]
    check_copies([SimpleNamespace(path=f"{run.id}.csv", run=run, columns=columns) for run in runs])
