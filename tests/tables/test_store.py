"""Tables keep units, descriptions and gaps, and are written whole or not at all."""

import errno

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.schema import TABLES, Column, Table

SMALL = Table(
    "small",
    "a table for tests",
    (
        Column("angle", "rad", "an angle"),
        Column("direction", "rad", "undefined where the centres coincide", nullable=True),
        Column("count", "1", "a whole number", "int"),
        Column("name", "", "a word", "text"),
        Column("good", "", "yes or no", "bool"),
    ),
)


@pytest.fixture
def frame():
    return pd.DataFrame(
        {
            "angle": [0.1, 1 / 3, np.pi],
            "direction": [np.nan, 0.0, 1e-300],
            "count": [1, 2, 3],
            "name": ["a", "b", "ä"],
            "good": [True, False, True],
        }
    )


def test_a_table_comes_back_bit_for_bit(tmp_path, frame):
    parquet.write(SMALL, frame, tmp_path / "small.parquet")
    pd.testing.assert_frame_equal(parquet.read(SMALL, tmp_path / "small.parquet"), frame, check_exact=True)


def test_undefined_is_null_in_the_file_and_never_zero(tmp_path, frame):
    parquet.write(SMALL, frame, tmp_path / "small.parquet")
    column = pq.read_table(tmp_path / "small.parquet").column("direction")
    assert column.null_count == 1
    assert column.to_pylist()[0] is None


def test_every_column_carries_unit_and_description(tmp_path, frame):
    parquet.write(SMALL, frame, tmp_path / "small.parquet")
    shown = parquet.describe(tmp_path / "small.parquet").set_index("column")
    assert shown.loc["angle", "unit"] == "rad"
    assert shown.loc["direction", "description"] == "undefined where the centres coincide"


@pytest.mark.parametrize("table", TABLES.values())
def test_every_shipped_column_has_a_description_and_every_number_a_unit(table):
    assert len({column.name for column in table.columns}) == len(table.columns)
    for column in (one for one in table.columns if one.name[0] != "{"):
        assert column.description, column.name
        assert column.unit or column.kind in ("text", "category", "bool"), column.name


def test_the_same_frame_gives_the_same_bytes(tmp_path, frame):
    for name in ("one", "two"):
        parquet.write(SMALL, frame, tmp_path / f"{name}.parquet")
    assert (tmp_path / "one.parquet").read_bytes() == (tmp_path / "two.parquet").read_bytes()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda frame: frame.drop(columns="angle"), "missing columns"),
        (lambda frame: frame.assign(more=1), "unknown columns"),
        (lambda frame: frame.assign(angle=np.nan), "angle.*non-nullable"),
        (lambda frame: frame.assign(angle=[0.0, 1.0, np.inf]), "angle holds an infinite value"),
    ],
)
def test_a_frame_that_is_not_the_table_is_refused_and_leaves_nothing_behind(tmp_path, frame, change, words):
    with pytest.raises(ValueError, match=words):
        parquet.write(SMALL, change(frame), tmp_path / "small.parquet")
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_keeps_the_old_file_and_no_half_written_one(tmp_path):
    place = tmp_path / "old.txt"
    place.write_text("old", encoding="utf-8")

    def stop_half_way(temporary):
        with open(temporary, "w", encoding="utf-8") as file:
            file.write("ne")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        parquet.write_atomically(place, stop_half_way)
    assert [file.read_text(encoding="utf-8") for file in tmp_path.iterdir()] == ["old"]


def test_a_folder_that_is_a_file_is_one_clear_error(tmp_path, frame):
    (tmp_path / "taken").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="cannot be written"):
        parquet.write(SMALL, frame, tmp_path / "taken" / "small.parquet")


def test_a_missing_a_damaged_and_a_wrong_file_are_told_apart(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        parquet.read(SMALL, tmp_path / "small.parquet")
    (tmp_path / "small.parquet").write_bytes(b"not parquet")
    with pytest.raises(InputError, match="cannot be read as Parquet"):
        parquet.read(SMALL, tmp_path / "small.parquet")
    pq.write_table(pa.table({"angle": [1.0]}), tmp_path / "small.parquet")
    with pytest.raises(InputError, match="not 'small'"):
        parquet.read(SMALL, tmp_path / "small.parquet")


def test_a_table_of_another_version_is_refused_by_the_columns_that_differ(tmp_path, frame):
    other = Table("small", "as it was", (*SMALL.columns[1:], Column("old", "1", "a column that is gone")))
    parquet.write(other, frame.drop(columns="angle").assign(old=1.0), tmp_path / "small.parquet")
    with pytest.raises(InputError, match=r"other columns than this version's, angle \(double\), old \(double\); run"):
        parquet.read(SMALL, tmp_path / "small.parquet")


def test_a_column_of_another_type_is_named(tmp_path, frame):
    arrow = parquet.to_arrow(SMALL, frame)
    text = pa.field("angle", pa.string())
    torn = arrow.set_column(0, text, pa.array(["0.1", "x", "0.3"])).replace_schema_metadata(arrow.schema.metadata)
    with parquet.writer(tmp_path / "small.parquet", torn.schema) as file:
        file.write_table(torn)
    with pytest.raises(InputError, match=r"angle \(double\), angle \(string\)"):
        parquet.read(SMALL, tmp_path / "small.parquet")


def test_a_file_that_lost_its_end_or_a_block_in_the_middle_is_refused(tmp_path, frame):
    place = tmp_path / "small.parquet"
    parquet.write(SMALL, frame, place)
    whole = place.read_bytes()
    for torn in (whole[:-1], whole[: len(whole) // 2], whole[:100] + bytes(50) + whole[150:], bytes(len(whole))):
        place.write_bytes(torn)
        with pytest.raises(InputError, match="cannot be read as Parquet"):
            parquet.read(SMALL, place)


def test_what_is_no_parquet_file_cannot_be_described(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        parquet.describe(tmp_path / "small.parquet")
    (tmp_path / "small.parquet").touch()
    with pytest.raises(InputError, match="cannot be read as Parquet"):
        parquet.describe(tmp_path / "small.parquet")


def test_a_disk_that_fills_up_is_one_clear_error_and_leaves_nothing_behind(tmp_path):
    def fill(temporary):
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(InputError, match=r"full\.txt: cannot be written \(No space left on device\)"):
        parquet.write_atomically(tmp_path / "full.txt", fill)
    assert list(tmp_path.iterdir()) == []


def test_whether_a_file_can_be_written_is_found_out_without_writing_it(tmp_path):
    parquet.check_writable(tmp_path / "new" / "deep" / "file.parquet")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "new").mkdir()
    parquet.check_writable(tmp_path / "new" / "file.parquet")
    assert list((tmp_path / "new").iterdir()) == []
    (tmp_path / "taken").touch()
    with pytest.raises(InputError, match="cannot be written"):
        parquet.check_writable(tmp_path / "taken" / "file.parquet")
    with pytest.raises(InputError, match="is a folder"):
        parquet.check_writable(tmp_path / "new")


def test_one_file_for_two_results_is_refused(tmp_path):
    with pytest.raises(InputError, match="named for two results"):
        parquet.check_writable(tmp_path / "a.parquet", tmp_path / "new" / ".." / "a.parquet")
