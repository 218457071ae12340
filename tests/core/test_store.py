"""Tables keep units, descriptions and gaps, and are written whole or not at all."""

import errno
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.schema import Column, Table
from tests.catalogue import refused

COLUMNS = (
    Column("angle", "rad", "an angle"),
    Column("direction", "rad", "undefined where the centres coincide", nullable=True),
    Column("count", "1", "a whole number", "int"),
    Column("name", "", "a word", "text"),
    Column("good", "", "yes or no", "bool"),
)
SMALL = Table("small", "a table for tests", COLUMNS)
ROWS = [(0.1, np.nan, 1, "a", True), (1 / 3, 0.0, 2, "b", False), (np.pi, 1e-300, 3, "ä", True)]
FRAME = pd.DataFrame(ROWS, columns=[column.name for column in COLUMNS])


@pytest.fixture
def place(tmp_path):
    return tmp_path / "small.parquet"


def test_a_table_comes_back_bit_for_bit_with_units_descriptions_and_gaps(place):
    parquet.write(SMALL, FRAME, place)
    first = place.read_bytes()
    pd.testing.assert_frame_equal(parquet.read(SMALL, place), FRAME, check_exact=True)
    column = pq.read_table(place).column("direction")
    assert (
        column.null_count == 1 and column.to_pylist()[0] is None
    )  # undefined is null and never zero
    shown = parquet.describe(place).set_index("column")
    assert shown.loc["angle", "unit"] == "rad"
    assert shown.loc["direction", "description"] == "undefined where the centres coincide"
    parquet.write(SMALL, FRAME, place)
    assert place.read_bytes() == first


def test_units_survive_pandas_reading_and_writing_a_table(place):
    parquet.write(SMALL, FRAME, place)
    wanted = {column.name: column.unit for column in COLUMNS}
    for read in (parquet.read_table, pd.read_parquet):
        frame = read(place)
        assert frame.attrs["units"] == wanted
        again = place.with_name("again.parquet")
        frame[["count", "angle"]].assign(extra=1.0).to_parquet(again)
        assert parquet.read_table(again).attrs["units"] == {
            "count": "1",
            "angle": "rad",
            "extra": "",
        }
        assert parquet.describe(again)["unit"].tolist() == ["1", "rad", ""]
    for attrs in ({}, {"units": "none"}, {"units": ["angle"]}, {"units": {"angle": 3}}):
        frame.attrs = attrs
        frame.to_parquet(again)
        assert parquet.read_table(again).attrs["units"]["count"] == ""


def test_a_frame_that_is_not_the_table_is_refused_and_leaves_nothing_behind(place):
    cases = [
        (FRAME.drop(columns="angle"), "missing columns"),
        (FRAME.assign(more=1), "unknown columns"),
        (FRAME.assign(angle=np.nan), "angle ~ non-nullable"),
        (FRAME.assign(angle=[0.0, 1.0, np.inf]), "angle contains an infinite value"),
    ]
    refused(lambda frame: parquet.write(SMALL, frame, place), cases, ValueError)
    assert list(place.parent.iterdir()) == []


def test_a_failed_write_keeps_the_old_file_and_no_half_written_one(place):
    def stops(error):
        def half_way(temporary):
            Path(temporary).write_text("ne")
            raise error

        return half_way

    place.write_text("old")
    with pytest.raises(KeyboardInterrupt):
        parquet.write_atomically(place, stops(KeyboardInterrupt))
    with pytest.raises(
        InputError, match=r"small\.parquet: cannot be written \(No space left on device\)"
    ):
        parquet.write_atomically(place, stops(OSError(errno.ENOSPC, "No space left on device")))
    assert [file.read_text() for file in place.parent.iterdir()] == ["old"]
    with pytest.raises(InputError, match="cannot be written"):
        parquet.write(SMALL, FRAME, place / "small.parquet")  # below a file


def test_a_missing_a_damaged_a_wrong_file_and_one_of_another_version_are_distinguished(place):
    refused(parquet.describe, [(place, "no such file")])
    refused(lambda: parquet.read(SMALL, place), [("no such file",)])
    parquet.write(SMALL, FRAME, place)
    whole = place.read_bytes()
    torn = [b"", b"not parquet", whole[:-1], whole[: len(whole) // 2]]
    for content in (*torn, whole[:100] + bytes(50) + whole[150:], bytes(len(whole))):
        place.write_bytes(content)
        with pytest.raises(InputError, match="cannot be read as Parquet"):
            parquet.read(SMALL, place)
    place.touch()
    refused(parquet.describe, [(place, "cannot be read as Parquet")])
    pq.write_table(pa.table({"angle": [1.0]}), place)
    refused(lambda: parquet.read(SMALL, place), [("not 'small'",)])
    other = Table("small", "as it was", (*COLUMNS[1:], Column("old", "1", "a column that is gone")))
    parquet.write(other, FRAME.drop(columns="angle").assign(old=1.0), place)
    words = "other columns than in this version (angle (double), old (double)); run"
    refused(lambda: parquet.read(SMALL, place), [(words,)])
    arrow = parquet.to_arrow(SMALL, FRAME)
    text = arrow.set_column(0, pa.field("angle", pa.string()), pa.array(["0.1", "x", "0.3"]))
    with parquet.writer(place, text.replace_schema_metadata(arrow.schema.metadata).schema) as file:
        file.write_table(text.replace_schema_metadata(arrow.schema.metadata))
    refused(lambda: parquet.read(SMALL, place), [("angle (double), angle (string)",)])


def test_whether_a_file_can_be_written_is_found_out_without_writing_it(tmp_path):
    parquet.check_writable(tmp_path / "new" / "deep" / "file.parquet")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "new").mkdir()
    parquet.check_writable(tmp_path / "new" / "file.parquet")
    assert list((tmp_path / "new").iterdir()) == []
    (tmp_path / "taken").touch()
    cases = [
        (tmp_path / "taken" / "file.parquet", "cannot be written"),
        (tmp_path / "new", "is a folder"),
        (tmp_path / "a.parquet", tmp_path / "new" / ".." / "a.parquet", "path of two results"),
    ]
    refused(parquet.check_writable, cases)
