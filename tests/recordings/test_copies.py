"""A run that repeats the samples of another one confirms nothing, and is refused."""

import os
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.config.load import load_campaign
from jointgap.core.csv_files import Columns
from jointgap.core.errors import InputError
from jointgap.rig.read_files import check_copies, read_measurements
from tests.recordings.rig import CAMPAIGN, table, write_rig

SAME_SPEED = [run | {"speed": "200 rpm"} for run in CAMPAIGN["runs"]]


def refusal(campaign_file) -> str:
    with pytest.raises(InputError) as caught:
        read_measurements(load_campaign(campaign_file))
    return str(caught.value)


def under_another_name(slow, fast):
    shutil.copy(slow, fast)


def by_a_link(slow, fast):
    fast.unlink()
    os.symlink(slow, fast)


def with_a_comment_and_another_separator(slow, fast):
    fast.write_text("# measured on Tuesday\n" + slow.read_text().replace(",", ";"))


def with_rows_left_out(slow, fast):
    lines = slow.read_text().splitlines()
    fast.write_text("\n".join([lines[0], *lines[20:-20]]))


@pytest.mark.parametrize(
    "copied", [under_another_name, by_a_link, with_a_comment_and_another_separator, with_rows_left_out]
)
def test_a_confirm_run_that_is_a_copy_of_an_identify_run_is_refused(tmp_path, copied):
    file = write_rig(tmp_path, {"runs": SAME_SPEED})
    copied(tmp_path / "slow.csv", tmp_path / "fast.csv")
    message = refusal(file)
    assert (
        f"{tmp_path / 'fast.csv'}: the run 'fast' has the samples of the run 'slow' in {tmp_path / 'slow.csv'}"
        in message
    )
    assert "a copy confirms nothing: give the file that was measured" in message


def test_a_copy_in_another_format_and_with_another_stated_speed_is_refused_too(tmp_path):
    file = write_rig(tmp_path, {"runs": [CAMPAIGN["runs"][0], CAMPAIGN["runs"][1] | {"file": "fast.parquet"}]})
    table(200.0).to_parquet(tmp_path / "fast.parquet")
    assert "the run 'fast' has the samples of the run 'slow'" in refusal(file)


def test_runs_that_are_rounded_until_cycles_are_alike_are_no_copies_of_each_other(tmp_path):
    angle = np.tile(np.arange(0.0, 360.0), 4)  # of an encoder that asks for the samples, and no time
    values = {"theta": angle, "x": np.round(np.cos(np.radians(angle)), 2)}
    columns = Columns(values, np.arange(angle.size), {})
    files = {run: (SimpleNamespace(path=f"{run}.csv"), columns) for run in ("slow", "fast")}
    check_copies(files)


def test_two_runs_at_one_speed_from_another_angle_are_no_copies(tmp_path):
    file = write_rig(tmp_path, {"runs": SAME_SPEED}, fast=table(200.0, first=0.4))
    assert set(read_measurements(load_campaign(file)).runs) == {"slow", "fast"}
