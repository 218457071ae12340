"""Tables as CSV: names with units, numbers with full precision, no file overwritten silently."""

import numpy as np
import pandas as pd
import pytest

from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.core.export import export
from tests.scenario.published_tables import numbers


@pytest.fixture
def events():
    frame = numbers(schema.EVENTS, 3, crank_angle=[0.1, 0.2, np.pi], joint=["crank_pin"] * 3)
    frame.loc[1, "impulse"] = np.nan
    return frame


@pytest.fixture
def folder(events, tmp_path):
    parquet.write(schema.EVENTS, events, tmp_path / "results/simulate/events.parquet")
    return tmp_path / "results"


def test_a_csv_file_has_units_in_its_headings_and_full_precision(folder, events):
    (file,) = export(folder)
    assert file == folder / "simulate/events.csv"
    exported = pd.read_csv(file)
    assert exported["crank_angle [rad]"].tolist() == events["crank_angle"].tolist()
    assert exported["impulse [N*s]"].isna().tolist() == [False, True, False]
    assert "joint" in exported


def test_columns_convert_to_a_unit_that_fits(folder, events, tmp_path):
    (file,) = export(folder / "simulate/events.parquet", tmp_path / "csv", ["deg", "mm"])
    exported = pd.read_csv(file)
    assert exported["crank_angle [deg]"].iloc[2] == pytest.approx(180.0)
    assert exported["approach_speed [m/s]"].tolist() == events["approach_speed"].tolist()


def test_an_existing_file_is_overwritten_only_with_force(folder):
    (file,) = export(folder)
    file.write_text("mine")
    with pytest.raises(InputError, match="already exists; overwrite with --force"):
        export(folder)
    assert file.read_text() == "mine"
    export(folder, force=True)
    assert file.read_text() != "mine"


@pytest.mark.parametrize("unit", ["bananas", "", "7"])
def test_an_unknown_unit_is_refused_before_anything_is_written(folder, tmp_path, unit):
    with pytest.raises(InputError, match="--unit"):
        export(folder, tmp_path / "csv", [unit])
    assert not (tmp_path / "csv").exists()


def test_a_folder_without_tables_is_refused(tmp_path):
    with pytest.raises(InputError, match="contains no Parquet file"):
        export(tmp_path)
