"""Tables keep units, descriptions and gaps, and are written completely or not at all."""

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
def file(tmp_path):
    return tmp_path / "small.parquet"


def test_a_table_comes_back_bit_for_bit_with_units_descriptions_and_gaps(file):
    parquet.write(SMALL, FRAME, file)
    first = file.read_bytes()
    pd.testing.assert_frame_equal(parquet.read(SMALL, file), FRAME, check_exact=True)
    column = pq.read_table(file).column("direction")
    assert (
        column.null_count == 1 and column.to_pylist()[0] is None
    )  # undefined is null and never zero
    shown = parquet.describe(file).set_index("column")
    assert shown.loc["angle", "unit"] == "rad"
    assert shown.loc["direction", "description"] == "undefined where the centres coincide"
    parquet.write(SMALL, FRAME, file)
    assert file.read_bytes() == first


def test_units_survive_pandas_reading_and_writing_a_table(file):
    parquet.write(SMALL, FRAME, file)
    wanted = {column.name: column.unit for column in COLUMNS}
    for read in (parquet.read_table, pd.read_parquet):
        frame = read(file)
        assert frame.attrs["units"] == wanted
        again = file.with_name("again.parquet")
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


@pytest.mark.parametrize(
    "frame, message",
    [
        (FRAME.drop(columns="angle"), "missing columns"),
        (FRAME.assign(more=1), "unknown columns"),
        (FRAME.assign(angle=np.nan), "angle.*non-nullable"),
        (FRAME.assign(angle=[0.0, 1.0, np.inf]), "angle contains an infinite value"),
    ],
)
def test_a_frame_with_other_columns_is_refused_and_no_file_is_written(file, frame, message):
    with pytest.raises(ValueError, match=message):
        parquet.write(SMALL, frame, file)
    assert list(file.parent.iterdir()) == []


def test_a_failed_write_keeps_the_old_file_and_no_half_written_one(file):
    def stops(error):
        def half_way(temporary):
            Path(temporary).write_text("ne")
            raise error

        return half_way

    file.write_text("old")
    with pytest.raises(KeyboardInterrupt):
        parquet.write_atomically(file, stops(KeyboardInterrupt))
    with pytest.raises(
        InputError, match=r"small\.parquet: cannot be written \(No space left on device\)"
    ):
        parquet.write_atomically(file, stops(OSError(errno.ENOSPC, "No space left on device")))
    assert [path.read_text() for path in file.parent.iterdir()] == ["old"]
    with pytest.raises(InputError, match="cannot be written"):
        parquet.write(SMALL, FRAME, file / "small.parquet")  # below a file


def test_a_missing_or_damaged_file_is_reported(file):
    parquet.write(SMALL, FRAME, file)
    content = file.read_bytes()
    file.unlink()
    for reader in (parquet.describe, lambda path: parquet.read(SMALL, path)):
        with pytest.raises(InputError, match="no such file"):
            reader(file)
    damaged = [b"", b"not parquet", content[:-1], content[: len(content) // 2]]
    for text in (*damaged, content[:100] + bytes(50) + content[150:], bytes(len(content))):
        file.write_bytes(text)
        with pytest.raises(InputError, match="cannot be read as Parquet"):
            parquet.read(SMALL, file)
    with pytest.raises(InputError, match="cannot be read as Parquet"):
        parquet.describe(file)


def test_a_file_of_another_table_or_version_is_refused(file):
    pq.write_table(pa.table({"angle": [1.0]}), file)
    with pytest.raises(InputError, match="not 'small'"):
        parquet.read(SMALL, file)
    columns = (*COLUMNS[1:], Column("old", "1", "a removed column"))
    parquet.write(Table("small", "", columns), FRAME.drop(columns="angle").assign(old=1.0), file)
    with pytest.raises(
        InputError, match=r"other columns .*\(angle \(double\), old \(double\)\); run"
    ):
        parquet.read(SMALL, file)
    arrow = parquet.to_arrow(SMALL, FRAME)
    text = arrow.set_column(0, pa.field("angle", pa.string()), pa.array(["0.1", "x", "0.3"]))
    text = text.replace_schema_metadata(arrow.schema.metadata)
    with parquet.writer(file, text.schema) as writer:
        writer.write_table(text)
    with pytest.raises(InputError, match=r"angle \(double\), angle \(string\)"):
        parquet.read(SMALL, file)


def test_the_check_of_a_path_leaves_no_file_and_no_folder(tmp_path):
    parquet.check_writable(tmp_path / "new/deep/file.parquet")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "paths, message",
    [
        (["taken/file.parquet"], "cannot be written"),
        (["new"], "is a folder"),
        (["a.parquet", "new/../a.parquet"], "path of two results"),
    ],
)
def test_a_path_that_cannot_be_written_is_found_out_in_advance(tmp_path, paths, message):
    (tmp_path / "new").mkdir()
    (tmp_path / "taken").touch()
    with pytest.raises(InputError, match=message):
        parquet.check_writable(*(tmp_path / path for path in paths))
