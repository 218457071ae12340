"""Tables as CSV: names with units, numbers whole, nothing written over unasked."""

import numpy as np
import pandas as pd
import pytest

from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.core.export import export
from tests.catalogue import refused
from tests.scenario.published_tables import numbers


@pytest.fixture
def written(tmp_path):
    """A results folder with a table, and the table."""
    events = numbers(schema.EVENTS, 3, crank_angle=[0.1, 0.2, np.pi], joint=["crank_pin"] * 3)
    events.loc[1, "impulse"] = np.nan
    parquet.write(schema.EVENTS, events, tmp_path / "results/simulate/events.parquet")
    return tmp_path / "results", events


def test_what_is_written_is_what_is_read_with_the_unit_behind_each_name_and_other_units_where_they_fit(
    written, tmp_path
):
    place, events = written
    (file,) = export(place)
    read = pd.read_csv(file)
    assert file == place / "simulate" / "events.csv"
    assert {"crank_angle [rad]", "impulse [N*s]", "joint"} <= set(read.columns)
    assert read["crank_angle [rad]"].tolist() == events["crank_angle"].tolist()
    assert read["impulse [N*s]"].isna().tolist() == [False, True, False]
    (file,) = export(place / "simulate" / "events.parquet", tmp_path / "csv", ["deg", "mm"])
    read = pd.read_csv(file)
    assert read["crank_angle [deg]"].iloc[2] == pytest.approx(180.0)
    assert read["approach_speed [m/s]"].tolist() == events["approach_speed"].tolist()


def test_a_file_that_is_there_stays_unless_force_is_asked_for(written):
    (file,) = export(written[0])
    file.write_text("mine")
    with pytest.raises(InputError, match="already exists; overwrite with --force"):
        export(written[0])
    assert file.read_text() == "mine"
    export(written[0], force=True)
    assert file.read_text() != "mine"


def test_an_unknown_unit_and_a_folder_without_tables_are_refused_before_anything_is_written(
    written, tmp_path
):
    refused(
        lambda unit: export(written[0], tmp_path / "csv", [unit]),
        [(unit, "--unit") for unit in ("bananas", "", "7")],
    )
    assert not (tmp_path / "csv").exists()
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="contains no Parquet file"):
        export(tmp_path / "empty")
