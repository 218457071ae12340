"""Tables as CSV: names with units, numbers whole, nothing written over unasked."""

import numpy as np
import pandas as pd
import pytest

from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.core.export import export
from tests.track.synthetic import numbers


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "results"
    place.mkdir()
    events = numbers(schema.EVENTS, 3, crank_angle=[0.1, 0.2, np.pi], joint=["crank_pin"] * 3)
    events.loc[1, "impulse"] = np.nan
    parquet.write(schema.EVENTS, events, place / "simulate" / "events.parquet")
    return place, events


def test_what_is_written_is_what_is_read_with_the_unit_behind_each_name(folder):
    place, events = folder
    (written,) = export(place)
    assert written == place / "simulate" / "events.csv"
    read = pd.read_csv(written)
    assert {"crank_angle [rad]", "impulse [N*s]", "joint"} <= set(read.columns)
    assert read["crank_angle [rad]"].tolist() == events["crank_angle"].tolist()
    assert read["impulse [N*s]"].isna().tolist() == [False, True, False]


def test_other_units_are_written_where_they_fit(folder, tmp_path):
    place, events = folder
    (written,) = export(place / "simulate" / "events.parquet", tmp_path / "csv", ["deg", "mm"])
    read = pd.read_csv(written)
    assert read["crank_angle [deg]"].iloc[2] == pytest.approx(180.0)
    assert read["approach_speed [m/s]"].tolist() == events["approach_speed"].tolist()


def test_a_file_that_is_there_stays_unless_force_is_asked_for(folder):
    place, _ = folder
    (written,) = export(place)
    written.write_text("mine")
    with pytest.raises(InputError, match="is there already; --force writes over it"):
        export(place)
    assert written.read_text() == "mine"
    export(place, force=True)
    assert written.read_text() != "mine"


@pytest.mark.parametrize("unit", ["bananas", "", "7"])
def test_an_unknown_unit_is_refused_before_anything_is_written(folder, tmp_path, unit):
    with pytest.raises(InputError, match="--unit"):
        export(folder[0], tmp_path / "csv", [unit])
    assert not (tmp_path / "csv").exists()


def test_a_folder_without_tables_says_so(tmp_path):
    with pytest.raises(InputError, match="holds no Parquet file"):
        export(tmp_path)
