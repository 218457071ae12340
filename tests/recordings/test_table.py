"""Files of samples are read as they are written, or refused with file, column, row and what to do."""

import numpy as np
import pandas as pd
import pytest

from jointgap.core.csv_files import Csv, read_columns
from jointgap.core.errors import InputError

WANTED = ("t", "x")
T, X = [0.0, 0.5, 1.0], [1.25, np.nan, -3e-3]


def read(folder, content, name="run.csv", wanted=WANTED, **form):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    return read_columns(path, wanted, Csv(**form))


@pytest.mark.parametrize(
    "content",
    [
        "t,x\n0,1.25\n0.5,\n1,-3e-3\n",
        "t;x\n0;1,25\n0,5;\n1;-3e-3\n",
        "t\tx\n0\t1.25\n0.5\tNaN\n1\t-0.003\n",
        "t\tx\r\n0\t1,25\r\n0,5\t\r\n1\t-0,003\r\n",
        "t|x\r0|1.25\r0.5|nan\r1|-3E-3",
        "t   x\n0   1.25\n0.5 nan\n  1 -3e-3\n",
        "\ufefft,x\n0,1.25\n0.5,\n1,-3e-3\n",
        "# rig A\n\nt,x\n# a break\n0,1.25\n\n0.5,\n1,-3e-3\n",
        "x,comment,t\n1.25,good,0\n,none,0.5\n-3e-3,'',1\n",
        '"t","x"\n"0","1.25"\n"0.5",""\n"1","-3e-3"\n',
        '"t"; "x"\n0; "1,25"\n0,5; \n1; -3e-3\n',
        "t,x,\n0,1.25,\n0.5,,\n1,-3e-3,\n",
        "t,x\n0,1.25,\n0.5,,\n1,-3e-3\n",
        "t,x\ns,mm\n0,1.25\n0.5,\n1,-3e-3\n",
        "t,x\n[s],[mm]\n0,1.25\n0.5,\n1,-3e-3\n",
        "t;x\n0;1,25\n0,5;\n1;-3e-3\n".encode("utf-16"),
        'Model,AB12\nLength 5" pipe\nRecord Length,3\n\nt,x\n0,1.25\n0.5,\n1,-3e-3\n',
        "Rig A\nt;comment;x\n0;good;1,25\n0,5;none;\n1;;-3e-3\n",
        "t,x,\n0,1.25\n0.5,\n1,-3e-3\n",
    ],
)
def test_tables_are_read_whatever_separator_and_decimal_mark_they_have(tmp_path, content):
    found = read(tmp_path, content)
    np.testing.assert_array_equal(found.values["t"], T)
    np.testing.assert_array_equal(found.values["x"], X)


def test_rows_are_lines_of_the_file(tmp_path):
    assert read(tmp_path, "# rig\nt,x\n\n0,1\n# break\n1,2\n").rows.tolist() == [4, 6]


def test_a_row_of_units_is_told(tmp_path):
    assert read(tmp_path, "t,x\n[s],(mm)\n0,1\n").units == {"t": "s", "x": "mm"}
    assert read(tmp_path, "t,x\n0,1\n").units == {}
    assert read(tmp_path, "t,x\n,\n0,1\n").units == {}  # a gap, not units


def test_lines_above_the_headings_are_told(tmp_path):
    found = read(tmp_path, "Model,AB12\nFirmware,1.12\n\nt,x\n0,1\n1,2\n")
    assert found.rows.tolist() == [5, 6]
    assert found.remarks == (f"{tmp_path}/run.csv: the headings are in row 4; 2 lines above them skipped",)


def test_headings_are_where_they_are_said_to_be(tmp_path):
    old_and_new = "t,x\nold,headings\nt,x\n0,1\n1,2\n"
    found = read(tmp_path, old_and_new, skip_rows=2)
    assert found.rows.tolist() == [4, 5]
    assert found.remarks == ()
    with pytest.raises(InputError, match=r"row 2: has no column 't' .*give csv\.skip_rows"):
        read(tmp_path, old_and_new, skip_rows=1)
    with pytest.raises(InputError, match=r"no rows below the 9 of csv\.skip_rows"):
        read(tmp_path, old_and_new, skip_rows=9)


@pytest.mark.parametrize(
    "stamps",
    [
        ["2026-03-01T12:00:00.000", "2026-03-01T12:00:00.500", "2026-03-01T12:00:01.000"],
        ["2026-03-01 23:59:59,5", "2026-03-02 00:00:00", "2026-03-02 00:00:00,5"],
        ["2026-03-01T12:00:00+01:00", "2026-03-01T11:00:00.5Z", "2026-03-01T12:00:01+01:00"],
    ],
)
def test_dates_are_seconds_since_the_first(tmp_path, stamps):
    content = "t;x\n" + "".join(f"{stamp};{x}\n" for stamp, x in zip(stamps, (1, 2, 3), strict=True))
    path = tmp_path / "run.csv"
    path.write_text(content, encoding="utf-8")
    found = read_columns(path, WANTED, Csv(), clock="t")
    assert found.is_dated
    np.testing.assert_allclose(found.values["t"], T, atol=1e-12)
    assert "dates are read as seconds since 2026-03-01" in found.remarks[0]
    with pytest.raises(InputError, match=r"column t, row 2: '2026.* is not a number"):
        read_columns(path, WANTED, Csv())  # of a channel that is no time


def test_dates_in_parquet_are_seconds_since_the_first(tmp_path):
    stamps = pd.to_datetime(["2026-03-01T12:00:00", None, "2026-03-01T12:00:01"])
    pd.DataFrame({"t": stamps, "x": [1.0, 2.0, 3.0]}).to_parquet(tmp_path / "run.parquet")
    found = read_columns(tmp_path / "run.parquet", WANTED, Csv(), clock="t")
    np.testing.assert_array_equal(found.values["t"], [0.0, np.nan, 1.0])


@pytest.mark.parametrize(
    ("second", "words"),
    [("yesterday", "column t, row 3: 'yesterday' is not a date"), ("2026-13-01", "row 3: '2026-13-01' is not a date")],
)
def test_a_time_that_is_no_date_among_dates_is_refused(tmp_path, second, words):
    path = tmp_path / "run.csv"
    path.write_text(f"t,x\n2026-03-01T12:00:00,1\n{second},2\n", encoding="utf-8")
    with pytest.raises(InputError, match=words):
        read_columns(path, WANTED, Csv(), clock="t")


def test_given_marks_are_taken_instead_of_detected_ones(tmp_path):
    found = read(tmp_path, "t,x:x\n0:1\n1:2,5\n", wanted=("x",), separator=":", decimal=",")
    np.testing.assert_array_equal(found.values["x"], [1.0, 2.5])


@pytest.mark.parametrize("kind", [float, np.float32, "int16", "Float64"])
def test_parquet_is_read_by_its_content_whatever_its_name(tmp_path, kind):
    frame = pd.DataFrame({"t": [0, 1, 2], "x": [3, 4, 5]}).astype({"x": kind})
    frame.to_parquet(tmp_path / "run.dat")
    found = read_columns(tmp_path / "run.dat", WANTED, Csv())
    np.testing.assert_array_equal(found.values["x"], [3.0, 4.0, 5.0])
    assert found.rows.tolist() == [1, 2, 3]


def test_a_gap_in_parquet_is_a_gap(tmp_path):
    pd.DataFrame({"t": [0.0, 1.0], "x": pd.array([3, None], dtype="Int64")}).to_parquet(tmp_path / "run.parquet")
    np.testing.assert_array_equal(read_columns(tmp_path / "run.parquet", WANTED, Csv()).values["x"], [3.0, np.nan])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", ["is empty"]),
        ("# nothing\n\n", ["is empty"]),
        ("t,x\n", ["holds headings but no samples"]),
        ("t,x\ns,mm\n", ["holds headings but no samples"]),
        ("time,x\n0,1\n", ["row 1", "no column 't'", "known here: time, x"]),
        ("t,xx\n0,1\n", ["no column 'x'", "did you mean 'xx'"]),
        ("0,1\n1,2\n", ["no column 't'"]),
        ("# t,x\n0,1\n1,2\n", ["no column 't'", "row 1 has them in a comment: remove the '#'"]),
        ("t,x,x\n0,1,2\n", ["has the column 'x' twice"]),
        ("t,x\n0,1\n0.5,broken\n", ["column x, row 3", "'broken' is not a number", "leave the cell empty"]),
        ("t,x\n0,1\n0.5,1_000\n", ["column x, row 3", "'1_000' is not a number"]),
        ("t,x\n0,1\n0.5,inf\n", ["column x, row 3", "infinite"]),
        ("t,x\n0,1\n0.5,1e999\n", ["column x, row 3", "infinite"]),
        ("t;x\n0;1\n0,5;1.234,5\n", ["column x, row 3", "'1.234,5' is not a number"]),
        (
            "t;x\n0;1,5\n0,5;1.5\n",
            ["column x, row 3: '1.5' is not a number", "a decimal comma", "throughout"],
        ),
        ("t,x\n0,1\n0.5\n", ["row 3: has 1 cells, but there are 2 headings"]),
        ("t,x,y\n0,1\n1,2\n", ["row 2: has 2 cells", "all rows have as many; remove the heading too many"]),
        ("t,x\n0,0,1,5\n0,5,1,5\n", ["row 2: has 4 cells", "decimals have a comma too", "such as ';'"]),
        ("t,x\n12:00:01,1\n", ["column t, row 2: '12:00:01' is not a number", "as ISO dates such as 2026-"]),
        ('t,x\n0,"1\n1,"2\n', ["row 2", "quotation mark"]),
        ('a,t,x\n0,"b"c,1\n1,"2,""3\n1,"2,3\n', ["quotation mark"]),
        ("t,x\n0,1\n0,5,1,5\n", ["row 3: has 4 cells", "csv.separator and csv.decimal"]),
        ('t,x\n0,1\n0.5,"1\n1,2\n', ["row 3: a quotation mark is not closed"]),
        ("t,x\n0,1\n" + 200000 * "1" + ",1\n", ["column t, row 3", "infinite"]),
        ("t,x\n0,1\n" + 2000 * "1" + ",1\n", ["column t, row 3", "infinite"]),
        ("t,x\nseconds,millimetres of travel\n0,1\n", ["column t, row 2", "'seconds' is not a number"]),
        (b"t,x\n0,1\n\xff,1\n", ["row 3", "is not text in UTF-8", "save it as UTF-8"]),
        (b"t,x\n0,1\n\x00,1\n", ["row 3", "is not text in UTF-8"]),
        (b"PK\x03\x04....", ["a spreadsheet or an archive", "save the samples as CSV or Parquet"]),
        (b"PAR1....", ["cannot be read as Parquet"]),
    ],
)
def test_a_file_that_is_no_table_of_numbers_is_refused_with_the_place_and_the_mend(tmp_path, content, words):
    with pytest.raises(InputError) as caught:
        read(tmp_path, content)
    assert str(caught.value).startswith(str(tmp_path / "run.csv"))
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (pd.DataFrame({"t": [0.0], "x": ["a"]}), ["column x", "string, not numbers"]),
        (pd.DataFrame({"t": [0.0], "x": [True]}), ["column x", "bool, not numbers"]),
        (pd.DataFrame({"t": [0.0, 1.0], "x": [1.0, np.inf]}), ["column x, row 2", "infinite"]),
        (pd.DataFrame({"t": [0.0], "y": [1.0]}), ["no column 'x'", "known here: t, y"]),
        (pd.DataFrame({"t": [], "x": []}, dtype=float), ["no samples"]),
    ],
)
def test_parquet_of_anything_but_numbers_is_refused(tmp_path, frame, words):
    frame.to_parquet(tmp_path / "run.parquet")
    with pytest.raises(InputError) as caught:
        read_columns(tmp_path / "run.parquet", WANTED, Csv())
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("name", ["nowhere.csv", "."])
def test_a_file_that_is_not_there_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="cannot be read"):
        read_columns(tmp_path / name, WANTED, Csv())
